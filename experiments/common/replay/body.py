"""Segments of a body from joint centres: frames built from points, with exact derivatives."""

from collections.abc import Set
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from experiments.common.replay.spline import CUTOFF_HZ, MAX_GAP, Trajectory, checked_time, covered, evaluate, smooth
from jgait.geometry.segments import Frame, Motion, Segments
from jgait.geometry.vectors import Vector, add, cross, dot, scale, subtract
from jgait.types import SIDES, AnyArray, Maybe, Values, as_float


class LegCentres(NamedTuple):
    """Joint centres and foot markers of one leg, each (T, 3) [m], z up; NaN where not measured."""

    hip: Values
    knee: Values
    ankle: Values
    heel: Values | None = None
    toe: Values | None = None


class PelvisMarkers(NamedTuple):
    """Anterior and posterior iliac spines, each (T, 3) [m], z up; NaN where not measured."""

    front_right: Values
    front_left: Values
    back_right: Values
    back_left: Values


class JointCentres(NamedTuple):
    """Points of the lower body measured by motion capture.

    Attributes:
        time: (T,) [s], strictly increasing.
        right: right leg, or None.
        left: left leg, or None.
        pelvis: markers, or None: the pelvis is then assumed level, facing perpendicular to the line through the hips.
        heading: (T,) heading of the sagittal plane [rad], counter-clockwise from x; None: the heading of the pelvis,
            low-passed at 1 Hz. Needed for one leg without pelvis markers.
    """

    time: Float[AnyArray, "time"]
    right: LegCentres | None = None
    left: LegCentres | None = None
    pelvis: PelvisMarkers | None = None
    heading: Maybe[Float[AnyArray, "time"]] = None


class Replay(NamedTuple):
    """A body in motion.

    Attributes:
        time: (T,) [s].
        motion: pose, rate and acceleration of `Segments` of `Frame`; None for segments that were not measured.
        valid: `Segments` of (T,) bool; False in long gaps of any point that the segment's frame is built from.
        points: name, for example 'knee_right' → (T, 3) [m], smoothed.
        yaw: (T,) [rad] yaw of the pelvis, counter-clockwise from x, seen from above.
        trajectories: name → spline of that point.
    """

    time: np.ndarray
    motion: Motion[Segments[Maybe[Frame]]]
    valid: Segments[np.ndarray | None]
    points: dict[str, np.ndarray]
    yaw: np.ndarray
    trajectories: dict[str, Trajectory]


def _unit(a: Vector) -> Vector:
    return scale(1.0 / jnp.sqrt(dot(a, a)), a)


def _across(direction: Vector, axis: Vector) -> Vector:
    """The part of a direction that is perpendicular to a unit axis, normalised to length 1."""
    return _unit(subtract(direction, scale(dot(direction, axis), axis)))


def frames(points: dict[str, Vector], toe_out: dict[str, Values]) -> Segments[Maybe[Frame]]:
    """The segments' frames from points, as elementwise functions that can be differentiated.

    Thigh: z along the bone, y the pelvis' horizontal lateral axis made perpendicular to z.
    Shank: z along the bone, y lateral to the foot, turned back about z by the toe-out, so that on average the shank
    points in the direction of the pelvis; without foot markers y as for the thigh.
    Foot: x from heel to toe, y perpendicular to the plane of heel, toe and ankle; origin at the ankle.
    Pelvis: y to the left, x forward: horizontal, or along the markers; origin between the hips.

    Args:
        points: name → position [m]; `lateral` is any vector to the left; its horizontal part is used for the legs.
        toe_out: side → constant angle [rad] of the foot from the pelvis about the shank's axis, to the left.

    Returns:
        Frames, None where points are missing.
    """
    lateral = points["lateral"]
    pelvis = None
    if {"hip_right", "hip_left"} <= points.keys():
        y = _unit(lateral)
        up = Vector(jnp.zeros_like(y.x), jnp.zeros_like(y.x), jnp.ones_like(y.x))
        x = _across(points.get("forward", cross(y, up)), y)
        pelvis = Frame(scale(0.5, add(points["hip_right"], points["hip_left"])), x, y, cross(x, y))
    legs = {side: _leg(points, lateral, side, toe_out.get(side)) for side in SIDES}
    return Segments(pelvis, *(legs[side][i] for i in range(3) for side in SIDES))


