r"""Walking speed from forward acceleration, cycle by cycle from a known initial speed: Köse's velocity update.

From the start (standing: 0) up to the first heel strike and over the first cycles, the velocity is integrated (OFI).
In each later cycle, which begins with v_i, OFI gives the final velocity v_f = v_i + J(T). With the gate

    G = 1 if |v_f − v_i| < ε, else 0,

    v = (1 − G) OFI(v_i) + G OFDRI(v_i, v_f := v_i),   v_i of the next cycle: v_i + (1 − G) J(T):

a change of less than ε is removed as drift, and a larger change is kept as a change of speed. A slow change of speed,
less than ε in every cycle, is removed too; without an update, successive cycles begin with the same velocity. After the
last cycle, and between cycles that do not touch, the velocity is that of OFI. The displacement is the integral of v by
trapezoids. If a recording has several bouts, OFI restarts at samples whose velocity is known, and the initial heel
strikes are counted in each bout.

`updated` is a `lax.scan` over cycles. The results are differentiable in the acceleration, the initial velocity,
cut-offs and β; the gradient in ε and in the cycles' begin and end is zero.

Source: A. Köse, A. Cereatti, U. Della Croce, "Estimation of traversed distance in level walking using a single inertial
measurement unit attached to the waist", 2011, section 2.1c.

Readings:
    1. v_f − v_i "lower than" ε is meant without its sign; by OFI it is J(T) whatever v_i.
    2. The first three initial heel strikes are those at which cycles 1, 2 and 3 begin: cycles 1 and 2 are integrated,
       the third is the first that may be corrected.
    3. OFI's cut-off is a parameter, 0 unless it is set. OFDRI's is that of the optimum rule (`optimum`), for each cycle
       by itself, or OFI's.
"""

from typing import Annotated, NamedTuple

import jax.numpy as jnp
from jax import Array, lax
from jax.typing import ArrayLike
from jaxtyping import PyTree

from jgait.estimators.waist.ofdri import Cycles, Placed, direct_reverse_cycles, placed, since
from jgait.estimators.waist.ofdri import signal_and_steps as _checked
from jgait.estimators.waist.optimum import HIGHEST, optimum_cutoffs
from jgait.params import Param, Parameter, documented, fixed, positive
from jgait.types import Flags, Values


@documented
class VelocityUpdateParams(NamedTuple):
    """Parameters, in natural units."""

    threshold: Annotated[Param, Parameter(
        positive, "m/s", "ε, the least change over a cycle that is taken for a change of speed",
    )] = 0.3  # fmt: skip
    cutoff_hz: Annotated[Param, Parameter(fixed, "Hz", "of OFI's high-pass, 0 for none")] = 0.0
    highest_hz: Annotated[Param, Parameter(fixed, "Hz", "f_max of the optimum rule")] = HIGHEST
    beta: Annotated[Param, Parameter(positive, "1", "β of OFDRI's weight")] = 0.1


INITIAL = 3
"""Number of heel strikes of each bout that take their velocity from OFI."""


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


class Sampled(NamedTuple):
    """The inputs that all methods of this module share, at samples (T,) or of cycles (K,).

    OFI restarts where the velocity is `given` and where a cycle begins or ends. `change` is J since then [m/s], `start`
    the last known velocity; `behind` is True if that velocity was known after the last cycle ended. `anew` (K,) is True
    if a velocity `begin` (K,) [m/s] was known between the cycle before and this one, or if there is no cycle before.
    """

    acc: Values
    steps: Values
    cycles: Cycles
    at: Placed
    given: Values
    restart: Flags
    change: Values
    start: Values
    behind: Values
    anew: Values
    begin: PyTree


def updated(
    p: VelocityUpdateParams, acc: ArrayLike, cycles: Cycles, dt: ArrayLike, start: ArrayLike = 0.0, *,
    optimum: bool = True, mask: ArrayLike | None = None, known: ArrayLike | None = None,
) -> Covered:  # fmt: skip
    """The velocity update.

    Args:
        p: parameters.
        acc: (T,) forward acceleration, without gravity [m/s²], finite.
        cycles: from heel strike to heel strike of one side.
        dt: sample time [s], or (T,) time from the sample before.
        start: velocity at the first sample and wherever it is known, one or (T,) [m/s]; 0 when standing.
        optimum: whether OFDRI's cut-off is that of the optimum rule, or OFI's; static.
        mask: (T,) bool, False in the padding behind the last sample; None: no padding.
        known: (T,) bool, a bout begins with the velocity `start`. Samples in a cycle, its end included, are ignored.
            None: only the first sample.

    Raises:
        ValueError: if shapes do not fit.
    """
    samples = sampled(p, acc, cycles, dt, start, mask, known)
    change, before, there = changes(samples)
    number = jnp.arange(there.shape[0])
    first = number - lax.cummax(jnp.where(samples.anew, number, 0)) < INITIAL - 1

    def update_cycle(v: Values, cycle: Values) -> PyTree:
        anew, begin, gap, gain, gated = cycle
        kept = (gated & (jnp.abs(gain) < p.threshold)).astype(gain.dtype)
        begun = jnp.where(anew, begin, v) + gap
        return begun + (1.0 - kept) * gain, (begun, kept)

    rows = (samples.anew, samples.begin, before, change, there & ~first)
    begun, kept = lax.scan(update_cycle, jnp.zeros_like(samples.acc[0]), rows)[1]
    return covered(p, samples, begun, kept, optimum=optimum)


