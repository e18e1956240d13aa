"""Rotations: matrices from rotation vectors, and unit quaternions, w first; differentiable in the range of the filters.

A quaternion `q_ws` takes vectors of the sensor (s) to the world (w); its indices are read from right to left.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Array, Float, PyTree

from jgait.geometry.arrays import xp
from jgait.geometry.vectors import Vector, as_array, cross, dot, kept, scale, subtract
from jgait.geometry.vectors import vector as split
from jgait.types import AnyArray, Scalar, Values


def rotation(vector: Float[AnyArray, "*batch 3"]) -> Float[Array, "*batch 3 3"]:
    """Rotation matrix of a rotation vector [rad], R = I + (sin θ / θ) [v]ₓ + ((1 − cos θ) / θ²) [v]ₓ², smooth at zero.

    Source: Rodrigues' formula.
    """
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    square = x * x + y * y + z * z
    near = square < 1e-4
    angle = xp.sqrt(xp.where(near, xp.ones_like(square), square))
    a = xp.where(near, 1.0 - square / 6.0 + square * square / 120.0, xp.sin(angle) / angle)
    b = xp.where(near, 0.5 - square / 24.0 + square * square / 720.0, 2.0 * (xp.sin(angle / 2.0) / angle) ** 2)
    rows = (
        (1.0 - b * (y * y + z * z), b * x * y - a * z, b * x * z + a * y),
        (b * x * y + a * z, 1.0 - b * (x * x + z * z), b * y * z - a * x),
        (b * x * z - a * y, b * y * z + a * x, 1.0 - b * (x * x + y * y)),
    )
    return xp.stack([xp.stack(row, axis=-1) for row in rows], axis=-2)


def turn(axis: Float[AnyArray, "3"], angle: Scalar) -> Float[Array, "3 3"]:
    """The rotation matrix about an axis of any length, by an angle [rad]."""
    return rotation(axis / xp.sqrt(xp.sum(axis * axis)) * angle)


class Quaternion(NamedTuple):
    """A unit quaternion in components, w first: `q_ws` takes vectors of the sensor to the world; all of one shape."""

    w: Values
    x: Values
    y: Values
    z: Values


def quaternion(values: Float[AnyArray, "*batch 4"]) -> Quaternion:
    """The last axis (4,) of an array as components, w first; `vectors.as_array` is the inverse."""
    return Quaternion(*(values[..., i] for i in range(4)))


def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """The quaternion a b: the rotation b, followed by the rotation a."""
    return kept(Quaternion(
        a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z,
        a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
        a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
        a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w,
    ))  # fmt: skip


def conjugate(q: Quaternion) -> Quaternion:
    """The inverse rotation."""
    return Quaternion(q.w, -q.x, -q.y, -q.z)


def normalised(q: Quaternion) -> Quaternion:
    """The quaternion divided by its norm."""
    norm = xp.sqrt(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z)
    return Quaternion(q.w / norm, q.x / norm, q.y / norm, q.z / norm)


def rotated(q: Quaternion, v: Vector) -> Vector:
    """The vector q v q*, v + 2 w (u × v) + 2 u × (u × v) with u = (x, y, z)."""
    u = Vector(q.x, q.y, q.z)
    t = kept(scale(2.0, cross(u, v)))
    s = cross(u, t)
    return kept(Vector(v.x + q.w * t.x + s.x, v.y + q.w * t.y + s.y, v.z + q.w * t.z + s.z))


def rows(q: Quaternion) -> tuple[Vector, Vector, Vector]:
    """The rows of the rotation matrix: fewer operations than `rotated` for many vectors."""
    x, y, z = scale(2.0, Vector(q.x, q.y, q.z))
    xx, xy, xz, yy, yz, zz = x * q.x, x * q.y, x * q.z, y * q.y, y * q.z, z * q.z
    wx, wy, wz = q.w * x, q.w * y, q.w * z
    return (
        Vector(1.0 - (yy + zz), xy - wz, xz + wy),
        Vector(xy + wz, 1.0 - (xx + zz), yz - wx),
        Vector(xz - wy, yz + wx, 1.0 - (xx + yy)),
    )


def small_turn(v: Vector) -> Quaternion:
    """The quaternion of a rotation vector, (cos |v|/2, v/|v| sin |v|/2), by power series of |v|²/4.

    The series has no branches and is smooth at zero. It is for the rotation within one sample: the error is 1e-10 up to
    half a radian, 1e-8 up to 1 rad and 3e-6 up to 2 rad. The caller normalises the result.
    """
    a = kept(0.25 * (v.x * v.x + v.y * v.y + v.z * v.z))
    half = 0.5 + a * (-1.0 / 12.0 + a * (1.0 / 240.0 - a * (1.0 / 10080.0)))
    w = 1.0 + a * (-1.0 / 2.0 + a * (1.0 / 24.0 + a * (-1.0 / 720.0 + a * (1.0 / 40320.0))))
    half = kept(half)
    return kept(Quaternion(w, half * v.x, half * v.y, half * v.z))


def small_logarithm(q: Quaternion) -> Vector:
    """The rotation vector of a unit quaternion by a series, to 1e-9 up to half a radian, to 5e-6 up to 1 rad."""
    a = q.x * q.x + q.y * q.y + q.z * q.z
    factor = 2.0 + a * (1.0 / 3.0 + a * (3.0 / 20.0 + a * (5.0 / 56.0 + a * (35.0 / 576.0 + a * (63.0 / 1408.0)))))
    return Vector(factor * q.x, factor * q.y, factor * q.z)


def between(a: Vector, b: Vector) -> Quaternion:
    """The shortest rotation that takes one direction to another, of any length but zero, also nearly opposite ones.

    With unit vectors, d = a·b and c = a × b, the quaternion is (1 + d, c) for an angle up to 90°. Beyond 90° it is
    (c·p, (1 − d) p) about the axis p = c / |c|; because c is small for nearly opposite directions, p is made
    perpendicular to a once more. For exactly opposite directions the rotation is half a turn about some perpendicular
    axis.
    """
    a, b = _direction(a), _direction(b)
    d, c = dot(a, b), cross(a, b)
    p = subtract(c, scale(dot(c, a), a))
    square = dot(p, p)
    none = square < xp.finfo(xp.result_type(square)).eps ** 2
    along = a.x * a.x > 0.5
    some = Vector(
        xp.where(along, -a.z, xp.zeros_like(a.x)),
        xp.where(along, xp.zeros_like(a.y), a.z),
        xp.where(along, a.x, -a.y),
    )
    p = _direction(Vector(*(xp.where(none, new, old) for new, old in zip(some, p, strict=True))))
    far = Quaternion(dot(c, p), *scale(1.0 - d, p))
    near = Quaternion(1.0 + d, *c)
    return normalised(Quaternion(*(xp.where(d < 0.0, new, old) for new, old in zip(far, near, strict=True))))


def _direction(v: Vector) -> Vector:
    return scale(1.0 / xp.sqrt(dot(v, v)), v)


def level(up: np.ndarray) -> np.ndarray:
    """(4,) the shortest rotation q_ws from a direction in sensor axes to the z axis of the world."""
    x, y, z = up / np.linalg.norm(up)
    if z < -0.999999:
        return np.array([0.0, 1.0, 0.0, 0.0])
    q = np.array([1.0 + z, y, -x, 0.0])
    return q / np.linalg.norm(q)


def turned(v: Float[AnyArray, "*batch axes"], angle: Values) -> Float[AnyArray, "*batch axes"]:
    """Vectors (…, 2 or 3) turned about the vertical, by one angle or one each [rad]."""
    c, s = xp.cos(angle), xp.sin(angle)
    x, y, *up = xp.moveaxis(v, -1, 0)
    return xp.stack([c * x - s * y, s * x + c * y, *up], axis=-1)


def yawed(q: Float[AnyArray, "*batch 4"], angle: Values) -> Float[AnyArray, "*batch 4"]:
    """Attitudes (…, 4) turned about the vertical, by one angle or one each [rad]."""
    c, s = xp.cos(0.5 * angle), xp.sin(0.5 * angle)
    w, x, y, z = xp.moveaxis(q, -1, 0)
    return xp.stack([c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w], axis=-1)


def integrated(
    gyr: Float[AnyArray, "time 3"], acc: Float[AnyArray, "time 3"], sampling_rate_hz: float
) -> tuple[Quaternion, np.ndarray]:
    """Attitude at each sample (T,), and the integral of the specific force since the first (T, 3) [m/s]; on the host.

    From angular rates without bias [rad/s] and specific forces [m/s²], in the axes of the first sample, without a
    correction: only differences over some seconds are of use.
    """
    mean = 0.5 * (gyr + np.concatenate([gyr[:1], gyr[:-1]])) / sampling_rate_hz
    attitude, shift = small_turn(split(mean)), 1
    while shift < len(gyr):  # products of 2, 4, 8 … turns
        earlier, later = (Quaternion(*(part[at] for part in attitude)) for at in (slice(-shift), slice(shift, None)))
        joined = zip(attitude, product(earlier, later), strict=True)
        attitude, shift = Quaternion(*(np.concatenate([old[:shift], new]) for old, new in joined)), 2 * shift
    force = as_array(rotated(attitude, split(acc)))
    total = np.cumsum(0.5 * (force[1:] + force[:-1]) / sampling_rate_hz, axis=0)
    return attitude, np.concatenate([np.zeros((1, 3)), total])


# States are tuples of vectors (3,) and a quaternion (4,). In their errors each field is a vector: that of the attitude
# is a rotation vector in the world, δ with q' = exp(δ) q, that of a vector its difference.


def near_unit(q: Quaternion) -> Quaternion:
    """Normalise a quaternion of nearly unit length by one Newton step for 1/√, without root and division."""
    factor = kept(1.5 - 0.5 * (q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z))
    return Quaternion(factor * q.w, factor * q.x, factor * q.y, factor * q.z)


def retract(s: PyTree, e: PyTree) -> PyTree:
    """The state `s` changed by the error `e`, whose rotation is below a radian, see `small_turn`."""
    return type(s)(*(_moved(value, error) for value, error in zip(s, e, strict=True)))


def _moved(value: Values, error: Values) -> Values:
    if value.shape[-1] == 3:
        return value + error
    return as_array(near_unit(product(small_turn(split(error)), quaternion(value))))


def differences(reference: PyTree, s: PyTree) -> list[Values]:
    """The fields of the error of the state `s` relative to `reference`."""
    return [_between(from_, value) for from_, value in zip(reference, s, strict=True)]


def _between(from_: Values, value: Values) -> Values:
    if value.shape[-1] == 3:
        return value - from_
    return as_array(small_logarithm(product(quaternion(value), conjugate(quaternion(from_)))))