def _leg(points: dict[str, Vector], lateral: Vector, side: str, toe_out: Values | None) -> tuple[Frame | None, ...]:
    if f"hip_{side}" not in points:
        return None, None, None
    hip, knee, ankle = (points[f"{joint}_{side}"] for joint in ("hip", "knee", "ankle"))
    thigh = _bone(hip, knee, lateral)
    shank = _bone(knee, ankle, lateral)
    if toe_out is None:
        return thigh, shank, None
    heel, toe = points[f"heel_{side}"], points[f"toe_{side}"]
    across = _across(cross(shank.z, subtract(toe, heel)), shank.z)
    y = subtract(scale(jnp.cos(toe_out), across), scale(jnp.sin(toe_out), cross(shank.z, across)))
    x = _unit(subtract(toe, heel))
    z = _across(subtract(ankle, heel), x)
    return thigh, Frame(knee, cross(y, shank.z), y, shank.z), Frame(ankle, x, cross(z, x), z)


def _bone(proximal: Vector, distal: Vector, lateral: Vector) -> Frame:
    z = _unit(subtract(proximal, distal))
    y = _across(lateral._replace(z=jnp.zeros_like(lateral.z)), z)
    return Frame(proximal, cross(y, z), y, z)


@jax.jit
def _motion(points: Motion[dict[str, Vector]], toe_out: dict[str, Values]) -> Motion[Segments[Maybe[Frame]]]:
    """Frames along p + v s + a s²/2, differentiated at s = 0."""
    place, speed, bend = points

    def pose(s: Values) -> Segments[Maybe[Frame]]:
        return frames(jax.tree.map(lambda p, v, a: p + s * (v + 0.5 * s * a), place, speed, bend), toe_out)

    at = jnp.zeros_like(place["lateral"].x)
    rates = partial(jax.jvp, pose, tangents=(jnp.ones_like(at),))
    (value, rate), (_, acceleration) = jax.jvp(lambda s: rates((s,)), (at,), (jnp.ones_like(at),))
    return Motion(value, rate, acceleration)


def _toe_out(points: dict[str, np.ndarray], side: str, valid: np.ndarray) -> float:
    """Median angle [rad] about the shank from the pelvis' lateral axis to the foot's lateral axis."""
    z = points[f"knee_{side}"] - points[f"ankle_{side}"]
    z = z / np.linalg.norm(z, axis=1, keepdims=True)
    level = points["lateral"] * [1.0, 1.0, 0.0]
    pelvis = level - np.sum(level * z, axis=1, keepdims=True) * z
    foot = np.cross(z, points[f"toe_{side}"] - points[f"heel_{side}"])
    sine, cosine = np.sum(np.cross(pelvis, foot) * z, axis=1), np.sum(pelvis * foot, axis=1)
    return median(np.arctan2(sine, cosine), valid)


def median(values: np.ndarray, valid: np.ndarray) -> float:
    """Median of the valid values; 0 without a valid value, because then no dependent result is valid either."""
    return float(np.median(values[valid])) if valid.any() else 0.0