def sampled(
    p: VelocityUpdateParams,
    acc: ArrayLike,
    cycles: Cycles,
    dt: ArrayLike,
    start: ArrayLike,
    mask: Values,
    known: Values,
) -> Sampled:
    """The shared inputs; arguments as of `updated`."""
    values, steps = _checked(acc, dt, mask)
    at = placed(cycles, values.shape[0])
    given = jnp.zeros_like(at.inside) if known is None else jnp.asarray(known, bool)
    starts = jnp.asarray(start, values.dtype)
    if given.shape != values.shape or starts.shape not in ((), values.shape):
        raise ValueError(
            f"known must be {values.shape} as the signal, start that or one number; got {given.shape}, {starts.shape}"
        )
    anew = given & ~at.inside
    starts = jnp.broadcast_to(starts, values.shape)
    restart = at.restart | anew
    change = since(values, steps, p.cutoff_hz, restart).change
    index = jnp.arange(values.shape[0], dtype=jnp.int32)
    upto = lax.cummax(jnp.where(anew, index, -1))
    before = jnp.concatenate([jnp.full_like(upto[:1], -1), upto[:-1]])
    ends = jnp.asarray(cycles.end).astype(jnp.int32)
    ended = jnp.where(at.ended > 0, ends[jnp.maximum(at.ended - 1, 0)], -1)
    # of each cycle, the last sample with a known velocity, up to and including the cycle's begin
    last = upto[cycles.begin]
    earlier = jnp.concatenate([jnp.full_like(ends[:1], -1), ends[:-1]])
    return Sampled(
        values, steps, cycles, at, anew, restart, change, starts[jnp.maximum(before, 0)], before >= ended,
        (last >= earlier) & at.valid, starts[jnp.maximum(last, 0)],
    )  # fmt: skip


def changes(samples: Sampled) -> tuple[Array, Array, Array]:
    """J over each cycle, J over the gap between the cycle before and this one, and whether the row holds a cycle."""
    begin, there = samples.cycles.begin, samples.at.valid
    # there is no gap if a cycle begins where the cycle before ends, or where the velocity is known
    gap = ~samples.at.inside[begin] & ~samples.given[begin]
    over = jnp.where(there, samples.change[samples.cycles.end], 0.0)
    return over, jnp.where(there & gap, samples.change[begin], 0.0), there


def covered(p: VelocityUpdateParams, samples: Sampled, begun: Array, kept: Array, *, optimum: bool) -> Covered:
    """Velocity at all samples, from the initial velocity of each cycle and the weight of OFDRI in it."""
    cycles, at = samples.cycles, samples.at
    change = changes(samples)[0]
    cutoff = optimum_cutoffs(samples.acc, cycles, 0.0, samples.steps, p.highest_hz) if optimum else p.cutoff_hz
    stop = begun + (1.0 - kept) * change
    behind = jnp.where(samples.behind, samples.start, stop[jnp.maximum(at.ended - 1, 0)])
    base = jnp.where(at.inside, begun[at.number], behind)
    direct = base + samples.change
    both = direct_reverse_cycles(samples.acc, cycles, begun, begun, samples.steps, cutoff, p.beta)
    velocity = direct + jnp.where(at.inside, kept[at.number], 0.0) * (both - direct)
    # At a mark the velocity may jump: the interval after the mark begins with the velocity after the jump.
    left = jnp.where(samples.restart[:-1], base[1:], velocity[:-1])
    way = way_of(jnp.concatenate([left, velocity[-1:]]), velocity, samples)
    return listed(samples, velocity, way, begun, change, kept)


def way_of(left: Array, velocity: Array, samples: Sampled) -> Array:
    """The displacement (T,), from the velocity at the begin and the end of the interval after each sample."""
    each = 0.5 * samples.steps[1:] * (left[:-1] + velocity[1:])
    return jnp.concatenate([jnp.zeros_like(velocity[:1]), jnp.cumsum(each)])


def listed(samples: Sampled, velocity: Array, way: Array, begun: Array, change: Array, kept: Array) -> Covered:
    """Velocity and displacement (T,), with the initial velocity, change and weight of OFDRI of the cycles (K,)."""
    there = samples.at.valid
    begun, change, kept = (jnp.where(there, v, 0.0) for v in (begun, change, kept))
    length = jnp.where(there, way[samples.cycles.end] - way[samples.cycles.begin], 0.0)
    return Covered(velocity, way, begun, change, kept, there & (kept < 0.5), length, there)
