r"""Distance by the paper's method: Köse's velocity update, over direct and reverse integration of every gait cycle.

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

From the start (standing: 0) up to the first heel strike and over the first cycles, the velocity is integrated (OFI).
In each later cycle, which begins with v_i, OFI gives the final velocity v_f = v_i + J(T). With the gate

    G = 1 if |v_f − v_i| < ε, else 0,

    v = (1 − G) OFI(v_i) + G OFDRI(v_i, v_f := v_i),   v_i of the next cycle: v_i + (1 − G) J(T):

a change of less than ε is removed as drift, and a larger change is kept as a change of speed. A slow change of speed,
less than ε in every cycle, is removed too; without an update, successive cycles begin with the same velocity. After the
last cycle, and between cycles that do not touch, the velocity is that of OFI. The displacement is the integral of v by
trapezoids. If a recording has several bouts, OFI restarts at samples whose velocity is known, and the initial heel
strikes are counted in each bout.

Every integral is a `lax.scan` that restarts at marks, differentiable in signal, cut-off, β and the velocities; marks
and ε carry no gradient.

Optimum rule (`optimum_cutoffs`): the cut-off in [0, f_max] that minimises |g|, g = v_i + J(T) − v_f; if several make g
zero, the lowest. The cut-off's gradient is that of the implicit function: −g_θ / g_f where g = 0, −g_fθ / g_ff where
|g| has a minimum above zero inside the range; it is zero at 0, and that of f_max at f_max. First derivatives only.

Source: A. Köse, A. Cereatti, U. Della Croce, "Estimation of traversed distance in level walking using a single inertial
measurement unit attached to the waist", 2011, section 2.1c; integration after M. Zok, C. Mazzà, U. Della Croce, Med.
Eng. Phys. 26 (2004) 791.

Readings:
    1. v_f − v_i "lower than" ε is meant without its sign; by OFI it is J(T) whatever v_i.
    2. The first three initial heel strikes are those at which cycles 1, 2 and 3 begin: cycles 1 and 2 are integrated,
       the third is the first that may be corrected.
    3. OFI has no high-pass. OFDRI's cut-off is that of the optimum rule, for each cycle by itself, or 0. The filter and
       the optimum rule are not printed in the paper.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array, lax
from jax.typing import ArrayLike, DTypeLike
from jaxtyping import PyTree

from jgait.estimators.waist.inputs import WaistInputs
from jgait.estimators.waist.model import Intervals, WaistWalk, begun, earlier, turned_round
from jgait.estimators.waist.motion import TrunkMotion
from jgait.estimators.waist.params import VelocityUpdateParams, WaistParams
from jgait.geometry.arrays import put, xp
from jgait.signal.marks import marks
from jgait.types import Counts, Flags, Values

INITIAL = 3
"""Number of heel strikes of each bout that take their velocity from OFI (reading 2)."""


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
    """Weight w of the reverse integral, from 0 to 1, at the part t / T of the cycle; the smaller β, the steeper in the
    middle.
    """
    s = jnp.asarray(part)
    return 0.5 + 0.5 * jnp.arctan((s - 0.5) / beta) / jnp.arctan(jnp.asarray(0.5 / beta, s.dtype))


def direct_reverse_cycles(
    acc: ArrayLike, cycles: Cycles, start: ArrayLike, end: ArrayLike, dt: ArrayLike, cutoff_hz: ArrayLike = 0.0,
    beta: ArrayLike = 0.1,
) -> Array:  # fmt: skip
    """OFDRI of every cycle of a recording: (T,) velocity [m/s] after the begin of each cycle, up to and including its
    end; 0 elsewhere. `start`, `end` and `cutoff_hz` are one value or (K,).
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
    """J(t) and the time since the mark before each sample; filter and integral restart at marks. `steps` (T,) is the
    time from the sample before [s], 0 at the first sample and in padding; `cutoff_hz` one value or (T,).
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


def optimum_cutoffs(
    acc: ArrayLike, cycles: Cycles, change: ArrayLike, dt: ArrayLike, highest_hz: ArrayLike = 1.0
) -> Array:
    """The cut-off f_c (K,) [Hz] by the optimum rule, of every cycle of a recording; 0 where there is no cycle. `change`
    is v_f − v_i, one or (K,) [m/s]; the search ends at `highest_hz`.
    """
    values, steps = signal_and_steps(acc, dt)
    at = placed(cycles, values.shape[0])
    wanted = jnp.where(at.valid, jnp.asarray(change, values.dtype), 0.0)

    def residual(cutoff: Values, given: Values) -> Values:
        ends = since(given[0], given[1], per_sample(cutoff, at, values.dtype), at.restart).change[cycles.end]
        return jnp.where(at.valid, ends - given[2], 0.0)

    return _least(residual, (values, steps, wanted), at.valid.shape, highest_hz)


def _least(
    residual: Callable[[Values, Values], Values], data: Values, shape: tuple[int, ...], highest_hz: ArrayLike
) -> Array:
    """The f in [0, f_max] that minimises |residual(f, data)|, for each entry of f, with the implicit gradient.

    A grid brackets the first change of sign, or else the minimum. Newton steps refine f; a step out of the bracket is
    replaced by a bisection. If the sign changes in the bracket of a minimum, the search continues at that change.
    """
    still = jax.tree.map(lax.stop_gradient, data)
    most = jnp.broadcast_to(jnp.asarray(highest_hz, data[0].dtype), shape)
    top = lax.stop_gradient(most)

    def slopes(f: Values, given: Values = still) -> Values:
        """The residual at f, and its derivative with respect to f."""
        return jax.jvp(lambda x: residual(x, given), (f,), (jnp.ones_like(f),))

    def curved(f: Values) -> Values:
        (value, slope), (_, bend) = jax.jvp(slopes, (f,), (jnp.ones_like(f),))
        return value, slope, bend

    parts = jnp.arange(17, dtype=top.dtype) / 16.0
    values = jax.vmap(lambda part: residual(part * top, still))(parts)
    crosses = jnp.sign(values[:-1]) != jnp.sign(values[1:])
    root, lowest = jnp.any(crosses, axis=0), jnp.argmin(jnp.abs(values), axis=0)
    first = jnp.argmax(crosses, axis=0)
    low = parts[jnp.where(root, first, jnp.maximum(lowest - 1, 0))] * top
    high = parts[jnp.where(root, first + 1, jnp.minimum(lowest + 1, 16))] * top
    sign = jnp.sign(values[0])
    # Without a change of sign the minimum may lie at an end of the range.
    edges = jax.vmap(slopes)(jnp.stack([0.0 * top, top]))[1]
    bottom = (sign == 0.0) | (~root & (lowest == 0) & (sign * edges[0] >= 0.0))
    ceiling = ~root & (lowest == 16) & (sign * edges[1] <= 0.0)

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

    # The secant across the change of sign is a better first value than the middle of the bracket.
    ends = [jnp.take_along_axis(values, (first + i)[None], axis=0)[0] for i in (0, 1)]
    across = jnp.where(root, ends[0] - ends[1], 2.0)
    share = jnp.where(root, ends[0], 1.0) / jnp.where(across == 0.0, 1.0, across)
    f, _, _, root = lax.fori_loop(0, 6, narrow, (low + share * (high - low), low, high, root))
    _, slope, bend = curved(f)
    rise = jnp.where(root, slope, bend)
    value, slope = slopes(f, data)
    off = jnp.where(root, value, slope)
    moved = (off - lax.stop_gradient(off)) / jnp.where(rise == 0.0, jnp.inf, rise)
    return jnp.where(bottom, 0.0, jnp.where(ceiling, most, f - moved))


class Covered(NamedTuple):
    """Velocity and displacement over a recording and its cycles; rows without a cycle hold 0."""

    velocity: Values  #: (T,) forward velocity [m/s].
    displacement: Values  #: (T,) displacement since the first sample [m].
    start: Values  #: (K,) v_i, velocity at which each cycle begins [m/s].
    change: Values  #: (K,) v_f − v_i by OFI over the cycle alone [m/s].
    kept: Values  #: (K,) G, weight of OFDRI in the cycle [1].
    updated: Values  #: (K,) bool, OFI has more weight than OFDRI: the next cycle begins with OFI's velocity.
    length: Values  #: (K,) displacement over the cycle [m].
    valid: Flags  #: (K,) bool, the row holds a cycle.


def updated(
    p: VelocityUpdateParams, acc: ArrayLike, cycles: Cycles, dt: ArrayLike, start: ArrayLike = 0.0, *,
    optimum: bool = True, mask: ArrayLike | None = None, known: ArrayLike | None = None, initial: int = INITIAL,
) -> Covered:  # fmt: skip
    """The velocity update.

    Args:
        p: parameters.
        acc: (T,) forward acceleration, without gravity [m/s²], finite.
        cycles: from heel strike to heel strike of one side.
        dt: sample time [s], or (T,) time from the sample before.
        start: velocity at the first sample and wherever it is known, one or (T,) [m/s]; 0 when standing.
        optimum: whether OFDRI's cut-off is that of the optimum rule, or 0; static.
        mask: (T,) bool, False in the padding behind the last sample; None: no padding.
        known: (T,) bool, a bout begins with the velocity `start`. Samples in a cycle, its end included, are ignored.
            None: only the first sample.
        initial: number of heel strikes of each bout that take their velocity from OFI; static.
    """
    values, steps = signal_and_steps(acc, dt, mask)
    at = placed(cycles, values.shape[0])
    begins, ends = marks(cycles.begin, cycles.end, values.shape[0], at.valid)
    given = jnp.zeros_like(at.inside) if known is None else jnp.asarray(known, bool) & ~at.inside
    speed = jnp.broadcast_to(jnp.asarray(start, values.dtype), values.shape)
    gains = 0.5 * steps * (values + jnp.concatenate([values[:1], values[:-1]]))

    def integrate(state: PyTree, sample: PyTree) -> PyTree:
        """One sample: OFI's velocity, that at which the next interval begins, and G where a cycle ends."""
        before, begun, count = state
        gain, begin, end, anew, known_speed = sample
        direct = before + gain
        kept = end & (count >= initial - 1) & (jnp.abs(direct - begun) < p.threshold)
        after = jnp.where(anew, known_speed, jnp.where(kept, begun, direct))
        count = jnp.where(anew, 0, count + end.astype(jnp.int32))
        return (after, jnp.where(begin, after, begun), count), (direct, after, kept)

    rows = (gains, begins, ends, given, speed)
    direct, after, kept = lax.scan(integrate, (speed[0], speed[0], jnp.int32(0)), rows)[1]
    begun, kept = (jnp.where(at.valid, v, 0.0) for v in (after[cycles.begin], kept[cycles.end].astype(values.dtype)))
    cutoff = optimum_cutoffs(values, cycles, 0.0, steps, p.highest_hz) if optimum else 0.0
    both = direct_reverse_cycles(values, cycles, begun, begun, steps, cutoff, p.beta)
    velocity = direct + jnp.where(at.inside, kept[at.number], 0.0) * (both - direct)
    # at a mark the velocity may jump: the interval after it begins with the velocity after the jump
    left = jnp.where(at.restart | given, after, velocity)[:-1]
    way = jnp.concatenate([jnp.zeros_like(velocity[:1]), jnp.cumsum(0.5 * steps[1:] * (left + velocity[1:]))])
    change, length = (
        jnp.where(at.valid, v[cycles.end] - u, 0.0) for v, u in ((direct, begun), (way, way[cycles.begin]))
    )
    return Covered(velocity, way, begun, change, kept, at.valid & (kept < 0.5), length, at.valid)


