"""Silva's 3-D stride length as printed: equation 3, not normalised, and up from one sample (deviations 3 and 5)."""

from functools import partial
from typing import Any, NamedTuple

import jax.numpy as jnp
from jax.typing import ArrayLike

from jgait.estimators.ankle_stride.length import (
    StrideLengthParams,
    StrideState,
    Travelled,
    advanced,
    begun,
    read,
    scanned,
)
from jgait.geometry.rotation import Quaternion, product
from jgait.geometry.vectors import Vector, scale
from jgait.signal.marks import Marks


class PrintedState(NamedTuple):
    """The integrals, and the specific force at the first sample [m/s²]."""

    integrals: StrideState
    sampled: Vector


def _step(
    p: StrideLengthParams, s: PrintedState, sample: tuple[Vector, Vector, Marks], *, dt: Any
) -> tuple[PrintedState, Travelled]:
    w, f, _ = sample
    before = s.integrals.attitude
    small = product(before, Quaternion(0.0, *scale(0.5 * dt, w)))
    attitude = Quaternion(*(a + b for a, b in zip(before, small, strict=True)))
    going = advanced(s.integrals, attitude, w, f, dt)
    return PrintedState(going, s.sampled), read(p, going, s.sampled)


def _begun(p: StrideLengthParams, w: Vector, f: Vector) -> PrintedState:
    return PrintedState(begun(p, w, f), f)


def inertial(p: StrideLengthParams, gyr: ArrayLike, acc: ArrayLike, strides: Marks, dt: ArrayLike) -> Travelled:
    """As `length.inertial`, as printed."""
    return scanned(partial(_step, p, dt=dt), partial(_begun, p), p, gyr, acc, strides)


def all_axes(gyr: ArrayLike) -> Any:
    """Rates (T, 3) [rad/s] whose sagittal rate is the norm over all axes, as the paper's pendulum takes it."""
    norm = jnp.linalg.norm(jnp.asarray(gyr), axis=1)
    return jnp.stack([jnp.zeros_like(norm), -norm, jnp.zeros_like(norm)], axis=1)
