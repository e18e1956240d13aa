r"""Filling the gaps of a gyroscope that is switched off part of the time: the interface, and the two plain ways.

Every filler has the same arguments and the same result,

    fill(rate, usable, acc, sampling_rate_hz, params, *, thigh=None) → Filled(rate, how, latency),

is causal or says how many samples it waits, is a `lax.scan` over the samples with fixed shapes, and so works under
`jit` and `vmap` and is differentiable in its parameters. What is measured is passed on as it is. As long as fewer than
`least_strides` strides were measured, the last measured value is held and the flag says so. `fillers` lists them all.

The stride period comes from the same signals, causally: where the running mean square difference between a signal and
itself a lag ago is least. The accelerometer never sleeps, so with it the period is followed through a gap.

Source: P. S. Udaya Shankar, N. Raveendranathan, N. R. Gans, R. Jafari, "Towards power optimized Kalman filter for gait
assessment using wearable sensors", Wireless Health 2010, section 5: `replicate`.

Deviations from the paper:
    1. The paper replicates "from the previous cycle" of its schedule, 1.4 s ago. Where that is no stride period, errors
       exceed those of a rate that is left at zero; so the period is estimated.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax.typing import ArrayLike

from jgait.events.trunk_rhythm import vertex
from jgait.params import fixed, interval, positive

MEASURED, FILLED, HELD = 0, 1, 2
"""How a sample was had: by the gyroscope; by the filler; by holding, since too little was measured before."""

RATES = (25.0, 400.0)
"""[Hz] Sampling rates for which the fillers are meant."""

PERIODS = (0.7, 2.0)
"""[s] Stride periods that are looked for."""

RATE_SCALE, ACC_SCALE = 2.0, 6.0
"""[rad/s], [m/s²] What a shank's signals vary by in walking: puts differences of both on one scale."""

MOVING = 0.5
"""[rad/s] Root mean square rate over about half a second above which a shank walks; standing stays under 0.1."""


class Thigh(NamedTuple):
    """What a sensor on the thigh measured at the same samples, never switched off.

    Attributes:
        rate: (T,) sagittal rate [rad/s].
        acc: (T, 3) specific force [m/s²].
    """

    rate: Any
    acc: Any


class Filled(NamedTuple):
    """A rate without gaps.

    Attributes:
        rate: (T,) [rad/s].
        how: (T,) int, `MEASURED`, `FILLED` or `HELD`.
        latency: how many samples after its own a value is known [samples]; 0: causal.
    """

    rate: Any
    how: Any
    latency: Any


class Filler(NamedTuple):
    """A way to fill gaps.

    Attributes:
        fill: the function, see the module.
        params: its usual parameters.
        transforms: of the parameters.
        needs_acc: whether there must be an accelerometer.
    """

    fill: Callable[..., Filled]
    params: Any
    transforms: Any
    needs_acc: bool = False


class Signals(NamedTuple):
    """The arguments of a filler, checked and of one floating type; 0 where the gyroscope was off."""

    rate: Any
    usable: Any
    acc: Any
    thigh: Any


class Pace(NamedTuple):
    """What is known of the strides at each sample, from the samples before it and itself.

    Attributes:
        period: (T,) stride period [s].
        strides: (T,) how many strides the gyroscope has measured in walking.
        known: (T,) bool, False as long as the signals are too short to tell a period.
    """

    period: Any
    strides: Any
    known: Any


def fillers() -> dict[str, Filler]:
    """Every filler by name."""
    from jgait.duty_cycle.fillers import neighbours as gap_neighbours  # they are built on this module
    from jgait.duty_cycle.fillers import oscillator as gap_oscillator
    from jgait.duty_cycle.fillers import ridge as gap_ridge

    return {
        "hold": HOLD_FILLER,
        "replicate": REPLICATE_FILLER,
        **gap_oscillator.FILLERS,
        **gap_ridge.FILLERS,
        **gap_neighbours.FILLERS,
    }


