"""One walk: the readings of worn sensors, and the reference in the types of an estimate.

`walk` is pure JAX: it can be jitted, mapped over people and differentiated with respect to every number. `recording`
returns the same as records of the library.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray, PyTree

from jgait.geometry.segments import Frame, Motion, Segments, inertial, segment_of
from jgait.geometry.vectors import Vector, dot, kept, subtract
from jgait.simulate.check import check_sensors, check_slack, check_values
from jgait.simulate.feet import LINGER
from jgait.simulate.footsteps import FIRST, Plan
from jgait.simulate.person import Body, Person
from jgait.simulate.routes import Route, straight
from jgait.simulate.sensors import IDEAL, Clock, ImuErrors, measure, true_times
from jgait.simulate.smooth import curve_at, step
from jgait.simulate.walker import Slack, clock, motion, plan, slack
from jgait.types import SIDES, AnyArray, Estimate, Imu, Legs, LegTrajectory, Recording, Strides, Values, as_float

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


class Load(NamedTuple):
    """Share of the body weight on one foot, (T,) from 0 to 1 [1]: under the heel, and under the ball and toes."""

    heel: Values
    toe: Values


class Truth(NamedTuple):
    """The reference of a simulated walk.

    Attributes:
        estimate: joint angles, foot positions, distance and strides in the type of an estimate.
        motion: motion of all segments, a `Motion` of `Segments` at the times of the estimate.
        load_right: load of the right foot.
        load_left: load of the left foot.
        plan: footholds and their times.
    """

    estimate: Estimate
    motion: Motion[Segments[Frame]]
    load_right: Load
    load_left: Load
    plan: Plan

    @property
    def strides(self) -> Strides:
        """Strides of both feet."""
        return self.estimate.strides


def duration(plan: Plan, person: Person) -> Values:
    """Duration of the walk [s], quiet standing included."""
    last = plan.end.astype(jnp.int32) + FIRST
    return plan.contact[last] + person.gait.quiet_after


def signals(
    key: PRNGKeyArray,
    moving: Motion[Segments[Frame]],
    time: Float[AnyArray, "time"],
    errors: ImuErrors,
    mounts: Mapping[str, Vector],
) -> dict[str, Imu]:
    """The readings of sensors on a moving body.

    Args:
        key: PRNG key of the sensors' errors.
        moving: the body at times (T,), a `Motion` of `Segments`.
        time: (T,) [s] nominal times of the samples.
        errors: errors and mounting of the sensors.
        mounts: placement → position on the segment [m].

    Returns:
        placement → readings.
    """
    read = {}
    for number, (placement, point) in enumerate(mounts.items()):
        name = segment_of(placement)
        own = Motion(*(getattr(part, name) for part in moving))
        gyr, acc = (jnp.stack(vector, axis=1) for vector in inertial(own, point))
        flipped = jnp.asarray(errors.left_flipped, gyr.dtype) if placement.endswith("left") else 0.0
        read[placement] = measure(jax.random.fold_in(key, number), time, gyr, acc, errors, flipped)
    return read


def walk(
    key: PRNGKeyArray, person: Person, along: Route, time: Float[AnyArray, "time"], errors: ImuErrors = IDEAL, *,
    capacity: int, placements: Sequence[str] = SEVEN, mounts: Mapping[str, Vector] | None = None,
    clock_of: Mapping[str, Clock] | None = None,
) -> tuple[dict[str, Imu], Truth]:  # fmt: skip
    """Simulate one walk; pure, so that it can be jitted, mapped over people and differentiated.

    Args:
        key: PRNG key of the person's variability and of the sensors' errors.
        person: the person.
        along: the route.
        time: (T,) [s], evenly spaced, T ≥ 2.
        errors: errors and mounting of the sensors.
        capacity: largest number of steps that the arrays hold; at least `person.gait.steps`. Static.
        placements: where sensors are worn, see `jgait.PLACEMENTS`. Static.
        mounts: positions on the segments that differ from `mount` [m].
        clock_of: placement → a clock with errors; the sensor samples at times that differ from its time stamps.

    Returns:
        The readings of each sensor, and the truth.
    """
    walks, reads = jax.random.split(key)
    laid = plan(walks, person, along, capacity)
    moving = kept(motion(person, laid, time))
    places = {name: mount(person.body, name) for name in placements} | dict(mounts or {})
    own = {name: wrong for name, wrong in (clock_of or {}).items() if name in places}
    right = {name: place for name, place in places.items() if name not in own}
    read = signals(reads, moving, time, errors, right)
    for number, (name, wrong) in enumerate(own.items()):
        late = kept(motion(person, laid, true_times(wrong, time)))
        read |= signals(jax.random.fold_in(reads, 1000 + number), late, time, errors, {name: places[name]})
    return {name: read[name] for name in places}, truth(person, laid, moving, time)


def truth(person: Person, laid: Plan, moving: Motion[Segments[Frame]], time: Float[AnyArray, "time"]) -> Truth:
    """The truth about a walk at times (T,) [s]."""
    body = person.body
    entry, r = clock(laid, time)
    heading, distance = (curve_at(table, entry, r) for table in (laid.heading_curve, laid.distance_curve))
    ahead = Vector(jnp.cos(heading), jnp.sin(heading), jnp.zeros_like(heading))
    segments: Segments[Frame] = moving.pose
    legs = Legs(*(_leg(segments, side, ahead) for side in SIDES))
    valid = time <= duration(laid, person) + 1e-6
    lengths = {"thigh_length": body.thigh_length, "shank_length": body.shank_length}
    diagnostics = {
        "hip_height": segments.pelvis.origin.z - body.ankle_height,
        "heading": heading,
        **{f"foot_displacement_{side}": _displacement(getattr(segments, f"foot_{side}"), ahead) for side in SIDES},
        **{name: jnp.asarray(value, time.dtype) for name, value in lengths.items()},
    }
    loads = _loads(person, laid, entry, r)
    estimate = Estimate(time, legs, None, distance, valid, diagnostics, strides(laid))
    return Truth(estimate, moving, *loads, laid)


def _leg(segments: Segments[Frame], side: str, ahead: Vector) -> LegTrajectory:
    """One leg in the vertical plane of the heading."""
    thigh, shank, foot = (getattr(segments, f"{name}_{side}") for name in ("thigh", "shank", "foot"))
    hip, tilt = (jnp.arctan2(-dot(part.z, ahead), part.z.z) for part in (thigh, shank))
    ankle = subtract(foot.origin, thigh.origin)
    return LegTrajectory(hip, hip - tilt, dot(ankle, ahead), ankle.z)


def _displacement(foot: Frame, ahead: Vector) -> Values:
    """Displacement of the ankle since the start, along the first heading [m]."""
    return (foot.origin.x - foot.origin.x[0]) * ahead.x[0] + (foot.origin.y - foot.origin.y[0]) * ahead.y[0]


def _time_at(laid: Plan, ticks: Float[Array, "foothold"]) -> Float[Array, "foothold"]:
    """Time [s] at which the clock of the walk shows ticks (K,) [1]."""
    entry = jnp.clip(jnp.floor(ticks).astype(jnp.int32) + FIRST, 0, laid.time_curve.shape[0] - 1)
    r = ticks - (entry - FIRST).astype(ticks.dtype)
    return curve_at(laid.time_curve, entry, r)


def strides(laid: Plan) -> Strides:
    """The strides of a walk, one for each foothold that is taken (K,), in the order in which they end."""
    k = jnp.arange(-1, laid.x.shape[0] - 1, dtype=laid.x.dtype)
    valid = (k > 0.5) & (k < laid.end - 0.5)

    def before(values: Float[Array, "foothold"]) -> Float[Array, "foothold"]:
        return jnp.roll(values, 2)

    def other(values: Float[Array, "foothold"]) -> Float[Array, "foothold"]:
        return jnp.roll(values, 1)

    dx, dy = laid.x - before(laid.x), laid.y - before(laid.y)
    length = jnp.sqrt(jnp.where(valid, dx * dx + dy * dy, 1.0))
    aside = dx * (other(laid.y) - laid.y) - dy * (other(laid.x) - laid.x)
    leaves = _time_at(laid, jnp.maximum(k - 2.0 + before(laid.leave) + LINGER, -1.0))
    start = jnp.where(k < 2.5, leaves, before(laid.contact))

    def filled(values: Float[Array, "foothold"]) -> Float[Array, "foothold"]:
        return jnp.where(valid, values, 0.0)

    side = jnp.where(laid.side > 0.0, 1, 0)
    return Strides(
        side, filled(start), filled(leaves), filled(laid.contact), filled(length), filled(jnp.abs(aside) / length),
        filled(laid.z - before(laid.z)), valid,
    )  # fmt: skip


def _loads(person: Person, laid: Plan, entry: Int[Array, "..."], r: Values) -> tuple[Load, Load]:
    """Loads of both feet: the weight moves onto the heel, along the sole, and off the toes."""
    gait = person.gait
    flat = 2.0 * gait.foot_flat

    def load(s: Values, at: Int[Array, "..."], lands: Bool[Array, "..."], leaves: Bool[Array, "..."]) -> Load:
        off, leave = laid.off[at], laid.leave[at]
        down = jnp.where(lands, step(s / 0.2), 1.0)
        sole = jnp.where(lands, step((s - 0.5 * flat) / (0.2 + 0.5 * flat)), 1.0)
        heel = down * jnp.where(leaves, 1.0 - step((s - off) / 0.3), 1.0)
        toe = sole * jnp.where(leaves, 1.0 - step((s - 1.0) / (leave + LINGER - 1.0)), 1.0)
        return Load(heel, toe)

    k = (entry - FIRST).astype(laid.end.dtype)
    steps = laid.end - 2.0
    new = load(r, entry, k > 0.5, k < steps - 0.5)
    old = load(1.0 + r, entry - 1, k > 1.5, k - 1.0 < steps - 0.5)
    left = laid.side[entry] > 0.0
    pairs = [(jnp.where(left, b, a), jnp.where(left, a, b)) for a, b in zip(new, old, strict=True)]
    return Load(*(right for right, _ in pairs)), Load(*(left for _, left in pairs))


_walk = jax.jit(walk, static_argnames=("capacity", "placements"))


def recording(
    key: PRNGKeyArray, person: Person | None = None, along: Route | None = None, errors: ImuErrors = IDEAL,
    rate: float = 100.0, *, placements: Sequence[str] = SEVEN, mounts: Mapping[str, Vector] | None = None,
    clock_of: Mapping[str, Clock] | None = None, name: str = "simulated", subject: str = "simulated",
) -> tuple[Recording, Truth]:  # fmt: skip
    """Simulate one walk and return records of the library.

    Args:
        key: PRNG key of the person's variability and of the sensors' errors.
        person: the person; None for the default.
        along: the route; None for straight ahead.
        errors: errors and mounting of the sensors.
        rate: sampling rate [Hz].
        placements: where sensors are worn, see `jgait.PLACEMENTS`.
        mounts: positions on the segments that differ from `mount` [m].
        clock_of: placement → a clock with errors.
        name: name of the recording in tables and figures.
        subject: name of the subject.

    Returns:
        The recording, and the truth at the same times, in NumPy arrays.

    Raises:
        TypeError, ValueError: if the person cannot walk like that, the sensors cannot err like that, or a placement
            is not known; the message names the limit.
    """
    person = Person() if person is None else person
    check_values(person)
    check_sensors(errors, rate, placements)
    steps = round(float(person.gait.steps))
    along = straight(max(1.0, steps * float(person.gait.stride_length))) if along is None else along
    last, left = limits(key, person, along)
    check_slack(person, left, "on this route")
    samples = samples_in(last, rate)
    time = jnp.asarray(np.arange(roomy(samples)) / rate)
    read, true = _walk(
        key, person, along, time, errors, capacity=room(steps), placements=tuple(placements), mounts=mounts,
        clock_of=clock_of,
    )  # fmt: skip
    read, true = trimmed(read, true, samples)
    return Recording(read, rate, name, subject), true


_plan = jax.jit(plan, static_argnames=("capacity",))


@jax.jit
def _ends(laid: Plan, person: Person) -> tuple[Values, Slack]:
    return duration(laid, person), slack(person, laid)


def limits(key: PRNGKeyArray, person: Person, along: Route) -> tuple[float, Slack]:
    """Duration of a walk [s], and distance of the legs from their limits; on the host, in floats."""
    laid = _plan(jax.random.split(key)[0], person, along, room(round(float(person.gait.steps))))
    last, left = _ends(laid, person)
    return float(last), Slack(*map(float, left))


def room(steps: int) -> int:
    """Number of steps that arrays hold, rounded up, so that other walks use the same compiled functions."""
    return 32 * math.ceil(steps / 32)


def samples_in(seconds: float, rate: float) -> int:
    """Number of samples of a walk, the first and the last included."""
    return math.floor(seconds * rate + 1e-6) + 1


def roomy(samples: int) -> int:
    """Number of samples that arrays hold, rounded up, so that other walks use the same compiled functions."""
    return 512 if samples <= 512 else 1024 * math.ceil(samples / 1024)


def trimmed(read: PyTree, true: PyTree, samples: int) -> PyTree:
    """Cut the padding off every array over time and move all to NumPy; for one walk."""
    longest = true.estimate.time.shape[0]

    def cut(leaf: AnyArray | np.generic | float) -> np.ndarray:
        array = np.asarray(leaf)
        array = array[:samples] if array.ndim and array.shape[0] == longest else array
        return array if array.dtype.kind in "bi" else as_float(array)

    return jax.tree.map(cut, read), jax.tree.map(cut, true)
