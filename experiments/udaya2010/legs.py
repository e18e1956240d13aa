"""Rate and accelerometer of shanks at 50 Hz, and when their gyroscope is on: three public sets, simulated people.

Axes, the sensor's true place and its gyroscope's bias come from the whole recording, as from a calibration. Recordings
above 100 Hz are low-passed causally at 20 Hz first. Forward swing is positive here.
"""

import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from experiments.common import protocols
from experiments.common.recordings import names, walks
from experiments.common.shanks import rested
from jgait.duty_cycle import power
from jgait.mounting import shank as shank_axes
from jgait.signal import butterworth
from jgait.types import SIDES, Imu, Recording, as_float

RATE_HZ = 50.0
CUTOFF_HZ = 20.0
SWINGING = 1.0  # [rad/s]
STEADY_S = 84.0  # [s] of the protocol with warm-up
WARM_S = 5.0


class Leg(NamedTuple):
    """What the sensors on one leg measured, never switched off.

    Attributes:
        walk: name of the recording.
        side: "right" or "left".
        tuned: whether the fillers' parameters were chosen on this recording.
        rate: (T,) sagittal rate of the shank [rad/s].
        acc: (T, 3) specific force of the shank, forward, left, up [m/s²].
        thigh: (T, 4) the same two of the thigh; None if it is not worn.
    """

    walk: str
    side: str
    tuned: bool
    rate: np.ndarray
    acc: np.ndarray
    thigh: np.ndarray | None

    def part(self, start: int, samples: int) -> "Leg":
        """The samples from `start`, at most so many."""
        kept = slice(start, start + samples)
        thigh = None if self.thigh is None else self.thigh[kept]
        return self._replace(rate=self.rate[kept], acc=self.acc[kept], thigh=thigh)


class Case(NamedTuple):
    """A leg and a schedule.

    Attributes:
        leg: everything that would have been measured.
        usable: (T,) bool, what is.
        judged: sample from which errors count.
        saving: part of the gyroscope's energy that the schedule saves while it is followed [1].
    """

    leg: Leg
    usable: np.ndarray
    judged: int
    saving: float


def legs(name: str, only: Sequence[str] | None = None) -> list[Leg]:
    """Every leg of a data set, while it walks: `tripod` on the belt at its speed, the others first stride to last.

    Args:
        name: "tripod", "walking5m" or "neura_sparse" (its sensors on mid shank and ankle, each as a leg).
        only: names of recordings; None: all.

    Raises:
        DatasetUnavailable: if the set is not there.
    """
    return [leg for walk in only or names(name) for leg in _of_walk(name, walk)]


@functools.cache
def _of_walk(name: str, walk: str) -> tuple[Leg, ...]:
    """The legs of one recording; read and turned once, though several parts of the experiment ask for them."""
    found: list[Leg] = []
    for one in walks(name, (walk,)):
        window = (one.info.get("windows") or {}).get("steady" if name == "tripod" else "whole")
        for side in SIDES if window is not None else ():
            tuned = walk.endswith("/PWS") or walk.startswith("Young/")
            found += _of_side(one.recording, side, window, tuned, ankle=name == "neura_sparse")
    return tuple(found)


def _of_side(recording: Recording, side: str, window: tuple[int, int], tuned: bool, *, ankle: bool) -> list[Leg]:
    """The shank's sensor, and on request the sensor at the ankle."""
    if f"shank_{side}" not in recording.sensors:
        return []
    place, _ = shank_axes.worn_on_shank(recording, side)
    other = f"thigh_{side}" if place == f"shank_{side}" else f"shank_{side}"
    thigh = sagittal(recording, other) if other in recording.sensors else None
    first, last = (int(edge / recording.sampling_rate_hz * RATE_HZ) for edge in window)
    found = []
    for where in (place, f"ankle_{side}") if ankle else (place,):
        signals = sagittal(recording, where) if where in recording.sensors else None
        if signals is not None:
            whole = Leg(recording.name, side, tuned, signals[:, 0], signals[:, 1:], thigh)
            found.append(whole.part(first, last - first))
    return found