def check_signals(
    rate: ArrayLike, usable: ArrayLike, acc: ArrayLike | None, sampling_rate_hz: float, thigh: Thigh | None
) -> Signals:
    """The arguments of a filler in one floating type, what is off set to zero.

    Raises:
        ValueError: if shapes or types do not fit, or the sampling rate is outside `RATES`.
    """
    if not RATES[0] <= sampling_rate_hz <= RATES[1]:
        raise ValueError(f"the sampling rate must lie between {RATES[0]:g} and {RATES[1]:g} Hz; got {sampling_rate_hz}")
    values, on = jnp.asarray(rate), jnp.asarray(usable)
    if values.ndim != 1 or values.shape[0] == 0 or not jnp.issubdtype(values.dtype, jnp.floating):
        raise ValueError(f"rate must be (T,) floating point with T > 0; got {values.shape} {values.dtype}")
    count, dtype = values.shape[0], values.dtype
    if on.shape != (count,) or on.dtype != bool:
        raise ValueError(f"usable must be ({count},) bool; got {on.shape} {on.dtype}")

    def typed(signal: Any, shape: tuple[int, ...], name: str) -> Any:
        array = jnp.asarray(signal)
        if array.shape != shape:
            raise ValueError(f"{name} must have shape {shape}; got {array.shape}")
        return array.astype(dtype)

    force = None if acc is None else typed(acc, (count, 3), "acc")
    above = None
    if thigh is not None:
        above = Thigh(typed(thigh.rate, (count,), "thigh.rate"), typed(thigh.acc, (count, 3), "thigh.acc"))
    return Signals(jnp.where(on, values, 0.0), on, force, above)


def in_type(params: Any, s: Signals) -> Any:
    """The parameters in the floating type of the signals."""
    return jax.tree.map(lambda p: jnp.asarray(p).astype(s.rate.dtype), params)


def held(s: Signals) -> Array:
    """(T,) the last measured rate [rad/s]; 0 before there is one."""

    def step(last: Any, sample: tuple[Any, Any]) -> tuple[Any, Any]:
        value = jnp.where(sample[1], sample[0], last)
        return value, value

    return lax.scan(step, jnp.zeros_like(s.rate[0]), (s.rate, s.usable))[1]


def finished(s: Signals, filled: Any, enough: Any, latency: int = 0) -> Filled:
    """What was measured, what was filled where `enough` was measured before, and held elsewhere."""
    rate = jnp.where(s.usable, s.rate, jnp.where(enough, filled, held(s)))
    how = jnp.where(s.usable, MEASURED, jnp.where(enough, FILLED, HELD)).astype(jnp.int32)
    return Filled(rate, how, jnp.asarray(latency, jnp.int32))


def pushed(register: Any, now: Any) -> Any:
    """A register of the samples before, (n, ...) newest first, with one more."""
    return jnp.concatenate([now[None], register[:-1]])


class _Differences(NamedTuple):
    """Mean square differences at every lag, with how much they count, of rate and accelerometer."""

    rate: Any
    rate_weight: Any
    acc: Any
    acc_weight: Any


def _mean(d: _Differences, some: float) -> Any:
    """Mean difference at each lag, over that of all lags; where little was seen, drawn to 1.5, which does not fit.

    Each signal is taken over its own mean, so that a lag at which the gyroscope was never on twice is no better off.
    """
    sums = [(d.rate, d.rate_weight), (d.acc, d.acc_weight)]
    total = sum(s * (w.sum() + 1.0) / (s.sum() + 1.0) for s, w in sums)
    return (total + 1.5 * some) / (d.rate_weight + d.acc_weight + some)


def _valley(score: Any) -> tuple[Any, Any]:
    """Index of the deepest valley, and by how much its bottom lies off it; the ends may be on a slope, and are none."""
    inner = score[1:-1]
    valley = (inner <= score[:-2]) & (inner <= score[2:])
    at = 1 + jnp.argmin(jnp.where(valley | ~valley.any(), inner, jnp.inf))
    return at, vertex(-score[at - 1], -score[at], -score[at + 1])


