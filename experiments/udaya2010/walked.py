"""Recordings whose shin gyroscopes are off part of the time, with the truth of the walk."""

import functools
from typing import NamedTuple

import jax
import numpy as np

from experiments.common import protocols
from experiments.common.recordings import walks
from experiments.udaya2010.legs import RATE_HZ, SWINGING, sagittal, stride_samples
from experiments.udaya2010.power_tradeoff import Plan, Shank, masks_of
from jgait.duty_cycle import power
from jgait.mounting import shank as shank_axes
from jgait.types import SIDES, Estimate, Recording, as_float


class Walked(NamedTuple):
    """A recording whose shin gyroscopes are switched off.

    Attributes:
        recording: with all gyroscopes always on.
        truth: angles as another measurement or the simulator has them.
        standing: half-open range of the truth's samples.
        begin: side → sample from which the shin's gyroscope follows the schedule.
        strides: side → [s].
        end: sample at which the walk ends.
    """

    recording: Recording
    truth: Estimate
    standing: tuple[int, int]
    begin: dict[str, int]
    strides: dict[str, float]
    end: int

    def on(self, duty: int, phase: float = 0.0) -> dict[str, np.ndarray]:
        """Placement → (T,) when its gyroscope is on, under a schedule of half strides begun at a part of its period."""
        found = {}
        for side, begin in self.begin.items():
            schedule = power.schedule_of_duty(duty / 100, 0.5 * self.strides[side])
            samples = len(self.recording.sensors[f"shank_{side}"].time)
            worn = Shank(np.zeros(samples), None, begin, self.strides[side])
            plan = Plan(0.5 * schedule.on, 0.5 * schedule.off)
            found[f"shank_{side}"] = masks_of(plan, worn, self.recording.sampling_rate_hz, phase).usable
        return found


def walked(recording: Recording, truth: Estimate, window: tuple[int, int], standing: tuple[int, int]) -> Walked:
    """First swings and strides, from the gyroscopes while they are on."""
    begin, strides = {}, {}
    rate_hz = recording.sampling_rate_hz
    for side in SIDES:
        if f"shank_{side}" in recording.sensors:
            signals = sagittal(recording, shank_axes.worn_on_shank(recording, side)[0])
            first, last = (round(edge / rate_hz * RATE_HZ) for edge in window)
            rate = signals[first:last, 0]
            stride = stride_samples(rate[20:])
            judged = first + int(np.argmax(np.abs(rate) > SWINGING)) + 2 * stride
            begin[side], strides[side] = round(judged / RATE_HZ * rate_hz), stride / RATE_HZ
    return Walked(recording, truth, standing, begin, strides, window[1])


def neura() -> list[Walked]:
    """`neura_sparse`, both legs."""
    walk = walks("neura_sparse")[0]
    windows = walk.info["windows"]
    return [walked(walk.recording, walk.reference, windows["whole"], windows["standing"])]


def _complete(recording: Recording) -> Recording:
    """The recording with its lost samples interpolated, so that only samples of the schedule are missing."""
    sensors = {
        name: shank_axes.filled(imu)._replace(mask=np.ones(len(imu.time), bool))
        for name, imu in recording.sensors.items()
    }
    return recording._replace(sensors=sensors)


@functools.cache
def people(count: int) -> tuple[Walked, ...]:
    """Simulated people after the paper: thigh and shin of the right leg."""
    found = []
    for one in protocols.udaya_shankar(jax.random.key(9), count):
        truth = one.truth.estimate
        knee = np.abs(np.gradient(as_float(truth.legs.right.knee_angle), as_float(truth.time)))
        moving = np.flatnonzero(knee > SWINGING)
        scale = one.recording.sampling_rate_hz * float(truth.time[1] - truth.time[0])
        window = (max(0, round(moving[0] * scale) - 10), round(moving[-1] * scale))
        found.append(walked(_complete(one.recording), truth, window, (0, max(1, moving[0] - 20))))
    return tuple(found)
