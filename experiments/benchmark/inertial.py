"""An inertial filter of 15 error states, to measure how long a larger filter takes to compile."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jgait.filtering import Belief, Covariance, Model

GRAVITY = 9.80665


class Vector(NamedTuple):
    """Three components."""

    x: Any
    y: Any
    z: Any


class Quaternion(NamedTuple):
    """Attitude, sensor to world."""

    w: Any
    x: Any
    y: Any
    z: Any


class Inertial(NamedTuple):
    """Position [m], velocity [m/s], attitude, biases [rad/s, m/s²]."""

    position: Vector
    velocity: Vector
    attitude: Quaternion
    gyr_bias: Vector
    acc_bias: Vector


class InertialError(NamedTuple):
    """The same with the attitude's error as a rotation vector in the world [rad]."""

    position: Vector
    velocity: Vector
    attitude: Vector
    gyr_bias: Vector
    acc_bias: Vector


class Measured(NamedTuple):
    """What the sensor measures: gyr [rad/s], acc [m/s²]."""

    gyr: Vector
    acc: Vector


def _plus(a: Any, b: Any) -> Any:
    return type(a)(*(x + y for x, y in zip(a, b, strict=True)))


def _times(a: Quaternion, b: Quaternion) -> Quaternion:
    return Quaternion(
        a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z,
        a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
        a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
        a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w,
    )


def _turn(v: Vector) -> Quaternion:
    """A rotation by less than a radian, to fourth order and normalised."""
    a = 0.25 * (v.x * v.x + v.y * v.y + v.z * v.z)
    half = 0.5 * (1.0 - a / 6.0)
    q = Quaternion(1.0 - 0.5 * a + a * a / 24.0, half * v.x, half * v.y, half * v.z)
    norm = jnp.sqrt(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z)
    return Quaternion(*(value / norm for value in q))


def _rotated(q: Quaternion, v: Vector) -> Vector:
    turned = _times(_times(q, Quaternion(0.0, *v)), Quaternion(q.w, -q.x, -q.y, -q.z))
    return Vector(turned.x, turned.y, turned.z)


def transition(params: Any, s: Inertial, u: Measured, dt: Any) -> Inertial:
    """Strapdown integration over one interval."""
    del params
    rate = Vector(*(dt * (w - b) for w, b in zip(u.gyr, s.gyr_bias, strict=True)))
    force = _rotated(s.attitude, Vector(*(a - b for a, b in zip(u.acc, s.acc_bias, strict=True))))
    acceleration = Vector(force.x, force.y, force.z - GRAVITY)
    moved = Vector(*(dt * v + 0.5 * dt * dt * a for v, a in zip(s.velocity, acceleration, strict=True)))
    faster = Vector(*(dt * a for a in acceleration))
    return s._replace(
        position=_plus(s.position, moved), velocity=_plus(s.velocity, faster), attitude=_times(s.attitude, _turn(rate))
    )


def transition_noise(params: Any, s: Inertial, u: Measured, dt: Any) -> InertialError:
    """White noise of the sensors, and wandering biases."""
    del s, u
    return InertialError(*(Vector(*(scale * dt,) * 3) for scale in (1e-10, params[0], params[1], 1e-10, 1e-8)))


def observation(params: Any, s: Inertial, u: Measured) -> Vector:
    """The velocity, which is zero while the foot stands."""
    del params, u
    return s.velocity


def observation_noise(params: Any, s: Inertial, u: Measured) -> Vector:
    """Of the zero velocity [m²/s²]."""
    del s, u
    return Vector(*(params[2],) * 3)


def retract(s: Inertial, e: InertialError) -> Inertial:
    """The state at an error from another."""
    plain = {name: _plus(getattr(s, name), getattr(e, name)) for name in ("position", "velocity", "gyr_bias")}
    return Inertial(**plain, attitude=_times(_turn(e.attitude), s.attitude), acc_bias=_plus(s.acc_bias, e.acc_bias))


def local(r: Inertial, s: Inertial) -> InertialError:
    """The error of a state about another, for small differences of attitude."""
    q = _times(s.attitude, Quaternion(r.attitude.w, -r.attitude.x, -r.attitude.y, -r.attitude.z))
    a = q.x * q.x + q.y * q.y + q.z * q.z
    scale = 2.0 * (1.0 + a / 6.0 + 3.0 * a * a / 40.0)
    near = {n: Vector(*(x - y for x, y in zip(getattr(s, n), getattr(r, n), strict=True)))
            for n in ("position", "velocity", "gyr_bias", "acc_bias")}  # fmt: skip
    return InertialError(attitude=Vector(scale * q.x, scale * q.y, scale * q.z), **near)


def initial(params: Any) -> Belief:
    """At rest, upright."""
    del params
    zero = Vector(0.0, 0.0, 0.0)
    mean = Inertial(zero, zero, Quaternion(1.0, 0.0, 0.0, 0.0), zero, zero)
    spread = InertialError(*(Vector(*(variance,) * 3) for variance in (1e-6, 1e-4, 1e-2, 1e-4, 1e-2)))
    return Belief(mean, Covariance.from_variances(spread))


MODEL = Model(initial, transition, transition_noise, observation, observation_noise, retract, local)
PARAMS = (1e-4, 1e-5, 1e-4)


def recordings(count: int, samples: int) -> tuple[Vector, Measured, Any]:
    """Observations, controls and mask (B, T) of feet that swing half of every second; float32."""
    time = 0.01 * jnp.arange(samples)
    phase = jnp.linspace(0.0, 1.0, count, endpoint=False)[:, None]
    swing = jnp.maximum(jnp.sin(2.0 * jnp.pi * (time[None, :] + phase)), 0.0)
    zero = jnp.zeros_like(swing)
    control = Measured(Vector(zero, 3.0 * swing, 0.2 * swing), Vector(5.0 * swing, zero, GRAVITY + swing))
    found = (Vector(zero, zero, zero), control, swing == 0.0)
    return jax.tree.map(lambda leaf: leaf if leaf.dtype == bool else leaf.astype(jnp.float32), found)
