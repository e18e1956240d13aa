"""States of vectors and an attitude, and their errors: filters of motion share how one changes the other.

A state is a tuple whose fields are `Vector`s and a `Quaternion`; in its error each field is a `Vector`: that of the
attitude is a rotation vector in the world, δ with q' = exp(δ) q, that of a vector its difference.
"""

from jaxtyping import PyTree

from jgait.geometry.rotation import Quaternion, conjugate, product, small_logarithm, small_turn
from jgait.geometry.vectors import Vector, add, kept, subtract


def near_unit(q: Quaternion) -> Quaternion:
    """Normalise a quaternion of nearly unit length by one Newton step for 1/√, without root and division."""
    factor = kept(1.5 - 0.5 * (q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z))
    return Quaternion(factor * q.w, factor * q.x, factor * q.y, factor * q.z)


def retract(s: PyTree, e: PyTree) -> PyTree:
    """The state `s` changed by the error `e`, whose rotation is below a radian, see `rotation.small_turn`."""
    return type(s)(*(
        near_unit(product(small_turn(error), value)) if isinstance(value, Quaternion) else add(value, error)
        for value, error in zip(s, e, strict=True)
    ))  # fmt: skip


def differences(reference: PyTree, s: PyTree) -> list[Vector]:
    """The fields of the error of the state `s` relative to `reference`."""
    return [
        small_logarithm(product(value, conjugate(from_))) if isinstance(value, Quaternion) else subtract(value, from_)
        for from_, value in zip(reference, s, strict=True)
    ]