def body_motion(
    points: JointCentres,
    time: Float[AnyArray, "time"],
    *,
    cutoff_hz: float = CUTOFF_HZ,
    noise: float | None = None,
    max_gap: float = MAX_GAP,
) -> Replay:
    """Smooth the points measured by motion capture and build the moving body from them, at times (T,) [s] within
    theirs.

    Settings as `smooth`; `noise` chooses the cut-off of each point separately.

    Raises:
        ValueError: if shapes are wrong, no leg was measured, the forward direction is unknown, or a time lies outside.
    """
    markers, time = _named(points), as_float(time)
    start, end = as_float(points.time)[[0, -1]]
    if time.ndim != 1 or not (start <= time.min() and time.max() <= end):
        raise ValueError(f"time must be (T,) within [{start:g}, {end:g}] s; got {time.shape}")
    splines = {
        # A heading is no position: the noise of the markers does not apply to it.
        name: smooth(
            points.time, values, cutoff_hz=cutoff_hz, noise=None if name == "facing" else noise, max_gap=max_gap
        )
        for name, values in markers.items()
    }
    moving = {name: evaluate(spline, time) for name, spline in splines.items()}
    known = {name: covered(spline, time) for name, spline in splines.items()}
    lateral = _lateral(moving.keys())
    built = {name: moving[name] for name in moving if not name.startswith(("facing", "pelvis"))}
    built["lateral"] = _combined(moving, lateral)
    if points.pelvis is not None:
        ends = (("pelvis_front", 1.0), ("pelvis_back", -1.0))
        built["forward"] = _combined(moving, {f"{p}_{side}": sign for p, sign in ends for side in SIDES})
    valid = _valid(known, list(lateral))
    poses = {name: m.pose for name, m in built.items()}
    toe_out = {}
    for side in SIDES:
        shank = getattr(valid, f"shank_{side}")
        if getattr(valid, f"foot_{side}") is not None:
            toe_out[side] = jnp.asarray(_toe_out(poses, side, shank))
    orders = ({name: Vector(*map(jnp.asarray, m[k].T)) for name, m in built.items()} for k in range(3))
    motion = jax.tree.map(as_float, _motion(Motion(*orders), toe_out))
    left = built["lateral"].pose
    yaw = np.unwrap(np.arctan2(-left[:, 0], left[:, 1]))
    return Replay(time, motion, valid, {name: m.pose for name, m in moving.items()}, yaw, splines)


def _named(points: JointCentres) -> dict[str, np.ndarray]:
    """All measured points by name; `facing` is the heading as a vector to the left."""
    shape = checked_time(points.time).shape
    parts = [(getattr(points, side), "", f"_{side}") for side in SIDES] + [(points.pelvis, "pelvis_", "")]
    if parts[0][0] is None and parts[1][0] is None:
        raise ValueError("JointCentres needs at least one leg; both are None")
    markers = {}
    for part, before, after in parts:
        for field, values in part._asdict().items() if part is not None else ():
            if values is not None:
                markers[before + field + after] = as_float(values)
    for name, values in markers.items():
        if values.shape != (*shape, 3):
            raise ValueError(f"{name} must be {(*shape, 3)} like time {shape}; got {values.shape}")
    if points.heading is not None:
        heading = as_float(points.heading)
        if heading.shape != shape:
            raise ValueError(f"heading must be {shape}; got {heading.shape}")
        markers["facing"] = np.stack([-np.sin(heading), np.cos(heading), np.zeros(shape)], axis=1)
    return markers


def _lateral(names: Set[str]) -> dict[str, float]:
    """The vector to the left as a weighted sum of points: pelvis markers, else hips, else heading."""
    if "pelvis_front_right" in names:
        ends = ("pelvis_front", "pelvis_back")
        return {f"{end}_{side}": sign for end in ends for side, sign in zip(SIDES, (-1.0, 1.0), strict=True)}
    if {"hip_right", "hip_left"} <= names:
        return {"hip_right": -1.0, "hip_left": 1.0}
    if "facing" in names:
        return {"facing": 1.0}
    raise ValueError("one leg alone does not say where forward is: give JointCentres.heading or pelvis markers")


def _combined(moving: dict[str, Motion[Values]], factors: dict[str, float]) -> Motion[Values]:
    return Motion(*(sum(factor * moving[name][k] for name, factor in factors.items()) for k in range(3)))


def _valid(known: dict[str, np.ndarray], lateral: list[str]) -> Segments[np.ndarray | None]:
    needs = {"pelvis": ["hip_right", "hip_left", *(name for name in known if name.startswith("pelvis_"))]}
    for side in SIDES:
        foot = [f"heel_{side}", f"toe_{side}"]
        needs[f"thigh_{side}"] = [f"hip_{side}", f"knee_{side}", *lateral]
        needs[f"shank_{side}"] = [f"knee_{side}", f"ankle_{side}", *(foot if set(foot) <= known.keys() else lateral)]
        needs[f"foot_{side}"] = [f"ankle_{side}", *foot]
    return Segments(*(
        np.all([known[name] for name in needs[segment]], axis=0) if set(needs[segment]) <= known.keys() else None
        for segment in Segments._fields
    ))  # fmt: skip
