"""Simulated walks: what the sensors on both legs read, and the exact truth in the type of an estimate.

`walk` is pure JAX: it can be jitted, mapped over people and differentiated. `leg_recording` and `cohort` wrap it in
the library's own records. How a person moves is in `jgait.walker`, how a sensor errs in `jgait.sensors`.

Source: the protocol is that of Bennett, Jafari and Gans, "An extended Kalman filter to estimate human gait
parameters and walking distance", sections IV and V: 3 to 4 m straight, starting and ending with feet parallel.
"""

import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jgait.sensors import DEGREE, GRAVITY, IDEAL, IDG300, SensorNoise, measure
from jgait.types import Estimate, Imu, Legs, LegTrajectory, Recording, as_float
from jgait.walker import SEGMENTS, Person, body_pose, moment, motion

__all__ = [
    "IDEAL", "IDG300", "LegImus", "Person", "SensorNoise", "check_person", "cohort", "duration", "leg_recording",
    "population", "walk",
]  # fmt: skip


class LegImus(NamedTuple):
    """What both legs wear."""

    thigh_right: Imu
    shank_right: Imu
    thigh_left: Imu
    shank_left: Imu


def walk(key: Any, person: Person, time: Any, noise: SensorNoise = IDEAL) -> tuple[LegImus, Estimate]:
    """Simulate one walk; pure, so that it can be jitted, mapped over people and differentiated.

    Args:
        key: PRNG key of this walk's sensor errors.
        person: who walks.
        time: (T,) [s], evenly spaced from 0.
        noise: how the sensors err and how they are mounted.

    Returns:
        What the four sensors read, and the truth. Its `distance` is that of the hip; its diagnostics hold the
        displacement of each foot (T,) [m], the height of the hip over a standing ankle (T,) [m], the rate of each
        segment (T,) [rad/s] and the lengths of the segments [m].
    """
    value, rate, acceleration = motion(person, time)
    s, c = jnp.sin(value.angle), jnp.cos(value.angle)
    ax, ay = acceleration.sensor_x, acceleration.sensor_y + GRAVITY
    zero = jnp.zeros_like(s)
    gyr = jnp.stack([zero, zero, rate.angle], axis=-1)
    acc = jnp.stack([c * ax + s * ay, c * ay - s * ax, zero], axis=-1)
    flipped = jnp.where(jnp.arange(4) < 2, 0.0, noise.left_flipped)
    read = jax.vmap(measure, in_axes=(0, None, 1, 1, None, 0))
    imus = read(jax.random.split(key, 4), time, gyr, acc, noise, flipped)
    imus = imus._replace(time=jnp.broadcast_to(time[None, :], imus.mask.shape))
    signals = LegImus(*(jax.tree.map(lambda leaf, i=i: leaf[i], imus) for i in range(4)))

    legs = value.legs
    right, left = (LegTrajectory(legs.hip[:, i], legs.knee[:, i], legs.x[:, i], legs.y[:, i]) for i in range(2))
    start = moment(person, jnp.zeros_like(time[0]))
    foot = value.hip_x[:, None] + legs.x - (start.hip_x + start.legs.x)[None, :]
    diagnostics = {
        "hip_height": value.hip_y,
        "foot_displacement_right": foot[:, 0],
        "foot_displacement_left": foot[:, 1],
        **{f"{name}_rate": rate.angle[:, i] for i, name in enumerate(SEGMENTS)},
        "thigh_length": jnp.asarray(person.thigh_length, time.dtype),
        "shank_length": jnp.asarray(person.shank_length, time.dtype),
    }
    valid = time <= duration(person) + 1e-6
    return signals, Estimate(time, Legs(right, left), None, value.hip_x - start.hip_x, valid, diagnostics)


def duration(person: Person) -> Any:
    """How long the recording lasts [s]: quiet standing, the steps, half a step to each side, quiet standing."""
    return person.quiet_before + (person.steps + 2.0) * person.step_time + person.quiet_after


_walk = jax.jit(walk)
_walks = jax.jit(jax.vmap(walk, in_axes=(0, 0, None, None)))


@jax.jit
def _geometry(person: Person) -> tuple[Any, Any, Any]:
    """Over the whole walk: largest |x| over the reach [1], least knee flexion [rad], lowest ankle [m]."""

    def at(u: Any) -> tuple[Any, Any, Any]:
        _, height, legs = body_pose(person, u)
        a, b = person.thigh_length, person.shank_length
        reach = jnp.sqrt(a * a + b * b + 2.0 * a * b * jnp.cos(legs.knee))
        return jnp.max(jnp.abs(legs.x) / reach), jnp.min(legs.knee), jnp.min(height + legs.y)

    ratio, knee, ankle = jax.vmap(at)(jnp.linspace(0.0, 1.0, 2049) * (person.steps + 2.0) - 0.5)
    return jnp.max(ratio), jnp.min(knee), jnp.min(ankle)


