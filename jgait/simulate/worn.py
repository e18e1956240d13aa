"""One walk: the readings of worn sensors, and the reference in the types of an estimate.

`walk` is pure JAX: it can be jitted, mapped over people and differentiated with respect to every number. `recording`
returns the same as records of the library.
"""

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array, Float, Int, PRNGKeyArray

from jgait.geometry.segments import Frame, Motion, Segments, in_world, inertial, segment_of
from jgait.geometry.vectors import Vector, dot, kept, subtract
from jgait.notes import record
from jgait.simulate.feet import LINGER
from jgait.simulate.footsteps import FIRST, Plan
from jgait.simulate.person import Body, Person
from jgait.simulate.routes import Route
from jgait.simulate.sensors import IDEAL, ImuErrors, measure
from jgait.simulate.smooth import curve_at
from jgait.simulate.walker import SKIN, Frames, framed, moved, plan, separated, ticks
from jgait.types import SIDES, AnyArray, Estimate, Feet, FootTrajectory, Imu, Legs, LegTrajectory, Strides, Values

SEVEN = Segments._fields
"""One sensor on each segment."""

FOUR = ("thigh_right", "shank_right", "thigh_left", "shank_left")
"""Placements of the sensors that `leg_ekf` needs."""


def mount(body: Body, placement: str) -> Vector:
    """Position of a sensor, in the axes of its segment [m] from the segment's proximal joint (see `Frame`).

    Thigh and shank: half way down, in front of the bone; ankle: outside, a little above the ankle; foot: on the instep;
    lower back and pelvis: behind the fifth lumbar vertebra; waist: on the right side.
    """
    if placement in ("pelvis", "lower_back"):
        return Vector(-body.back_depth, 0.0, body.back_height)
    if placement == "waist":
        return Vector(0.0, -0.9 * body.hip_width, body.back_height)
    kind, _, side = placement.partition("_")
    out = 1.0 if side == "left" else -1.0
    places = {
        "thigh": Vector(0.07, 0.0, -0.5 * body.thigh_length),
        "shank": Vector(0.04, 0.0, -0.5 * body.shank_length),
        "ankle": Vector(0.0, 0.04 * out, 0.04 - body.shank_length),
        "foot": Vector(0.4 * body.ball_length, 0.0, 0.0),
    }
    return places[kind]


@record
class Truth(NamedTuple):
    """The reference of a simulated walk."""

    #: joint angles, positions of the insteps (of sensors worn there), distance and strides in the type of an estimate.
    estimate: Estimate
    motion: Motion[Segments[Frame]]  #: motion of all segments, a `Motion` of `Segments` at the times of the estimate.
    plan: Plan  #: footholds and their times.

    @property
    def strides(self) -> Strides:
        """Strides of both feet."""
        return self.estimate.strides


def duration(plan: Plan, person: Person) -> Values:
    """Duration of the walk [s], quiet standing included."""
    last = plan.end.astype(jnp.int32) + FIRST
    return plan.contact[last] + person.gait.quiet_after


class Sensors(NamedTuple):
    """Where sensors are worn; each field has one row for a sensor."""

    segment: Int[AnyArray, "sensor"]  #: (S,) index of what the sensor is worn on, in the frames of `walker.with_skin`.
    point: Float[AnyArray, "sensor 3"]  #: (S, 3) position in the segment's axes [m], see `mount`.


def worn_on(placement: str) -> int:
    """Index of what a sensor is worn on, in the frames of `walker.with_skin`; an ankle has hardly any soft tissue."""
    segment = segment_of(placement)
    bone = SEVEN.index(segment)
    return bone if placement.startswith("ankle") else SKIN.get(segment, bone)


def sensors_at(
    body: Body,
    placements: Sequence[str],
    dtype: DTypeLike = float,
    places: Mapping[str, Sequence[float]] | None = None,
) -> Sensors:
    """The sensors at placements on a body, of which one may occur more than once; at other places where given."""
    points = [list((places or {}).get(placement, mount(body, placement))) for placement in placements]
    return Sensors(np.array([worn_on(placement) for placement in placements]), jnp.asarray(points, dtype))


def named(read: Imu, time: Float[AnyArray, "time"], placements: Iterable[str]) -> dict[str, Imu]:
    """Placement → readings, from the readings of all sensors along the first axis of each array."""
    return {name: Imu(time, *(part[i] for part in read[1:])) for i, name in enumerate(placements)}


def ideal_readings(moving: Motion[Frames], sensors: Sensors) -> tuple[Values, Values]:
    """Angular rates and specific forces (S, T, 3) at sensors, from the motion (4, 3, 13, T) of all segments."""
    worn = (framed(part[:, :, sensors.segment]) for part in moving)
    points = Vector(*(sensors.point[:, i, None] for i in range(3)))
    gyr, acc = (jnp.stack(vector, axis=-1) for vector in inertial(Motion(*worn), points))
    return gyr, acc


