"""Li's 2-D stride length: the sagittal rate and two axes of the accelerometer, upright when the stride starts.

The paper compares its own method with this one.

Source: Q. Li, M. Young, V. Naing, J. M. Donelan, J. Biomech. 43 (2010) 1640.
"""

from functools import partial
from typing import Any, NamedTuple

import jax.numpy as jnp
from jax.typing import ArrayLike

from jgait.estimators.ankle_stride.length import StrideLengthParams, Travelled, scanned
from jgait.geometry.vectors import Vector
from jgait.signal.marks import Marks


class PlanarState(NamedTuple):
    """As `length.StrideState`, in the sagittal plane: angle [rad], forward velocity and way, the last sample."""

    angle: Any
    velocity: Any
    way: Any
    duration: Any
    start: Any
    rate: Any
    force: Any


def _step(
    p: StrideLengthParams, s: PlanarState, sample: tuple[Vector, Vector, Marks], *, dt: Any
) -> tuple[PlanarState, Travelled]:
    """One sample of the 2-D method; arguments and result as of a step of `length.scanned`, without rise and turn."""
    w, f, _ = sample
    angle = s.angle + 0.5 * dt * (s.rate + w.y)
    force = f.x * jnp.cos(angle) + f.z * jnp.sin(angle)
    velocity = s.velocity + 0.5 * dt * (s.force + force)
    way = s.way + 0.5 * dt * (s.velocity + velocity)
    duration = s.duration + dt
    stop = w.y * p.lever.z * jnp.cos(angle)
    length = jnp.abs(way - 0.5 * duration * velocity + 0.5 * duration * (s.start + stop))
    nothing = jnp.zeros_like(length)
    found = Travelled(length, length, nothing, nothing, duration)
    return PlanarState(angle, velocity, way, duration, s.start, w.y, force), found


def _begun(p: StrideLengthParams, w: Vector, f: Vector) -> PlanarState:
    nothing = jnp.zeros_like(w.y)
    return PlanarState(nothing, nothing, nothing, nothing, w.y * p.lever.z + nothing, w.y, f.x)


def planar(p: StrideLengthParams, gyr: ArrayLike, acc: ArrayLike, strides: Marks, dt: ArrayLike) -> Travelled:
    """Length of each stride by Li's 2-D method; arguments and result as of `length.inertial`, without rise and turn."""
    return scanned(partial(_step, p, dt=dt), partial(_begun, p), p, gyr, acc, strides)