def check_person(person: Person) -> None:
    """Refuse a person who cannot walk as asked.

    Raises:
        TypeError: if a field is not a number.
        ValueError: if a field lies outside its range, or the leg is too short for the step, the knee would bend
            backwards, or a foot would cut into the ground; the message names the limit.
    """
    for name, value in zip(Person._fields, person, strict=True):
        if np.ndim(value) != 0 or not np.issubdtype(np.asarray(value).dtype, np.number):
            raise TypeError(f"Person.{name} must be one number; got {value!r}")
        low, high = _RANGES.get(name, (0.0, math.inf))
        if not (math.isfinite(value) and low <= float(value) <= high):
            raise ValueError(f"Person.{name} must lie in [{low:g}, {high:g}]; got {float(value):g}")
    if float(person.steps) != round(float(person.steps)):
        raise ValueError(f"Person.steps must be a whole number; got {float(person.steps):g}")
    ratio, knee, ankle = (float(v) for v in _geometry(Person(*map(float, person))))
    if not ratio < 0.95:
        raise ValueError(
            f"a leg of {person.thigh_length + person.shank_length:.3f} m is too short for steps of "
            f"{person.step_length:.3f} m: the ankle would be {ratio:.2f} of the leg's reach from below the hip "
            "(at most 0.95); shorten step_length or lengthen thigh_length and shank_length"
        )
    if not knee > 0.0:
        raise ValueError(
            f"the knee would bend backwards by {-knee / DEGREE:.1f} deg; raise knee_stance or standing_knee"
        )
    if not ankle > -0.02:
        raise ValueError(
            f"an ankle would be {-100 * ankle:.1f} cm below where it stands; raise knee_swing or lower knee_loading"
        )


_RANGES: dict[str, tuple[float, float]] = {
    "thigh_length": (0.1, 0.8),
    "shank_length": (0.1, 0.8),
    "step_length": (0.05, 2.0),
    "step_time": (0.2, 2.0),
    "steps": (1.0, 200.0),
    "double_support": (0.02, 0.6),
    "knee_stance": (0.5 * DEGREE, 60.0 * DEGREE),
    "knee_loading": (0.0, 60.0 * DEGREE),
    "knee_swing": (0.0, 120.0 * DEGREE),
    "toe_up": (0.0, 60.0 * DEGREE),
    "heel_up": (0.0, 80.0 * DEGREE),
    "roll_over": (0.0, 1.5),
    "standing_hip": (-30.0 * DEGREE, 30.0 * DEGREE),
    "standing_knee": (0.5 * DEGREE, 60.0 * DEGREE),
    "right_first": (0.0, 1.0),
    "thigh_sensor": (0.0, 1.0),
    "shank_sensor": (0.0, 1.0),
}
"""Closed ranges of the fields; those not listed must not be negative."""


def leg_recording(
    key: Any,
    person: Person | None = None,
    noise: SensorNoise = IDG300,
    rate: float = 50.0,
    *,
    name: str = "simulated",
    subject: str = "simulated",
) -> tuple[Recording, Estimate]:
    """Simulate one walk as the library's own records.

    Args:
        key: PRNG key of this walk's sensor errors.
        person: who walks; None for the default.
        noise: how the sensors err and how they are mounted.
        rate: sampling rate [Hz].
        name: what tables and figures call the recording.
        subject: who walked.

    Returns:
        The recording, with placements as in `LegImus`, and the truth at the same times.

    Raises:
        ValueError: if the person cannot walk like that; the message names the limit.
    """
    person = Person() if person is None else person
    check_person(person)
    _check_rate(rate)
    samples = math.floor(float(duration(person)) * rate) + 1
    signals, truth = _walk(key, person, _times(samples, rate), noise)
    return _records(signals, truth, samples, rate, name, subject)


def _records(
    signals: LegImus, truth: Estimate, samples: int, rate: float, name: str, subject: str
) -> tuple[Recording, Estimate]:
    """Cut the padding off and move everything to NumPy."""

    def cut(leaf: Any) -> np.ndarray:
        array = np.asarray(leaf)[..., :samples, :] if np.ndim(leaf) == 2 else np.asarray(leaf)[..., :samples]
        return array if array.dtype == np.bool_ else as_float(array)

    sensors = {place: Imu(*map(cut, imu)) for place, imu in zip(SEGMENTS, signals, strict=True)}
    lengths = {k: float(v) for k, v in truth.diagnostics.items() if np.ndim(v) == 0}
    series = {k: cut(v) for k, v in truth.diagnostics.items() if np.ndim(v) == 1}
    trimmed = jax.tree.map(cut, truth._replace(diagnostics={}))
    return Recording(sensors, rate, name, subject), trimmed._replace(diagnostics={**series, **lengths})


