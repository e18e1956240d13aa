r"""What all fillers of gyroscope gaps share: records, the check of the arguments, the pace, and the last stage.

Every filler has the same arguments and the same result,

    fill(rate, usable, acc, sampling_rate_hz, params, *, thigh=None) → Filled(rate, how, latency, unlike).

`rate` (T,) [rad/s] and `acc` (T, 3) [m/s²] are signals of the shank, `usable` (T,) is True where the gyroscope was on
and awake, `thigh` has the signals of a sensor on the thigh. A filler is causal, or reports its latency in samples. It
is a `lax.scan` over the samples with fixed shapes, so it works under `jit` and `vmap`, and it is differentiable in its
parameters. Measured samples are passed on unchanged. As long as fewer than `least_strides` strides were measured, the
last measured value is held and `how` is `HELD`; `how` is also `HELD` at samples for which `neighbours` finds nothing
similar, as in a turn or when a person stops. `check_signals` and `started` list the errors.

The stride period is the lag with the least running mean square difference between a signal and the signal delayed by
that lag. The accelerometer is always on, so with it the period is followed through a gap of the gyroscope.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int, PyTree, Shaped

from jgait.params import Param
from jgait.signal.counted import held_on, scanned
from jgait.signal.windows import vertex
from jgait.types import AnyArray, Maybe

MEASURED, FILLED, HELD = 0, 1, 2
"""Origin of a sample: the gyroscope; the filler; neither, because too little or nothing similar was measured before."""

RATES = (25.0, 400.0)
"""[Hz] Least and greatest sampling rate that the fillers support."""

PERIODS = (0.7, 2.0)
"""[s] Range of stride periods."""

Rate = Float[AnyArray, "time"]
On = Bool[AnyArray, "time"]
Force = Float[AnyArray, "time 3"]


class Thigh(NamedTuple):
    """A sensor on the thigh that is always on: sagittal rate (T,) [rad/s], specific force (T, 3) [m/s²]."""

    rate: Rate
    acc: Force


class Filled(NamedTuple):
    """A rate without gaps."""

    rate: Float[AnyArray, "*batch time"]  #: (T,) sagittal rate [rad/s].
    how: Int[AnyArray, "*batch time"]  #: (T,) int, `MEASURED`, `FILLED` or `HELD`.
    latency: Int[AnyArray, "*batch"]  #: number of samples after which a value is known [samples]; 0: causal.
    #: (T,) how unlike the earlier samples are that a sample was filled from [1]: a factor on the variance of its error;
    #: 1: not known.
    unlike: Float[AnyArray, "*batch time"] | float = 1.0


class Filler(NamedTuple):
    """A method that fills gaps: its function, see the module, with default parameters and their transforms."""

    fill: Callable[..., Filled]
    params: PyTree
    transforms: PyTree
    needs_acc: bool = False


class Signals(NamedTuple):
    """The arguments of a filler, checked and of one floating type."""

    rate: Float[Array, "time"]  #: (T,) sagittal rate of the shank [rad/s]; 0 where the gyroscope was off.
    usable: Bool[Array, "time"]  #: (T,) bool, where the gyroscope was on and awake.
    acc: Maybe[Float[Array, "time 3"]]  #: (T, 3) specific force of the shank [m/s²], or None.
    thigh: Maybe[Thigh]  #: signals of the thigh, or None.


def check_signals(rate: Rate, usable: On, acc: Force | None, sampling_rate_hz: float, thigh: Thigh | None) -> Signals:
    """The arguments of a filler in one floating type; rates of a gyroscope that is off are 0. Raises ValueError if the
    sampling rate is outside `RATES`.
    """
    if not RATES[0] <= sampling_rate_hz <= RATES[1]:
        raise ValueError(f"the sampling rate must lie between {RATES[0]:g} and {RATES[1]:g} Hz; got {sampling_rate_hz}")
    dtype = jnp.asarray(rate).dtype
    values, force, above = jax.tree.map(lambda v: jnp.asarray(v).astype(dtype), (rate, acc, thigh))
    return Signals(jnp.where(usable, values, 0.0), jnp.asarray(usable), force, above)


def started[P](
    rate: Rate, usable: On, acc: Force | None, sampling_rate_hz: float, params: P, thigh: Thigh | None, *,
    needs_acc: bool = False,
) -> tuple[Signals, P]:  # fmt: skip
    """The first stage of every filler: its arguments, and its parameters in the same floating type. Raises ValueError
    as `check_signals`, or if the filler needs an accelerometer and there is none.
    """
    s = check_signals(rate, usable, acc, sampling_rate_hz, thigh)
    if needs_acc and s.acc is None:
        raise ValueError("this filler needs the signal of the accelerometer; acc is None")
    return s, jax.tree.map(lambda p: jnp.asarray(p).astype(s.rate.dtype), params)


def held(s: Signals) -> Float[Array, "time"]:
    """The last measured rate [rad/s]; 0 before the first measured rate."""

    def step(last: Array, sample: tuple[Array, Array]) -> tuple[Array, Array]:
        value = jnp.where(sample[1], sample[0], last)
        return value, value

    return lax.scan(step, jnp.zeros_like(s.rate[0]), (s.rate, s.usable))[1]


def finished(s: Signals, filled: Rate, enough: On, latency: int = 0) -> Filled:
    """Measured samples; filled samples where `enough` was measured before them; held samples elsewhere."""
    rate = jnp.where(s.usable, s.rate, jnp.where(enough, filled, held(s)))
    how = jnp.where(s.usable, MEASURED, jnp.where(enough, FILLED, HELD)).astype(jnp.int32)
    return Filled(rate, how, jnp.asarray(latency, jnp.int32))


def reversed_behind(values: Shaped[AnyArray, "time *rest"], size: int) -> Shaped[Array, "longer *rest"]:
    """The samples in reverse, with `size` zeros behind: `past` takes its slices from them."""
    return jnp.concatenate([jnp.asarray(values)[::-1], jnp.zeros((size, *values.shape[1:]), values.dtype)])


def past(
    behind: Shaped[Array, "longer *rest"], count: int, number: Int[Array, ""], lag: int, size: int
) -> Shaped[Array, "memory *rest"]:
    """`size` samples from `lag` before the sample `number` of `count` on, newest first; 0 before the first sample."""
    return lax.dynamic_slice_in_dim(behind, count - 1 - number + lag, size)


def pushed(register: Shaped[Array, "n *rest"], now: Shaped[Array, "*rest"]) -> Shaped[Array, "n *rest"]:
    """The register of the latest n samples, newest first, after one more sample; the oldest sample is dropped."""
    return jnp.concatenate([now[None], register[:-1]])


class Pace(NamedTuple):
    """Stride period and number of strides at each sample, from this sample and earlier samples."""

    period: Float[Array, "time"]  #: (T,) stride period [s].
    strides: Float[Array, "time"]  #: (T,) number of strides that the gyroscope has measured in walking.
    known: Bool[Array, "time"]  #: (T,) bool, False as long as the signals are too short for a stride period.


class _Differences(NamedTuple):
    """Sums of square differences at every lag, and their weights, of the rate and of the accelerometer."""

    rate: Float[Array, "lag"]
    rate_weight: Float[Array, "lag"]
    acc: Float[Array, "lag"]
    acc_weight: Float[Array, "lag"]


def _mean(d: _Differences, some: float) -> Float[Array, "lag"]:
    """Mean difference at each lag over the mean of all lags; a lag with few samples is moved towards 1.5, a poor fit.

    Each signal is divided by its mean, so that a lag without pairs of measured rates has no advantage.
    """
    sums = [(d.rate, d.rate_weight), (d.acc, d.acc_weight)]
    total = sum(s * (w.sum() + 1.0) / (s.sum() + 1.0) for s, w in sums)
    return (total + 1.5 * some) / (d.rate_weight + d.acc_weight + some)


@partial(jax.jit, static_argnames=("sampling_rate_hz",))
def pace(s: Signals, sampling_rate_hz: float) -> Pace:
    r"""The stride period and the number of measured strides; a decision, without gradient.

    At each lag l, with forgetting γ over 3 s and u = 1 where the gyroscope was on,

        D_l ← γ D_l + u_t u_{t−l} (ω_t − ω_{t−l})² / s_ω² + ‖a_t − a_{t−l}‖² / s_a²,

    with scales s_ω = 2 rad/s and s_a = 6 m/s² of a shank in walking; each sum is divided by its mean, and their total
    by the total weight; the period is the lag of the smallest result,
    refined by a parabola through the neighbouring lags. Without accelerometer nothing is forgotten while the gyroscope
    is off. After the last sample without the gyroscope nothing is computed: nothing is filled there.
    """
    s = jax.tree.map(lax.stop_gradient, s)
    dt, dtype = 1.0 / sampling_rate_hz, s.rate.dtype
    lags = np.arange(int(PERIODS[0] * sampling_rate_hz), int(np.ceil(PERIODS[1] * sampling_rate_hz)) + 1)
    keep, half = float(np.exp(-dt / 3.0)), float(np.exp(-dt / 0.5))
    blank = jnp.zeros(len(lags), dtype)
    force = jnp.zeros((len(s.rate), 3), dtype) if s.acc is None else s.acc
    some = 0.1 * sampling_rate_hz
    longer = jnp.asarray(1.0 + 0.1 * lags * dt, dtype)  # of a period and its double, the period

    count, longest = len(s.rate), int(lags[-1])
    behind = [reversed_behind(v, longest) for v in (s.rate, s.usable, force, jnp.ones_like(s.usable))]

    def step(carry: tuple[_Differences, Array, Array], sample: tuple[Array, ...]) -> tuple[PyTree, Pace]:
        d, power, walked = carry
        number, rate, on, acc = sample
        before = [past(values, count, number, int(lags[0]), len(lags)) for values in behind]
        pairs = (before[1] & on).astype(dtype)
        forget = keep if s.acc is not None else jnp.where(on, keep, 1.0).astype(dtype)
        there = before[3].astype(dtype) if s.acc is not None else jnp.zeros_like(pairs)
        d = _Differences(
            forget * d.rate + pairs * ((rate - before[0]) / 2.0) ** 2,
            forget * d.rate_weight + pairs,
            keep * d.acc + there * ((acc[None] - before[2]) ** 2).sum(axis=1) / 6.0**2,
            keep * d.acc_weight + there,
        )
        # a shank walks above 0.5 rad/s, root mean square over about 0.5 s; in standing it stays under 0.1
        power = jnp.where(on, half * power + (1.0 - half) * rate**2, power)
        score = _mean(d, some) * longer
        # the deepest valley; the two ends are none
        inner = score[1:-1]
        valley = (inner <= score[:-2]) & (inner <= score[2:])
        at = 1 + jnp.argmin(jnp.where(valley | ~valley.any(), inner, jnp.inf))
        shift = vertex(-score[at - 1], -score[at], -score[at + 1])
        period = ((lags[0] + at).astype(dtype) + shift) * dt
        walked = walked + jnp.where(on & (power > 0.5**2), dt, 0.0)
        weight = jnp.maximum(d.rate_weight[at], d.acc_weight[at])
        return (d, power, walked), Pace(period, walked / period, weight > 0.2 * sampling_rate_hz)

    start = (_Differences(blank, blank, blank, blank), jnp.zeros((), dtype), jnp.zeros((), dtype))
    samples = (jnp.arange(count, dtype=jnp.int32), s.rate, s.usable, force)
    needed = jnp.max(jnp.where(s.usable, 0, jnp.arange(count))) + 1
    return jax.tree.map(partial(held_on, count=needed), scanned(step, start, samples, needed)[1])


def measured_enough(paces: Pace, least_strides: Param) -> Bool[Array, "time"]:
    """True from the sample on at which `least_strides` strides, rounded to a whole number, were measured."""
    measured = paces.known & (paces.strides >= jnp.asarray(least_strides, paces.strides.dtype) - 0.5)
    return lax.cummax(measured.astype(jnp.int32)) > 0


def filled_once_enough(
    s: Signals, filled: Float[Array, "time"], sampling_rate_hz: float, least_strides: Param, latency: int = 0
) -> Filled:
    """The last stage of most fillers: filled samples after `least_strides` measured strides, held samples before."""
    return finished(s, filled, measured_enough(pace(s, sampling_rate_hz), least_strides), latency)
