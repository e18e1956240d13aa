r"""Filling a gyroscope's gaps with what it measured when the accelerometer felt the same: kernel-weighted neighbours.

Two samples are alike if their recent histories are. With scales s, the sample j before the present one t and a memory
ρ = exp(−1/(τ f_s)) of the history,

    c_{t,j} = ‖a_t − a_{t−j}‖² / s_a²  (+ the same of the thigh's signals)
    d_{t,j} = c_{t,j} + ρ d_{t−1,j},   n_{t,j} = 1 + ρ n_{t−1,j}                  (0 before the first sample)
    q_{t,j} = d_{t,j} / n_{t,j} + κ (1 − (1 − ρ) n_{t,j})                         (less is known of a short history)
    w_{t,j} = softmax_j (−(q_{t,j} − min q) / (2 h² (min q + ε)))  over the samples j at which the gyroscope was on
    ω̂_t    = Σ_j w_{t,j} ω_{t−j}

The lag j stays the same as both histories move on, so a sample costs one pass over the memory, online as offline.
Only rates measured before are used. The accelerometer's axes share one scale: the axis that moves little says little,
and to blow its noise up to the size of the others costs a quarter of the accuracy.
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
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
    pushed,
)
from jgait.params import fixed, positive

MEMORY_S = 90.0
"""[s] How far back neighbours are looked for."""


class Neighbours(NamedTuple):
    """Parameters of `neighbours`.

    Attributes:
        history_s: time constant τ over which histories are compared [s].
        bandwidth: h, of the kernel over the distance of the nearest neighbour [1].
        floor: ε, distance under which neighbours are equally near [1].
        short: κ, what is added to the distance of a history that has only just begun [1].
        acc_scale: s_a of the shank's accelerometer [m/s²].
        thigh_rate_scale: of the thigh's gyroscope [rad/s].
        thigh_acc_scale: of the thigh's accelerometer [m/s²].
        least_strides: that must have been measured before anything but holding is trusted [strides].
    """

    history_s: Any = 0.1
    bandwidth: Any = 0.4
    floor: Any = 1e-3
    short: Any = 0.4
    acc_scale: Any = 6.0
    thigh_rate_scale: Any = 1.0
    thigh_acc_scale: Any = 3.0
    least_strides: Any = 2.0


NEIGHBOURS = Neighbours()
TRANSFORMS = Neighbours(*(positive,) * 7, least_strides=fixed)


class NeighboursState(NamedTuple):
    """What is remembered from one sample to the next, newest first.

    Attributes:
        signals: (n, k) scaled signals of the samples before.
        rate: (n,) their rates [rad/s].
        usable: (n,) bool, which were measured.
        there: (n,) bool, which there were at all.
        distance, weight: (n,) d and n of each lag.
    """

    signals: Any
    rate: Any
    usable: Any
    there: Any
    distance: Any
    weight: Any


def begin(size: int, channels: int, dtype: Any) -> NeighboursState:
    """The state before the first sample.

    Args:
        size: samples that are remembered.
        channels: signals that are compared.
        dtype: floating type.
    """
    none, no = jnp.zeros(size, dtype), jnp.zeros(size, bool)
    return NeighboursState(jnp.zeros((size, channels), dtype), none, no, no, none, none)


def step(
    p: Neighbours, dt: Any, s: NeighboursState, signals: Array, rate: Array, usable: Array
) -> tuple[NeighboursState, Array]:
    """One sample: what the rate should be, and the state to carry on.

    Args:
        p: parameters.
        dt: interval of the samples [s].
        s: from `begin` or the step before.
        signals: (k,) scaled signals that never sleep.
        rate: sagittal rate [rad/s]; finite where it is off.
        usable: bool, whether it was measured.

    Returns:
        The state, and the rate as the neighbours have it [rad/s]; 0 as long as there is none.
    """
    keep = jnp.exp(-dt / p.history_s)
    there = s.there.astype(s.rate.dtype)
    distance = there * ((signals[None] - s.signals) ** 2).sum(axis=1) + keep * s.distance
    weight = there + keep * s.weight
    alike, nearest = distances(p, keep, s, distance, weight)
    further = jnp.where(s.usable, alike - nearest, 0.0)
    kernel = jnp.where(s.usable, jnp.exp(-0.5 * further / (p.bandwidth**2 * (nearest + p.floor))), 0.0)
    total = kernel.sum()
    told = (kernel * s.rate).sum() / jnp.where(total > 0.0, total, 1.0)
    after = NeighboursState(
        pushed(s.signals, signals), pushed(s.rate, rate), pushed(s.usable, usable),
        pushed(s.there, jnp.ones_like(usable)), distance, weight,
    )  # fmt: skip
    return after, told


def distances(p: Neighbours, keep: Any, s: NeighboursState, distance: Array, weight: Array) -> tuple[Array, Array]:
    """How far each lag's history is from the latest one (n,), and the least of those with a rate, 1 without any.

    Args:
        p: parameters.
        keep: what is kept of a history from a sample to the next [1].
        s: the state before the sample.
        distance: (n,) weighted sum of square differences, the sample's own among them.
        weight: (n,) sum of the weights.
    """
    alike = distance / jnp.where(s.there, weight, 1.0) + p.short * (1.0 - (1.0 - keep) * weight)
    nearest = jnp.min(jnp.where(s.usable, alike, jnp.inf))
    return alike, jnp.where(s.usable.any(), nearest, 1.0)


def scaled(s: Signals, p: Neighbours) -> Array:
    """(T, k) the signals that are compared, over their scales [1]."""
    parts = [s.acc / p.acc_scale]
    if s.thigh is not None:
        parts += [s.thigh.rate[:, None] / p.thigh_rate_scale, s.thigh.acc / p.thigh_acc_scale]
    return jnp.concatenate(parts, axis=1)


def neighbours(
    rate: ArrayLike, usable: ArrayLike, acc: ArrayLike | None, sampling_rate_hz: float,
    params: Neighbours = NEIGHBOURS, *, thigh: Thigh | None = None,
) -> Filled:  # fmt: skip
    """Rates measured before, weighted by how alike the accelerometer's history is; causal.

    Args:
        rate: (T,) sagittal rate of the shank [rad/s]; anything where it is off.
        usable: (T,) bool, where the gyroscope was on and awake.
        acc: (T, 3) specific force of the shank [m/s²], never switched off.
        sampling_rate_hz: of the samples [Hz]; static.
        params: parameters.
        thigh: signals of the thigh, if worn.

    Returns:
        The filled rate.

    Raises:
        ValueError: as `check_signals`, or without accelerometer.
    """
    s = check_signals(rate, usable, acc, sampling_rate_hz, thigh)
    if s.acc is None:
        raise ValueError("neighbours are told from the accelerometer; acc is None")
    return _filled(s, in_type(params, s), sampling_rate_hz)


@partial(jax.jit, static_argnames="sampling_rate_hz")
def _filled(s: Signals, p: Neighbours, sampling_rate_hz: float) -> Filled:
    compared = scaled(s, p)
    size = min(len(s.rate), round(MEMORY_S * sampling_rate_hz))
    start = begin(size, compared.shape[1], s.rate.dtype)
    dt = jnp.asarray(1.0 / sampling_rate_hz, s.rate.dtype)
    told = lax.scan(lambda c, x: step(p, dt, c, *x), start, (compared, s.rate, s.usable))[1]
    return finished(s, told, measured_enough(pace(s, sampling_rate_hz), p.least_strides))


FILLERS = {"neighbours": Filler(neighbours, NEIGHBOURS, TRANSFORMS, needs_acc=True)}