def population(key: Any, n: int) -> Person:
    """Draw `n` adults; every field of the result is (n,).

    Segment lengths follow stature H: thigh 0.245 H, shank 0.246 H, ankle 0.039 H high. Everyone differs from that by
    2 %. Step length is 0.36 H and step time 0.51 s on average (1.2 m/s at 1.70 m);
    it is then stretched so that a whole number of steps covers a distance drawn from 3.1 to 4.0 m.

    Source: proportions of Drillis and Contini as given by Winter, Biomechanics and Motor Control of Human Movement,
    figure 4.1. The averages of step length and time are round values close to the indoor reference data for adults
    at normal speed of Oberg, Karsznia and Oberg, J Rehabil Res Dev 30 (1993) 210; the spreads, the pose and the
    spread of stature (N(1.70, 0.09) m within 1.50 to 1.95) are chosen here.

    Raises:
        ValueError: if `n` is not positive.
    """
    if n < 1:
        raise ValueError(f"population needs at least one person; got n={n}")
    keys = iter(jax.random.split(key, 16))

    def spread(mean: Any, deviation: Any, width: float = 2.0) -> Any:
        return mean + deviation * jax.random.truncated_normal(next(keys), -width, width, (n,))

    height = jnp.clip(spread(1.70, 0.09, 3.0), 1.50, 1.95)
    distance = jax.random.uniform(next(keys), (n,), minval=3.1, maxval=4.0)
    steps = jnp.round(distance / (height * spread(0.36, 0.02)))
    draws = Person(
        thigh_length=height * 0.245 * spread(1.0, 0.02),
        shank_length=height * 0.246 * spread(1.0, 0.02),
        ankle_height=height * 0.039,
        ball_length=height * 0.080,
        heel_length=height * 0.030,
        step_length=distance / steps,
        step_time=spread(0.51, 0.03),
        steps=steps,
        double_support=spread(0.20, 0.02),
        knee_loading=spread(11.0, 2.0) * DEGREE,
        knee_swing=spread(54.0, 3.0) * DEGREE,
        toe_up=spread(18.0, 3.0) * DEGREE,
        heel_up=spread(40.0, 4.0) * DEGREE,
        roll_over=spread(1.0, 0.15),
        standing_hip=spread(2.0, 1.5) * DEGREE,
        standing_knee=spread(5.0, 1.5) * DEGREE,
        right_first=jnp.where(jax.random.bernoulli(next(keys), shape=(n,)), 1.0, 0.0),
        quiet_after=jax.random.uniform(next(keys), (n,), minval=1.0, maxval=2.0),
    )
    return jax.tree.map(lambda leaf: jnp.broadcast_to(jnp.asarray(leaf, height.dtype), (n,)), draws)


def cohort(key: Any, n: int, noise: SensorNoise = IDG300, rate: float = 50.0) -> list[tuple[Recording, Estimate]]:
    """Simulate one walk of each of `n` people drawn from `population`; see `leg_recording` for what each holds.

    Raises:
        ValueError: if `n` is not positive, or `rate` is not a positive number.
    """
    _check_rate(rate)
    who, errors = jax.random.split(key)
    people = population(who, n)
    persons = [Person(*(float(leaf[i]) for leaf in people)) for i in range(n)]
    for person in persons:
        check_person(person)
    counts = [math.floor(float(duration(person)) * rate) + 1 for person in persons]
    times = _times(max(counts), rate)
    signals, truth = _walks(jax.random.split(errors, n), people, times, noise)
    names = [f"simulated_{i + 1:02d}" for i in range(n)]
    walks = [jax.tree.map(lambda leaf, i=i: leaf[i], (signals, truth)) for i in range(n)]
    return [
        _records(worn, true, count, rate, name, name)
        for (worn, true), count, name in zip(walks, counts, names, strict=True)
    ]


def _check_rate(rate: float) -> None:
    if not (math.isfinite(rate) and rate > 0.0):
        raise ValueError(f"rate must be a positive number of samples per second; got {rate!r}")


def _times(samples: int, rate: float) -> Any:
    """Sample times [s], some more than asked for, so that people of other lengths find the function compiled."""
    return jnp.asarray(np.arange(64 * math.ceil(samples / 64)) / rate)