def bouts_begin(p: WaistParams, inputs: WaistInputs, like: Values) -> tuple[Values, Values]:
    """Samples at which a bout begins (T,) bool, and the initial speed: 0 after standing, else `start_speed` [m/s], in
    the dtype of `like` (T,).
    """
    at = xp.where(inputs.fresh, inputs.at, like.shape[0])
    starts = xp.where(inputs.stands, 0.0, p.start_speed)
    return put(xp.zeros_like(inputs.valid), at, True), put(xp.zeros_like(like), at, starts.astype(like.dtype))


def integrated_speed(
    p: WaistParams, inputs: WaistInputs, motion: TrunkMotion, intervals: Intervals,
    initial: int = INITIAL,
) -> tuple[Values, Values]:  # fmt: skip
    """Mean speed over each interval by integration (K,) [m/s], and whether OFDRI was used over the interval."""
    known, start = bouts_begin(p, inputs, motion.forward)
    cycles = Cycles(inputs.cycle_begin, inputs.cycle_end, inputs.cycles)
    covered = updated(
        p.update, motion.forward, cycles, inputs.dt, start, mask=inputs.valid, known=known, initial=initial
    )
    here = covered.displacement[inputs.at]
    duration = xp.where(intervals.duration > 0.0, intervals.duration, 1.0)
    ends = put(xp.zeros_like(inputs.valid), inputs.cycle_end, covered.kept > 0.5, "max")
    ended = ends[inputs.at]
    held = ended | xp.concatenate([ended[1:], xp.zeros_like(ended[:1])])
    return (here - earlier(here, 1)) / duration, held & inputs.steps


