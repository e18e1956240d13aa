"""The leg estimator sample by sample, for a device that shows joint angles while the person walks.

The filter steps and results are those of `leg_ekf.run` without smoothing; sensor axes, signs and gyroscope biases come
from a calibration recording, see `leg_ekf.prepare`.
"""

from typing import NamedTuple

import jax

from jgait import filtering
from jgait.estimators.leg_ekf import inclination
from jgait.estimators.leg_ekf import model as leg_model
from jgait.estimators.leg_ekf.estimator import deviation_of, model_params, observe, prior_of, trajectory_of
from jgait.estimators.leg_ekf.inputs import LegInputs, LegSignals, Segment
from jgait.estimators.leg_ekf.params import LegOptions, LegParams
from jgait.estimators.sides import stacked
from jgait.filtering import Belief
from jgait.types import Counts, Flags, LegTrajectory, Values


class LegOnlineState(NamedTuple):
    """State of the online estimator between two samples."""

    segments: Belief  #: beliefs about the inclinations of thigh and shank, leaves (2, …).
    leg: Belief  #: belief about the leg.
    rates: Values  #: the last rates of thigh and shank [rad/s], for the mean over the interval; leaves (2,).


class LegNow(NamedTuple):
    """The leg at n samples, its standard deviations, and (n,) False where an update failed numerically."""

    leg: LegTrajectory
    stddev: LegTrajectory
    valid: Flags


def start(p: LegParams, leg: LegSignals, start_variance: Values, options: LegOptions) -> LegOnlineState:
    """The state before the first sample: beliefs in the standing pose, with a variance [rad²]; arguments as of `over`.

    Of the leg's signals only biases, variances and the first rates are used.
    """
    both = stacked(leg.thigh, leg.shank)
    segments = jax.vmap(lambda bias, unrest: inclination.prior(bias, start_variance, unrest).joined())
    belief = prior_of(p, leg, start_variance, options).joined()
    return LegOnlineState(segments(both.bias, both.unrest), belief, both.gyr[:, 0])


def over(
    p: LegParams, state: LegOnlineState, leg: LegSignals, inputs: LegInputs, options: LegOptions,
    count: Counts | None = None,
) -> tuple[LegOnlineState, LegNow]:  # fmt: skip
    """The samples (n,) of one leg that follow; not compiled, for use in a compiled program.

    Args:
        p: parameters of this leg, see `one_side`.
        state: from `start` or the samples before.
        leg: signals (n, 3) [rad/s], [m/s²] in segment axes, measured, lost; bias and variance from the calibration.
        inputs: dt [s], still and valid of the samples; its legs are not used.
        options: as of `leg_ekf`.
        count: number of samples; later ones must not be measured, with a dt of 0. None: n.

    Returns:
        The state after the last sample, and the leg at every sample.
    """
    newest = leg.thigh.gyr.shape[0] - 1 if count is None else count - 1
    both, segments, inclinations = stacked(leg.thigh, leg.shank), state.segments, None

    def incline(belief: Belief, before: Values, segment: Segment) -> tuple[Belief, inclination.Inclination]:
        observed, controls, mask = inclination.observed(segment, before, inputs, options.standing)
        posterior = filtering.kalman_filter(
            inclination.MODEL, p.inclination, observed, controls=controls, dt=inputs.dt, mask=mask, initial=belief,
            keep=("mean", "cov"),
        )  # fmt: skip
        return posterior.belief(newest), inclination.read_out(posterior.mean, posterior.cov, observed.gyr)

    if options.gravity:
        segments, angles = jax.vmap(incline)(state.segments, state.rates, both)
        inclinations = tuple(jax.tree.map(lambda v, k=k: v[k], angles) for k in range(2))
    observations, controls, mask = observe(p, leg, inclinations, inputs, options)
    posterior = filtering.kalman_filter(
        leg_model.MODEL, model_params(p, leg), observations, controls=controls, dt=inputs.dt, mask=mask,
        method=options.method, initial=state.leg, keep=("mean", "cov", "valid"),
    )  # fmt: skip
    now = LegNow(trajectory_of(posterior.mean), deviation_of(p, posterior.mean, posterior.cov), posterior.valid)
    return LegOnlineState(segments, posterior.belief(newest), both.gyr[:, newest]), now
