"""What is read off the joint state of both feet: trajectories and strides in one world, widths, distances between."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jgait.estimators.foot_ins import readout as foot_strides
from jgait.estimators.foot_ins.inputs import FootSignals
from jgait.estimators.foot_ins.model import FootState
from jgait.estimators.foot_ins.readout import root
from jgait.estimators.stride_width_ekf import readout as stride_width_readout
from jgait.estimators.stride_width_ekf.inputs import StrideRows
from jgait.estimators.stride_width_ekf.model import WidthState
from jgait.estimators.two_feet_inputs import TwoFeetInputs
from jgait.estimators.two_feet_model import Plane, TwoFeetState, relative, turned
from jgait.estimators.two_feet_params import TwoFeetParams, width_params
from jgait.filtering import Covariance
from jgait.filtering.covariance import names_of
from jgait.types import SIDES, Feet, FootTrajectory, Strides


class Read(NamedTuple):
    """What the state says.

    Attributes:
        feet: in one world: the right foot's start at the origin, x along its first stride.
        stddev: of positions since the last foothold, of velocities, and of attitudes.
        strides: rows of the right foot, then of the left.
        strides_stddev: standard deviations of them.
        distances: z₁, z₂ and their standard deviations (T,) [m].
        pitch: (T,) of each foot against standing [rad].
    """

    feet: Feet
    stddev: Feet
    strides: Strides
    strides_stddev: Strides
    distances: dict[str, Any]
    pitch: tuple[Any, Any]


def read(p: TwoFeetParams, inputs: TwoFeetInputs, state: TwoFeetState, cov: Covariance, *, flatten: bool) -> Read:
    """Trajectories, strides and distances of both feet.

    Args:
        p: parameters.
        inputs: the recording's.
        state: smoothed (or filtered) states, (T,) leaves.
        cov: their covariance.
        flatten: as of `foot_strides.path_of`.
    """
    signals = (inputs.right, inputs.left)
    paths = [
        foot_strides.path_of(
            p.foot, foot, inputs.time, getattr(state, name), _one_foot(cov, name), side, flatten=flatten
        )
        for side, (name, foot) in enumerate(zip(SIDES, signals, strict=True))
    ]
    right, left = paths
    first = [_first_heading(getattr(state, name), foot) for name, foot in zip(SIDES, signals, strict=True)]
    apart = turned(-first[0], relative(state))
    place = right.trajectory.position[:, :2] - jnp.stack(apart, axis=1)
    angle = state.yaw + first[1] - first[0]
    moved = _turned_rows(angle, left.trajectory.velocity)
    feet = Feet(
        right.trajectory,
        FootTrajectory(
            jnp.concatenate([place, left.trajectory.position[:, 2:]], axis=1), moved,
            _turned_quaternions(angle, left.trajectory.orientation),
        ),
    )  # fmt: skip
    strides, deviations = _with_widths(p, inputs, state, cov, paths)
    return Read(
        feet, Feet(right.stddev, _left_stddev(left.stddev, cov, state.yaw - first[0])), strides, deviations,
        _distances(p, inputs, state, cov), (right.pitch, left.pitch),
    )  # fmt: skip


def _one_foot(cov: Covariance, side: str) -> Covariance:
    """The covariance of one foot's errors."""
    foot = getattr(jax.tree.unflatten(cov.structure, range(cov.structure.num_leaves)), side)
    names = names_of(foot)
    upper = tuple(cov[f"{side}.{a}", f"{side}.{b}"] for i, a in enumerate(names) for b in names[i:])
    return Covariance(upper, jax.tree.structure(foot))


def _first_heading(state: FootState, foot: FootSignals) -> Any:
    """Direction of a foot's first stride, which is the x axis of `foot_strides.path_of`."""
    way = Plane(state.position.x[foot.foothold[1:]], state.position.y[foot.foothold[1:]])
    square = way.x * way.x + way.y * way.y
    real = jnp.arange(square.shape[0], dtype=jnp.int32) < jnp.asarray(foot.count, jnp.int32) - 1
    first = jnp.argmax(real & (square > foot_strides.SHORTEST**2))
    return jnp.arctan2(way.y[first], way.x[first])


def _turned_rows(angle: Any, rows: Any) -> Any:
    """Vectors (T, 3) turned about the vertical."""
    plane = turned(angle, Plane(rows[:, 0], rows[:, 1]))
    return jnp.stack([plane.x, plane.y, rows[:, 2]], axis=1)


def _turned_quaternions(angle: Any, rows: Any) -> Any:
    c, s = jnp.cos(0.5 * angle), jnp.sin(0.5 * angle)
    w, x, y, z = (rows[:, i] for i in range(4))
    return jnp.stack([c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w], axis=1)