def walk(
    key: PRNGKeyArray, person: Person, along: Route, time: Float[AnyArray, "time"], errors: ImuErrors = IDEAL, *,
    capacity: int, placements: Sequence[str] = SEVEN,
) -> tuple[dict[str, Imu], Truth]:  # fmt: skip
    """Simulate one walk; pure, so that it can be jitted, mapped over people and differentiated.

    Times (T,) [s] are evenly spaced, T ≥ 2; the arrays hold `capacity` steps, at least `person.gait.steps`. `capacity`
    and `placements` are static. Other arguments as of `recording`.

    Returns:
        The readings of each sensor, and the truth.
    """
    walks, reads = jax.random.split(key)
    laid = plan(walks, person, along, capacity)
    sensors = sensors_at(person.body, placements, time.dtype)
    read, moving, known = walked(reads, person, laid, time, errors, sensors)
    return named(read, time, placements), Truth(known, Motion(*map(separated, moving)), laid)


def walked(
    key: PRNGKeyArray, person: Person, laid: Plan, time: Float[AnyArray, "time"], errors: ImuErrors,
    sensors: Sensors,
) -> tuple[Imu, Motion[Frames], Estimate]:  # fmt: skip
    """The readings of a planned walk (S, T, …), its motion (see `moved`), and its reference."""
    entry, r = ticks(laid, time)
    moving = kept(moved(person, laid, entry, r))
    keys = jax.vmap(partial(jax.random.fold_in, key))(jnp.arange(sensors.point.shape[0]))
    reads = jax.vmap(lambda key, gyr, acc: measure(key, time, gyr, acc, errors)[1:])(
        keys, *ideal_readings(moving, sensors)
    )
    return Imu(time, *reads), moving, _known(person, laid, moving.pose, time, entry, r.pose)


def _known(
    person: Person, laid: Plan, frames: Frames, time: Float[AnyArray, "time"], entry: Int[Array, "time"], r: Values
) -> Estimate:
    """Estimate of a walk at times (T,) [s], from the frames of all segments (4, 3, 13, T)."""
    body = person.body
    heading, distance = curve_at(jnp.stack([laid.heading_curve, laid.distance_curve]), entry, r)
    ahead = Vector(jnp.cos(heading)[None], jnp.sin(heading)[None], jnp.zeros_like(heading)[None])
    thighs, shanks, feet = (framed(frames[:, :, i : i + 2]) for i in (1, 3, 5))
    hip, tilt = (jnp.arctan2(-dot(part.z, ahead), part.z.z) for part in (thighs, shanks))
    ankle = subtract(feet.origin, thighs.origin)
    legs = LegTrajectory(hip, hip - tilt, dot(ankle, ahead), ankle.z)
    # Displacement of the ankles since the start, along the first heading.
    x, y = (part - part[:, :1] for part in feet.origin[:2])
    gone = x * ahead.x[:, :1] + y * ahead.y[:, :1]
    valid = time <= duration(laid, person) + 1e-6
    lengths = {"thigh_length": body.thigh_length, "shank_length": body.shank_length}
    diagnostics = {
        "hip_height": frames[0, 2, 0] - body.ankle_height,
        "heading": heading,
        **{f"foot_displacement_{side}": gone[i] for i, side in enumerate(SIDES)},
        **{name: jnp.asarray(value, time.dtype) for name, value in lengths.items()},
    }
    by_side = Legs(*(jax.tree.map(lambda part, i=i: part[i], legs) for i in range(2)))
    places = [in_world(framed(frames[:, :, worn_on(name)]), mount(body, name)) for name in ("foot_right", "foot_left")]
    instep = Feet(*(FootTrajectory(jnp.stack(place, axis=-1), None, None) for place in places))
    return Estimate(time, by_side, None, distance, valid, diagnostics, strides(laid), instep)


def _time_at(laid: Plan, ticks: Float[Array, "foothold"]) -> Float[Array, "foothold"]:
    """Time [s] at which the clock of the walk shows ticks (K,) [1]."""
    entry = jnp.clip(jnp.floor(ticks).astype(jnp.int32) + FIRST, 0, laid.time_curve.shape[0] - 1)
    r = ticks - (entry - FIRST).astype(ticks.dtype)
    return curve_at(laid.time_curve, entry, r)


def strides(laid: Plan) -> Strides:
    """The strides of a walk, one for each foothold that is taken (K,), in the order in which they end."""
    k = jnp.arange(-1, laid.x.shape[0] - 1, dtype=laid.x.dtype)
    valid = (laid.stood < 0.5) & (k < laid.end - 0.5)

    def before(values: Float[Array, "foothold"]) -> Float[Array, "foothold"]:
        return jnp.roll(values, 2)

    dx, dy = laid.x - before(laid.x), laid.y - before(laid.y)
    length = jnp.sqrt(jnp.where(valid, dx * dx + dy * dy, 1.0))
    aside = dx * (jnp.roll(laid.y, 1) - laid.y) - dy * (jnp.roll(laid.x, 1) - laid.x)  # from the other foot
    leaves = _time_at(laid, jnp.maximum(k - 2.0 + before(laid.leave) + LINGER, -1.0))
    start = jnp.where(before(laid.stood) > 0.5, leaves, before(laid.contact))

    numbers = start, leaves, laid.contact, length, jnp.abs(aside) / length, laid.z - before(laid.z)
    start, leaves, end, length, width, height = (jnp.where(valid, values, 0.0) for values in numbers)
    return Strides(jnp.where(laid.side > 0.0, 1, 0), start, leaves, end, length, width, height, valid)
