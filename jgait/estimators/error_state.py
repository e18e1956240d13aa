"""States of vectors and an attitude, and their errors: filters of motion share how one changes the other.

A state is a tuple of vectors (3,) and a quaternion (4,); in its error each field is a vector: that of the attitude is
a rotation vector in the world, δ with q' = exp(δ) q, that of a vector its difference.
"""

from jaxtyping import PyTree

from jgait.geometry.rotation import Quaternion, conjugate, product, quaternion, small_logarithm, small_turn
from jgait.geometry.vectors import as_array, kept, vector
from jgait.types import Values


def near_unit(q: Quaternion) -> Quaternion:
    """Normalise a quaternion of nearly unit length by one Newton step for 1/√, without root and division."""
    factor = kept(1.5 - 0.5 * (q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z))
    return Quaternion(factor * q.w, factor * q.x, factor * q.y, factor * q.z)


def retract(s: PyTree, e: PyTree) -> PyTree:
    """The state `s` changed by the error `e`, whose rotation is below a radian, see `rotation.small_turn`."""
    return type(s)(*(_moved(value, error) for value, error in zip(s, e, strict=True)))


def _moved(value: Values, error: Values) -> Values:
    if value.shape[-1] == 3:
        return value + error
    return as_array(near_unit(product(small_turn(vector(error)), quaternion(value))))


def differences(reference: PyTree, s: PyTree) -> list[Values]:
    """The fields of the error of the state `s` relative to `reference`."""
    return [_between(from_, value) for from_, value in zip(reference, s, strict=True)]


def _between(from_: Values, value: Values) -> Values:
    if value.shape[-1] == 3:
        return value - from_
    return as_array(small_logarithm(product(quaternion(value), conjugate(quaternion(from_)))))
