"""The cut-off of the high-pass over a gait cycle that makes the integral fit the known change of velocity.

Optimum rule (`optimum_cutoffs`): the cut-off in [0, f_max] that minimises |g|, g = v_i + J(T) − v_f; if several make g
zero, the lowest. The cut-off's gradient is that of the implicit function: −g_θ / g_f where g = 0, −g_fθ / g_ff where
|g| has a minimum above zero inside the range; it is zero at 0, and that of f_max at f_max. First derivatives only.

Source: A. Köse, A. Cereatti, U. Della Croce, "Estimation of traversed distance in level walking using a single inertial
measurement unit attached to the waist", 2011, section 2.1c. The rule is not printed there; it is a reading.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import Array, lax
from jax.typing import ArrayLike
from jaxtyping import PyTree

from jgait.estimators.waist.ofdri import Cycles, per_sample, placed, signal_and_steps, since
from jgait.types import Values

HIGHEST = 1.0
"""[Hz] Upper limit of the search for a cut-off; the high-pass has to pass steps, one to two a second."""

GRID, REFINED = 16, 6
"""Number of intervals that the search checks for a change of sign; number of Newton steps in the interval found."""


def optimum_cutoffs(
    acc: ArrayLike, cycles: Cycles, change: ArrayLike, dt: ArrayLike, highest_hz: ArrayLike = HIGHEST
) -> Array:
    """The cut-off f_c (K,) [Hz] by the optimum rule, of every cycle of a recording; 0 where there is no cycle.

    `change` is v_f − v_i, one or (K,) [m/s]; the search ends at `highest_hz`, other arguments as of
    `direct_reverse_cycles`.
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

    parts = jnp.arange(GRID + 1, dtype=top.dtype) / GRID
    values = jax.vmap(lambda part: residual(part * top, still))(parts)
    crosses = jnp.sign(values[:-1]) != jnp.sign(values[1:])
    root, lowest = jnp.any(crosses, axis=0), jnp.argmin(jnp.abs(values), axis=0)
    first = jnp.argmax(crosses, axis=0)
    low = parts[jnp.where(root, first, jnp.maximum(lowest - 1, 0))] * top
    high = parts[jnp.where(root, first + 1, jnp.minimum(lowest + 1, GRID))] * top
    sign = jnp.sign(values[0])
    # Without a change of sign the minimum may lie at an end of the range.
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

    # The secant across the change of sign is a better first value than the middle of the bracket.
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
