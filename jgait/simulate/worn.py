"""One walk: the readings of worn sensors, and the reference in the types of an estimate.

`walk` is pure JAX: it can be jitted, mapped over people and differentiated with respect to every number. `recording`
returns the same as records of the library.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PRNGKeyArray, PyTree, Shaped

from jgait.geometry.segments import Frame, Motion, Segments, inertial, segment_of, separated
from jgait.geometry.vectors import Vector, dot, kept, subtract
from jgait.simulate.check import check_sensors, check_slack, check_values
from jgait.simulate.feet import LINGER
from jgait.simulate.footsteps import FIRST, Plan
from jgait.simulate.person import Body, Person
from jgait.simulate.routes import Route, straight
from jgait.simulate.sensors import IDEAL, Clock, ImuErrors, measure, true_times
from jgait.simulate.smooth import curve_at, step
from jgait.simulate.walker import Slack, moved, plan, planned, ticks
from jgait.types import SIDES, AnyArray, Estimate, Flags, Imu, Legs, LegTrajectory, Recording, Strides, Values, as_float

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


type Known = tuple[Estimate, Load, Load]


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
    """The readings of sensors on a body that moves at nominal times (T,) [s]: placement → readings.

    `mounts` has the position of each placement on its segment [m].
    """
    if not mounts:
        return {}
    own = (Motion(*(getattr(part, segment_of(placement)) for part in moving)) for placement in mounts)
    worn = jax.tree.map(lambda *parts: jnp.stack(parts), *own)
    return _readings(_numbered(key, len(mounts)), worn, time, errors, mounts)


def _numbered(key: PRNGKeyArray, count: int) -> Shaped[Array, "sensor ..."]:
    return jax.vmap(partial(jax.random.fold_in, key))(jnp.arange(count))


def _readings(
    keys: Shaped[Array, "sensor ..."],
    moving: Motion[Frame],
    time: Float[AnyArray, "time"],
    errors: ImuErrors,
    mounts: Mapping[str, Vector],
) -> dict[str, Imu]:
    """As `signals`, from a key and the motion of the segment of each sensor, along the first axis of each array."""
    dtype = time.dtype
    points = Vector(
        *(jnp.stack([jnp.asarray(c, dtype) for c in part])[:, None] for part in zip(*mounts.values(), strict=True))
    )
    gyr, acc = (jnp.stack(vector, axis=-1) for vector in inertial(moving, points))
    left = jnp.asarray([placement.endswith("left") for placement in mounts], dtype)

    def read(key: PRNGKeyArray, gyr: Values, acc: Values, flipped: Values) -> tuple[Values, Values, Flags]:
        return measure(key, time, gyr, acc, errors, flipped)[1:]

    signals = jax.vmap(read)(keys, gyr, acc, left * jnp.asarray(errors.left_flipped, dtype))
    return {name: Imu(time, *(part[i] for part in signals)) for i, name in enumerate(mounts)}


def walk(
    key: PRNGKeyArray, person: Person, along: Route, time: Float[AnyArray, "time"], errors: ImuErrors = IDEAL, *,
    capacity: int, placements: Sequence[str] = SEVEN, clock_of: Mapping[str, Clock] | None = None,
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
        clock_of: placement → a clock with errors; the sensor samples at times that differ from its time stamps.

    Returns:
        The readings of each sensor, and the truth.
    """
    walks, reads = jax.random.split(key)
    laid = plan(walks, person, along, capacity)
    read, moving, known = _walked(reads, person, laid, time, errors, tuple(placements), clock_of)
    return read, _truth(laid, moving, known)


