"""Smooth functions of the walking model: steps that start and end at rest, and curves through given points.

Steps are constant outside [0, 1], so that a foot in stance is exactly at rest, and six times continuously
differentiable, so that sums over samples converge fast to integrals.
"""

import math

import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Int

from jgait.geometry.jets import Jet, chained, part, parts, stacked
from jgait.geometry.vectors import kept
from jgait.types import AnyArray, Values

ORDER = 6
"""A step's derivatives up to this order vanish at both ends."""

_SLOPE = 1.0 / sum(math.comb(ORDER, k) * (-1) ** k / (2 * k + 1) for k in range(ORDER + 1))
"""Slope of a step in its middle, over 2: one over the integral of (1 − x²)⁶ from 0 to 1."""

_INTEGRAL = tuple(_SLOPE * math.comb(ORDER, k) * (-1) ** k / (2 * k + 1) / 2.0 for k in range(ORDER + 1))
"""Coefficients of x, x³ … of a step less one half."""


def step(u: Values) -> Values:
    """From 0 at u ≤ 0 to 1 at u ≥ 1:  ∫ (1 − x²)⁶ dx, normalised, with x = 2u − 1."""
    x = jnp.clip(2.0 * u - 1.0, -1.0, 1.0)
    square = x * x
    total = jnp.zeros_like(x)
    for coefficient in reversed(_INTEGRAL):
        total = total * square + coefficient
    return 0.5 + x * total


def ramp(u: Values) -> Values:
    """The integral of `step`: 0 at u ≤ 0, u − 1/2 at u ≥ 1."""
    x = jnp.clip(2.0 * u - 1.0, -1.0, 1.0)
    square = x * x
    total = jnp.zeros_like(x)
    for k, coefficient in reversed(list(enumerate(_INTEGRAL))):
        total = total * square + coefficient / (2.0 * k + 2.0)
    # The constant makes the integral 0 at x = −1.
    least = sum(c / (2.0 * k + 2.0) for k, c in enumerate(_INTEGRAL))
    return 0.5 * (0.5 * (x + 1.0) + square * total - least) + jnp.maximum(u - 1.0, 0.0)


def glide(u: Jet, gather: Values, lose: Values) -> Jet:
    """From 0 at u ≤ 0 to 1 at u ≥ 1: acceleration in the first share `gather`, deceleration in the last, `lose`."""
    both = stacked([u / gather, (u - 1.0 + lose) / lose])
    now = kept(both.value)
    begins, ends = parts(chained(ramp(now), step(now), _SLOPE * bump(now), both))
    return (begins * gather - ends * lose) / (1.0 - 0.5 * (gather + lose))


def smooth_step(u: Jet) -> Jet:
    """As `step`, of a jet."""
    height, slope, _ = _bump(u.value, ORDER)
    return chained(step(u.value), _SLOPE * height, _SLOPE * slope, u)


def bump(u: Values) -> Values:
    """From 0 to 1 at u = 1/2 and back to 0: (1 − x²)⁶ with x = 2u − 1, 0 outside (0, 1)."""
    height = 4.0 * u * (1.0 - u)
    return jnp.where(height > 0.0, height, 0.0) ** ORDER


def smooth_bump(u: Jet, order: int = ORDER) -> Jet:
    """As `bump`, of a jet, with another power than 6."""
    return chained(*_bump(u.value, order), u)


def _bump(u: Values, order: int) -> tuple[Values, Values, Values]:
    """A bump with its first and second derivative."""
    height = 4.0 * u * (1.0 - u)
    height = jnp.where(height > 0.0, height, 0.0)
    slope, last = 4.0 - 8.0 * u, height ** (order - 2)
    once = last * height
    return once * height, order * once * slope, order * ((order - 1.0) * last * slope * slope - 8.0 * once)


CURVE = 10
"""Number of coefficients of one piece of a curve."""


