"""Checks of the simulated walk: signals that integrate to the truth, feet at rest in stance, legs of constant length.

One uneven walk of a minute round a rectangle serves all of these. Further rows: the gradients, and a fit of the
simulator to its own noisy signals.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax

from experiments.common.row import Row
from jgait import simulate, tune
from jgait.geometry.segments import in_world
from jgait.geometry.vectors import GRAVITY, Vector
from jgait.params import positive
from jgait.simulate import SEVEN, Body, Gait, Person, Truth
from jgait.simulate.feet import LINGER
from jgait.simulate.footsteps import FIRST
from jgait.simulate.sensors import IDEAL, MPU6000
from jgait.simulate.shapes import shape_of
from jgait.simulate.walker import ticks
from jgait.types import SIDES, Recording
from tests import strapdown

RATE_HZ = 200.0
UNEVEN = {"length_variability": 0.03, "time_variability": 0.025, "width_variability": 0.017}
DISCRETE = ("steps", "right_first", "quiet_before", "quiet_after")
"""Fields of a gait that are decisions, or durations of standing."""


# --- one long walk ---


def long_walk(seconds: float, usual: Gait = Gait()) -> tuple[Person, Recording, Truth]:  # noqa: B008
    """A walk round a rectangle with perfect sensors that lasts at least so long, and is cut there."""
    gait = usual._replace(**UNEVEN)
    steps = float(np.ceil((seconds - gait.quiet_before - gait.quiet_after) / (0.5 * gait.stride_time)) + 1.0)
    person = Person(gait=gait._replace(steps=steps))
    laps = int(np.ceil(0.5 * steps * gait.stride_length / 28.0))
    read, truth = simulate.recording(
        jax.random.key(1), person, simulate.rectangle(10.0, 6.0, laps), IDEAL, RATE_HZ
    )  # fmt: skip
    samples = min(round(seconds * RATE_HZ) + 1, truth.estimate.time.size)
    sensors, truth = simulate.trimmed(read.sensors, truth, samples)
    return person, read._replace(sensors=sensors), truth


def strapdown_rows(recording: Recording, truth: Truth, person: Person) -> list[Row]:
    """Largest error of the position integrated from each sensor's readings, at 200, 100 and 50 Hz, and its order."""
    time = truth.estimate.time
    seconds = round(float(time[-1]))
    errors = {}
    for every in (1, 2, 4):
        worst = 0.0
        for placement, imu in recording.sensors.items():
            frame = getattr(truth.motion.pose, simulate.segment_of(placement))
            point = simulate.mount(person.body, placement)
            path, place, _ = strapdown.followed(imu, frame, point, RATE_HZ, every)
            apart = np.linalg.norm(np.asarray(path.position) - place, axis=1)
            worst = max(worst, 1e3 * float(apart.max()))
        errors[every] = worst
    rates = np.array([RATE_HZ / every for every in errors])
    order = -np.polyfit(np.log(rates), np.log(list(errors.values())), 1)[0]
    split = f"{seconds} s, worst of {len(recording.sensors)} ideal sensors, float64"
    names = {1: "", 2: "_100hz", 4: "_50hz"}
    rows = [
        Row(
            f"strapdown_position_error_mm_{seconds}s{names[every]}", error, "mm", None, len(recording.sensors), split
        ).on(
            f"a perfect sensor integrated for {seconds} s, worst placement: error of the position",
            f"{RATE_HZ / every:g} Hz",
            "sensors",
            simulated=True,
        )
        for every, error in errors.items()
    ]
    return [*rows, Row("strapdown_order_of_convergence", float(order), "", None, 3, "fitted over 50, 100 and 200 Hz")]


class Stance(NamedTuple):
    """What of a foot rests in a phase of its stance: points of the sole ahead of the ankle, from and to [steps]."""

    points: tuple[float, ...]
    start: float
    end: float


