"""Noise models: how the variance of a measurement follows the signals, learned from walks.

A model is a record of parameters with one method, log_scale(features) → (T,), the logarithm of the factor on a
variance. With the parameters of `MODELS` every factor is 1, so that a tuning starts at the constant; their priors keep
them near 0 where walks are few. The type of the parameters selects the model, so an estimator needs no option.

The features are logarithms of magnitudes, so that a linear function of them is a product of powers. Windows end at the
sample that they describe, but `jolt`, `jerk` and `since_contact` use up to 8 ms after it, and `stance` is that of a
detector which sees the whole recording. Only magnitudes are used, so the sensor may be mounted in any orientation.

| feature | logarithm of | over |
|---|---|---|
| `rate`, `rate_long` | root mean square of the angular rate | 25 ms, 0.1 s |
| `shake`, `shake_long` | spread of the specific force | 25 ms, 0.1 s |
| `weight`, `weight_long` | difference of the mean force's length from gravity | 25 ms, 0.1 s |
| `speed` | root mean square of the angular rate | 1.5 s, about a stride |
| `jolt`, `jerk` | change of the specific force and of the rate from sample to sample | 15 ms |
| `stance` | no logarithm: ½ in a stance of the detector, −½ elsewhere | |
| `since_contact` | no logarithm: exp(−t / 0.1 s), t the time since the last jolt of a contact | |
| `clipped` | no logarithm: 1 where a sample was lost or clipped | |
"""

from typing import Annotated, NamedTuple

import jax.numpy as jnp
import numpy as np

from jgait.geometry.vectors import GRAVITY
from jgait.notes import record
from jgait.params import Param, Parameter, documented, normal, real
from jgait.types import AnyArray, Values

FEATURES = (
    "rate", "shake", "weight", "rate_long", "shake_long", "weight_long", "speed", "jolt", "jerk", "stance",
    "since_contact", "clipped",
)  # fmt: skip
"""Names of the features, in the order of the columns."""


def features(
    gyr: np.ndarray, acc: np.ndarray | None, jumps: tuple[AnyArray, AnyArray], stands: AnyArray, doubtful: AnyArray,
    sampling_rate_hz: float,
) -> np.ndarray:  # fmt: skip
    """The features (T, F) of a sensor, in the order of `FEATURES`; raises ValueError without an accelerometer.

    `gyr` (T, 3) is without bias [rad/s], `acc` (T, 3) [m/s²]; `jumps` are the changes (T,) of rate and force from
    sample to sample, `stands` (T,) the stances of the detector, `doubtful` (T,) lost or clipped samples.
    """
    if acc is None:
        raise ValueError("a noise model with features needs an accelerometer; the sensor has a gyroscope alone")
    turning, centred = (gyr**2).sum(axis=1), acc - acc.mean(axis=0)

    def of_window(seconds: float) -> list[np.ndarray]:
        size = max(2, round(seconds * sampling_rate_hz))
        mean = _trailing(centred, size)
        spread = np.maximum(_trailing(centred**2, size) - mean**2, 0.0).sum(axis=1)
        off = np.linalg.norm(mean + acc.mean(axis=0), axis=1) - GRAVITY
        # [rad/s], [m/s²] magnitudes in stance, whose logarithm is 0
        return [_half_log(_trailing(turning, size), 0.4), _half_log(spread, 0.5), _half_log(off**2, 0.5)]

    jolts = np.asarray(jumps[1])
    at = np.arange(len(gyr))
    last = np.maximum.accumulate(np.where(jolts > 20.0, at, -(10**9)))  # [m/s²] a contact
    columns = [
        *of_window(0.025), *of_window(0.105),
        _half_log(_trailing(turning, max(2, round(1.5 * sampling_rate_hz))), 1.0),
        np.log(jolts + 0.05), np.log((np.asarray(jumps[0]) + 0.01) / 0.1), np.where(stands, 0.5, -0.5),
        np.exp(-(at - last) / (0.1 * sampling_rate_hz)), np.asarray(doubtful, np.float64),
    ]  # fmt: skip
    return np.stack(columns, axis=1)


def _half_log(square: np.ndarray, typical: float) -> np.ndarray:
    """The logarithm of a magnitude; 0.1 is added in quadrature, so that sensors at rest have no infinite logarithm."""
    return 0.5 * np.log((square + 0.1**2) / typical**2)


