"""The leg estimator sample by sample, for a device that shows joint angles while the person walks.

The filter steps and results are those of `leg_ekf.run` without smoothing; sensor axes, signs and gyroscope biases come
from a calibration recording, see `leg_ekf.prepare`.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp

from jgait import filtering
from jgait.estimators.leg_ekf import inclination
from jgait.estimators.leg_ekf import model as leg_model
from jgait.estimators.leg_ekf.estimator import deviation_of, model_params, observe, prior_of, trajectory_of
from jgait.estimators.leg_ekf.inputs import LegInputs, LegSignals, Segment
from jgait.estimators.leg_ekf.params import LegOptions, LegParams
from jgait.filtering import Belief
from jgait.geometry.vectors import Vector, vector
from jgait.types import LegTrajectory, Values


class LegOnlineState(NamedTuple):
    """State of the online estimator between two samples.

    Attributes:
        thigh: belief about the thigh's inclination.
        shank: belief about the shank's inclination.
        leg: belief about the leg.
        rates: the last rates of thigh and shank [rad/s], for the mean over the interval.
    """

    thigh: Belief
    shank: Belief
    leg: Belief
    rates: tuple[Vector, Vector]


class OnlineStep(NamedTuple):
    """The state for the next step, the leg at this sample, and its standard deviations."""

    state: LegOnlineState
    leg: LegTrajectory
    stddev: LegTrajectory


def start(p: LegParams, leg: LegSignals, start_variance: Values, options: LegOptions) -> LegOnlineState:
    """The state before the first sample: beliefs in the standing pose, with a variance [rad²].

    Args:
        p: parameters of this leg, see `one_side`.
        leg: calibrated signals; only biases, variances and the first rates are used.
        start_variance: variance of the pose at the first sample [rad²].
        options: as of `leg_ekf`; `smooth` has no effect.
    """
    beliefs = [inclination.prior(vector(segment.bias), start_variance) for segment in leg]
    rates = tuple(vector(segment.gyr[0]) for segment in leg)
    return LegOnlineState(beliefs[0], beliefs[1], prior_of(p, leg, start_variance, options), (rates[0], rates[1]))


def _incline(
    p: LegParams, belief: Belief, before: Vector, segment: Segment, inputs: LegInputs, options: LegOptions
) -> tuple[Belief, inclination.Inclination]:
    rate = vector(segment.gyr)
    measured = segment.measured
    still = inputs.still if options.standing else jnp.zeros_like(inputs.still)
    mean = Vector(*(0.5 * (a + b) for a, b in zip(rate, before, strict=True)))
    observation, mask = inclination.observe(rate, vector(segment.acc), still if options.standing else None, measured)
    result = filtering.step(
        inclination.MODEL, p.inclination, belief, observation,
        control=inclination.InclinationControl(mean, still, measured, segment.lost), dt=inputs.dt, mask=mask,
    )  # fmt: skip
    return result.belief, inclination.read_out(result.belief.mean, result.belief.cov, rate)


@partial(jax.jit, static_argnames=("options",))
def step(p: LegParams, state: LegOnlineState, sample: LegSignals, inputs: LegInputs, options: LegOptions) -> OnlineStep:
    """One sample of one leg: the state for the next step, the leg at this sample, and its standard deviations.

    Args:
        p: parameters of this leg, see `one_side`.
        state: from `start` or the previous step.
        sample: gyr (3,) [rad/s] and acc (3,) [m/s²] in segment axes, measured; bias and variance from the calibration.
        inputs: dt [s], still and valid of this sample; its legs are not used.
        options: as of `leg_ekf`.
    """
    thigh, shank, inclinations = state.thigh, state.shank, None
    if options.gravity:
        thigh, upper = _incline(p, state.thigh, state.rates[0], sample.thigh, inputs, options)
        shank, lower = _incline(p, state.shank, state.rates[1], sample.shank, inputs, options)
        inclinations = (upper, lower)
    observation, control, mask = observe(p, sample, inclinations, inputs, options)
    result = filtering.step(
        leg_model.MODEL, model_params(p, sample), state.leg, observation,
        control=control, dt=inputs.dt, mask=mask, method=options.method,
    )  # fmt: skip
    belief = result.belief
    rates = (vector(sample.thigh.gyr), vector(sample.shank.gyr))
    return OnlineStep(
        LegOnlineState(thigh, shank, belief, rates),
        trajectory_of(belief.mean),
        deviation_of(p, belief.mean, belief.cov),
    )
