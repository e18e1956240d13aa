"""The sagittal rate of a leg segment from a recording, for filters that users write; NumPy, on the host."""

from typing import NamedTuple

import numpy as np

from jgait.events.rest import legs_at_rest
from jgait.mounting import shank
from jgait.mounting.leg import worn_legs
from jgait.notes import record
from jgait.types import Recording, RecordingError, as_float

CALLER = "sagittal_rate"


@record
class SagittalRate(NamedTuple):
    """How fast a segment turns in the sagittal plane."""

    time: np.ndarray  #: (T,) [s].
    rate: np.ndarray  #: (T,) [rad/s], positive when the lower end swings forward; 0 where the mask is False.
    mask: np.ndarray  #: (T,) bool; False where the sample was lost.


def sagittal_rate(recording: Recording, placement: str) -> SagittalRate:
    """The rate of a thigh, shank or ankle about its sagittal axis, without the bias at rest.

    The axis is the axis of most rotation in the walk, perpendicular to gravity. The sign of a shank or ankle follows
    from its forward swing, which is the faster one. The sign of a thigh follows from the shank of the same side, so
    both sensors are needed.

    Args:
        recording: a walk; SI units, sensors in any orientation.
        placement: `thigh_SIDE`, `shank_SIDE` or `ankle_SIDE`.

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
    hz = 1.0 / float(np.median(np.diff(time)))
    if segment == "thigh":
        if f"shank_{side}" not in recording.sensors:
            raise RecordingError(f"which way a thigh faces follows from the shank; there is no sensor shank_{side}")
        sensors = {f"{name}_{side}": recording.sensors[f"{name}_{side}"] for name in ("thigh", "shank")}
        gyrs, masks = zip(*((i.gyr, i.mask) for i in sensors.values()), strict=True)
        worn = worn_legs(sensors, legs_at_rest(gyrs, hz, masks), hz, estimator=CALLER)
        leg = worn.legs[side]
        if worn.places.moved or worn.places.doubtful or leg.notes:
            raise RecordingError(f"{placement} does not swing as a thigh before its shank: its front is not certain")
        left, bias = leg.rows["thigh"][1], leg.gyr_bias["thigh"]
    else:
        whole = shank.filled(imu)
        rest_bias = shank.rest_bias(imu, hz)
        bias = np.zeros(3) if rest_bias is None else rest_bias
        axes = shank.functional_axes(whole._replace(gyr=as_float(whole.gyr) - bias))
        if axes is None:
            raise RecordingError(f"{placement} does not walk")
        left = axes.rows[1]
    rate = -(as_float(imu.gyr) - bias) @ left
    return SagittalRate(time, np.where(mask, rate, 0.0), mask)