def _trailing(values: np.ndarray, size: int) -> np.ndarray:
    """Mean over the `size` samples up to each sample; before the start the first sample is repeated."""
    total = np.cumsum(np.concatenate([np.repeat(values[:1], size, axis=0), values]), axis=0)
    return (total[size:] - total[:-size]) / size


POWER = normal(0.0, 4.0)
"""Prior of every weight of `LogLinear`: a power of 4 is that of a detector with a nearly hard threshold."""

WEIGHT = normal(0.0, 1.0)
"""Prior of every weight of `Network`; chosen by hand."""


class Constant(NamedTuple):
    """No parameters: every factor is 1."""

    def log_scale(self, columns: Values) -> Values:
        """Zeros (T,) for features (T, F)."""
        return jnp.zeros_like(columns[:, 0])


@documented
@record
class LogLinear(NamedTuple):
    """Weights of the features, so that a variance is a product of powers; 0 leaves a feature out."""

    rate: Annotated[Param, Parameter(real, "1", "power of `rate`", POWER)] = 0.0
    shake: Annotated[Param, Parameter(real, "1", "power of `shake`", POWER)] = 0.0
    weight: Annotated[Param, Parameter(real, "1", "power of `weight`", POWER)] = 0.0
    rate_long: Annotated[Param, Parameter(real, "1", "power of `rate_long`", POWER)] = 0.0
    shake_long: Annotated[Param, Parameter(real, "1", "power of `shake_long`", POWER)] = 0.0
    weight_long: Annotated[Param, Parameter(real, "1", "power of `weight_long`", POWER)] = 0.0
    speed: Annotated[Param, Parameter(real, "1", "power of `speed`", POWER)] = 0.0
    jolt: Annotated[Param, Parameter(real, "1", "power of `jolt`", POWER)] = 0.0
    jerk: Annotated[Param, Parameter(real, "1", "power of `jerk`", POWER)] = 0.0
    stance: Annotated[Param, Parameter(real, "1", "power of `stance`", POWER)] = 0.0
    since_contact: Annotated[Param, Parameter(real, "1", "power of `since_contact`", POWER)] = 0.0
    clipped: Annotated[Param, Parameter(real, "1", "power of `clipped`", POWER)] = 0.0

    def log_scale(self, columns: Values) -> Values:
        """Σ_f w_f φ_f (T,) for features (T, F)."""
        return columns @ jnp.stack([jnp.asarray(getattr(self, name), columns.dtype) for name in FEATURES])


@documented
@record
class Network(NamedTuple):
    """Weights of one hidden layer of 8 units, 208 in all.

    Each unit takes the features of now and of 8 samples, 40 ms at 200 Hz, before. At the start the output is 0; the
    first layer is drawn, with a fixed seed.
    """

    first: Annotated[Param, Parameter(real, "1", "weights (inputs, units) of the first layer", WEIGHT)] = (
        np.random.default_rng(0).normal(size=(2 * len(FEATURES), 8)) / len(FEATURES)
    )
    shift: Annotated[Param, Parameter(real, "1", "(units,) added to the first layer", WEIGHT)] = np.zeros(8)
    last: Annotated[Param, Parameter(real, "1", "weights (units,) of the output", WEIGHT)] = np.zeros(8)

    def log_scale(self, columns: Values) -> Values:
        """wᵀ tanh(W [φ_k, φ_{k−8}] + c) (T,) for features (T, F); before the first sample the first is repeated."""
        before = jnp.concatenate([jnp.repeat(columns[:1], 8, axis=0), columns])[: len(columns)]
        first, shift, last = (jnp.asarray(leaf, columns.dtype) for leaf in self)
        return jnp.tanh(jnp.concatenate([columns, before], axis=1) @ first + shift[None, :]) @ last


type NoiseModel = Constant | LogLinear | Network

MODELS: dict[str, NoiseModel] = {"constant": Constant(), "log_linear": LogLinear(), "network": Network()}
"""Name → parameters with which every factor is 1."""


def model_of(name: str) -> NoiseModel:
    """The noise model of this name, with its start values. Raises ValueError for an unknown name."""
    if name not in MODELS:
        raise ValueError(f"the noise model must be one of {', '.join(MODELS)}; got {name!r}")
    return MODELS[name]
