"""Functions for the data sets with one sensor on one foot: files, axes, and the distance along footprints."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from jgait.types import SIDES, AnyArray, Imu, RecordingError, Strides

FLIP = np.array([1.0, -1.0, -1.0])
"""Half a turn about x, a proper rotation: converts readings of a sensor with z down to axes with z up."""

SHORTEST = 0.1
"""[m] Shortest stride between two footprints; at a smaller distance the foot was put down again on the spot."""


def read_mat(path: Path, names: Sequence[str]) -> dict[str, np.ndarray]:
    """Variables of a MATLAB file (version 5), arrays without axes of length one.

    Raises:
        RecordingError: if the file lacks one of the variables.
    """
    from scipy.io import loadmat

    content = loadmat(path, squeeze_me=True, variable_names=list(names))
    lacking = [name for name in names if name not in content]
    if lacking:
        raise RecordingError(f"{path.name} has no variable {lacking[0]}; needed are {', '.join(names)}")
    return {name: content[name] for name in names}


def foot_imu(name: str, time: np.ndarray, gyr: np.ndarray, acc: np.ndarray) -> tuple[Imu, float]:
    """A sensor [rad/s, m/s²] with time from 0, non-finite samples masked; and its sampling rate [Hz] from the median
    step.

    Raises:
        RecordingError: if the shapes do not fit or time does not increase; with the name of the file.
    """
    if time.ndim != 1 or len(time) < 2 or gyr.shape != (len(time), 3) or acc.shape != (len(time), 3):
        raise RecordingError(
            f"{name} must have at least 2 samples of time (T,), gyroscope (T, 3) and accelerometer (T, 3); "
            f"got {time.shape}, {gyr.shape} and {acc.shape}"
        )
    back = np.flatnonzero(~(np.diff(time) > 0))
    if len(back):
        raise RecordingError(f"{name}: time must run forwards; it does not after sample {back[0]}, {time[back[0]]} s")
    mask = np.isfinite(gyr).all(axis=1) & np.isfinite(acc).all(axis=1)
    gyr, acc = np.where(mask[:, None], gyr, 0.0), np.where(mask[:, None], acc, 0.0)
    return Imu(time - time[0], gyr, acc, mask), float(1.0 / np.median(np.diff(time)))


def way(time: AnyArray, position: AnyArray, arrived: AnyArray, left: AnyArray) -> np.ndarray:
    """Distance along footprints (T,) [m]: constant while the foot stands, linear in time between stances.

    The foot comes to stand on footprint `position` (n, 2) or (n, 3) [m] when it `arrived` and leaves when it `left`,
    (n,) [s]; height does not count.
    """
    if len(position) == 0:
        return np.zeros_like(time)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(position[:, :2], axis=0), axis=1))])
    return np.interp(time, np.stack([arrived, left], axis=1).ravel(), np.repeat(along, 2))


def footprint_strides(
    side: str, position: np.ndarray, arrived: np.ndarray, left: np.ndarray, whole: np.ndarray | None = None
) -> Strides:
    """Strides from footprint to footprint, fields (n − 1,); contacts, widths and heights are not known.

    Footprints as in `way`. `whole` (n − 1,) is False where a footprint between two footprints may be missing.
    """
    length = np.linalg.norm(np.diff(position[:, :2], axis=0), axis=1)
    valid = (length > SHORTEST) & (True if whole is None else whole)
    nothing = np.full(length.size, np.nan)
    return Strides(
        side=np.full(length.size, SIDES.index(side)), start=None, final_contact=None, end=None, length=length,
        width=nothing, height=nothing, valid=valid, standing=left[:-1], standing_end=arrived[1:],
    )  # fmt: skip
