"""Walks as records of the library, on the host, by programs that other walks use too.

The programs are compiled once and kept between processes (`jgait.estimators.programs`): steps, pieces of the route,
samples and sensors are padded to lengths that walks share.
"""

import math
from collections.abc import Iterator, Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, PRNGKeyArray, PyTree

from jgait.estimators.programs import bucket, compiled
from jgait.geometry.segments import Motion
from jgait.simulate.check import check_places, check_sensors, check_slack, check_values
from jgait.simulate.footsteps import Plan
from jgait.simulate.person import Person
from jgait.simulate.routes import Route, padded, straight
from jgait.simulate.sensors import IDEAL, ImuErrors
from jgait.simulate.walker import Frames, Slack, planned, separated
from jgait.simulate.worn import SEVEN, Sensors, Truth, duration, named, sensors_at, walked
from jgait.types import AnyArray, Estimate, Imu, Recording, Values, as_float, check_key, check_kind


def recording(
    key: PRNGKeyArray, person: Person | None = None, along: Route | None = None, errors: ImuErrors = IDEAL,
    rate: float = 100.0, *, placements: Sequence[str] = SEVEN, name: str = "simulated", subject: str = "simulated",
    places: Mapping[str, Sequence[float]] | None = None,
) -> tuple[Recording, Truth]:  # fmt: skip
    """Simulate one walk and return records of the library.

    Args:
        key: PRNG key of the person's variability and of the sensors' errors.
        person: the person; None for the default.
        along: the route, on which the person takes `person.gait.steps` steps and stops; `covering` gives a person the
            steps for all of a route. None for straight ahead.
        errors: errors and mounting of the sensors.
        rate: sampling rate [Hz].
        placements: where sensors are worn, see `jgait.PLACEMENTS`.
        name: name of the recording in tables and figures.
        subject: name of the subject.
        places: placement → position of that sensor in the axes of its segment: forward, left and up from the upper
            joint [m], and from the ankle for a foot; None for the usual ones (`simulate.mount`).

    Returns:
        The recording, and the truth at the same times, in NumPy arrays.

    Raises:
        TypeError, ValueError: if the person cannot walk like that, the sensors cannot err like that, or a placement
            is not known; the message names the limit.
    """
    person = Person() if person is None else person
    check_key(key)
    check_values(person)
    check_sensors(errors, rate, placements)
    check_places(places, placements)
    steps = round(float(person.gait.steps))
    check_kind(along, (Route, type(None)), "along must be a Route, such as jgait.simulate.straight(10.0)")
    along = straight(max(1.0, steps * float(person.gait.stride_length))) if along is None else along
    laid, last = planned_walk(key, person, along, "on this route")
    worn, true = simulated(key, person, laid, last, errors, rate, placements, places)
    return Recording(worn, rate, name, subject), true


def walks(
    keys: Sequence[PRNGKeyArray], people: Sequence[Person], along: Sequence[Route], errors: ImuErrors = IDEAL,
    rate: float = 100.0, placements: Sequence[str] = SEVEN, *, names: Sequence[str] | None = None,
) -> Iterator[tuple[Recording, Truth]]:  # fmt: skip
    """Simulate a walk of each of several people, one by one, all by one compiled program; yields as `recording`.

    `keys`, `people` (their fields floats) and `along` have one entry for each person, the key that of `covering`;
    `names` of recording and subject, None for subject_0001 … Other arguments as of `recording`.

    Raises:
        TypeError, ValueError: as `recording`, before anything is simulated; the message names the recording of whom the
            route asks more than the legs can do.
    """
    if not (len(keys) == len(people) == len(along) > 0):
        raise ValueError(f"walks needs a key and a route for each person; got {len(keys)}, {len(along)}, {len(people)}")
    check_sensors(errors, rate, placements)
    for person in people:
        check_values(person)
    names = names or [f"subject_{i + 1:04d}" for i in range(len(people))]
    laid = [
        (key, person, *planned_walk(key, person, way, f"on the route of {name}"))
        for key, person, way, name in zip(keys, people, along, names, strict=True)
    ]

    def one_by_one() -> Iterator[tuple[Recording, Truth]]:
        for name, walk in zip(names, laid, strict=True):
            worn, true = simulated(*walk, errors, rate, placements)
            yield Recording(worn, rate, name, name), true

    return one_by_one()


def simulated(
    key: PRNGKeyArray, person: Person, laid: Plan, last: float, errors: ImuErrors, rate: float,
    placements: Sequence[str], places: Mapping[str, Sequence[float]] | None = None,
) -> tuple[dict[str, Imu], Truth]:  # fmt: skip
    """One planned walk of `last` seconds, in NumPy arrays, by a program that holds more samples and sensors."""
    samples = samples_in(last, rate)
    time = jnp.asarray(np.arange(bucket(samples)) / rate)
    walker, erring = jax.tree.map(float, (person, errors))
    worn = [*placements, *("pelvis",) * (len(SEVEN) - len(placements))]
    sensors = sensors_at(walker.body, worn, places=places)
    program = compiled(_walk, quick=True)
    read, moving, known = jax.tree.map(np.asarray, program(key, walker, laid, time, erring, sensors))
    whole = Truth(known, Motion(*map(separated, moving)), laid)
    imus, true = trimmed(named(read, read.time, placements), whole, samples)
    return {name: imus[name] for name in placements}, true


def _walk(
    key: PRNGKeyArray, person: Person, laid: Plan, time: Float[AnyArray, "time"], errors: ImuErrors,
    sensors: Sensors,
) -> tuple[Imu, Motion[Frames], Estimate]:  # fmt: skip
    return walked(jax.random.split(key)[1], person, laid, time, errors, sensors)


def _limits(key: PRNGKeyArray, person: Person, along: Route, *, capacity: int) -> tuple[Plan, Values, Slack]:
    laid, left = planned(jax.random.split(key)[0], person, along, capacity)
    return laid, duration(laid, person), left


def limits(key: PRNGKeyArray, person: Person, along: Route) -> tuple[Plan, float, Slack]:
    """The plan of a walk, its duration [s], and the distance of the legs from their limits, in floats; on the host."""
    capacity = room(round(float(person.gait.steps)))
    program = compiled(_limits, quick=True)
    laid, last, left = program(key, jax.tree.map(float, person), padded(along), capacity=capacity)
    return laid, float(last), Slack(*map(float, left))


def planned_walk(key: PRNGKeyArray, person: Person, along: Route, where: str) -> tuple[Plan, float]:
    """The plan of a walk and its duration [s]. Raises ValueError, with the route described by `where`, if it asks more
    than the legs can do.
    """
    laid, last, left = limits(key, person, along)
    check_slack(person, left, where)
    return laid, last


def room(steps: int) -> int:
    """Number of steps that arrays hold, rounded up, so that other walks use the same programs."""
    return bucket(steps, 128)


def samples_in(seconds: float, rate: float) -> int:
    """Number of samples of a walk, the first and the last included."""
    return math.floor(seconds * rate + 1e-6) + 1


def trimmed(read: PyTree, true: PyTree, samples: int) -> PyTree:
    """Cut the padding off every array over time and move all to NumPy; for one walk."""
    longest = true.estimate.time.shape[0]

    def cut(leaf: AnyArray | np.generic | float) -> np.ndarray:
        array = np.asarray(leaf)
        array = array[:samples] if array.ndim and array.shape[0] == longest else array
        return array if array.dtype.kind in "bi" else as_float(array)

    return jax.tree.map(cut, read), jax.tree.map(cut, true)
