"""Does a shoe turn the way its path does? The gyroscope alone against the directions of the strides."""

import numpy as np
from scipy.spatial.transform import Rotation

from jgait.datasets.foot_reference import level
from jgait.types import Imu


def heading(imu: Imu, rest: float) -> np.ndarray:
    """Direction of the sensor's x from above (T,) [rad], left positive; the first `rest` [s] stand."""
    standing = imu.time < rest
    gyr = imu.gyr - imu.gyr[standing].mean(axis=0)
    turns = Rotation.from_rotvec((gyr[1:] + gyr[:-1]) / 2 * np.diff(imu.time)[:, None]).as_matrix()
    axes = level(imu.acc[standing].mean(axis=0)).as_matrix()
    forward = [axes[:, 0]]
    for turn in turns:
        axes = axes @ turn
        forward.append(axes[:, 0])
    return np.unwrap(np.arctan2(*np.array(forward).T[1::-1]))


def agreement(imu: Imu, rest: float, samples: np.ndarray, position: np.ndarray) -> float:
    """1 if the directions of the strides follow the shoe's up to one constant angle, near 0 if they do not."""
    way = np.diff(position[:, :2], axis=0)
    shoe = heading(imu, rest)[samples]
    apart = np.arctan2(way[:, 1], way[:, 0]) - (shoe[1:] + shoe[:-1]) / 2
    return float(np.abs(np.mean(np.exp(1j * apart))))
