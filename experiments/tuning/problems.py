"""What the tuning experiment tunes: legs drawn from the leg model itself, and walks of the leg protocol.

The process noises are known only for data drawn from the model.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from experiments.common import protocols
from experiments.common.sets import datasets
from jgait import filtering, params, simulate, tune
from jgait.estimators import leg_ekf
from jgait.estimators.leg_ekf import PAPER
from jgait.estimators.leg_ekf import model as leg_model
from jgait.estimators.leg_ekf.model import LegModelParams, LegState
from jgait.tune import Lesson, Lessons, losses
from jgait.types import Estimate, Walk

RATE_HZ = 100.0
SECONDS = 10.0


class Rates(NamedTuple):
    """Rates of both gyroscopes [rad/s]."""

    thigh_gyro: Any
    shin_gyro: Any


def _observation(p: LegModelParams, state: LegState, control: Any) -> Rates:
    whole = leg_model.observation(p, state, control)
    return Rates(whole.thigh_gyro, whole.shin_gyro)


def _observation_noise(p: LegModelParams, state: LegState, control: Any) -> Rates:
    return Rates(p.gyro_variance_thigh, p.gyro_variance_shin)


MODEL = leg_model.MODEL._replace(observation=_observation, observation_noise=_observation_noise)
"""The leg model with the gyroscopes as its only observations."""


class Noise(NamedTuple):
    """Noise of the leg model.

    Attributes:
        angle_noise: σ_θ, spectral density of the angular acceleration [rad²/s³].
        gyro_variance: R of both gyroscopes [rad²/s²].
        position_noise: σ_xy, variance added to the ankle's position each sample [m²].
        bias_noise: σ_β, variance added to the gyroscope biases each sample [rad²/s²].
    """

    angle_noise: Any
    gyro_variance: Any
    position_noise: Any
    bias_noise: Any


TRUE = Noise(1.0, 2.5e-3, 1e-6, 1e-10)
START = Noise(10.0, 1e-4, 1e-5, 1e-9)
FREE = Noise(*(params.positive,) * 4)


class Drawn(NamedTuple):
    """A leg drawn from the model: what its gyroscopes read (T,) [rad/s], and its lengths [m]."""

    rates: Rates
    thigh_length: Any
    shank_length: Any


def leg_params(p: Noise, item: Drawn) -> LegModelParams:
    return LegModelParams(
        item.thigh_length, item.shank_length, p.position_noise, p.angle_noise, p.bias_noise, p.gyro_variance,
        p.gyro_variance, 1e-6,
    )  # fmt: skip


def drawn(key: Any, people: int, seconds: float = SECONDS) -> Drawn:
    """Legs of people of the population, drawn from the model with the true noise; leaves (people, …)."""
    who, how = jax.random.split(key)
    body = simulate.population(who, people).body
    samples = round(seconds * RATE_HZ)

    def one(one_key: Any, thigh: Any, shank: Any) -> Any:
        p = leg_params(TRUE, Drawn(Rates(None, None), thigh, shank))
        return filtering.draw(one_key, MODEL, p, samples, dt=1.0 / RATE_HZ)[1]

    keys = jax.random.split(how, people)
    rates = jax.jit(jax.vmap(one))(keys, body.thigh_length, body.shank_length)
    return Drawn(rates, body.thigh_length, body.shank_length)


def filtered(p: Noise, item: Drawn, *keep: str) -> Any:
    return filtering.kalman_filter(MODEL, leg_params(p, item), item.rates, dt=1.0 / RATE_HZ, keep=keep)


def nats(p: Noise, item: Drawn) -> Any:
    """Minus the log-likelihood of a whole recording [nat]."""
    return -jnp.sum(filtered(p, item, "log_likelihood").log_likelihood)


GYROSCOPES = PAPER._replace(rate_hz=None, median=1, distance="forward")
"""The paper's filter at the rate of the recording: gyroscopes alone."""


def walks(key: Any, people: int, dtype: Any) -> Lessons:
    """Walks of the leg protocol, right leg, in the given precision."""
    worn = ("thigh_right", "shank_right")
    found = protocols.bennett(key, people, rate=RATE_HZ, placements=worn)
    made = tune.lessons(
        leg_ekf.estimator(GYROSCOPES), [Walk(one.recording, one.truth.estimate, {}) for one in found],
        body=datasets.body,
    )  # fmt: skip
    if made.failures:
        raise RuntimeError(f"simulated walks that cannot be used: {made.failures}")
    cast = jax.tree.map(lambda v: v.astype(dtype) if v.dtype.kind == "f" else v, made.data)
    return made._replace(data=cast)


def absolute(estimate: Estimate, lesson: Lesson) -> Any:
    """Squared error of angles [°²] and foot path [cm²], offsets included."""
    return losses.trajectory(estimate, lesson.reference, window=lesson.look)
