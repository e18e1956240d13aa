r"""Velocity over gait cycles from acceleration: filtered integration, direct, and direct and reverse.

With α_k = 1 / (1 + 2π f_c h_k), h_k the time from the sample before, the high-pass is the signal minus its low-pass,

    l_k = l_{k−1} + (1 − α_k) (a_k − l_{k−1}),   l_0 = 0,   y_k = a_k − l_k,

which equals α (y_{k−1} + a_k − a_{k−1}) with y_0 = a_0; at f_c = 0, y equals a to the last bit. For a cycle 0 … T,

    J(t) = ∫ y dt (trapezoids),   direct: v_i + J(t),   reverse: v_f − (J(T) − J(t)),
    OFI:    v = v_i + J(t),
    OFDRI:  v = (1 − w) direct + w reverse = v_i + J(t) − w (v_i + J(T) − v_f),
    w = ½ + atan((2t − T) / (2 β T)) / (2 atan(1 / (2 β))).

The reverse minus the direct velocity is constant over the cycle, and w − ½ is antisymmetric about the cycle's middle.
Therefore the displacement over a cycle of evenly spaced samples depends neither on β nor on a constant error of the
acceleration.

Every integral is a `lax.scan` that restarts at marks, differentiable in signal, cut-off, β and the velocities; marks
carry no gradient.

Source: M. Zok, C. Mazzà, U. Della Croce, Med. Eng. Phys. 26 (2004) 791; A. Köse, A. Cereatti, U. Della Croce,
"Estimation of traversed distance in level walking using a single inertial measurement unit attached to the waist",
2011, section 2.1c. The filter is not printed there; it is a reading.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array, lax
from jax.typing import ArrayLike, DTypeLike
from jaxtyping import PyTree

from jgait.signal.marks import marks
from jgait.types import Counts, Flags, Values


class Cycles(NamedTuple):
    """Gait cycles of a recording, in order of time and without overlap; room for K cycles."""

    begin: PyTree  #: (K,) sample at which each cycle begins; after the last cycle, 0.
    end: Values  #: (K,) sample at which each cycle ends; the next cycle may begin at the same sample.
    count: Counts  #: number of cycles.


class Since(NamedTuple):
    """Integrals at each sample since the mark before it (at a mark, since the previous mark)."""

    change: Values  #: J, the integral of the filtered signal [m/s].
    time: Values  #: time since the mark [s].
    filtered: Values  #: y, the high-passed signal [m/s²].


class Placed(NamedTuple):
    """The cycle of each sample; a cycle contains the samples after its begin, up to and including its end."""

    inside: Values  #: (T,) bool, the sample is in a cycle.
    number: Values  #: (T,) index of the sample's cycle; 0 outside cycles.
    restart: Flags  #: (T,) bool, a cycle begins or ends at the sample.
    valid: Flags  #: (K,) bool, the row holds a cycle.


def weight(part: ArrayLike, beta: ArrayLike = 0.1) -> Array:
    """Weight w of the reverse integral, from 0 to 1, at the part t / T of the cycle.

    The smaller β > 0, the steeper w in the middle of the cycle; the larger β, the nearer w is to t / T.
    """
    s = jnp.asarray(part)
    return 0.5 + 0.5 * jnp.arctan((s - 0.5) / beta) / jnp.arctan(jnp.asarray(0.5 / beta, s.dtype))


def direct_reverse_cycles(
    acc: ArrayLike, cycles: Cycles, start: ArrayLike, end: ArrayLike, dt: ArrayLike, cutoff_hz: ArrayLike = 0.0,
    beta: ArrayLike = 0.1,
) -> Array:  # fmt: skip
    """OFDRI of every cycle of a recording; `start`, `end` and `cutoff_hz` are one value or (K,).

    Returns:
        (T,) velocity [m/s] after the begin of each cycle, up to and including its end; 0 elsewhere.
    """
    values, steps = signal_and_steps(acc, dt)
    at = placed(cycles, values.shape[0])
    begun, ended = (jnp.broadcast_to(jnp.asarray(v, values.dtype), at.valid.shape) for v in (start, end))
    integrals = since(values, steps, per_sample(cutoff_hz, at, values.dtype), at.restart)
    going = begun[at.number] + integrals.change
    missed = begun + integrals.change[cycles.end] - ended
    whole = integrals.time[cycles.end][at.number]
    share = weight(integrals.time / jnp.where(whole > 0.0, whole, 1.0), beta)
    return jnp.where(at.inside, going - share * missed[at.number], 0.0)


def placed(cycles: Cycles, samples: int) -> Placed:
    """The cycle of each of T samples."""
    valid = jnp.arange(len(cycles.begin), dtype=jnp.int32) < jnp.asarray(cycles.count).astype(jnp.int32)
    flags = marks(cycles.begin, cycles.end, samples, valid)
    begun, ended = (jnp.cumsum(flag, dtype=jnp.int32) - flag.astype(jnp.int32) for flag in flags)
    inside = begun > ended
    return Placed(inside, jnp.where(inside, begun - 1, 0), flags.begin | flags.end, valid)


def since(acc: Array, steps: Array, cutoff_hz: ArrayLike, restart: ArrayLike | None = None) -> Since:
    """J(t) and the time since the mark before each sample; filter and integral restart at marks.

    `steps` (T,) is the time from the sample before [s], 0 at the first sample and in padding; `cutoff_hz` one value, or
    one for the interval that ends at each sample; without marks only the first sample is one.
    """
    anew = jnp.zeros(acc.shape, bool) if restart is None else jnp.asarray(restart)
    turned = 2.0 * jnp.pi * jnp.asarray(cutoff_hz, steps.dtype) * steps
    shares = turned / (1.0 + turned)  # 1 − α

    def integrate(state: PyTree, sample: PyTree) -> PyTree:
        low, change, time, before = state
        now, share, step, mark = sample
        low = low + share * (now - low)
        integrals = Since(change + 0.5 * step * (before + now - low), time + step, now - low)
        kept = jnp.where(mark, 0.0, 1.0).astype(now.dtype)
        return (kept * low, kept * integrals.change, kept * integrals.time, now - kept * low), integrals

    nothing = jnp.zeros_like(acc[0])
    samples = (acc, shares, steps, anew)
    return lax.scan(integrate, (nothing, nothing, nothing, acc[0]), samples)[1]


def per_sample(values: ArrayLike, at: Placed, dtype: DTypeLike) -> Array:
    """Values (K,) of the cycles at their samples (T,), 0 outside cycles; a single value is returned as it is."""
    given = jnp.asarray(values, dtype)
    return given if given.ndim == 0 else jnp.where(at.inside, given[at.number], 0.0)


def signal_and_steps(acc: ArrayLike, dt: ArrayLike, mask: ArrayLike | None = None) -> tuple[Array, Array]:
    """The samples (T,), and the time from the sample before each; both are 0 in padding."""
    values = jnp.asarray(acc)
    there = jnp.ones(values.shape, bool) if mask is None else jnp.asarray(mask, bool)
    steps = jnp.where(there & (jnp.arange(values.shape[0]) > 0), jnp.asarray(dt, values.dtype), 0.0)
    return jnp.where(there, values, 0.0), steps
