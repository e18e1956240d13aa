"""The sagittal rate of a leg segment from a recording, for filters that users write; NumPy, on the host."""

from typing import NamedTuple

import numpy as np

from jgait.mounting.cycle import cycle_of
from jgait.mounting.places import places_of
from jgait.notes import record
from jgait.types import Recording, RecordingError, as_float


@record
class SagittalRate(NamedTuple):
    """How fast a segment turns in the sagittal plane."""

    time: np.ndarray  #: (T,) [s].
    rate: np.ndarray  #: (T,) [rad/s], positive when the lower end swings forward; 0 where the mask is False.
    mask: np.ndarray  #: (T,) bool; False where the sample was lost.


def sagittal_rate(recording: Recording, placement: str) -> SagittalRate:
    """The rate of a thigh, shank or ankle about its sagittal axis, without the gyroscope's bias.

    The axis is the axis of most rotation in the walk, perpendicular to gravity. Its sign follows from how the segment
    turns over a stride; that of a thigh from the shank of the same side, so both sensors are needed. `placement` is
    `thigh_SIDE`, `shank_SIDE` or `ankle_SIDE`.

    Raises:
        RecordingError: if there is no such sensor, the segment does not walk, or the sign is not certain.
    """
    segment, _, side = placement.partition("_")
    if segment not in ("thigh", "shank", "ankle"):
        raise RecordingError(f"the sagittal rate is that of a thigh, shank or ankle; got {placement!r}")
    if placement not in recording.sensors:
        raise RecordingError(f"there is no sensor {placement}; the recording has {', '.join(recording.sensors)}")
    imu = recording.sensors[placement]
    time, mask = as_float(imu.time), np.asarray(imu.mask, bool)
    name = placement.replace("ankle", "shank")  # which turn together
    leg = {f"{other}_{side}": recording.sensors.get(f"{other}_{side}") for other in ("thigh", "shank")} | {name: imu}
    cycle = cycle_of({key: each for key, each in leg.items() if each and np.array_equal(as_float(each.time), time)})
    if cycle is None or name not in cycle.turning:
        raise RecordingError(f"{placement} does not walk")
    places, turning = places_of(cycle), cycle.turning[name]
    if segment == "thigh" and len(cycle.turning) < 2:
        raise RecordingError(f"which way a thigh faces follows from the shank; there is no sensor shank_{side}")
    if places.moved or places.doubtful or places.unsure(name):
        raise RecordingError(f"{placement} does not swing as a {segment} in walking: its front is not certain")
    rate = (as_float(imu.gyr) - turning.bias) @ (places.right[name] * turning.axis)
    return SagittalRate(time, np.where(mask, rate, 0.0), mask)
