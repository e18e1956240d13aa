r"""Filling a gyroscope's gaps by ridge regression on the accelerometer's recent samples, learned as the walk goes.

With x_t the scaled samples of the accelerometer (and of a thigh's sensor) at some lags about t, and a 1, the weights
minimise Σ_s γ^{t−s} u_s (ω_s − w·x_s)² + γ^t λ ‖w‖², u = 1 where the gyroscope was on: recursive least squares,

    e = ω_t − w·x_t,   v = Q x_t,   k = v / (γ + x_t·v),   w ← w + k e,   Q ← (Q − k vᵀ) / γ,   Q_0 = I / λ,

in Joseph's form, where rounding in float32 cannot make Q indefinite. `latency_s` lets x_t have later samples: the
regression then also knows how the movement went on, and is late by as much.
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax.typing import ArrayLike

from jgait.duty_cycle.fillers.base import (
    Filled,
    Filler,
    Signals,
    Thigh,
    check_signals,
    finished,
    in_type,
    measured_enough,
    pace,
)
from jgait.duty_cycle.fillers.neighbours import NEIGHBOURS, Neighbours, neighbours
from jgait.duty_cycle.fillers.neighbours import TRANSFORMS as NEIGHBOURS_TRANSFORMS
from jgait.params import fixed, interval, positive

HISTORY_S, SPACING_S = 0.4, 0.04
"""[s] How far back samples are looked at, and how far apart."""


class Ridge(NamedTuple):
    """Parameters of `ridge`.

    Attributes:
        penalty: λ, of large weights [1].
        forget: γ, how much a measured sample counts after the next one [1].
        acc_scale: of the shank's accelerometer [m/s²].
        thigh_rate_scale: of the thigh's gyroscope [rad/s].
        thigh_acc_scale: of the thigh's accelerometer [m/s²].
        least_strides: that must have been measured before anything but holding is trusted [strides].
    """

    penalty: Any = 10.0
    forget: Any = 0.9995
    acc_scale: Any = 6.0
    thigh_rate_scale: Any = 1.0
    thigh_acc_scale: Any = 3.0
    least_strides: Any = 2.0


RIDGE = Ridge()
TRANSFORMS = Ridge(positive, interval(0.9, 1.0), positive, positive, positive, fixed)


class RidgeState(NamedTuple):
    """Weights (k,) [rad/s], and the inverse Q (k, k) of what was seen."""

    weights: Any
    inverse: Any


def begin(p: Ridge, size: int, dtype: Any) -> RidgeState:
    """The state before the first sample, of `size` features."""
    return RidgeState(jnp.zeros(size, dtype), jnp.eye(size, dtype=dtype) / p.penalty)


def step(p: Ridge, s: RidgeState, features: Array, rate: Array, usable: Array) -> tuple[RidgeState, Array]:
    """One sample: what the rate should be by the weights so far, and the state to carry on.

    Args:
        p: parameters.
        s: from `begin` or the step before.
        features: (k,) scaled samples [1].
        rate: sagittal rate [rad/s]; finite where it is off.
        usable: bool, whether it was measured.

    Returns:
        The state, and the predicted rate [rad/s].
    """
    told = s.weights @ features
    seen = s.inverse @ features
    gain = seen / (p.forget + features @ seen)
    across = gain[:, None] * seen[None, :]
    spread = (features @ seen + p.forget) * gain[:, None] * gain[None, :]
    inverse = (s.inverse - across - across.T + spread) / p.forget
    after = RidgeState(s.weights + gain * (rate - told), inverse)
    return jax.tree.map(lambda new, old: jnp.where(usable, new, old), after, s), told


def features(s: Signals, p: Ridge, sampling_rate_hz: float, latency: int) -> Array:
    """(T, k) scaled samples from `HISTORY_S` before each to `latency` samples after it, and a 1; edges repeat."""
    parts = [s.acc / p.acc_scale]
    if s.thigh is not None:
        parts += [s.thigh.rate[:, None] / p.thigh_rate_scale, s.thigh.acc / p.thigh_acc_scale]
    signals = jnp.concatenate(parts, axis=1)
    count = len(signals)
    apart = max(round(SPACING_S * sampling_rate_hz), 1)
    lags = np.arange(-(latency // apart) * apart, round(HISTORY_S * sampling_rate_hz) + 1, apart)
    rows = np.clip(np.arange(count)[:, None] - lags[None, :], 0, count - 1)
    return jnp.concatenate([signals[rows].reshape(count, -1), jnp.ones((count, 1), signals.dtype)], axis=1)


def ridge(
    rate: ArrayLike, usable: ArrayLike, acc: ArrayLike | None, sampling_rate_hz: float, params: Ridge = RIDGE, *,
    thigh: Thigh | None = None, latency_s: float = 0.0,
) -> Filled:  # fmt: skip
    """Ridge regression of the rate on the accelerometer, learned from what was measured so far.

    Args:
        rate: (T,) sagittal rate of the shank [rad/s]; anything where it is off.
        usable: (T,) bool, where the gyroscope was on and awake.
        acc: (T, 3) specific force of the shank [m/s²], never switched off.
        sampling_rate_hz: of the samples [Hz]; static.
        params: parameters.
        thigh: signals of the thigh, if worn.
        latency_s: how long later samples are waited for [s]; static.

    Returns:
        The filled rate.

    Raises:
        ValueError: as `check_signals`, without accelerometer, or for a latency that is negative or over a second.
    """
    s = check_signals(rate, usable, acc, sampling_rate_hz, thigh)
    if s.acc is None:
        raise ValueError("the regression is on the accelerometer; acc is None")
    if not 0.0 <= latency_s <= 1.0:
        raise ValueError(f"latency_s must lie between 0 and 1 s; got {latency_s}")
    return _filled(s, in_type(params, s), sampling_rate_hz, round(latency_s * sampling_rate_hz))


@partial(jax.jit, static_argnames=("sampling_rate_hz", "latency"))
def _filled(s: Signals, p: Ridge, sampling_rate_hz: float, latency: int) -> Filled:
    looked = features(s, p, sampling_rate_hz, latency)
    start = begin(p, looked.shape[1], s.rate.dtype)
    told = lax.scan(lambda c, x: step(p, c, *x), start, (looked, s.rate, s.usable))[1]
    return finished(s, told, measured_enough(pace(s, sampling_rate_hz), p.least_strides), latency)


LATER_S = 0.4
"""[s] Latency of the variant that waits."""


def _later(*args: Any, **kwargs: Any) -> Filled:
    """`ridge` with `LATER_S` of latency."""
    return ridge(*args, latency_s=LATER_S, **kwargs)


class Blend(NamedTuple):
    """Parameters of `blend`.

    Attributes:
        share: of the regression in the filled rate [1].
        neighbours: parameters of `gap_neighbours.neighbours`.
        ridge: parameters of `ridge`.
    """

    share: Any = 0.5
    neighbours: Neighbours = NEIGHBOURS
    ridge: Ridge = RIDGE


BLEND = Blend()
BLEND_TRANSFORMS = Blend(interval(0.0, 1.0), NEIGHBOURS_TRANSFORMS, TRANSFORMS)


def blend(
    rate: ArrayLike, usable: ArrayLike, acc: ArrayLike | None, sampling_rate_hz: float, params: Blend = BLEND, *,
    thigh: Thigh | None = None,
) -> Filled:  # fmt: skip
    """A weighted mean of `ridge` and `neighbours`, whose errors differ where strides do: short walks over ground.

    On a treadmill the neighbours alone do better.

    Args:
        rate: (T,) sagittal rate of the shank [rad/s]; anything where it is off.
        usable: (T,) bool, where the gyroscope was on and awake.
        acc: (T, 3) specific force of the shank [m/s²], never switched off.
        sampling_rate_hz: of the samples [Hz]; static.
        params: parameters.
        thigh: signals of the thigh, if worn.

    Returns:
        The filled rate; filled where both are.

    Raises:
        ValueError: as `ridge`.
    """
    line = ridge(rate, usable, acc, sampling_rate_hz, params.ridge, thigh=thigh)
    near = neighbours(rate, usable, acc, sampling_rate_hz, params.neighbours, thigh=thigh)
    share = jnp.asarray(params.share).astype(line.rate.dtype)
    return Filled(near.rate + share * (line.rate - near.rate), jnp.maximum(line.how, near.how), line.latency)


FILLERS = {
    "ridge": Filler(ridge, RIDGE, TRANSFORMS, needs_acc=True),
    "ridge_later": Filler(_later, RIDGE, TRANSFORMS, needs_acc=True),
    "blend": Filler(blend, BLEND, BLEND_TRANSFORMS, needs_acc=True),
}
