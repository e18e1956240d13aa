"""Inputs of the leg estimator: signals in segment axes, as arrays."""

from typing import Annotated, NamedTuple

import numpy as np

from jgait.estimators.ankle_stride.inputs import AnkleInputs
from jgait.estimators.axes import Axis, Sampled, Times
from jgait.types import Values

SHORT_GAP = 0.1
"""[s] Longest gap that the leg's filter bridges by its own prediction of the rates; a swing lasts 0.4 s."""


class Segment(NamedTuple):
    """Signals of one sensor in the axes of its segment (forward, left, up).

    Attributes:
        gyr: (T, 3) [rad/s]; where samples are lost, what bridges the loss, see `rates_between`.
        acc: (T, 3) [m/s²], scaled to standard gravity in standing; zeros without an accelerometer.
        measured: (T,) bool.
        bias: (3,) gyroscope bias at rest [rad/s].
        variance: sagittal gyroscope variance at rest [rad²/s²].
        lost: (T,) time since the last measured sample [s]; 0 where a sample is measured.
    """

    gyr: Sampled
    acc: Sampled
    measured: Sampled
    bias: np.ndarray
    variance: np.ndarray
    lost: Sampled


class LegSignals(NamedTuple):
    """Thigh and shank of one leg."""

    thigh: Segment
    shank: Segment


class LegInputs(NamedTuple):
    """Inputs of `leg_ekf.run`; every leaf is an array, so that inputs can be padded, stacked and mapped.

    Attributes:
        right: right leg, or None.
        left: left leg, or None.
        time: (T,) [s].
        dt: (T,) time since the previous sample [s]; 0 at the first and in padding.
        still: (T,) bool, the person stands.
        valid: (T,) bool, False for padding and for long gaps in the signals of a leg.
        start_variance: variance of the pose at the first sample [rad²]; small if the recording starts standing.
        shanks: inputs of the strapdown of the shanks' sensors; None without their accelerometers.
    """

    right: LegSignals | None
    left: LegSignals | None
    time: Times
    dt: Sampled
    still: Annotated[Values, Axis("one")]
    valid: Sampled
    start_variance: np.ndarray
    shanks: AnkleInputs | None = None


def has_gravity(inputs: LegInputs) -> bool:
    """Whether every worn sensor has an accelerometer."""
    legs = [leg for leg in (inputs.right, inputs.left) if leg is not None]
    return all(bool(np.any(np.asarray(segment.acc))) for leg in legs for segment in leg)
