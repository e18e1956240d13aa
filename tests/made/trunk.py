"""Simulated trunks, all of one shape, so that one compiled program serves them: one sensor at the waist, 50 Hz.

Cutting, joining and turning what the sensor read makes the other recordings.
"""

from typing import NamedTuple

import jax
import numpy as np

from jgait import simulate
from jgait.simulate import Gait, Person
from jgait.types import Imu, Recording

RATE = 50.0


class Made(NamedTuple):
    """What was made: a recording, its way [m], contacts (n,) [s], their sides (0 right), and lengths of strides [m]."""

    recording: Recording
    distance: float
    contact: np.ndarray
    side: np.ndarray
    length: np.ndarray


def walk(turn: float = 0.0, steps: int = 16, quiet: float = 3.0, speed: float | None = None) -> Made:
    """Standing [s], steps and the one that closes up, standing; after 5 m the walk turns [rad]; None: a usual speed."""
    gait = Gait() if speed is None else simulate.gait(speed=speed, stature=1.75)
    person = Person(gait=gait._replace(steps=float(steps), quiet_before=quiet))
    along = simulate.route({"length": 5.0}, {"length": 1.5, "turn": turn}, {"length": 20.0})
    recording, truth = simulate.recording(jax.random.key(1), person, along, rate=RATE, placements=("waist",))
    strides = truth.strides
    rows = np.flatnonzero(strides.valid)
    return Made(
        recording, float(truth.estimate.distance[-1]), np.asarray(strides.end)[rows], np.asarray(strides.side)[rows],
        np.asarray(strides.length)[rows],
    )  # fmt: skip


def imu_of(recording: Recording) -> Imu:
    """Its only sensor."""
    return next(iter(recording.sensors.values()))


def worn(recording: Recording, **fields) -> Recording:
    """The recording with fields of its sensor replaced."""
    ((name, imu),) = recording.sensors.items()
    return recording._replace(sensors={name: imu._replace(**fields)})


def turned(recording: Recording, mount: np.ndarray) -> Recording:
    """The sensor turned in its mount; (3, 3), its axes in the former ones', in columns."""
    imu = imu_of(recording)
    return worn(recording, gyr=imu.gyr @ mount, acc=imu.acc @ mount)


def cut(recording: Recording, first: float, last: float = np.inf) -> Recording:
    """What lies between two instants [s]; time goes on as it was."""
    imu = imu_of(recording)
    kept = (imu.time >= first) & (imu.time <= last)
    return worn(recording, time=imu.time[kept], gyr=imu.gyr[kept], acc=imu.acc[kept], mask=imu.mask[kept])


def joined(*recordings: Recording) -> Recording:
    """One recording behind the other."""
    imus = [imu_of(one) for one in recordings]
    gyr, acc, mask = (np.concatenate([getattr(one, name) for one in imus]) for name in ("gyr", "acc", "mask"))
    return worn(recordings[0], time=np.arange(len(mask)) / recordings[0].sampling_rate_hz, gyr=gyr, acc=acc, mask=mask)


def rotation(seed: int = 3) -> np.ndarray:
    """Any rotation."""
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


def about_vertical(angle: float) -> np.ndarray:
    """A sensor turned about the vertical [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