@functools.cache
def simulated(people: int) -> tuple[Leg, ...]:
    """Right legs of simulated people after the paper's protocol, from their first swing on."""
    found = []
    for walk in protocols.udaya_shankar(jax.random.key(9), people):
        signals = sagittal(walk.recording, "shank_right")
        thigh = sagittal(walk.recording, "thigh_right")
        if signals is not None:
            first = int(np.argmax(np.abs(signals[:, 0]) > SWINGING))
            whole = Leg(walk.recording.name, "right", False, signals[:, 0], signals[:, 1:], thigh)
            found.append(whole.part(first, round(14.0 * RATE_HZ)))
    return tuple(found)


def sagittal(recording: Recording, place: str) -> np.ndarray | None:
    """(T, 4) rate and specific force in the segment's axes at `RATE_HZ`; None if the leg does not walk."""
    rate_hz = recording.sampling_rate_hz
    imu: Imu = rested(recording.sensors[place], rate_hz)
    axes = shank_axes.functional_axes(imu)
    if axes is None:
        return None
    told: Any = np.column_stack([-(as_float(imu.gyr) @ axes.rows[1]), as_float(imu.acc) @ axes.rows.T])
    if rate_hz > 2.01 * RATE_HZ:
        # Padded to one of few lengths, for each of which it is compiled; a causal filter is not changed by it.
        longer = np.pad(told, ((0, -len(told) % 2048), (0, 0)), "edge")
        told = np.asarray(butterworth.low_pass(jnp.asarray(longer), CUTOFF_HZ, rate_hz))[: len(told)]
    time = np.arange(len(told)) / rate_hz
    samples = np.arange(0.0, time[-1], 1.0 / RATE_HZ)
    return np.stack([np.interp(samples, time, column) for column in told.T], axis=1)


def stride_samples(rate: np.ndarray) -> int:
    """The stride period [samples] by autocorrelation: to set up a schedule; the fillers do not get it."""
    centred = rate - rate.mean()
    alike = np.correlate(centred, centred, "full")[len(centred) - 1 :]
    low, high = int(0.8 * RATE_HZ), int(1.9 * RATE_HZ)
    return low + int(np.argmax(alike[low:high]))


def papers_case(leg: Leg, duty: int) -> Case:
    """The paper's protocol: 14 s of ten 1.4 s units, on first, without warm-up."""
    schedule = power.schedule_of_duty(duty / 100)
    part = leg.part(0, round(14.0 * RATE_HZ))
    return Case(part, power.masks(schedule, len(part.rate), RATE_HZ).usable, 0, power.saving(schedule))


def warm_case(leg: Leg, duty: int, seconds: float = STEADY_S) -> Case:
    """Units of a stride; the first 5 s are measured, and count as the rest does."""
    unit = stride_samples(leg.rate[: round(14.0 * RATE_HZ)]) / RATE_HZ
    schedule, part = power.schedule_of_duty(duty / 100, unit), leg.part(0, round(seconds * RATE_HZ))
    usable = power.masks(schedule, len(part.rate), RATE_HZ).usable.copy()
    usable[: round(WARM_S * RATE_HZ)] = True
    return Case(part, usable, 0, power.saving(schedule))


def overground_case(leg: Leg, duty: int) -> Case:
    """Two strides are measured, from the leg's first swing; then units of half a stride, off first; only these count.

    A walk of five metres has four to six strides: longer units would not repeat in it.
    """
    stride = stride_samples(leg.rate[20:])  # without the gait's initiation
    schedule = power.schedule_of_duty(duty / 100, (stride // 2) / RATE_HZ)
    judged = int(np.argmax(np.abs(leg.rate) > SWINGING)) + 2 * stride
    usable = np.ones(len(leg.rate), bool)
    on = schedule.on * (stride // 2)
    usable[judged:] = power.masks(schedule, len(leg.rate) - judged + on, RATE_HZ).usable[on:]
    return Case(leg, usable, judged, power.saving(schedule))
