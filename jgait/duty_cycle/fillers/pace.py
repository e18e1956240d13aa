r"""The stride period and the number of measured strides, from a gyroscope with gaps and an accelerometer; causal.

The stride period is the lag with the least running mean square difference between a signal and the signal delayed by
that lag. The accelerometer is always on, so with it the period is followed through a gap of the gyroscope.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, PyTree

from jgait.duty_cycle.fillers.base import PERIODS, Filled, Signals, finished, past, reversed_behind
from jgait.params import Param
from jgait.signal.counted import held_on, scanned
from jgait.signal.windows import vertex

RATE_SCALE, ACC_SCALE = 2.0, 6.0
"""[rad/s], [m/s²] Scales of a shank's rate and specific force in walking, by which differences are divided."""

MEMORY = 3.0
"""[s] Time constant with which differences are forgotten."""

MOVING = 0.5
"""[rad/s] A shank whose rate has a larger root mean square over about 0.5 s walks; in standing it stays under 0.1."""


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

    At each lag l, with forgetting γ over `MEMORY` and u = 1 where the gyroscope was on,

        D_l ← γ D_l + u_t u_{t−l} (ω_t − ω_{t−l})² / s_ω² + ‖a_t − a_{t−l}‖² / s_a²,

    each sum is divided by its mean, and their total by the total weight; the period is the lag of the smallest result,
    refined by a parabola through the neighbouring lags. Without accelerometer nothing is forgotten while the gyroscope
    is off. After the last sample without the gyroscope nothing is computed: nothing is filled there.
    """
    s = jax.tree.map(lax.stop_gradient, s)
    dt, dtype = 1.0 / sampling_rate_hz, s.rate.dtype
    lags = np.arange(int(PERIODS[0] * sampling_rate_hz), int(np.ceil(PERIODS[1] * sampling_rate_hz)) + 1)
    keep, half = float(np.exp(-dt / MEMORY)), float(np.exp(-dt / 0.5))
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
            forget * d.rate + pairs * ((rate - before[0]) / RATE_SCALE) ** 2,
            forget * d.rate_weight + pairs,
            keep * d.acc + there * ((acc[None] - before[2]) ** 2).sum(axis=1) / ACC_SCALE**2,
            keep * d.acc_weight + there,
        )
        power = jnp.where(on, half * power + (1.0 - half) * rate**2, power)
        score = _mean(d, some) * longer
        # the deepest valley; the two ends are none
        inner = score[1:-1]
        valley = (inner <= score[:-2]) & (inner <= score[2:])
        at = 1 + jnp.argmin(jnp.where(valley | ~valley.any(), inner, jnp.inf))
        shift = vertex(-score[at - 1], -score[at], -score[at + 1])
        period = ((lags[0] + at).astype(dtype) + shift) * dt
        walked = walked + jnp.where(on & (power > MOVING**2), dt, 0.0)
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
