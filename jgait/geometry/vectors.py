"""Vectors in space as three arrays, one per component; every function is elementwise over time and people."""

from typing import NamedTuple

from jax import lax
from jaxtyping import Float

from jgait.geometry.arrays import of_jax, xp
from jgait.notes import record
from jgait.types import AnyArray, Values

GRAVITY = 9.80665
"""Standard gravity [m/s²]."""


type Three = Float[AnyArray, "*batch 3"]
"""A vector, or a rotation vector, as an array."""


@record
class Vector(NamedTuple):
    """Three components along x, y and z, each of any one shape."""

    x: Values
    y: Values
    z: Values


def kept[T](values: T) -> T:
    """The same values, computed once: without this barrier the compiler repeats the computation at every use."""
    return lax.optimization_barrier(values) if of_jax(values) else values


def vector(values: Float[AnyArray, "*batch 3"]) -> Vector:
    """The last axis (3,) of an array as components."""
    return Vector(values[..., 0], values[..., 1], values[..., 2])


def as_array(v: tuple[Values, ...]) -> Float[AnyArray, "*batch component"]:
    """The components of a vector or a quaternion along a last axis."""
    return xp.stack(v, axis=-1)


def add(a: Vector, b: Vector) -> Vector:
    """The sum a + b."""
    return Vector(a.x + b.x, a.y + b.y, a.z + b.z)


def subtract(a: Vector, b: Vector) -> Vector:
    """The difference a − b."""
    return Vector(a.x - b.x, a.y - b.y, a.z - b.z)


def scale(factor: Values, a: Vector) -> Vector:
    """The vector a, `factor` times as long."""
    return Vector(factor * a.x, factor * a.y, factor * a.z)


def dot(a: Vector, b: Vector) -> Values:
    """The scalar product a · b."""
    return a.x * b.x + a.y * b.y + a.z * b.z


def cross(a: Vector, b: Vector) -> Vector:
    """The vector product a × b, right-handed."""
    return Vector(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)


def root(square: Values) -> Values:
    """The square root; 0, with gradient 0, for values that are not positive."""
    positive = square > 0.0
    return xp.where(positive, xp.sqrt(xp.where(positive, square, xp.ones_like(square))), 0.0)


def wrapped(angle: Values) -> Values:
    """An angle from −π to π [rad]."""
    return angle - 2.0 * xp.pi * xp.round(angle / (2.0 * xp.pi))


def entries(matrix: Values, *pairs: str) -> list[Values]:
    """Entries of matrices (…, 3, 3), by pairs of axes: "xx", "xy"."""
    return [matrix[..., "xyz".index(pair[0]), "xyz".index(pair[1])] for pair in pairs]
