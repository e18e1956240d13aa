r"""Stride by stride without a filter: forward and backward integration, for comparison.

Each stride starts level and at rest at one foothold and ends at rest at the next. Velocity is integrated forward from
the first and backward from the second, and the two are weighed by a logistic function of the time in the stride:

    v = (1 − w) v_forward + w v_backward,   w(s) = (σ(s) − σ(0)) / (σ(1) − σ(0)),   σ(s) = 1 / (1 + exp((τ − s) / β))

Source: J. Hannink, M. Ollenschläger, F. Kluge, N. Roth, J. Klucken, B. Eskofier, "Benchmarking foot trajectory
estimation methods for mobile gait analysis", Sensors 17(9), 2017; τ = 0.6 and β = 0.08 as gaitmap has them.
"""

from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from jgait.estimators.foot_ins.inputs import FootSignals
from jgait.estimators.foot_ins.model import FootState
from jgait.geometry.rotation import Quaternion, between, exponential, from_array, normalised, product, rotated
from jgait.geometry.vectors import GRAVITY, Vector, add, scale, subtract, vector

TURNING_POINT, STEEPNESS = 0.6, 0.08
"""τ and β [1]."""


def forward_backward(foot: FootSignals) -> FootState:
    """States (T,) of one foot, positions from the last foothold; biases as at rest."""
    level = _levels(foot)
    bias, acc_bias = (vector(values) for values in (foot.gyr_bias, foot.acc_bias))
    first = from_array(foot.attitude)
    zero = Vector(*(jnp.zeros((), foot.gyr.dtype),) * 3)
    stride = jnp.cumsum(foot.restart).astype(jnp.int32)

    def forward(carry: Any, item: Any) -> Any:
        attitude, velocity = carry
        gyr, acc, dt, restart, number = item
        again = restart > 0.5
        levelled = _levelled(attitude, Quaternion(*(part[jnp.maximum(number - 1, 0)] for part in level)))
        attitude = Quaternion(*(jnp.where(again, a, b) for a, b in zip(levelled, attitude, strict=True)))
        velocity = Vector(*(jnp.where(again, 0.0, part) for part in velocity))
        half = exponential(scale(0.5 * dt, subtract(vector(gyr), bias)))
        middle = product(attitude, half)
        force = rotated(middle, subtract(vector(acc), acc_bias))
        pull = Vector(force.x, force.y, force.z - GRAVITY)
        attitude, velocity = normalised(product(middle, half)), add(velocity, scale(dt, pull))
        return (attitude, velocity), (attitude, velocity)

    items = (foot.gyr, foot.acc, foot.dt, foot.restart, stride)
    _, (attitude, velocity) = lax.scan(forward, (first, zero), items)
    velocity = _returned(velocity, foot, stride)
    position = _summed(velocity, foot)
    still = Vector(*(jnp.zeros_like(foot.rate),) * 3)
    biases = (Vector(*(b + z for b, z in zip(of, still, strict=True))) for of in (bias, acc_bias))
    return FootState(position, velocity, attitude, *biases)


def _returned(velocity: Vector, foot: FootSignals, stride: Any) -> Vector:
    """The weighted mean of forward and backward integration: both differ by what is left at the stride's end."""
    rows = foot.foothold.shape[0]
    index = jnp.clip(stride, 0, rows - 1)
    # the stride with number n starts at foothold n − 1 and ends at foothold n
    start = foot.foothold[jnp.maximum(index - 1, 0)].astype(foot.rate.dtype)
    end = foot.foothold[index]
    length = jnp.maximum(end.astype(foot.rate.dtype) - start, 1.0)
    samples = jnp.arange(foot.rate.shape[0], dtype=foot.rate.dtype)
    s = jnp.clip((samples - start) / length, 0.0, 1.0)
    low, high = (jax.nn.sigmoid((edge - TURNING_POINT) / STEEPNESS) for edge in (0.0, 1.0))
    weight = (jax.nn.sigmoid((s - TURNING_POINT) / STEEPNESS) - low) / (high - low)
    walks = (index >= 1) & (index < foot.count)
    return Vector(*(jnp.where(walks, part - weight * part[end], 0.0) for part in velocity))


def _summed(velocity: Vector, foot: FootSignals) -> Vector:
    """Positions from the last foothold, by the trapezoidal rule."""
    again = foot.restart > 0.5

    def whole(part: Any) -> Any:
        step = 0.5 * foot.dt * (part + jnp.concatenate([part[:1], part[:-1]]))
        total = jnp.cumsum(step)
        base = lax.associative_scan(jnp.maximum, jnp.where(again, jnp.arange(step.shape[0], dtype=jnp.int32), 0))
        since = jnp.where(base > 0, total[jnp.maximum(base - 1, 0)], 0.0)
        return total - since

    return Vector(*(whole(part) for part in velocity))


def _levels(foot: FootSignals) -> Quaternion:
    """(K,) how the sensor stands on each foothold, by the specific force there, its heading arbitrary."""
    window = jnp.arange(-2, 3, dtype=foot.foothold.dtype)
    at = jnp.clip(foot.foothold[:, None] + window[None, :], 0, foot.rate.shape[0] - 1)
    up = jnp.mean(foot.acc[at] - foot.acc_bias[None, None, :], axis=1)
    zero = jnp.zeros_like(up[:, 0])
    return between(Vector(up[:, 0], up[:, 1], up[:, 2]), Vector(zero, zero, zero + 1.0))


def _levelled(attitude: Quaternion, level: Quaternion) -> Quaternion:
    """The attitude that stands on a foothold, with the heading that integration has come to."""
    away = product(attitude, Quaternion(level.w, -level.x, -level.y, -level.z))
    yaw = jnp.arctan2(away.z, away.w)
    zero = jnp.zeros_like(yaw)
    return product(Quaternion(jnp.cos(yaw), zero, zero, jnp.sin(yaw)), level)
