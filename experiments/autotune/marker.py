"""The place of the reference's marker on the foot: solved from paths that a filter gave, for any weights of the trials.

The path of a point of the foot is linear in the point's place, and the filter does not depend on it. So the filter runs
once, and the marker of each set of trials follows without it.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy import optimize

from jgait import filtering, params
from jgait.estimators import foot_ins
from jgait.estimators.foot_ins import FootParams
from jgait.geometry.rotation import Quaternion, rotated
from jgait.geometry.vectors import Vector
from jgait.tune import Lessons, losses

PRIORS = params.priors(FootParams()).tracked_point


class Paths(NamedTuple):
    """The right foot of every trial: the sensor's path (n, T, 3) [m], its attitude (n, T, 4), the marker's path by the
    reference (n, T, 3) [m], and the samples to compare (n, T)."""

    sensor: Any
    attitude: Any
    marker: Any
    look: Any


@filtering.compiled
def _paths(p: FootParams, data: Any) -> Any:
    def one(lesson: Any) -> Paths:
        found = foot_ins.run(p, lesson.inputs)
        foot, look = found.feet.right, lesson.look & found.valid & lesson.reference.valid
        return Paths(foot.position, foot.orientation, lesson.reference.feet.right.position, look)

    return jax.lax.map(one, data)


def paths(p: FootParams, groups: Sequence[tuple[np.ndarray, Lessons]]) -> Paths:
    """The paths of all trials, in the order of the trials, of the sensor itself."""
    single = jax.tree.map(lambda v: jnp.asarray(v, jnp.float32), p._replace(tracked_point=Vector(0.0, 0.0, 0.0)))
    parts = [jax.tree.map(np.asarray, _paths(single, made.data)) for _, made in groups]
    back = np.argsort(np.concatenate([rows for rows, _ in groups]))
    return Paths(*(np.concatenate(leaves)[back] for leaves in zip(*parts, strict=True)))


@jax.jit
def _mean_squares(place: Any, found: Paths) -> Any:
    def one(item: Paths) -> Any:
        arm = jnp.stack(rotated(Quaternion(*item.attitude.T), Vector(*place)), axis=1)
        error = losses.aligned_error(item.sensor + arm, item.marker, item.look)
        return losses.masked_mean(jnp.sum(error**2, axis=1), item.look)

    return jax.vmap(one)(found)


@jax.jit
@jax.value_and_grad
def _loss(place: Any, found: Paths, weights: Any) -> Any:
    """As the loss `position_log` and the priors of `FootParams.tracked_point`."""
    prior = sum((one.penalty(place[i]) for i, one in enumerate(PRIORS)), jnp.zeros_like(place[0]))
    return jnp.sum(weights * 0.5 * jnp.log1p(1e4 * _mean_squares(place, found))) + prior


def solved(found: Paths, weights: np.ndarray) -> np.ndarray:
    """(3,) place of the marker in the sensor's axes [m] that suits the trials with a weight above 0."""

    kind = found.sensor.dtype

    def of(place: np.ndarray) -> tuple[float, np.ndarray]:
        value, slope = _loss(jnp.asarray(place, kind), found, jnp.asarray(weights, kind))
        return float(value), np.asarray(slope, float)

    return np.asarray(optimize.minimize(of, np.zeros(3), jac=True, method="BFGS", options={"gtol": 1e-3}).x)


def errors(found: Paths, place: np.ndarray) -> np.ndarray:
    """(n,) 3-D error of the path of a point [m]."""
    return np.sqrt(np.asarray(_mean_squares(jnp.asarray(place, found.sensor.dtype), found), float))


def held_out(found: Paths, away: np.ndarray) -> np.ndarray:
    """Error of the trials of `away` (n,) bool, with the marker that the other trials taught [m]."""
    return errors(found, solved(found, (~away).astype(float)))[away]
