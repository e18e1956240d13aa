"""The experiment on tuned noise models: what is taken of a tuning, the marker's place, kinds of gait, PyShoe."""

import numpy as np
from made.foot import foot
from scipy.spatial.transform import Rotation

from experiments.autotune import evidence, marker, pyshoe


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


def test_the_simplest_candidate_within_a_standard_error_of_the_best_is_taken():
    rng = np.random.default_rng(0)
    days = np.repeat(np.arange(6), 5)
    noise = np.repeat(rng.normal(size=6), 5)
    clear = {"by hand": noise, "half": noise - 0.2, "full": noise - 0.21}
    clear["full"] = clear["full"] + np.repeat([0.1, -0.1, 0.05, -0.05, 0.1, -0.1], 5)
    assert evidence.simplest(clear, days) == "half"
    chance = {"by hand": noise, "full": noise - np.repeat([1.0, 0.0, 0.0, 0.0, 0.0, -0.5], 5)}
    assert evidence.simplest(chance, days) == "by hand"


def test_a_marker_is_found_from_the_path_of_a_foot_that_turns():
    rng = np.random.default_rng(2)
    time, place = np.linspace(0.0, 10.0, 400), np.array([0.03, -0.02, 0.04])
    turns = Rotation.from_euler(
        "zyx", np.stack([0.3 * time, 0.8 * np.sin(3.0 * time), 0.2 * np.sin(2.0 * time)], axis=1)
    )
    sensor = np.stack([time, np.sin(time), 0.1 * np.sin(3.0 * time)], axis=1)
    yaw = Rotation.from_euler("z", 0.7)
    true = yaw.apply(sensor + turns.apply(place)) + [1.0, 2.0, 3.0] + 1e-3 * rng.normal(size=(400, 3))
    look = np.ones(400, bool)
    found = marker.Paths(*(v[None] for v in (sensor, turns.as_quat()[:, [3, 0, 1, 2]], true, look)))
    np.testing.assert_allclose(marker.solved(found, np.full(1, 1e3)), place, atol=2e-3)
    assert np.linalg.norm(marker.solved(found, np.ones(1))) < np.linalg.norm(place)  # the prior is at 0
    assert marker.errors(found, place)[0] < 2e-3 < 0.02 < marker.errors(found, np.zeros(3))[0]
