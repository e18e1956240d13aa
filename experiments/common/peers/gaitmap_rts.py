"""gaitmap's foot trajectories: its RtsKalman over a whole recording, and its forward-backward integration per stride.

Takes, for each job:
    gyr: (T, 3) [rad/s].
    acc: (T, 3) [m/s²], +g upwards at rest; any mounting, for the start is levelled as gaitmap levels a region.
    sampling_rate_hz: scalar.
    bias: (3,) [rad/s], taken off the gyroscope first; absent: as it comes.
    strides: (n, 2) [samples] from standing to standing, half-open; absent: no forward-backward integration.
    repeats: how often RtsKalman is timed; absent: once. Compilation is not in the time.

Gives, in a world with z up whose heading is the sensor's own at the start:
    position: (T, 3) [m] after each sample.
    orientation: (T, 4) sensor → world after each sample, w first.
    zupts: (T,) bool, True where gaitmap detects stance.
    seconds: (repeats,) of RtsKalman.
    stride_displacement_gyro, stride_displacement_madgwick: (n, 3) [m] from start to end of each stride, by either
        orientation method; each stride has a heading of its own.
"""

import time
import warnings

import numpy as np
import pandas as pd
from gaitmap.trajectory_reconstruction import (
    ForwardBackwardIntegration,
    MadgwickAHRS,
    RtsKalman,
    SimpleGyroIntegration,
    StrideLevelTrajectory,
)
from gaitmap.utils.consts import SF_ACC, SF_GYR
from gaitmap.utils.rotations import get_gravity_rotation
from protocol import main

ALIGN = 5  # samples: what RegionLevelTrajectory's default window leaves of itself at the start of a recording
METHODS = {"gyro": SimpleGyroIntegration, "madgwick": MadgwickAHRS}


def smoothed(data, rate_hz, repeats):
    """RtsKalman with its defaults, and how long it took."""
    start = get_gravity_rotation(data[SF_ACC].iloc[:ALIGN].median().to_numpy())
    seconds = []
    # The first is for numba to compile.
    for part in [data.iloc[: int(rate_hz)], *[data] * repeats]:
        before = time.perf_counter()
        found = RtsKalman(initial_orientation=start).estimate(part, sampling_rate_hz=rate_hz)
        seconds.append(time.perf_counter() - before)
    return found, np.array(seconds[1:])


def displacements(data, rate_hz, strides, orientation):
    """What StrideLevelTrajectory finds for each stride, (n, 3) [m]."""
    columns = {"start": strides[:, 0], "end": strides[:, 1], "min_vel": strides[:, 0]}
    events = pd.DataFrame({"s_id": np.arange(len(strides)), **columns})
    method = StrideLevelTrajectory(ori_method=orientation(), pos_method=ForwardBackwardIntegration())
    with warnings.catch_warnings():
        # A stride at an edge of the recording is levelled by half a window.
        warnings.filterwarnings("ignore", "Could not use complete window length")
        found = method.estimate(data, events, sampling_rate_hz=rate_hz)
    return found.position_.groupby("s_id").last().to_numpy()


def trajectory(gyr, acc, sampling_rate_hz, bias=(0.0, 0.0, 0.0), strides=None, repeats=1):
    """One sensor; see the module."""
    rate_hz = float(sampling_rate_hz)
    data = pd.DataFrame(np.hstack([acc, np.rad2deg(gyr - np.asarray(bias))]), columns=[*SF_ACC, *SF_GYR])
    found, seconds = smoothed(data, rate_hz, int(repeats))
    zupts = np.zeros(len(data), bool)
    for start, end in found.zupts_[["start", "end"]].to_numpy():
        zupts[start:end] = True
    # gaitmap gives the state before the first sample too, and quaternions with w last.
    result = {
        "position": found.position_.to_numpy()[1:],
        "orientation": np.roll(found.orientation_object_.as_quat()[1:], 1, axis=1),
        "zupts": zupts,
        "seconds": seconds,
    }
    if strides is not None:
        for name, orientation in METHODS.items():
            result[f"stride_displacement_{name}"] = displacements(data, rate_hz, strides, orientation)
    return result


if __name__ == "__main__":
    main(trajectory)
