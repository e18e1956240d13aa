"""The experiment on the cohort: walks come back from disk as they were made."""

import numpy as np
import pytest

from experiments.cohort import walks
from jgait.simulate import FOUR

pytestmark = pytest.mark.release


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Three walks of six seconds."""
    made = tmp_path_factory.mktemp("walks")
    assert walks.simulated(made, 5, 0, 3, (6.0, 6.5)) == []
    return made


def test_walks_come_back_as_they_were_made(folder):
    (one,) = (entry for entry in walks.walkers(5, 1, 2, (6.0, 6.5)))
    walk = walks.read(str(folder), one.name)
    assert one.name == "00001_corner"
    assert tuple(walk.recording.sensors) == FOUR
    assert walk.recording.subject == "subject_00001"
    truth, body = walk.reference, one.person.body
    assert walk.info == pytest.approx({"thigh_length": body.thigh_length, "shank_length": body.shank_length})
    assert truth.time[-1] == pytest.approx(one.seconds, abs=0.0101) and 5.5 < one.seconds < 8.0
    assert truth.distance[-1] - truth.distance[0] == pytest.approx(float(np.sum(one.along.length)), rel=1e-5)
    # The legs close: the ankle is where the angles put it.
    for leg in truth.legs:
        shank = leg.hip_angle - leg.knee_angle
        x = body.thigh_length * np.sin(leg.hip_angle) + body.shank_length * np.sin(shank)
        np.testing.assert_allclose(leg.x, x, atol=0.02)
    still = truth.time < 0.5
    for imu in walk.recording.sensors.values():
        assert imu.gyr.dtype == np.float32 and imu.mask.mean() > 0.9
        assert np.linalg.norm(imu.acc[still & imu.mask], axis=1) == pytest.approx(9.81, rel=0.1)
    assert truth.strides.valid.all()
    assert len(truth.strides.length) == pytest.approx(one.person.gait.steps + 1)