def stance_motion(truth: Truth, person: Person) -> float:
    """Largest way [m] of a point of the sole while it is what the foot stands on, in any stance of the walk."""
    body, gait = person
    entry, moving = ticks(truth.plan, jnp.asarray(truth.estimate.time))
    entry, r = np.asarray(entry), np.asarray(moving.pose)
    k, steps = entry - FIRST, float(person.gait.steps)
    flat, off, leave = (2.0 * share for share in (gait.foot_flat, gait.heel_off, gait.stance_fraction))
    leave -= LINGER
    phases = (
        Stance((-body.heel_length,), 0.0, flat),
        Stance((-body.heel_length, body.ball_length), flat, off),
        Stance((body.ball_length,), off, leave - float(shape_of(person).when.toes_rise)),
    )
    worst = 0.0
    left_is_new = np.asarray(truth.plan.side)[entry] > 0.0
    for number, side in enumerate(SIDES):
        new = left_is_new == (number == 1)
        foothold, since = np.where(new, k, k - 1), np.where(new, r, 1.0 + r)
        frame = getattr(truth.motion.pose, f"foot_{side}")
        # The first footholds are stood on, not landed on, and the last two are not left.
        walked = (foothold >= 1) & (foothold < steps - 0.5)
        for phase in phases:
            for ahead in phase.points:
                point = np.stack(in_world(frame, Vector(ahead, 0.0, -body.ankle_height)), axis=1)
                rests = walked & (since >= phase.start) & (since <= phase.end)
                for one in np.unique(foothold[rests]):
                    stood = point[rests & (foothold == one)]
                    worst = max(worst, float(np.linalg.norm(stood - stood[0], axis=1).max()))
    return worst


def length_error(truth: Truth, body: Body) -> float:
    """Largest difference [m] of the distances between joints from the lengths of the body."""
    s = truth.motion.pose
    pairs = [("hip_width", s.thigh_right.origin, s.thigh_left.origin)]
    for side in SIDES:
        thigh, shank, foot = (getattr(s, f"{name}_{side}").origin for name in ("thigh", "shank", "foot"))
        pairs += [("thigh_length", thigh, shank), ("shank_length", shank, foot)]
    return max(
        float(np.abs(np.linalg.norm(np.stack(a) - np.stack(b), axis=0) - getattr(body, name)).max())
        for name, a, b in pairs
    )


def standing_error(recording: Recording, truth: Truth, person: Person) -> float:
    """Largest difference [m/s²] between the specific force while standing and gravity in the segment's axes."""
    stands = truth.estimate.time < person.gait.quiet_before
    worst = 0.0
    for placement, imu in recording.sensors.items():
        frame = getattr(truth.motion.pose, simulate.segment_of(placement))
        up = GRAVITY * np.stack([frame.x.z, frame.y.z, frame.z.z], axis=1)
        worst = max(worst, float(np.abs(imu.acc - up)[stands].max()))
    return worst


def walk_rows(seconds: float) -> list[Row]:
    """Rows of one long walk."""
    person, recording, truth = long_walk(seconds)
    split = f"{seconds:g} s round a rectangle, {RATE_HZ:g} Hz, float64"
    steps = int(person.gait.steps)
    return [
        *strapdown_rows(recording, truth, person),
        Row("stance_foot_motion_m", stance_motion(truth, person), "m", None, steps, split),
        Row("segment_length_error_m", length_error(truth, person.body), "m", None, 5, split),
        Row("standing_acc_error", standing_error(recording, truth, person), "m/s²", None, len(SEVEN), split),
    ]


# --- gradients ---


def gradient_row(samples: int) -> Row:
    """Gradient of a loss on all signals against central differences, by every gait parameter that is a number.

    The differences are extrapolated from two widths; the error is relative to each component, or to a thousandth of
    the largest where a component is smaller than that.
    """
    names = [name for name in Gait._fields if name not in DISCRETE]
    usual = Gait(**UNEVEN, length_asymmetry=0.02, time_asymmetry=-0.01)._replace(
        steps=4.0, quiet_before=0.5, quiet_after=0.5
    )
    start = np.array([float(getattr(usual, name)) for name in names])
    time = jnp.asarray(np.arange(samples) * 0.01)

    def signals(values: Any) -> Any:
        person = Person(gait=usual._replace(**dict(zip(names, values, strict=True))))
        read, _ = simulate.walk(jax.random.key(2), person, simulate.straight(20.0), time, capacity=4)
        return jnp.stack([jnp.concatenate([imu.gyr, 0.2 * imu.acc], axis=1) for imu in read.values()])

    def loss(values: Any) -> Any:
        # Against signals that are 0, so that every signal counts.
        return jnp.mean(jnp.square(signals(values)))

    slope = np.asarray(jax.jit(jax.jacfwd(loss))(jnp.asarray(start)))
    width = 1e-4 * np.maximum(np.abs(start), 0.01)
    moves = np.concatenate([sign * np.diag(part * width) for part in (1.0, 0.5) for sign in (1.0, -1.0)])
    found = np.asarray(jax.jit(lambda v: jax.lax.map(loss, v))(jnp.asarray(start[None, :] + moves)))
    wide, wide_back, narrow, narrow_back = found.reshape(4, -1)
    difference = (4.0 * (narrow - narrow_back) / width - (wide - wide_back) / (2.0 * width)) / 3.0
    scale = np.maximum(np.abs(slope), 1e-3 * np.abs(slope).max())
    error = np.abs(slope - difference) / scale
    worst = names[int(np.argmax(error))]
    return Row("gradient_max_rel_error", float(error.max()), "", None, len(names), f"parameters; worst: {worst}")