def by_integration(
    p: WaistParams, inputs: WaistInputs, intervals: Intervals, speed: Values, held: Flags, start_sd: Values
) -> WaistWalk:
    """Distance by the paper's method, and its standard deviation.

    A bias b of the forward acceleration causes an error b t of the speed, which grows up to the cycle from which OFDRI
    holds the speed (`held`); a turn of the walk reverses the bias. The initial speed of a bout that does not begin from
    standing has the deviation `start_sd` (K,) [m/s]. Errors of bouts add up, because all have the same bias. `speed`
    (K,) is the mean over each interval [m/s].
    """
    step = xp.where(inputs.moves, intervals.duration * speed, 0.0)
    distance = xp.cumsum(step)
    turned = turned_round(inputs, intervals)
    known = xp.where(xp.any(inputs.still), p.acc_bias, p.acc_bias_unknown)
    free = xp.where(inputs.moves & (~held | ~inputs.stood), intervals.duration, 0.0)
    bias = known + xp.where(turned, p.acc_bias_turn, 0.0)
    drifted = xp.cumsum(bias * free)
    wrong = start_sd + drifted - drifted[begun(inputs)]
    off = xp.cumsum(xp.where(inputs.moves, wrong * intervals.duration, 0.0))
    stride, two = step + earlier(step, 1), intervals.duration + earlier(intervals.duration, 1)
    spread = wrong * intervals.duration
    return WaistWalk(distance, off, step, spread, stride, wrong * two, ~inputs.stood | turned, {})
