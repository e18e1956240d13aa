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

The results are differentiable in the acceleration, the initial velocity, the highest cut-off and β; the gradient in ε
and in the cycles' begin and end is zero.

Source: A. Köse, A. Cereatti, U. Della Croce, "Estimation of traversed distance in level walking using a single inertial
measurement unit attached to the waist", 2011, section 2.1c.

Readings:
    1. v_f − v_i "lower than" ε is meant without its sign; by OFI it is J(T) whatever v_i.
    2. The first three initial heel strikes are those at which cycles 1, 2 and 3 begin: cycles 1 and 2 are integrated,
       the third is the first that may be corrected.
    3. OFI has no high-pass. OFDRI's cut-off is that of the optimum rule, for each cycle by itself, or 0.
"""

from typing import Annotated, NamedTuple

import jax.numpy as jnp
from jax import lax
from jax.typing import ArrayLike
from jaxtyping import PyTree

from jgait.estimators.waist.ofdri import (
    HIGHEST,
    Cycles,
    direct_reverse_cycles,
    optimum_cutoffs,
    placed,
    signal_and_steps,
)
from jgait.params import Param, Parameter, documented, fixed, positive
from jgait.signal.marks import marks
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
