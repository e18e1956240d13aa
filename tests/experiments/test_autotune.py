"""The experiment on tuned noise models: kinds of gait, and the peer's filter on a foot whose path is known."""

import numpy as np
from made.foot import foot

from experiments.autotune import pyshoe
from experiments.autotune.walks import kind


def test_kinds_of_gait_by_speed():
    assert [kind(v) for v in (None, 0.59, 0.6, 1.29, 1.3)] == ["creeping", "creeping", "walking", "walking", "fast"]


def test_the_peer_s_filter_finds_the_path_of_a_foot():
    made = foot(strides=4, hz=200.0)
    imu = made.recording.sensors["foot_right"]
    ratio = pyshoe.shoe(imu.gyr, imu.acc)
    stands = ratio < pyshoe.THRESHOLD
    middle = round(0.5 * (made.lift_off[1] + made.contact[1]) * 200.0)
    assert stands[:200].all() and not stands[middle]
    position = pyshoe.path(imu.gyr, imu.acc, stands, 1.0 / 200.0)
    walked = np.linalg.norm(position[-1, :2] - position[0, :2])
    assert abs(walked / np.sum(made.length) - 1.0) < 0.02
    assert abs(position[-1, 2]) < 0.05
