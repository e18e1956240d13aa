"""What every data set on this computer keeps."""

import numpy as np
import pytest
from foot_heading import agreement, heading

from jgait import datasets
from jgait.datasets.foot_reference import foot_path
from jgait.estimators import checks


@pytest.mark.parametrize("name", datasets.list_datasets())
def test_every_recording_gives_a_walk(data, name):
    walks = data(name)
    again = datasets.repeated(name)
    if again:
        assert not {walk.recording.name for walk in walks} & set(again)
        walks = data(name, *datasets.names(name))
    assert walks.failures == ()
    assert {walk.recording.name for walk in walks} == set(datasets.names(name))
    for walk in walks:
        assert (walk.reference is None) == bool(walk.info.get("no_reference"))
        for imu in walk.recording.sensors.values():
            assert all(np.isfinite(part).all() for part in imu if part is not None)
            assert len({len(part) for part in imu if part is not None}) == 1
            assert checks.fast_rate(imu) < 0.5 * checks.FASTEST and checks.force_unit(imu)[1] == ""  # no other unit


SHOES = {
    "SensorConnectData_36": ("footprints", 59, 76.292, 0, 1.4),
    "SensorConnectData_39": ("footprints", 81, 98.341, 0, 1.4),
    "2017-11-22-11-22-03": ("pyshoe_vicon", 23, 27.318, 88, 3.0),
    "2017-11-27-11-13-10": ("pyshoe_vicon", 29, 25.156, 0, 0.4),
}  # fmt: skip
"""Recording → set, footprints, path [m], masked samples of the reference's path, time of standing at the start [s]."""

FITS = {"footprints": (9.81, 0.02, 0.9, 0.15), "pyshoe_vicon": (9.80, 0.01, 0.95, 0.35)}
"""Set → gravity and its tolerance [m/s²], least agreement of the headings [1], and how much less it is if mirrored."""


@pytest.mark.parametrize("name", SHOES)
def test_a_shoe_goes_as_far_as_its_footprints_and_turns_as_they_do(data, name):
    dataset, count, path, masked, stands = SHOES[name]
    walk = data(dataset, name)[0]
    imu, prints = walk.recording.sensors["foot_right"], walk.info["footprints"]
    assert walk.info["verified"] is True and len(prints["samples"]) == count
    assert walk.reference.distance[-1] == pytest.approx(path, abs=2e-3)
    if dataset == "pyshoe_vicon":
        assert (~walk.reference.valid).sum() == masked
    else:
        assert foot_path(imu, 200.0).distance[-1] == pytest.approx(path, rel=0.01), "units: the sensor goes as far"
    gravity, near, least, less = FITS[dataset]
    rest = imu.acc[imu.time < stands].mean(axis=0)
    assert np.linalg.norm(rest) == pytest.approx(gravity, abs=near) and rest[2] > 8, "gravity's reaction points up"
    assert walk.recording.sampling_rate_hz == pytest.approx(200, abs=0.2)
    assert np.ptp(heading(imu, stands)) > 2 * np.pi, "it turns, so that a mirrored plan would show"
    place = prints["position"][:, :2]
    above, below = (agreement(imu, stands, prints["samples"], place * way) for way in ([1, 1], [1, -1]))
    assert above > least and above > below + less
