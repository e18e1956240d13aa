"""Inputs of the leg estimator: signals in segment axes, as arrays."""

from typing import Annotated, NamedTuple

import numpy as np

from jgait.estimators.ankle_stride.prepare import AnkleInputs
from jgait.estimators.interface import Axis, Sampled, Times
from jgait.mounting.leg import Pose
from jgait.notes import record
from jgait.types import Values


class Segment(NamedTuple):
    """Signals of one sensor in the axes of its segment (forward, left, up)."""

    gyr: Sampled  #: (T, 3) [rad/s]; where samples are lost, what bridges the loss, see `rates_between`.
    acc: Sampled  #: (T, 3) [m/s²], scaled to standard gravity in standing; zeros without an accelerometer.
    measured: Sampled  #: (T,) bool.
    bias: np.ndarray  #: (3,) gyroscope bias at rest [rad/s].
    variance: np.ndarray  #: sagittal gyroscope variance at rest [rad²/s²].
    lost: Sampled  #: (T,) time since the last measured sample [s]; 0 where a sample is measured.
    #: variance of the segment's turns in the standing that calibrates, over that of quiet standing [rad²/s²].
    unrest: np.ndarray
    #: inclination at the first sample, from the pose that calibrates [rad]; None: 0.
    start: np.ndarray | None = None


class LegSignals(NamedTuple):
    """Thigh and shank of one leg."""

    thigh: Segment
    shank: Segment
    pose: Pose | None = None  #: what walking states of the pose that calibrates; None: that of the parameters.


@record
class LegInputs(NamedTuple):
    """Inputs of `leg_ekf.run`; every leaf is an array, so that inputs can be padded, stacked and mapped."""

    right: LegSignals | None  #: right leg, or None.
    left: LegSignals | None  #: left leg, or None.
    time: Times  #: (T,) [s].
    dt: Sampled  #: (T,) time since the previous sample [s]; 0 at the first and in padding.
    still: Annotated[Values, Axis("one")]  #: (T,) bool, the person stands.
    valid: Sampled  #: (T,) bool, False for padding and for long gaps in the signals of any leg.
    #: variance of the pose at the first sample [rad²]; small if the recording starts standing.
    start_variance: np.ndarray
    #: inputs of the strapdown of the shanks' sensors; None without their accelerometers.
    shanks: AnkleInputs | None = None
