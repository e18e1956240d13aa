"""What the tuning experiment tunes: legs drawn from the leg model itself, and walks of the leg protocol.

Only of data drawn from the model are the process noises known: people do not walk in white accelerations.
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jgait import filtering, params, protocols, simulate
from jgait.estimators import leg_ekf, leg_model
from jgait.estimators.leg_ekf import PAPER, BySide, LegParams
from jgait.estimators.leg_inputs import LegInputs, pad
from jgait.estimators.leg_model import LegModelParams, LegRates
from jgait.types import Estimate

RATE_HZ = 100.0
SECONDS = 10.0
MODEL = leg_model.only_rates(leg_model.MODEL)


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

    rates: LegRates
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
        p = leg_params(TRUE, Drawn(LegRates(None, None), thigh, shank))
        return filtering.draw(one_key, MODEL, p, samples, dt=1.0 / RATE_HZ)[1]

    keys = jax.random.split(how, people)
    rates = jax.jit(jax.vmap(one))(keys, body.thigh_length, body.shank_length)
    return Drawn(rates, body.thigh_length, body.shank_length)


def filtered(p: Noise, item: Drawn, *keep: str) -> Any:
    return filtering.kalman_filter(MODEL, leg_params(p, item), item.rates, dt=1.0 / RATE_HZ, keep=keep)


def nats(p: Noise, item: Drawn) -> Any:
    """Minus the log-likelihood of a whole recording [nat]."""
    return -jnp.sum(filtered(p, item, "log_likelihood").log_likelihood)


class Lesson(NamedTuple):
    """A walk of the leg protocol: inputs of the leg estimator, and the truth at the same times."""

    inputs: LegInputs
    truth: Estimate
    thigh_length: Any
    shank_length: Any


GYROSCOPES = PAPER._replace(rate_hz=None, median=1, distance="forward", execution="fast")
"""The paper's filter at the rate of the recording: gyroscopes alone."""


def walks(key: Any, people: int, rate: float, samples: int, sides: tuple[str, ...], dtype: Any) -> Lesson:
    """Walks of the leg protocol, padded or cut to one length; leaves (people, …)."""
    worn = [f"{segment}_{side}" for segment in ("thigh", "shank") for side in sides]
    found = []
    for walked in protocols.bennett(key, people, rate=rate, placements=worn):
        inputs = leg_ekf.prepared(walked.recording, GYROSCOPES).inputs
        truth = walked.truth.estimate
        body = truth.diagnostics
        have = inputs.time.size
        inputs = pad(inputs, max(have, samples))
        legs = truth.legs._replace(**{side: None for side in ("right", "left") if side not in sides})
        bare = Estimate(truth.time, legs, None, truth.distance, np.asarray(truth.valid), {})
        bare = jax.tree.map(partial(_longer, more=max(0, samples - have)), bare)
        one = Lesson(inputs, bare, body["thigh_length"], body["shank_length"])
        found.append(jax.tree.map(partial(_cut, have=max(have, samples), samples=samples, dtype=dtype), one))
    return jax.tree.map(lambda *v: np.stack(v), *found)


def _longer(values: Any, more: int) -> np.ndarray:
    return np.pad(values, (0, more))


def _cut(values: Any, *, have: int, samples: int, dtype: Any) -> np.ndarray:
    values = np.asarray(values)
    values = values[:samples] if values.ndim and values.shape[0] == have else values
    return values.astype(dtype) if values.dtype.kind == "f" else values


def with_lengths(p: LegParams, thigh: Any, shank: Any) -> LegParams:
    return p._replace(thigh_length=BySide(thigh, thigh), shank_length=BySide(shank, shank))
