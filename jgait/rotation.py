"""Rotations: matrices from rotation vectors, and unit quaternions, w first. Smooth wherever a filter goes.

A quaternion `q_ws` takes vectors of the sensor to the world; frames read right to left.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp

from jgait.kinematics import Vector, cross


def rotation(vector: Any) -> Any:
    """Rotation matrix of a rotation vector, R = I + (sin θ / θ) [v]ₓ + ((1 − cos θ) / θ²) [v]ₓ², smooth at zero.

    Args:
        vector: (..., 3) axis times angle [rad].

    Returns:
        (..., 3, 3).

    Source: Rodrigues' formula.
    """
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    square = x * x + y * y + z * z
    near = square < 1e-4
    angle = jnp.sqrt(jnp.where(near, jnp.ones_like(square), square))
    a = jnp.where(near, 1.0 - square / 6.0 + square * square / 120.0, jnp.sin(angle) / angle)
    b = jnp.where(near, 0.5 - square / 24.0 + square * square / 720.0, 2.0 * (jnp.sin(angle / 2.0) / angle) ** 2)
    rows = (
        (1.0 - b * (y * y + z * z), b * x * y - a * z, b * x * z + a * y),
        (b * x * y + a * z, 1.0 - b * (x * x + z * z), b * y * z - a * x),
        (b * x * z - a * y, b * y * z + a * x, 1.0 - b * (x * x + y * y)),
    )
    return jnp.stack([jnp.stack(row, axis=-1) for row in rows], axis=-2)


def turn(axis: Any, angle: Any) -> Any:
    """Rotation matrix (3, 3) about a direction (3,) of any length, by an angle [rad]."""
    return rotation(axis / jnp.sqrt(jnp.sum(axis * axis)) * angle)


class Quaternion(NamedTuple):
    """A unit quaternion in components, w first: `q_ws` takes vectors of the sensor to the world; any one shape."""

    w: Any
    x: Any
    y: Any
    z: Any


def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """The quaternion a b: first the rotation b, then a."""
    return Quaternion(
        a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z,
        a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
        a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
        a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w,
    )


def conjugate(q: Quaternion) -> Quaternion:
    """The rotation back."""
    return Quaternion(q.w, -q.x, -q.y, -q.z)


def normalised(q: Quaternion) -> Quaternion:
    """The same direction at length one."""
    norm = jnp.sqrt(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z)
    return Quaternion(q.w / norm, q.x / norm, q.y / norm, q.z / norm)


def rotated(q: Quaternion, v: Vector) -> Vector:
    """The vector q v q*, v + 2 w (u × v) + 2 u × (u × v) with u = (x, y, z)."""
    u = Vector(q.x, q.y, q.z)
    t = cross(u, v)
    t = Vector(2.0 * t.x, 2.0 * t.y, 2.0 * t.z)
    s = cross(u, t)
    return Vector(v.x + q.w * t.x + s.x, v.y + q.w * t.y + s.y, v.z + q.w * t.z + s.z)


_SINE = (1.0, -1.0 / 6.0, 1.0 / 120.0, -1.0 / 5040.0, 1.0 / 362880.0, -1.0 / 39916800.0, 1.0 / 6227020800.0)
_COSINE = (1.0, -1.0 / 2.0, 1.0 / 24.0, -1.0 / 720.0, 1.0 / 40320.0, -1.0 / 3628800.0, 1.0 / 479001600.0)


def exponential(v: Vector) -> Quaternion:
    """The quaternion of a rotation vector, (cos |v|/2, v/|v| sin |v|/2), by power series of |v|²/4.

    Without branches and smooth at zero, for what turns within one sample: exact to 1e-13 up to 1 rad, to 1e-7 up to
    π, and then normalised. Larger rotations: `quaternion(rotation(v))`.
    """
    square = 0.25 * (v.x * v.x + v.y * v.y + v.z * v.z)
    sine, cosine = (_horner(terms, square) for terms in (_SINE, _COSINE))
    half = 0.5 * sine
    return normalised(Quaternion(cosine, half * v.x, half * v.y, half * v.z))


def _horner(terms: tuple[float, ...], x: Any) -> Any:
    value = terms[-1] * x + terms[-2]
    for term in terms[-3::-1]:
        value = value * x + term
    return value


def logarithm(q: Quaternion) -> Vector:
    """The rotation vector of a unit quaternion, shorter than π: the inverse of `exponential`, smooth at zero."""
    sign = jnp.where(q.w < 0.0, -1.0, 1.0).astype(jnp.result_type(q.w))
    w, square = sign * q.w, q.x * q.x + q.y * q.y + q.z * q.z
    near = square < 1e-4
    length = jnp.sqrt(jnp.where(near, jnp.ones_like(square), square))
    far = 2.0 * jnp.arctan2(length, w) / length
    # asin(n) / n as a series of n²
    series = 2.0 * (1.0 + square / 6.0 + 3.0 * square**2 / 40.0 + 15.0 * square**3 / 336.0)
    factor = sign * jnp.where(near, series, far)
    return Vector(factor * q.x, factor * q.y, factor * q.z)
