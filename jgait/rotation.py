"""Rotations as matrices, from rotation vectors or from an axis and an angle; smooth everywhere."""

from typing import Any

import jax.numpy as jnp


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
