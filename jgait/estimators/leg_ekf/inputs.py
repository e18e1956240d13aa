"""What the leg estimator takes: signals in segment axes, as arrays that pad, stack and map."""

from typing import Any, NamedTuple

import numpy as np

from jgait.estimators.interface import lengthened


class Segment(NamedTuple):
    """One sensor's signals, turned into its segment's axes (forward, up, right), as the filters take them.

    Attributes:
        gyr: (T, 3) [rad/s].
        acc: (T, 3) in units of gravity [1]; zeros without an accelerometer.
        measured: (T,) bool.
        bias: (3,) gyroscope bias at rest [rad/s].
        variance: sagittal gyroscope variance at rest [rad²/s²].
    """

    gyr: np.ndarray
    acc: np.ndarray
    measured: np.ndarray
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
    time: np.ndarray
    dt: np.ndarray
    still: np.ndarray
    valid: np.ndarray
    start_variance: np.ndarray


class Preparation(NamedTuple):
    """Inputs, and in words what was decided or noticed on the way."""

    inputs: LegInputs
    notes: tuple[str, ...]
    standing: tuple[int, int]


def has_gravity(inputs: LegInputs) -> bool:
    """Whether every worn sensor has an accelerometer."""
    legs = [leg for leg in (inputs.right, inputs.left) if leg is not None]
    return all(bool(np.any(np.asarray(segment.acc))) for leg in legs for segment in leg)


def pad(inputs: LegInputs, samples: int) -> LegInputs:
    """The same recording with invalid samples behind it, so that recordings of different length stack.

    Args:
        inputs: of T samples.
        samples: length wanted, T or more.

    Returns:
        Inputs of `samples` samples; the estimate at the first T is unchanged.

    Raises:
        ValueError: if `samples` is less than T.
    """
    have = inputs.time.shape[0]
    time = lengthened(inputs.time, samples)
    more = samples - have

    def longer(values: Any, *, edge: bool = False) -> np.ndarray:
        values = np.asarray(values)
        if values.ndim == 0 or values.shape[0] != have:
            return values
        return np.pad(values, [(0, more)] + [(0, 0)] * (values.ndim - 1), mode="edge" if edge else "constant")

    def segment(one: Segment) -> Segment:
        return one._replace(gyr=longer(one.gyr), acc=longer(one.acc), measured=longer(one.measured))

    def leg(one: LegSignals | None) -> LegSignals | None:
        return None if one is None else LegSignals(segment(one.thigh), segment(one.shank))

    return LegInputs(
        leg(inputs.right),
        leg(inputs.left),
        time,
        longer(inputs.dt, edge=True),
        np.concatenate([np.asarray(inputs.still), np.ones(more, bool)]),
        longer(inputs.valid),
        inputs.start_variance,
    )