def _hermite() -> np.ndarray:
    """(CURVE, 6): coefficients of 1, r … from value, slope and curvature at 0 and rise, slope and curvature at 1."""
    half = CURVE // 2
    powers = np.arange(CURVE)
    rows = []
    for at in (0.0, 1.0):
        for order in range(half):
            falling = np.array([math.perm(int(p), order) if p >= order else 0 for p in powers], float)
            rows.append(falling * np.where(powers == order, 1.0, at))
    inverse = np.linalg.inv(np.array(rows))
    table = np.round(inverse[:, [0, 1, 2, half, half + 1, half + 2]], 10)
    # The rise is the value at r = 1 relative to that at r = 0, so that no precision is lost far from the start.
    table[1:, 0] = 0.0
    return table


HERMITE = _hermite()


def pieces(
    values: Float[Array, "*curve knot"], moving: Float[Array, "*curve knot"], *, monotone: bool = False
) -> Float[Array, "*curve interval coefficient"]:
    """Curves through given points, four times continuously differentiable, at rest where nothing moves.

    Slope and curvature at each point are central differences; the third and fourth derivative are 0.

    Args:
        values: (…, K) at r = 0, 1 … K − 1.
        moving: (…, K) 1 where the curve moves through the point, 0 where it rests at the point.
        monotone: keep the curve between its points: curvature 0 at all points, slope 0 at the extreme points.

    Returns:
        (…, K − 1, CURVE) coefficients of 1, r … in each interval.
    """
    rise = values[..., 1:] - values[..., :-1]
    none = jnp.zeros_like(values[..., :1])
    back, on = jnp.concatenate([none, rise], axis=-1), jnp.concatenate([rise, none], axis=-1)
    if monotone:
        slope = moving * jnp.maximum(back * on, 0.0) * (back + on) / (back * back + on * on + 1e-9)
        curvature = jnp.zeros_like(slope)
    else:
        slope, curvature = moving * (back + on) / 2.0, moving * (on - back)
    ends = (values[..., :-1], slope[..., :-1], curvature[..., :-1], rise, slope[..., 1:], curvature[..., 1:])
    hermite = jnp.asarray(HERMITE, values.dtype).reshape((1,) * values.ndim + HERMITE.shape)
    # Explicit sums: a matrix product would lose precision on some devices.
    return jnp.sum(jnp.stack(ends, axis=-1)[..., None, :] * hermite, axis=-1)


def coefficients(
    table: Float[AnyArray, "*curve interval coefficient"], entry: Int[Array, "*shape"]
) -> Float[Array, "coefficient ..."]:
    """The coefficients of 1, r … of curves (see `pieces`) in the intervals `entry`, (CURVE, *curve, *shape)."""
    return jnp.moveaxis(table, -1, 0)[..., entry]


def curve_at(table: Float[AnyArray, "*curve interval coefficient"], entry: Int[Array, "..."], r: Values) -> Values:
    """Curves (see `pieces`) in the intervals `entry` (T,), at the shares r (T,) of the intervals: (*curve, T)."""
    return polynomial(coefficients(table, entry), jnp.expand_dims(r, tuple(range(table.ndim - 2))))[0]


def smooth_curve(table: Float[AnyArray, "*curve interval coefficient"], entry: Int[Array, "..."], r: Jet) -> Jet:
    """As `curve_at`, of a jet: (*curve, T)."""
    beside = part(r, *(None,) * (table.ndim - 2))
    return chained(*kept(polynomial(coefficients(table, entry), beside.value)), beside)


def polynomial(coefficients: Float[AnyArray, "coefficient ..."], r: Values) -> tuple[Values, Values, Values]:
    """Value, first and second derivative of Σ cᵢ rⁱ, with the coefficients along the first axis."""

    def onward(now: tuple[Values, Values, Values], c: Values) -> tuple[tuple[Values, Values, Values], None]:
        value, slope, half = now
        return (value * r + c, slope * r + value, half * r + slope), None

    none = jnp.zeros_like(coefficients[0] * r)
    # A loop, because the compiler takes as long for each power as for the loop.
    (value, slope, half), _ = lax.scan(onward, (none, none, none), coefficients, reverse=True)
    return value, slope, 2.0 * half
