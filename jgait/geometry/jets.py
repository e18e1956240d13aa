"""Jets: numbers that carry their first and second derivative with respect to time through arithmetic.

A function of +, −, *, / and the functions of this file then computes its own derivatives, exactly. Numbers and arrays
that are no jets are constant. All orders are one array, so that the compiler sees one operation instead of three.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import PyTree

from jgait.geometry.vectors import kept
from jgait.types import Values


class Jet(NamedTuple):
    """Numbers that depend on time."""

    orders: Values  #: (3, …) value, first and second derivative with respect to time; or (1, …), the value alone.

    @property
    def value(self) -> PyTree:
        """(…) the numbers themselves."""
        return self.orders[0]

    def __add__(self, other: PyTree) -> "Jet":
        """The sum."""
        if isinstance(other, Jet):
            return Jet(self.orders + other.orders)
        value, rates = self.orders[:1] + _raised(other), self.orders[1:]
        return Jet(jnp.concatenate([value, jnp.broadcast_to(rates, (len(rates), *value.shape[1:]))]))

    def __mul__(self, other: PyTree) -> "Jet":
        """The product: (a b)″ = a″ b + 2 a′ b′ + a b″."""
        if not isinstance(other, Jet):
            return Jet(self.orders * _raised(other))
        a, b = self.orders, other.orders
        value = a[:1] * b[:1]
        if len(a) == 1:
            return Jet(value)
        rate = a[1:2] * b[:1] + a[:1] * b[1:2]
        return Jet(jnp.concatenate([value, rate, a[2:] * b[:1] + 2.0 * a[1:2] * b[1:2] + a[:1] * b[2:]]))

    def __radd__(self, constant: PyTree) -> "Jet":
        """The sum."""
        return self + constant

    def __rmul__(self, constant: PyTree) -> "Jet":
        """The product."""
        return self * constant

    def __neg__(self) -> "Jet":
        """The opposite."""
        return Jet(-self.orders)

    def __sub__(self, other: PyTree) -> "Jet":
        """The difference."""
        return self + -other

    def __rsub__(self, other: PyTree) -> "Jet":
        """The difference from a constant."""
        return -self + other

    def __truediv__(self, constant: PyTree) -> "Jet":
        """The quotient by a constant."""
        return Jet(self.orders / _raised(constant))


def _raised(constant: PyTree) -> PyTree:
    """A constant beside the orders of a jet."""
    return constant if jnp.ndim(constant) == 0 else constant[None]


def chained(value: Values, slope: Values, bend: Values, of: Jet) -> Jet:
    """A function of a jet, from its value and its derivatives there: (f ∘ u)″ = f″ u′² + f′ u″."""
    if len(of.orders) == 1:
        return Jet(value[None])
    rate = of.orders[1]
    return kept(Jet(jnp.stack([value, slope * rate, bend * rate * rate + slope * of.orders[2]])))


def sin_cos(angle: Jet) -> tuple[Jet, Jet]:
    """Sine and cosine of an angle [rad]."""
    s, c = kept((jnp.sin(angle.value), jnp.cos(angle.value)))
    return chained(s, c, -s, angle), chained(c, -s, -c, angle)


def root(square: Jet, least: float) -> Jet:
    """The square root; that of `least`, constant, where the value is not greater than `least`."""
    free = square.value > least
    value = kept(jnp.sqrt(jnp.where(free, square.value, least)))
    slope = jnp.where(free, 0.5, 0.0) / value
    return chained(value, slope, -0.5 * slope / (value * value), square)


def reciprocal(of: Jet) -> Jet:
    """One over a jet."""
    over = kept(1.0 / of.value)
    return chained(over, -over * over, 2.0 * over * over * over, of)


def stacked(jets: Sequence[Jet], axis: int = 0) -> Jet:
    """Several jets along a new axis; their shapes are broadcast."""
    return Jet(jnp.stack(jnp.broadcast_arrays(*(jet.orders for jet in jets)), axis + 1))


def part(jet: Jet, *index: PyTree) -> Jet:
    """The elements at an index, of all orders."""
    return Jet(jet.orders[(slice(None), *index)])


def parts(jet: Jet) -> list[Jet]:
    """The elements along the first axis."""
    return [part(jet, i) for i in range(jet.orders.shape[1])]


def outer(a: Jet, b: Jet) -> Jet:
    """(n, m, …) products of each row of a (n, …) and each row of b (m, …)."""
    return part(a, slice(None), None) * part(b, None)


def summed(jet: Jet) -> Jet:
    """The sum over the first axis."""
    first, *rest = parts(jet)
    return sum(rest, first)


def turned_axes(yaw: Jet, pitch: Jet, roll: Jet) -> Jet:
    """Forward, left and up axis (3, 3, …), turned by yaw, then pitched (forward end up), then rolled [rad]."""
    sines, cosines = sin_cos(stacked([yaw, pitch, roll]))
    (sy, sp, sr), (cy, cp, cr) = parts(sines), parts(cosines)
    # Without the yaw, the three axes have these components.
    (ss, sc), (cs, cc) = map(parts, parts(outer(stacked([sp, cp]), stacked([sr, cr]))))
    ahead, aside, up = (stacked(row) for row in ((cp, -ss, -sc), (cr * 0.0, cr, -sr), (sp, cs, cc)))
    return turned(stacked([cy, sy]), stacked([ahead, aside]), up)


def turned(cosine_sine: Jet, level: Jet, up: Jet) -> Jet:
    """Vectors (n, 3, …), turned about the vertical by an angle with a cosine and sine (2, …).

    They have components forward and left, `level` (2, n, …), and `up` (n, …).
    """
    by_cosine, by_sine = map(parts, parts(kept(part(cosine_sine, slice(None), None, None) * part(level, None))))
    return stacked([by_cosine[0] - by_sine[1], by_sine[0] + by_cosine[1], up], axis=1)