# --- fitting the simulator to its own signals ---


FREE = ("stride_length", "stride_time", "stance_fraction", "step_width", "toe_up", "heel_up", "swing_lift",
        "landing_speed", "pelvis_rise")  # fmt: skip
WORN = ("shank_right", "shank_left", "foot_right", "foot_left")


class Free(NamedTuple):
    """Gait parameters that are fitted, each (n,) over people."""

    stride_length: Any
    stride_time: Any
    stance_fraction: Any
    step_width: Any
    toe_up: Any
    heel_up: Any
    swing_lift: Any
    landing_speed: Any
    pelvis_rise: Any


def fit_errors(people: int, steps: int, samples: int = 384) -> np.ndarray:
    """Errors of the fitted stride lengths (n,) [m], from a start with every parameter 5 % off, up or down.

    The signals have the noise and biases of an MPU-6000, well aligned.
    """
    rng = np.random.default_rng(5)
    drawn = simulate.population(jax.random.key(11), people, recorded=False)
    usual = drawn.gait._replace(
        steps=jnp.full((people,), 4.0), quiet_before=jnp.full((people,), 0.3), quiet_after=jnp.full((people,), 0.3),
        **{name: jnp.zeros((people,)) for name in UNEVEN},
    )  # fmt: skip
    drawn = Person(drawn.body, usual)
    true = Free(*(np.asarray(getattr(usual, name)) for name in FREE))
    time = jnp.asarray(np.arange(samples) * 0.01)
    errors = MPU6000._replace(mounting=0.0, packet_loss=0.0, acc_range=np.inf, gyr_range=np.inf)

    def read(person: Person, key: Any, erring: Any) -> Any:
        sensors, _ = simulate.walk(
            key, person, simulate.straight(20.0), time, erring, capacity=4, placements=WORN
        )  # fmt: skip
        return jnp.stack([jnp.concatenate([imu.gyr, 0.2 * imu.acc], axis=1) for imu in sensors.values()])

    keys = jax.random.split(jax.random.key(12), people)
    observed = jax.jit(jax.vmap(lambda p, k: read(p, k, errors)))(drawn, keys)
    start = Free(*(np.asarray(value) * (1.0 + 0.05 * rng.choice((-1.0, 1.0), people)) for value in true))

    def loss(params: Free, data: Any) -> Any:
        def one(own: Free, person: Person, seen: Any) -> Any:
            gait = person.gait._replace(**own._asdict())
            # A contact moved by a sample must not look like another walk: large differences count less.
            apart = read(Person(person.body, gait), jax.random.key(0), IDEAL) - seen
            return jnp.mean(jnp.sqrt(1.0 + jnp.square(apart)) - 1.0)

        return jnp.mean(jax.vmap(one)(params, *data))

    rate = optax.cosine_decay_schedule(0.006, steps)
    found = tune.fit(
        loss, jax.tree.map(jnp.asarray, start), Free(*(positive for _ in FREE)), (drawn, observed),
        optax.adam(rate), steps=steps, batched=False,
    )  # fmt: skip
    return np.asarray(found.params.stride_length) - true.stride_length


def fit_rows(people: int, steps: int) -> list[Row]:
    """Rows of the fit."""
    error = 100.0 * np.abs(fit_errors(people, steps))
    line = "the simulator fitted to its own noisy signals: error of the stride length"
    split = f"shanks and feet, {len(FREE)} parameters 5 % off at the start, {steps} steps of Adam"
    return [
        Row("fit_stride_length_error_cm", float(error.mean()), "cm", None, people, split).on(
            line, "mean", "people", simulated=True
        ),
        Row("fit_stride_length_error_cm_worst", float(error.max()), "cm", None, people, split).on(
            line, "worst", "people", simulated=True
        ),
    ]


def rows(quick: bool) -> list[Row]:
    """Of one long walk, of gradients, and of the fit."""
    walked = walk_rows(20.0 if quick else 60.0)
    return [*walked, gradient_row(384), *(fit_rows(2, 60) if quick else fit_rows(4, 300))]
