"""Rigid segments in space: position and orientation, their derivatives, and the readings of a perfect sensor.

World: x forward at the start, y to the left, z up. A segment standing upright has the axes of the world; its x points
forward, y to the left, z along it to the proximal end (for the foot: up). A vector is three arrays, not one array
with an axis of three: so every function is elementwise, and compiles into loops over time and people.
"""

from typing import NamedTuple

from jgait.geometry.vectors import GRAVITY, Vector, dot
from jgait.types import SIDES


class Frame(NamedTuple):
    """Position and orientation of a segment, or their first or second derivative."""

    origin: Vector  #: the segment's proximal joint in the world [m]; the middle of the hips for the pelvis.
    x: Vector  #: the segment's forward axis in the world [1].
    y: Vector  #: its axis to the left [1].
    z: Vector  #: its long axis, towards the proximal end [1].


class Segments[S](NamedTuple):
    """One value for each segment of the lower body, such as its `Frame`."""

    pelvis: S
    thigh_right: S
    thigh_left: S
    shank_right: S
    shank_left: S
    foot_right: S
    foot_left: S


def segment_of(placement: str) -> str:
    """The segment that carries a sensor at a placement (see `jgait.PLACEMENTS`).

    Raises:
        ValueError: if the placement is not on the lower body.
    """
    if placement in ("pelvis", "lower_back", "waist"):
        return "pelvis"
    kind, _, side = placement.partition("_")
    segments = {"thigh": "thigh", "shank": "shank", "ankle": "shank", "foot": "foot"}
    if kind not in segments or side not in SIDES:
        raise ValueError(
            f"the lower body can wear sensors on {', '.join(Segments._fields)}, ankle_right, ankle_left, lower_back "
            f"and waist; got {placement!r}"
        )
    return f"{segments[kind]}_{side}"


class Motion[P](NamedTuple):
    """A pose of any type and its first and second derivative with respect to time, of the same type."""

    pose: P
    rate: P
    acceleration: P


def in_world(frame: Frame, point: Vector) -> Vector:
    """The world coordinates of a point given in segment axes; of a frame's derivative: the derivative of the point."""
    return Vector(*(
        origin + x * point.x + y * point.y + z * point.z
        for origin, x, y, z in zip(frame.origin, frame.x, frame.y, frame.z, strict=True)
    ))  # fmt: skip


def in_segment(frame: Frame, direction: Vector) -> Vector:
    """The components along the segment's axes of a direction given in the world."""
    return Vector(dot(frame.x, direction), dot(frame.y, direction), dot(frame.z, direction))


def inertial(motion: Motion[Frame], point: Vector) -> tuple[Vector, Vector]:
    """The readings of a perfect inertial sensor on a segment, in the segment's axes.

    gyr = (ẏ·z, ż·x, ẋ·y),  acc = (p̈·x, p̈·y, p̈·z) + g (z component of the axes), with p the position of the sensor.

    Returns:
        Angular rate [rad/s] and specific force [m/s²].
    """
    frame, rate = motion.pose, motion.rate
    gyr = Vector(dot(rate.y, frame.z), dot(rate.z, frame.x), dot(rate.x, frame.y))
    force = in_world(motion.acceleration, point)
    return gyr, in_segment(frame, force._replace(z=force.z + GRAVITY))
