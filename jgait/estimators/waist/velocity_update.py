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
the highest cut-off and β; the gradient in ε and in the cycles' begin and end is zero.

Source: A. Köse, A. Cereatti, U. Della Croce, "Estimation of traversed distance in level walking using a single inertial
measurement unit attached to the waist", 2011, section 2.1c.

Readings:
    1. v_f − v_i "lower than" ε is meant without its sign; by OFI it is J(T) whatever v_i.
    2. The first three initial heel strikes are those at which cycles 1, 2 and 3 begin: cycles 1 and 2 are integrated,
       the third is the first that may be corrected.
    3. OFI has no high-pass. OFDRI's cut-off is that of the optimum rule (`optimum`), for each cycle by itself, or 0.
"""

from typing import Annotated, NamedTuple

import jax.numpy as jnp
from jax import Array, lax
from jax.typing import ArrayLike
from jaxtyping import PyTree

from jgait.estimators.waist.ofdri import Cycles, Placed, direct_reverse_cycles, integral, placed, signal_and_steps
from jgait.estimators.waist.optimum import HIGHEST, optimum_cutoffs
from jgait.params import Param, Parameter, documented, fixed, positive
from jgait.types import Flags, Values


@documented
class VelocityUpdateParams(NamedTuple):
    """Parameters, in natural units."""

    threshold: Annotated[Param, Parameter(
        positive, "m/s", "ε, the least change over a cycle that is taken for a change of speed",
    )] = 0.3  # fmt: skip
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
    """The inputs that all methods of this module share, at samples (T,) or of cycles (K,)."""

    acc: Values
    steps: Values
    cycles: Cycles
    at: Placed
    total: Values  #: integral of the acceleration since the first sample [m/s].
    given: Values  #: bool, a velocity is known at the sample, and it is in no cycle.
    start: Values  #: velocity by OFI alone from the last known one before the sample [m/s].
    behind: Values  #: bool, that velocity was known after the last cycle ended.
    anew: Values  #: (K,) bool, a velocity was known between the cycle before and this one, or there is none before.
    begin: PyTree  #: (K,) velocity by OFI at the begin of the cycle from the last known one [m/s].
    gap: Values  #: (K,) J from the end of the cycle before to the begin of this one [m/s].
    change: Values  #: (K,) J over the cycle [m/s].


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
        optimum: whether OFDRI's cut-off is that of the optimum rule, or 0; static.
        mask: (T,) bool, False in the padding behind the last sample; None: no padding.
        known: (T,) bool, a bout begins with the velocity `start`. Samples in a cycle, its end included, are ignored.
            None: only the first sample.
    """
    samples = sampled(acc, cycles, dt, start, mask, known)
    number = jnp.arange(samples.anew.shape[0])
    first = number - lax.cummax(jnp.where(samples.anew, number, 0)) < INITIAL - 1

    def update_cycle(v: Values, cycle: Values) -> PyTree:
        anew, begin, gap, gain, gated = cycle
        kept = (gated & (jnp.abs(gain) < p.threshold)).astype(gain.dtype)
        begun = jnp.where(anew, begin, v + gap)
        return begun + (1.0 - kept) * gain, (begun, kept)

    rows = (samples.anew, samples.begin, samples.gap, samples.change, samples.at.valid & ~first)
    begun, kept = lax.scan(update_cycle, jnp.zeros_like(samples.acc[0]), rows)[1]
    return covered(p, samples, begun, kept, optimum=optimum)


def sampled(
    acc: ArrayLike, cycles: Cycles, dt: ArrayLike, start: ArrayLike, mask: ArrayLike | None, known: ArrayLike | None
) -> Sampled:
    """The shared inputs; arguments as of `updated`."""
    values, steps = signal_and_steps(acc, dt, mask)
    at, total = placed(cycles, values.shape[0]), integral(values, steps)
    given = jnp.zeros_like(at.inside) if known is None else jnp.asarray(known, bool) & ~at.inside
    upto = lax.cummax(jnp.where(given, jnp.arange(values.shape[0], dtype=jnp.int32), -1))
    before = jnp.concatenate([jnp.full_like(upto[:1], -1), upto[:-1]])
    began = jnp.broadcast_to(jnp.asarray(start, values.dtype), values.shape) - total

    def ofi(sample: Values, mark: Values) -> Values:
        return began[jnp.maximum(mark, 0)] + total[sample]

    begin, end = (jnp.asarray(each).astype(jnp.int32) for each in cycles[:2])
    ended = jnp.where(at.ended > 0, end[jnp.maximum(at.ended - 1, 0)], -1)
    last = jnp.concatenate([jnp.full_like(end[:1], -1), end[:-1]])  # sample at which the cycle before ended
    gap, change = total[begin] - total[jnp.maximum(last, 0)], total[end] - total[begin]
    return Sampled(
        values, steps, cycles, at, total, given, ofi(jnp.arange(values.shape[0]), before), before >= ended,
        (upto[begin] >= last) & at.valid, ofi(begin, upto[begin]), gap, jnp.where(at.valid, change, 0.0),
    )  # fmt: skip


def covered(p: VelocityUpdateParams, samples: Sampled, begun: Array, kept: Array, *, optimum: bool) -> Covered:
    """Velocity at all samples, from the initial velocity of each cycle and the weight of OFDRI in it."""
    cycles, at, total = samples.cycles, samples.at, samples.total
    cutoff = optimum_cutoffs(samples.acc, cycles, 0.0, samples.steps, p.highest_hz) if optimum else 0.0
    stop = begun + (1.0 - kept) * samples.change - total[cycles.end]
    behind = jnp.where(samples.behind, samples.start, stop[jnp.maximum(at.ended - 1, 0)] + total)
    direct = jnp.where(at.inside, (begun - total[cycles.begin])[at.number] + total, behind)
    both = direct_reverse_cycles(samples.acc, cycles, begun, begun, samples.steps, cutoff, p.beta)
    velocity = direct + jnp.where(at.inside, kept[at.number], 0.0) * (both - direct)
    # At a mark the velocity may jump: the interval after the mark begins with the velocity after the jump.
    jumps = (at.restart | samples.given)[:-1]
    left = jnp.where(jumps, direct[1:] - jnp.diff(total), velocity[:-1])
    return listed(samples, velocity, left, begun, kept)


def listed(samples: Sampled, velocity: Array, left: Array, begun: Array, kept: Array) -> Covered:
    """The results, from the velocity (T,), that at which the interval after each sample but the last begins (T − 1,),
    and the initial velocity and the weight of OFDRI of the cycles (K,).
    """
    each = 0.5 * samples.steps[1:] * (left + velocity[1:])
    way = jnp.concatenate([jnp.zeros_like(velocity[:1]), jnp.cumsum(each)])
    there = samples.at.valid
    begun, kept = (jnp.where(there, v, 0.0) for v in (begun, kept))
    length = jnp.where(there, way[samples.cycles.end] - way[samples.cycles.begin], 0.0)
    return Covered(velocity, way, begun, samples.change, kept, there & (kept < 0.5), length, there)
