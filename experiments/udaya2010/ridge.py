r"""Gaps of a gyroscope filled by ridge regression on the accelerometer's recent samples, learned during the walk.

With x_t the scaled samples of the accelerometer (and of a thigh's sensor) at some lags around t, and a 1, the weights
minimise Σ_s γ^{t−s} u_s (ω_s − w·x_s)² + γ^t λ ‖w‖², u = 1 where the gyroscope was on: recursive least squares,

    e = ω_t − w·x_t,   v = Q x_t,   k = v / (γ + x_t·v),   w ← w + k e,   Q ← (Q − k vᵀ) / γ,   Q_0 = I / λ,

in Joseph's form, so that rounding in float32 cannot make Q indefinite. With `latency_s` x_t has later samples as well,
and the filled rate is delayed by `latency_s`.
"""

from functools import partial
from typing import Annotated, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.typing import DTypeLike
from jaxtyping import Array, Bool, Float

from jgait.duty_cycle.fillers import NEIGHBOURS, Neighbours, neighbours, scaled
from jgait.duty_cycle.filling import Filled, Filler, Force, On, Rate, Signals, Thigh, filled_once_enough, started
from jgait.params import Param, Parameter, documented, fixed, interval, positive, ranges

HISTORY_S, SPACING_S = 0.4, 0.04
"""[s] Longest time before a sample of the regression's samples, and their spacing."""


@documented
class Ridge(NamedTuple):
    """Parameters of `ridge`."""

    penalty: Annotated[Param, Parameter(positive, "1", "λ, penalty of large weights")] = 10.0
    forget: Annotated[Param, Parameter(
        interval(0.9, 1.0), "1", "γ, factor by which the weight of a measured sample falls with each further one",
    )] = 0.9995  # fmt: skip
    acc_scale: Annotated[Param, Parameter(positive, "m/s²", "of the shank's accelerometer")] = 6.0
    thigh_rate_scale: Annotated[Param, Parameter(positive, "rad/s", "of the thigh's gyroscope")] = 1.0
    thigh_acc_scale: Annotated[Param, Parameter(positive, "m/s²", "of the thigh's accelerometer")] = 3.0
    least_strides: Annotated[Param, Parameter(
        fixed, "strides", "strides that must be measured before samples are filled rather than held",
    )] = 2.0  # fmt: skip


RIDGE = Ridge()


class RidgeState(NamedTuple):
    """Weights (k,) [rad/s], and the inverse Q (k, k) of the weighted sum of x xᵀ."""

    weights: Float[Array, "feature"]
    inverse: Float[Array, "feature feature"]


def begin(p: Ridge, size: int, dtype: DTypeLike) -> RidgeState:
    """The state before the first sample, for `size` features."""
    return RidgeState(jnp.zeros(size, dtype), jnp.eye(size, dtype=dtype) / p.penalty)


def step(
    p: Ridge, s: RidgeState, features: Float[Array, "feature"], rate: Float[Array, ""], usable: Bool[Array, ""]
) -> tuple[RidgeState, Float[Array, ""]]:
    """One sample: the state after it, and the rate [rad/s] predicted by the weights before it; as in `neighbours`."""
    predicted = s.weights @ features
    v = s.inverse @ features
    gain = v / (p.forget + features @ v)
    across = gain[:, None] * v[None, :]
    spread = (features @ v + p.forget) * gain[:, None] * gain[None, :]
    inverse = (s.inverse - across - across.T + spread) / p.forget
    after = RidgeState(s.weights + gain * (rate - predicted), inverse)
    return jax.tree.map(lambda new, old: jnp.where(usable, new, old), after, s), predicted


def features(s: Signals, p: Ridge, sampling_rate_hz: float, latency: int) -> Float[Array, "time feature"]:
    """Scaled samples from `HISTORY_S` before each sample to `latency` samples after it, and a 1; edges repeat."""
    signals = scaled(s, p)
    count = len(signals)
    apart = max(round(SPACING_S * sampling_rate_hz), 1)
    lags = np.arange(-(latency // apart) * apart, round(HISTORY_S * sampling_rate_hz) + 1, apart)
    rows = np.clip(np.arange(count)[:, None] - lags[None, :], 0, count - 1)
    return jnp.concatenate([signals[rows].reshape(count, -1), jnp.ones((count, 1), signals.dtype)], axis=1)


def ridge(
    rate: Rate, usable: On, acc: Force | None, sampling_rate_hz: float, params: Ridge = RIDGE, *,
    thigh: Thigh | None = None, latency_s: float = 0.0,
) -> Filled:  # fmt: skip
    """Ridge regression of the rate on the accelerometer, learned from the samples measured so far.

    Arguments and errors: see `base`; an accelerometer is needed. `latency_s`, static, is the time that the filler waits
    for later samples [s], at most 1 s.
    """
    if not 0.0 <= latency_s <= 1.0:
        raise ValueError(f"latency_s must lie between 0 and 1 s; got {latency_s}")
    s, p = started(rate, usable, acc, sampling_rate_hz, params, thigh, needs_acc=True)
    return _filled(s, p, sampling_rate_hz, round(latency_s * sampling_rate_hz))


@partial(jax.jit, static_argnames=("sampling_rate_hz", "latency"))
def _filled(s: Signals, p: Ridge, sampling_rate_hz: float, latency: int) -> Filled:
    looked = features(s, p, sampling_rate_hz, latency)
    start = begin(p, looked.shape[1], s.rate.dtype)
    predicted = lax.scan(lambda c, x: step(p, c, *x), start, (looked, s.rate, s.usable))[1]
    return filled_once_enough(s, predicted, sampling_rate_hz, p.least_strides, latency)


@documented
class Blend(NamedTuple):
    """Parameters of `blend`."""

    share: Annotated[Param, Parameter(interval(0.0, 1.0), "1", "of the regression in the filled rate")] = 0.5
    neighbours: Annotated[Neighbours, Parameter(None, "", "parameters of `neighbours`")] = NEIGHBOURS
    ridge: Annotated[Ridge, Parameter(None, "", "parameters of `ridge`")] = RIDGE


BLEND = Blend()


def blend(
    rate: Rate, usable: On, acc: Force | None, sampling_rate_hz: float, params: Blend = BLEND, *,
    thigh: Thigh | None = None,
) -> Filled:  # fmt: skip
    """A weighted mean of `ridge` and `neighbours`: best on short walks over ground, where strides differ.

    On a treadmill the neighbours alone have the smaller error. A sample is `FILLED` where both fill it. Arguments and
    errors: see `base`; an accelerometer is needed.
    """
    line = ridge(rate, usable, acc, sampling_rate_hz, params.ridge, thigh=thigh)
    near = neighbours(rate, usable, acc, sampling_rate_hz, params.neighbours, thigh=thigh)
    share = jnp.asarray(params.share).astype(line.rate.dtype)
    return Filled(
        near.rate + share * (line.rate - near.rate), jnp.maximum(line.how, near.how), line.latency, near.unlike
    )


FILLERS = {
    "ridge": Filler(ridge, RIDGE, ranges(RIDGE), needs_acc=True),
    "blend": Filler(blend, BLEND, ranges(BLEND), needs_acc=True),
}
