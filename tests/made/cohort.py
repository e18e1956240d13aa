"""A cohort that costs nothing: walks of a few numbers, and an estimator that adds them up, for tests in any process."""

import contextlib
import os
import signal
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from made.notes import note

from jgait import params
from jgait.estimators.interface import Estimator, Prepared, Sampled, Times
from jgait.types import Estimate, Imu, Legs, LegTrajectory, Recording, RecordingError, Strides, Walk


class Inputs(NamedTuple):
    time: Times
    speed: Sampled
    valid: Sampled


class Params(NamedTuple):
    scale: Annotated[Any, params.Parameter(params.positive, "1", "of the distance")] = 1.1
    offset: Annotated[Any, params.Parameter(params.real, "rad", "of the angle")] = 0.25


TRACED: list[tuple[int, Any]] = []
"""Length and options each time the estimator is traced."""


def prepare(recording: Recording) -> Prepared[Inputs]:
    if "foot_right" not in recording.sensors:
        raise RecordingError(f"needs 'foot_right';\n the recording has {sorted(recording.sensors)}")
    imu = recording.sensors["foot_right"]
    return Prepared(Inputs(imu.time, imu.gyr[:, 0], imu.mask), recording.sampling_rate_hz > 150.0, (note("prepared"),))


def run(p: Params, inputs: Inputs, options: Any) -> Estimate:
    """Distance is the sum of speeds; a speed below −5 makes it NaN, as a bad recording does."""
    TRACED.append((inputs.time.shape[0], options))
    way = jnp.where(inputs.valid, p.scale * inputs.speed, 0.0) * 0.01
    way = jnp.where(inputs.speed < -5.0, jnp.sqrt(jnp.where(inputs.speed < -5.0, -1.0, 1.0)), way)
    angle = jnp.sin(inputs.time) + p.offset * jnp.where(options, 2.0, 1.0)
    leg = LegTrajectory(angle, 0.6 + 0.4 * angle, 0.1 * angle, 0.2 * angle)
    distance = jnp.cumsum(way)
    return Estimate(inputs.time, Legs(leg, None), None, distance, inputs.valid, {"nis_right": jnp.mean(way)})


def with_body(p: Params, body: dict[str, Any]) -> Params:
    return p._replace(offset=body["offset"])


FAKE = Estimator("fake", Params(), prepare, run, with_body)


def walk(i: int, bad: str = "") -> Walk:
    """Walk number i, of 300 to 1300 samples at 100 or 200 Hz by turns of seven; `bad` spoils it."""
    rng = np.random.default_rng(i)
    samples = 300 + int(rng.integers(0, 1000))
    time = np.arange(samples) * 0.01
    speed = 1.0 + 0.2 * rng.normal(size=samples)
    seen = np.ones(samples, bool)
    if bad == "nan":
        speed[100:] = -9.0
    if bad == "blind":
        seen[:] = False
    imu = Imu(time, np.stack([speed, speed, speed], 1), None, seen)
    leg = LegTrajectory(*(np.sin(time),) * 4)
    starts = np.arange(0.0, time[-1] - 1.0, 1.1)
    count = starts.size
    strides = Strides(
        np.arange(count) % 2, starts, starts + 0.6, starts + 1.0, np.full(count, 1.0), np.full(count, 0.1),
        np.zeros(count), np.arange(count) != 1,
    )  # fmt: skip
    truth = Estimate(
        time, Legs(leg, leg), None, np.cumsum(speed) * 0.01, np.ones(samples, bool), {"offset": 0.5}, strides
    )
    sensors = {"waist" if bad == "misplaced" else "foot_right": imu}
    rate = 200.0 if i % 7 == 0 else 100.0
    return Walk(Recording(sensors, rate, f"walk_{i:03d}", f"00{i % 4}", (note("as it came"),)), truth, {"number": i})


def read(number: Any) -> Walk:
    """A walk by its number; 13 cannot be read."""
    if int(number) == 13:
        raise OSError("no such file: 13")
    return walk(int(number))


def read_or_die(item: str) -> Walk:
    """A walk by "number:folder"; the process that 20 finds with a file `die` in the folder dies, with 7 always."""
    number, folder = item.split(":", 1)
    if number == "7":
        os.kill(os.getpid(), signal.SIGKILL)
    if number == "20":
        with contextlib.suppress(FileNotFoundError):
            (Path(folder) / "die").unlink()
            os.kill(os.getpid(), signal.SIGKILL)
    return walk(int(number))