def _walked(
    key: PRNGKeyArray, person: Person, laid: Plan, time: Float[AnyArray, "time"], errors: ImuErrors,
    placements: tuple[str, ...], clock_of: Mapping[str, Clock] | None,
) -> tuple[dict[str, Imu], Motion[Frame], Known]:  # fmt: skip
    """The readings of a planned walk, its motion (see `moved`), and the other parts of its truth."""
    entry, r = ticks(laid, time)
    moving = kept(moved(person, laid, entry, r))
    places = {name: mount(person.body, name) for name in placements}
    own = {name: wrong for name, wrong in (clock_of or {}).items() if name in places}
    right = {name: place for name, place in places.items() if name not in own}
    read = {}
    if right:
        read = _readings(_numbered(key, len(right)), _of_sensors(moving, right), time, errors, right)
    for number, (name, wrong) in enumerate(own.items()):
        late = _of_sensors(kept(moved(person, laid, *ticks(laid, true_times(wrong, time)))), [name])
        read |= _readings(
            _numbered(jax.random.fold_in(key, 1000 + number), 1), late, time, errors, {name: places[name]}
        )
    return {name: read[name] for name in places}, moving, _known(person, laid, moving.pose, time, entry, r.pose)


def _of_sensors(moving: Motion[Frame], placements: Iterable[str]) -> Motion[Frame]:
    """The motion of each sensor's segment, along the first axis of each array."""
    segments = [SEVEN.index(segment_of(placement)) for placement in placements]
    return (
        moving if segments == list(range(len(SEVEN))) else jax.tree.map(lambda part: part[np.array(segments)], moving)
    )


def _truth(laid: Plan, moving: Motion[Frame], known: Known) -> Truth:
    return Truth(known[0], Motion(*map(separated, moving)), *known[1:], laid)


def _known(
    person: Person, laid: Plan, frames: Frame, time: Float[AnyArray, "time"], entry: Int[Array, "time"], r: Values
) -> Known:
    """Estimate and loads of a walk at times (T,) [s], from the frames of all segments (7, T)."""
    body = person.body
    heading, distance = curve_at(jnp.stack([laid.heading_curve, laid.distance_curve]), entry, r)
    ahead = Vector(jnp.cos(heading)[None], jnp.sin(heading)[None], jnp.zeros_like(heading)[None])
    thighs, shanks, feet = (jax.tree.map(lambda part, i=i: part[i : i + 2], frames) for i in (1, 3, 5))
    hip, tilt = (jnp.arctan2(-dot(part.z, ahead), part.z.z) for part in (thighs, shanks))
    ankle = subtract(feet.origin, thighs.origin)
    legs = LegTrajectory(hip, hip - tilt, dot(ankle, ahead), ankle.z)
    # Displacement of the ankles since the start, along the first heading.
    x, y = (part - part[:, :1] for part in feet.origin[:2])
    gone = x * ahead.x[:, :1] + y * ahead.y[:, :1]
    valid = time <= duration(laid, person) + 1e-6
    lengths = {"thigh_length": body.thigh_length, "shank_length": body.shank_length}
    diagnostics = {
        "hip_height": frames.origin.z[0] - body.ankle_height,
        "heading": heading,
        **{f"foot_displacement_{side}": gone[i] for i, side in enumerate(SIDES)},
        **{name: jnp.asarray(value, time.dtype) for name, value in lengths.items()},
    }
    by_side = Legs(*(jax.tree.map(lambda part, i=i: part[i], legs) for i in range(2)))
    estimate = Estimate(time, by_side, None, distance, valid, diagnostics, strides(laid))
    return estimate, *_loads(person, laid, entry, r)


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
    flat = 2.0 * person.gait.foot_flat
    late = jnp.asarray((0, 1), entry.dtype)[:, None]  # the foot that landed last, and the other foot
    at, s = entry[None] - late, r[None] + late.astype(r.dtype)
    k, off, leave = (at - FIRST).astype(r.dtype), laid.off[at], laid.leave[at]
    lands, leaves = k > 0.5, k < laid.end - 2.5
    begins = jnp.stack([s / 0.2, (s - 0.5 * flat) / (0.2 + 0.5 * flat)])
    ends = jnp.stack([(s - off) / 0.3, (s - 1.0) / (leave + LINGER - 1.0)])
    down, up = step(jnp.stack([begins, ends]))
    loads = jnp.where(lands[None], down, 1.0) * jnp.where(leaves[None], 1.0 - up, 1.0)  # heel and toe, both feet
    left = laid.side[entry][None] > 0.0
    right_foot, left_foot = jnp.where(left, loads[:, 1], loads[:, 0]), jnp.where(left, loads[:, 0], loads[:, 1])
    return Load(*right_foot), Load(*left_foot)


