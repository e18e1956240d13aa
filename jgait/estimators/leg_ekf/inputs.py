"""What the leg estimator takes: signals in segment axes, as arrays that pad, stack and map."""

from typing import Annotated, NamedTuple

import numpy as np

from jgait.estimators.axes import Axis, Held, Sampled, Times
from jgait.types import Values


class Segment(NamedTuple):
    """One sensor's signals, turned into its segment's axes (forward, left, up), as the filters take them.

    Attributes:
        gyr: (T, 3) [rad/s].
        acc: (T, 3) [m/s²], of standard gravity at standing; zeros without an accelerometer.
        measured: (T,) bool.
        bias: (3,) gyroscope bias at rest [rad/s].
        variance: sagittal gyroscope variance at rest [rad²/s²].
    """

    gyr: Sampled
    acc: Sampled
    measured: Sampled
    bias: np.ndarray
    variance: np.ndarray


class LegSignals(NamedTuple):
    """Thigh and shank of one leg."""

    thigh: Segment
    shank: Segment


class LegInputs(NamedTuple):
    """All that `leg_ekf.run` needs; every leaf is an array, so that inputs pad, stack and vmap.

    Attributes:
        right: right leg, or None.
        left: left leg, or None.
        time: (T,) [s].
        dt: (T,) time from the sample before [s]; 0 at the first.
        still: (T,) bool, the person stands.
        valid: (T,) bool, False for padding, and where samples of a leg are missing for long.
        start_variance: of the pose at the first sample [rad²]; small when the recording starts standing.
    """

    right: LegSignals | None
    left: LegSignals | None
    time: Times
    dt: Held
    still: Annotated[Values, Axis("one")]
    valid: Sampled
    start_variance: np.ndarray


def has_gravity(inputs: LegInputs) -> bool:
    """Whether every worn sensor has an accelerometer."""
    legs = [leg for leg in (inputs.right, inputs.left) if leg is not None]
    return all(bool(np.any(np.asarray(segment.acc))) for leg in legs for segment in leg)
