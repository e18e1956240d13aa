r"""Strapdown integration: where a sensor went, from what it felt and from where it started.

Sums of samples stand for integrals, so smooth signals are integrated with an error that falls with the sixth power
of the sample time while the attitude's falls with the fourth. No drift is removed and nothing is assumed about
standing: the errors of the sensor grow as they do.

Source: the rotation over one interval, from its angular rate ω(s) in the sensor's axes,

    exp(α + (α × μ) / h),   α = ∫ ω ds,   μ = ∫ (s − h/2) ω ds,

is Magnus' expansion to fourth order (Iserles and Nørsett, Phil. Trans. R. Soc. A 357 (1999) 983).
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jgait.geometry.rotation import rotation
from jgait.geometry.segments import in_world
from jgait.geometry.vectors import GRAVITY

_SUM = (11.0 / 1440.0, -93.0 / 1440.0, 802.0 / 1440.0)
"""Weights of six samples in the integral over the interval between the middle two, the outermost first."""


def _moment_weights() -> tuple[float, ...]:
    """Weights of the differences of opposite samples in ∫ (s − 1/2) f ds over [0, 1]; exact to degree five."""
    offsets = np.array([2.5, 1.5, 0.5])  # half distances of the pairs
    powers = np.array([1, 3, 5])
    wanted = 2.0 * 0.5 ** (powers + 2.0) / (powers + 2.0)
    weights = np.linalg.solve((2.0 * offsets[None, :] ** powers[:, None]), wanted)
    return tuple(float(w) for w in weights)


_MOMENT = _moment_weights()


class Path(NamedTuple):
    """Where a sensor was."""

    position: Any  #: (T, 3) in the world, z up [m].
    axes: Any  #: (T, 3, 3); column i is the sensor's axis i in the world [1].


def _shifted(samples: Any, by: int) -> Any:
    """Samples moved by some places along time, the ends repeated; without the last."""
    index = jnp.clip(jnp.arange(samples.shape[0] - 1) + by, 0, samples.shape[0] - 1)
    return samples[index]


def _integral(samples: Any, dt: Any) -> Any:
    """Integral from the first sample to each (T, n), exact for polynomials of degree five."""
    pairs = [_shifted(samples, -i) + _shifted(samples, i + 1) for i in (2, 1, 0)]
    steps = dt * sum(weight * pair for weight, pair in zip(_SUM, pairs, strict=True))
    return jnp.concatenate([jnp.zeros_like(samples[:1]), jnp.cumsum(steps, axis=0)])


@jax.jit
def attitude(gyr: Any, dt: Any, start: Any) -> Any:
    """Axes of a sensor (T, 3, 3) from its angular rate (T, 3) [rad/s], samples dt [s] apart, and its first axes."""
    rates = [_shifted(gyr, i) for i in (-2, -1, 0, 1, 2, 3)]
    total = dt * sum(w * (a + b) for w, a, b in zip(_SUM, rates[:3], rates[:2:-1], strict=True))
    # First moment about the middle, in units of dt².
    odd = [(b - a) for a, b in zip(rates[:3], rates[:2:-1], strict=True)]
    moment = dt * dt * sum(w * d for w, d in zip(_MOMENT, odd, strict=True))
    turns = rotation(total + jnp.cross(total, moment) / dt)
    all_turns = jnp.concatenate([start[None], turns])
    return jax.lax.associative_scan(lambda a, b: a @ b, all_turns)


@jax.jit
def _integrated(gyr: Any, acc: Any, dt: Any, axes: Any, position: Any) -> Path:
    """The path of a sensor that starts at rest."""
    turned = attitude(gyr, dt, axes)
    force = jnp.einsum("tij,tj->ti", turned, acc)
    speed = _integral(force - jnp.asarray([0.0, 0.0, GRAVITY], acc.dtype)[None, :], dt)
    return Path(_integral(speed, dt) + position[None, :], turned)


def stacked(vector: Any) -> np.ndarray:
    """A `Vector` of arrays (T,) as one array (T, 3)."""
    return np.stack([np.asarray(part) for part in vector], axis=1)


def followed(imu: Any, frame: Any, point: Any, rate: float, every: int = 1) -> tuple[Path, np.ndarray, np.ndarray]:
    """The path of a sensor from its readings, or some of them; true places (T, 3) and axes (T, 3, 3) of the point."""
    place, axes = stacked(in_world(frame, point)), np.stack([stacked(axis) for axis in frame[1:]], axis=2)
    place, axes = place[::every], axes[::every]
    gyr, acc, *start = map(jnp.asarray, (imu.gyr[::every], imu.acc[::every], axes[0], place[0]))
    return _integrated(gyr, acc, every / rate, *start), place, axes
