r"""Velocity over gait cycles from acceleration: filtered integration, direct, and direct and reverse.

With α_k = 1 / (1 + 2π f_c h_k), h_k the time from the sample before, the high-pass is what a low-pass leaves,

    l_k = l_{k−1} + (1 − α_k) (a_k − l_{k−1}),   l_0 = 0,   y_k = a_k − l_k,

which is α (y_{k−1} + a_k − a_{k−1}) with y_0 = a_0, and y = a at f_c = 0 to the last bit. Of a cycle 0 … T,

    J(t) = ∫ y dt (trapezoids),   direct: v_i + J(t),   reverse: v_f − (J(T) − J(t)),
    OFI:    v = v_i + J(t),
    OFDRI:  v = (1 − w) direct + w reverse = v_i + J(t) − w (v_i + J(T) − v_f),
    w = ½ + atan((2t − T) / (2 β T)) / (2 atan(1 / (2 β))).

Reverse minus direct is one number for the whole cycle, and w is as far above ½ at the end as below it at the start. So
the displacement over a cycle of even samples does not depend on β, and a constant error of the acceleration leaves it
as it is.

Optimum rule (`optimum_cutoff`): the cut-off in [0, f_max] that minimises |g|, g = v_i + J(T) − v_f; the least, where
several make it zero. Its gradient is that of the implicit function: −g_θ / g_f where g = 0, −g_fθ / g_ff where g only
comes near zero in between; at 0 it is zero, and at f_max that of f_max. First derivatives only.

Every integral is a `lax.scan` that starts anew at marks, differentiable in signal, cut-off, β and the velocities; marks
carry no gradient.

Source: M. Zok, C. Mazzà, U. Della Croce, Med. Eng. Phys. 26 (2004) 791; A. Köse, A. Cereatti, U. Della Croce,
"Estimation of traversed distance in level walking using a single inertial measurement unit attached to the waist",
2011, section 2.1c. Neither filter nor rule is printed there; both are readings.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array, lax
from jax.typing import ArrayLike, DTypeLike
from jaxtyping import PyTree

from jgait.signal.butterworth import UNROLL
from jgait.signal.marks import marks
from jgait.types import Counts, Flags, Values

HIGHEST = 1.0
"""[Hz] Where the search for a cut-off ends: steps, one to two a second, are to pass."""

GRID, REFINED = 16, 6
"""Intervals in which the search looks for a change of sign; safeguarded Newton steps in the one found."""


class Cycles(NamedTuple):
    """Cycles of a recording, in order, none beginning before the one before has ended; room for K.

    Attributes:
        begin: (K,) sample at which each begins; behind the last, 0.
        end: (K,) sample at which it ends; one may begin at the same sample.
        count: how many there are.
    """

    begin: PyTree
    end: Values
    count: Counts


class Since(NamedTuple):
    """At each sample, since the mark before it (at a mark, since the mark before that).

    Attributes:
        change: J, the integral of the filtered signal [m/s].
        time: [s].
        filtered: y, the signal without what is slow [m/s²].
    """

    change: Values
    time: Values
    filtered: Values


class Placed(NamedTuple):
    """Which cycle a sample is in, each from behind its begin up to and with its end.

    Attributes:
        inside: (T,) bool, in some cycle.
        number: (T,) which; 0 outside.
        ended: (T,) how many ended before this sample.
        restart: (T,) bool, a cycle begins or ends here.
        valid: (K,) bool, there is such a cycle.
    """

    inside: Values
    number: Values
    ended: Values
    restart: Flags
    valid: Flags


def weight(part: ArrayLike, beta: ArrayLike = 0.1) -> Array:
    """How much the reverse integral counts, w; from 0 to 1, the steeper in the middle the smaller β.

    Args:
        part: t / T, how much of the cycle has passed [1].
        beta: β > 0 [1]; the larger, the nearer to t / T.
    """
    s = jnp.asarray(part)
    return 0.5 + 0.5 * jnp.arctan((s - 0.5) / beta) / jnp.arctan(jnp.asarray(0.5 / beta, s.dtype))


def direct(
    acc: ArrayLike, start: ArrayLike, dt: ArrayLike, cutoff_hz: ArrayLike = 0.0, mask: ArrayLike | None = None
) -> Array:
    """OFI of one cycle, or of a whole recording: v_i + J(t).

    Args:
        acc: (T,) acceleration [m/s²], finite.
        start: v_i, at the first sample [m/s].
        dt: sample time [s], or (T,) that from the sample before.
        cutoff_hz: f_c [Hz].
        mask: (T,) bool, False in the padding behind the last sample; None: no padding.

    Returns:
        (T,) velocity [m/s]; in the padding, that of the last sample.

    Raises:
        ValueError: if there is no sample, they are not floating point, or dt or mask do not fit.
    """
    return start + since(*signal_and_steps(acc, dt, mask), cutoff_hz).change


def direct_reverse(
    acc: ArrayLike, start: ArrayLike, end: ArrayLike, dt: ArrayLike, cutoff_hz: ArrayLike = 0.0,
    beta: ArrayLike = 0.1, mask: ArrayLike | None = None,
) -> Array:  # fmt: skip
    """OFDRI of one cycle whose first and last velocity are known.

    Args:
        acc: (T,) acceleration [m/s²], finite.
        start: v_i, at the first sample [m/s].
        end: v_f, at the last sample [m/s].
        dt: sample time [s], or (T,) that from the sample before.
        cutoff_hz: f_c [Hz].
        beta: β of the weight [1].
        mask: (T,) bool, False in the padding behind the last sample; None: no padding.

    Returns:
        (T,) velocity [m/s]; in the padding, v_f.

    Raises:
        ValueError: as `direct`.
    """
    found = since(*signal_and_steps(acc, dt, mask), cutoff_hz)
    return start + found.change - weight(_part(found.time, found.time[-1]), beta) * (start + found.change[-1] - end)


def optimum_cutoff(
    acc: ArrayLike, change: ArrayLike, dt: ArrayLike, highest_hz: ArrayLike = HIGHEST, mask: ArrayLike | None = None
) -> Array:
    """The cut-off by the optimum rule, of one cycle.

    Args:
        acc: (T,) acceleration [m/s²], finite.
        change: v_f − v_i, by how much the velocity is known to change over the cycle [m/s].
        dt: sample time [s], or (T,) that from the sample before.
        highest_hz: f_max [Hz].
        mask: (T,) bool, False in the padding behind the last sample; None: no padding.

    Returns:
        f_c [Hz], from 0 to f_max.

    Raises:
        ValueError: as `direct`.
    """
    values, steps = signal_and_steps(acc, dt, mask)
    data = (values, steps, jnp.asarray(change, values.dtype))

    def residual(cutoff: Values, given: Values) -> Values:
        return _scanned(given[0], given[1], cutoff)[0] - given[2]

    return _least(residual, data, (), highest_hz)


def direct_reverse_cycles(
    acc: ArrayLike, cycles: Cycles, start: ArrayLike, end: ArrayLike, dt: ArrayLike, cutoff_hz: ArrayLike = 0.0,
    beta: ArrayLike = 0.1, mask: ArrayLike | None = None,
) -> Array:  # fmt: skip
    """OFDRI of every cycle of a recording.

    Args:
        acc: (T,) acceleration [m/s²], finite.
        cycles: where they are.
        start: v_i, one or (K,) [m/s].
        end: v_f, one or (K,) [m/s].
        dt: as of `direct_reverse`.
        cutoff_hz: f_c [Hz], one or (K,).
        beta: as of `direct_reverse`.
        mask: as of `direct_reverse`.

    Returns:
        (T,) velocity [m/s], of each cycle from behind its begin up to and with its end; 0 elsewhere.

    Raises:
        ValueError: as `direct`, or if the cycles do not fit.
    """
    values, steps = signal_and_steps(acc, dt, mask)
    at = placed(cycles, values.shape[0])
    begun, ended = (jnp.broadcast_to(jnp.asarray(v, values.dtype), at.valid.shape) for v in (start, end))
    found = since(values, steps, per_sample(cutoff_hz, at, values.dtype), at.restart)
    going = begun[at.number] + found.change
    missed = begun + found.change[cycles.end] - ended
    return jnp.where(at.inside, going - reverse_share(found, cycles, at, beta) * missed[at.number], 0.0)


def optimum_cutoffs(
    acc: ArrayLike, cycles: Cycles, change: ArrayLike, dt: ArrayLike, highest_hz: ArrayLike = HIGHEST,
    mask: ArrayLike | None = None,
) -> Array:  # fmt: skip
    """The cut-off by the optimum rule, of every cycle of a recording.

    Args:
        acc: (T,) acceleration [m/s²], finite.
        cycles: where they are.
        change: v_f − v_i, one or (K,) [m/s].
        dt: as of `optimum_cutoff`.
        highest_hz: as of `optimum_cutoff`.
        mask: as of `optimum_cutoff`.

    Returns:
        f_c (K,) [Hz]; 0 where there is no cycle.

    Raises:
        ValueError: as `direct_reverse_cycles`.
    """
    values, steps = signal_and_steps(acc, dt, mask)
    at = placed(cycles, values.shape[0])
    wanted = jnp.where(at.valid, jnp.asarray(change, values.dtype), 0.0)

    def residual(cutoff: Values, given: Values) -> Values:
        ends = since(given[0], given[1], per_sample(cutoff, at, values.dtype), at.restart).change[cycles.end]
        return jnp.where(at.valid, ends - given[2], 0.0)

    return _least(residual, (values, steps, wanted), at.valid.shape, highest_hz)


def placed(cycles: Cycles, samples: int) -> Placed:
    """Which cycle each sample is in.

    Args:
        cycles: where they are.
        samples: T; static.

    Raises:
        ValueError: if begins and ends are not as many, or there is no room for any.
    """
    shape = jnp.shape(cycles.begin)
    if len(shape) != 1 or shape[0] < 1 or jnp.shape(cycles.end) != shape:
        raise ValueError(f"begin and end of cycles must be (K,) with K >= 1; got {shape} and {jnp.shape(cycles.end)}")
    valid = jnp.arange(shape[0], dtype=jnp.int32) < jnp.asarray(cycles.count).astype(jnp.int32)
    flags = marks(cycles.begin, cycles.end, samples, valid)
    begun, ended = (jnp.cumsum(flag, dtype=jnp.int32) - flag.astype(jnp.int32) for flag in flags)
    inside = begun > ended
    return Placed(inside, jnp.where(inside, begun - 1, 0), ended, flags.begin | flags.end, valid)


def since(acc: Array, steps: Array, cutoff_hz: ArrayLike, restart: ArrayLike | None = None) -> Since:
    """J(t) and the time since the mark before each sample; filter and integral start anew at marks.

    Args:
        acc: (T,) [m/s²].
        steps: (T,) time from the sample before, 0 at the first and in padding [s].
        cutoff_hz: f_c [Hz], one, or (T,) that for the interval up to each sample.
        restart: (T,) bool, marks; None: only the first sample.
    """
    return _scanned(acc, steps, cutoff_hz, restart)[1]


def _scanned(acc: Array, steps: Array, cutoff_hz: ArrayLike, restart: ArrayLike | None = None) -> tuple[Array, Since]:
    """What `since` says, and J behind the last sample for those who need no more: nothing is then stored."""
    anew = jnp.zeros(acc.shape, bool) if restart is None else jnp.asarray(restart)
    shares = _share(cutoff_hz, steps)

    def one(state: PyTree, sample: PyTree) -> PyTree:
        low, change, time, before = state
        now, share, step, mark = sample
        low = low + share * (now - low)
        found = Since(change + 0.5 * step * (before + now - low), time + step, now - low)
        kept = jnp.where(mark, 0.0, 1.0).astype(now.dtype)
        return (kept * low, kept * found.change, kept * found.time, now - kept * low), found

    nothing = jnp.zeros_like(acc[0])
    samples = (acc, shares, steps, anew)
    (_, last, _, _), found = lax.scan(one, (nothing, nothing, nothing, acc[0]), samples, unroll=UNROLL)
    return last, found


def reverse_share(found: Since, cycles: Cycles, at: Placed, beta: ArrayLike) -> Array:
    """The weight w (T,) in the cycle that each sample is in; means nothing outside."""
    return weight(_part(found.time, found.time[cycles.end][at.number]), beta)


def per_sample(values: ArrayLike, at: Placed, dtype: DTypeLike) -> Array:
    """One value, or those (K,) of cycles, at the samples (T,); 0 outside cycles where they are (K,)."""
    given = jnp.asarray(values, dtype)
    return given if given.ndim == 0 else jnp.where(at.inside, given[at.number], 0.0)


def _share(cutoff_hz: ArrayLike, steps: Values) -> Values:
    """1 − α."""
    turned = 2.0 * jnp.pi * jnp.asarray(cutoff_hz, steps.dtype) * steps
    return turned / (1.0 + turned)


def _part(time: Values, whole: Values) -> Values:
    """How much has passed, t / T; 0 in a cycle of one sample."""
    return time / jnp.where(whole > 0.0, whole, 1.0)


def signal_and_steps(acc: ArrayLike, dt: ArrayLike, mask: ArrayLike | None) -> tuple[Array, Array]:
    """The samples, and the time from the sample before each; padding takes none, and reads nothing."""
    values = jnp.asarray(acc)
    if values.ndim != 1 or values.shape[0] < 1 or not jnp.issubdtype(values.dtype, jnp.floating):
        raise ValueError(f"a signal must be (T,) floating point with T >= 1; got {values.shape} {values.dtype}")
    there = jnp.arange(values.shape[0]) > 0
    steps = jnp.asarray(dt, values.dtype)
    if steps.shape not in ((), values.shape):
        raise ValueError(f"dt must be one number or {values.shape} as the signal; got shape {steps.shape}")
    if mask is not None:
        real = jnp.asarray(mask, bool)
        if real.shape != values.shape:
            raise ValueError(f"the mask must be {values.shape} as the signal; got shape {real.shape}")
        values, there = jnp.where(real, values, 0.0), there & real
    return values, jnp.where(there, steps, 0.0)


def _least(
    residual: Callable[[Values, Values], Values], data: Values, shape: tuple[int, ...], highest_hz: ArrayLike
) -> Array:
    """Where |residual(f, data)| is least over [0, f_max], each entry of f by itself, with the implicit gradient.

    A grid finds the first change of sign, or else the lowest point; Newton's steps, halving where they leave the
    bracket, do the rest. A bracket of a lowest point in which the sign turns out to change is narrowed to that change.
    """
    still = jax.tree.map(lax.stop_gradient, data)
    most = jnp.broadcast_to(jnp.asarray(highest_hz, data[0].dtype), shape)
    top = lax.stop_gradient(most)

    def slopes(f: Values, given: Values = still) -> Values:
        """Residual and its slope along f."""
        return jax.jvp(lambda x: residual(x, given), (f,), (jnp.ones_like(f),))

    def curved(f: Values) -> Values:
        (value, slope), (_, bend) = jax.jvp(slopes, (f,), (jnp.ones_like(f),))
        return value, slope, bend

    parts = jnp.arange(GRID + 1, dtype=top.dtype) / GRID
    values = jax.vmap(lambda part: residual(part * top, still))(parts)
    crosses = jnp.sign(values[:-1]) != jnp.sign(values[1:])
    root, lowest = jnp.any(crosses, axis=0), jnp.argmin(jnp.abs(values), axis=0)
    first = jnp.argmax(crosses, axis=0)
    low = parts[jnp.where(root, first, jnp.maximum(lowest - 1, 0))] * top
    high = parts[jnp.where(root, first + 1, jnp.minimum(lowest + 1, GRID))] * top
    sign = jnp.sign(values[0])
    # Without a change of sign the end of the range may be the lowest point.
    edges = jax.vmap(slopes)(jnp.stack([0.0 * top, top]))[1]
    bottom = (sign == 0.0) | (~root & (lowest == 0) & (sign * edges[0] >= 0.0))
    ceiling = ~root & (lowest == GRID) & (sign * edges[1] <= 0.0)

    def narrow(_: Values, state: PyTree) -> Values:
        f, low, high, root = state
        value, slope, bend = curved(f)
        beyond = sign * value <= 0.0
        root = root | beyond
        right = jnp.where(root, beyond, sign * slope > 0.0)
        low, high = jnp.where(right, low, f), jnp.where(right, f, high)
        off, rise = jnp.where(root, value, slope), jnp.where(root, slope, bend)
        newton = f - off / jnp.where(rise == 0.0, 1.0, rise)
        good = (rise != 0.0) & (newton >= low) & (newton <= high)
        return jnp.where(good, newton, 0.5 * (low + high)), low, high, root

    # A chord across the change of sign is nearer than the middle.
    ends = [jnp.take_along_axis(values, (first + i)[None], axis=0)[0] for i in (0, 1)]
    across = jnp.where(root, ends[0] - ends[1], 2.0)
    share = jnp.where(root, ends[0], 1.0) / jnp.where(across == 0.0, 1.0, across)
    f, _, _, root = lax.fori_loop(0, REFINED, narrow, (low + share * (high - low), low, high, root))
    _, slope, bend = curved(f)
    rise = jnp.where(root, slope, bend)
    value, slope = slopes(f, data)
    off = jnp.where(root, value, slope)
    moved = (off - lax.stop_gradient(off)) / jnp.where(rise == 0.0, jnp.inf, rise)
    return jnp.where(bottom, 0.0, jnp.where(ceiling, most, f - moved))