@partial(jax.jit, static_argnames=("sampling_rate_hz", "memory_s"))
def pace(s: Signals, sampling_rate_hz: float, memory_s: float = 3.0) -> Pace:
    r"""The stride period, and how many strides were measured; a decision, without gradient.

    At each lag l, with forgetting γ over `memory_s` and u = 1 where the gyroscope was on,

        D_l ← γ D_l + u_t u_{t−l} (ω_t − ω_{t−l})² / s_ω² + ‖a_t − a_{t−l}‖² / s_a²,

    each sum over its own mean and both together over what they count; the period is the lag where that is least, a
    parabola through its neighbours. Without accelerometer nothing is forgotten while the gyroscope is off.

    Args:
        s: from `check_signals`.
        sampling_rate_hz: of the samples [Hz]; static.
        memory_s: time constant of forgetting [s]; static.
    """
    dt, dtype = 1.0 / sampling_rate_hz, s.rate.dtype
    lags = np.arange(int(PERIODS[0] * sampling_rate_hz), int(np.ceil(PERIODS[1] * sampling_rate_hz)) + 1)
    keep, half = float(np.exp(-dt / memory_s)), float(np.exp(-dt / 0.5))
    blank = jnp.zeros(len(lags), dtype)
    force = jnp.zeros((len(s.rate), 3), dtype) if s.acc is None else s.acc
    some = 0.1 * sampling_rate_hz
    longer = jnp.asarray(1.0 + 0.1 * lags * dt, dtype)  # of a period and its double, the period

    def step(carry: Any, sample: Any) -> tuple[Any, Any]:
        d, past, power, walked = carry
        rate, on, acc = sample
        before = jax.tree.map(lambda register: register[lags - 1], past)
        pairs = (before[1] & on).astype(dtype)
        forget = keep if s.acc is not None else jnp.where(on, keep, 1.0).astype(dtype)
        there = before[3].astype(dtype) if s.acc is not None else jnp.zeros_like(pairs)
        d = _Differences(
            forget * d.rate + pairs * ((rate - before[0]) / RATE_SCALE) ** 2,
            forget * d.rate_weight + pairs,
            keep * d.acc + there * ((acc[None] - before[2]) ** 2).sum(axis=1) / ACC_SCALE**2,
            keep * d.acc_weight + there,
        )
        power = jnp.where(on, half * power + (1.0 - half) * rate**2, power)
        score = _mean(d, some) * longer
        at, shift = _valley(score)
        period = ((lags[0] + at).astype(dtype) + shift) * dt
        walked = walked + jnp.where(on & (power > MOVING**2), dt, 0.0)
        seen = jnp.maximum(d.rate_weight[at], d.acc_weight[at])
        past = tuple(pushed(p, v) for p, v in zip(past, (rate, on, acc, jnp.ones_like(on)), strict=True))
        return (d, past, power, walked), Pace(period, walked / period, seen > 0.2 * sampling_rate_hz)

    longest = int(lags[-1])
    no = jnp.zeros(longest, bool)
    past = (jnp.zeros(longest, dtype), no, jnp.zeros((longest, 3), dtype), no)
    start = (_Differences(blank, blank, blank, blank), past, jnp.zeros((), dtype), jnp.zeros((), dtype))
    told = lax.scan(step, start, (s.rate, s.usable, force))[1]
    return jax.tree.map(lax.stop_gradient, told)


def measured_enough(told: Pace, least_strides: ArrayLike) -> Array:
    """(T,) bool, since when at least so many strides were measured, counted to the nearest whole one."""
    measured = told.known & (told.strides >= jnp.asarray(least_strides, told.strides.dtype) - 0.5)
    return lax.cummax(measured.astype(jnp.int32)) > 0


class Hold(NamedTuple):
    """Parameters of `hold`.

    Attributes:
        decay_s: time constant with which a held value goes to zero [s]; infinite: it stays.
    """

    decay_s: Any = np.inf