def recording(
    key: PRNGKeyArray, person: Person | None = None, along: Route | None = None, errors: ImuErrors = IDEAL,
    rate: float = 100.0, *, placements: Sequence[str] = SEVEN, clock_of: Mapping[str, Clock] | None = None,
    name: str = "simulated", subject: str = "simulated",
) -> tuple[Recording, Truth]:  # fmt: skip
    """Simulate one walk and return records of the library.

    Args:
        key: PRNG key of the person's variability and of the sensors' errors.
        person: the person; None for the default.
        along: the route; None for straight ahead.
        errors: errors and mounting of the sensors.
        rate: sampling rate [Hz].
        placements: where sensors are worn, see `jgait.PLACEMENTS`.
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
    laid, last, left = limits(key, person, along)
    check_slack(person, left, "on this route")
    length = roomy(samples_in(last, rate))
    worn, true = simulated(key, person, laid, last, length, errors, rate, placements, clock_of)
    return Recording(worn, rate, name, subject), true


def simulated(
    key: PRNGKeyArray, person: Person, laid: Plan, last: float, length: int, errors: ImuErrors, rate: float,
    placements: Sequence[str], clock_of: Mapping[str, Clock] | None = None,
) -> tuple[dict[str, Imu], Truth]:  # fmt: skip
    """One planned walk of `last` seconds, in NumPy arrays; computed in arrays of `length` samples."""
    time = np.arange(length) / rate
    walked = _walk(key, person, laid, time, errors, tuple(placements), clock_of)
    read, *parts = jax.tree.map(np.asarray, walked)
    read, true = trimmed(read, _truth(laid, *parts), samples_in(last, rate))
    return {name: read[name] for name in placements}, true


QUICKLY = {"xla_backend_optimization_level": 0}
"""Options of programs that run for milliseconds: without the compiler's optimisations they compile in two thirds of the
time; a walk of 20 s then takes 60 ms instead of 26 ms."""


@partial(jax.jit, static_argnames=("placements",), compiler_options=QUICKLY)
def _walk(
    key: PRNGKeyArray, person: Person, laid: Plan, time: Float[AnyArray, "time"], errors: ImuErrors,
    placements: tuple[str, ...], clock_of: Mapping[str, Clock] | None,
) -> tuple[dict[str, Imu], Motion[Frame], Known]:  # fmt: skip
    return _walked(jax.random.split(key)[1], person, laid, jnp.asarray(time), errors, placements, clock_of)


@partial(jax.jit, static_argnames=("capacity",), compiler_options=QUICKLY)
def _limits(key: PRNGKeyArray, person: Person, along: Route, capacity: int) -> tuple[Plan, Values, Slack]:
    laid, left = planned(jax.random.split(key)[0], person, along, capacity)
    return laid, duration(laid, person), left


def limits(key: PRNGKeyArray, person: Person, along: Route, capacity: int = 0) -> tuple[Plan, float, Slack]:
    """The plan of a walk, its duration [s], and the distance of the legs from their limits, in floats; on the host.

    The arrays of the plan hold at least `capacity` steps.
    """
    capacity = max(capacity, room(round(float(person.gait.steps))))
    laid, last, left = _limits(key, jax.tree.map(float, person), along, capacity)
    return laid, float(last), Slack(*map(float, left))


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