def _left_stddev(along_own: FootTrajectory, cov: Covariance, angle: Any) -> FootTrajectory:
    """Standard deviations of the left foot along the axes of the world; heights keep theirs."""
    c, s = jnp.cos(angle), jnp.sin(angle)

    def part(name: str, rows: Any) -> Any:
        xx, xy, yy = (cov[f"left.{name}.{a}", f"left.{name}.{b}"] for a, b in ("xx", "xy", "yy"))
        x, y = c * c * xx - 2.0 * c * s * xy + s * s * yy, s * s * xx + 2.0 * c * s * xy + c * c * yy
        return jnp.stack([root(x), root(y), rows[:, 2]], axis=1)

    return FootTrajectory(
        part("position", along_own.position), part("velocity", along_own.velocity),
        part("attitude", along_own.orientation),
    )  # fmt: skip


_SHOWS = (
    "right.position.x", "right.position.y", "left.position.x", "left.position.y", "yaw", "between.x", "between.y",
    "left.attitude.z",
)  # fmt: skip
"""What the distances between the feet depend on; the last through the left foot's heading."""


def _plane(state: TwoFeetState, cov: Covariance, heading: Any) -> tuple[WidthState, Covariance]:
    """The six states of the paper, the right foot's last foothold at the origin, as the read-out of widths takes them.

    Args:
        state: (n,) leaves.
        cov: its covariance.
        heading: (n,) of the left foot's stride in the left foot's world [rad].
    """

    def places(v: Any, heading: Any) -> Any:
        left = turned(v[4], Plane(v[2], v[3]))
        return jnp.stack([
            v[0], v[1], jnp.zeros_like(v[0]), left.x - v[5], left.y - v[6], heading + v[4] + v[7],
            v[0], v[1], left.x, left.y,
        ])  # fmt: skip

    right, left = state.right.position, state.left.position
    values = jnp.stack([right.x, right.y, left.x, left.y, state.yaw, *state.between, jnp.zeros_like(heading)], axis=1)
    joint = jnp.stack([jnp.stack([cov[a, b] for b in _SHOWS], axis=-1) for a in _SHOWS], axis=-2)
    found, slope = jax.vmap(places)(values, heading), jax.vmap(jax.jacfwd(places))(values, heading)
    planar = WidthState(*(found[:, i] for i in range(found.shape[1])))
    spread = jnp.einsum("nij,njk,nlk->nil", slope, joint, slope)
    return planar, Covariance.from_dense(spread, planar)


def _distances(p: TwoFeetParams, inputs: TwoFeetInputs, state: TwoFeetState, cov: Covariance) -> dict[str, Any]:
    heading = jnp.asarray(inputs.heading_left, state.yaw.dtype)
    return stride_width_readout.distances(width_params(p), *_plane(state, cov, heading))


def _with_widths(
    p: TwoFeetParams, inputs: TwoFeetInputs, state: TwoFeetState, cov: Covariance, paths: list[foot_strides.Path]
) -> tuple[Strides, Strides]:
    """Strides of both feet: as each foot tells them, and what the state says of the other foot at their ends."""
    strides = jax.tree.map(lambda *rows: jnp.concatenate(rows), *(path.strides for path in paths))
    deviations = jax.tree.map(lambda *rows: jnp.concatenate(rows), *(path.strides_stddev for path in paths))
    at = jnp.concatenate([inputs.right.foothold[1:], inputs.left.foothold[1:]])
    there = jax.tree.map(lambda leaf: leaf[at], (state, cov))
    planar = _plane(there[0], there[1], jnp.zeros_like(there[0].yaw))
    passed: Any = jnp.concatenate([_passed(inputs.right, inputs.left), _passed(inputs.left, inputs.right)])
    order: Any = jnp.arange(at.shape[0])
    rows = StrideRows(
        strides.side, order, strides.start, strides.final_contact, strides.end, strides.standing,
        strides.standing_end, strides.height, strides.turn, passed, strides.valid,
    )  # fmt: skip
    values, spread = stride_width_readout.strides(width_params(p), rows, *planar)
    return (
        strides._replace(width=values.width, step_length=values.step_length),
        deviations._replace(width=spread.width, step_length=spread.step_length),
    )


def _passed(own: FootSignals, other: FootSignals) -> Any:
    """Whether the other foot stood in one place while this one strode (K − 1,).

    It stood just once in between; or, where a walk begins, it has stood there since before.
    """
    left_behind = jnp.cumsum(other.restart > 0.5)  # footholds of the other foot before each sample
    first, last = own.foothold[:-1], own.foothold[1:]
    before = left_behind[jnp.minimum(first + 1, left_behind.shape[0] - 1)]
    between = left_behind[last] - before
    stays = (before > 0) & (other.final_contact[jnp.maximum(before - 1, 0)] > own.final_contact[:-1])
    return (between == 1) | ((between == 0) & stays)