HOLD = Hold()
HOLD_TRANSFORMS = Hold(decay_s=positive)


def hold(
    rate: ArrayLike, usable: ArrayLike, acc: ArrayLike | None, sampling_rate_hz: float, params: Hold = HOLD, *,
    thigh: Thigh | None = None,
) -> Filled:  # fmt: skip
    """The last measured value, going to zero with a time constant; what every other one has to beat.

    Args:
        rate: (T,) sagittal rate of the shank [rad/s]; anything where it is off.
        usable: (T,) bool, where the gyroscope was on and awake.
        acc: not used.
        sampling_rate_hz: of the samples [Hz]; static.
        params: parameters.
        thigh: not used.

    Returns:
        The filled rate; every filled sample is flagged `HELD`.

    Raises:
        ValueError: as `check_signals`.
    """
    s = check_signals(rate, usable, acc, sampling_rate_hz, thigh)
    lost = 1.0 / (in_type(params, s).decay_s * sampling_rate_hz)

    def step(age: Any, on: Any) -> tuple[Any, Any]:
        age = jnp.where(on, 0.0, age + 1.0).astype(s.rate.dtype)
        return age, age

    age = lax.scan(step, jnp.zeros_like(s.rate[0]), s.usable)[1]
    kept = finished(s, s.rate, jnp.zeros_like(s.usable))
    return kept._replace(rate=jnp.where(s.usable, s.rate, kept.rate * jnp.exp(-age * lost)))


class Replicate(NamedTuple):
    """Parameters of `replicate`.

    Attributes:
        stretch: of the period that is looked back, over the estimated one [1].
        least_strides: that must have been measured before anything but holding is trusted [strides].
    """

    stretch: Any = 1.0
    least_strides: Any = 2.0


REPLICATE = Replicate()
REPLICATE_TRANSFORMS = Replicate(stretch=interval(0.8, 1.25), least_strides=fixed)


def replicate(
    rate: ArrayLike, usable: ArrayLike, acc: ArrayLike | None, sampling_rate_hz: float,
    params: Replicate = REPLICATE, *, thigh: Thigh | None = None,
) -> Filled:  # fmt: skip
    """The last cycle once more: ω̂_t = ω̂_{t − P}, P the stride period estimated up to then.

    Args:
        rate: (T,) sagittal rate of the shank [rad/s]; anything where it is off.
        usable: (T,) bool, where the gyroscope was on and awake.
        acc: (T, 3) specific force of the shank [m/s²], from which the period is followed through the gap; or None.
        sampling_rate_hz: of the samples [Hz]; static.
        params: parameters.
        thigh: not used.

    Returns:
        The filled rate.

    Raises:
        ValueError: as `check_signals`.
    """
    s = check_signals(rate, usable, acc, sampling_rate_hz, thigh)
    p, told = in_type(params, s), pace(s, sampling_rate_hz)
    enough = measured_enough(told, p.least_strides)
    length = int(np.ceil(1.25 * PERIODS[1] * sampling_rate_hz)) + 2

    def step(carry: Any, sample: Any) -> tuple[Any, Any]:
        register, last = carry
        value, on, period, trusted = sample
        back = jnp.clip(p.stretch * period * sampling_rate_hz - 1.0, 0.0, length - 2.0)
        low = jnp.floor(lax.stop_gradient(back)).astype(jnp.int32)
        share = back - low.astype(back.dtype)
        again = (1.0 - share) * register[low] + share * register[low + 1]
        value = jnp.where(on, value, jnp.where(trusted, again, last))
        return (pushed(register, value), jnp.where(on, value, last)), value

    start = (jnp.zeros(length, s.rate.dtype), jnp.zeros_like(s.rate[0]))
    return finished(s, lax.scan(step, start, (s.rate, s.usable, told.period, enough))[1], enough)


HOLD_FILLER = Filler(hold, HOLD, HOLD_TRANSFORMS)
REPLICATE_FILLER = Filler(replicate, REPLICATE, REPLICATE_TRANSFORMS)
