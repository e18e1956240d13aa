"""Walks with a sensor on the back: units, bouts and unseen contacts by files written here, axes by the real ones."""

import json

import numpy as np
import pytest
from made.sets import loaded

from experiments.common.sets import mobgap_lab

EMPTY = np.zeros(0, np.uint8)  # how upstream says nothing


@pytest.fixture
def root(data_dir):
    return data_dir / "mobgap_lab" / mobgap_lab.ROOT


def bout(first=2.0, steps=7, counts=False, unseen=(), **changed):
    """A bout as upstream writes it: a step of 0.6 m every half second, the left foot first."""
    contacts = np.round(first + 0.5 * np.arange(steps), 2)
    end = contacts[-1]
    contacts[list(unseen)] = np.nan
    strides = np.stack([contacts[:-2], contacts[2:]], axis=1)
    final = contacts[:-2] + 0.7
    labels = np.array(["Left", "Right"] * steps, object)
    return {
        "Start": first, "End": end, "Length": 0.6 * (steps - 1), "LengthFeet": 0.61 * (steps - 1), "WalkingSpeed": 1.2,
        "Cadence": 120.0, "Turning_Flag": 0, "Turn_Start": EMPTY, "Turn_End": EMPTY, "Turn_Angle": EMPTY,
        "InitialContact_Event": contacts, "InitialContact_LeftRight": labels[:steps],
        "FinalContact_Event": final, "FinalContact_LeftRight": labels[: steps - 2],
        "Stride_InitialContacts": strides * (100 if counts else 1), "Stride_Length": np.full(steps - 2, 1.2),
        "Step_Length": EMPTY if counts else np.full(steps - 1, 0.6), **changed,
    }  # fmt: skip


def trial(samples=800, optical=EMPTY, indip=EMPTY, **sensor):
    acc, gyr = np.tile([1.0, 0.0, -0.1], (samples, 1)), np.tile([90.0, 0.0, -180.0], (samples, 1))
    sensor = {"Acc": acc, "Gyr": gyr, "Timestamp": 1.6e9 + np.arange(samples) / 100,
              "Fs": {"Acc": 100, "Gyr": 100}, **sensor}  # fmt: skip
    standards = {"Stereophoto": {"MicroWB": optical, "Fs": 100}, "INDIP": {"MicroWB": indip, "Fs": 100}}
    return {"SU": {"LowerBack": sensor}, "Standards": standards}


def write(root, tests, participant="HA/009", person=True, index=True):
    from scipy.io import savemat

    folder = root / participant
    folder.mkdir(parents=True, exist_ok=True)
    savemat(folder / "data.mat", {"data": {"TimeMeasure1": tests}}, oned_as="row")
    if person:
        about = {"Height": 170, "Weight": 65, "SensorHeight": 98.5}
        savemat(folder / "infoForAlgo.mat", {"infoForAlgo": {"TimeMeasure1": about}})
    if index:
        keys = [{"key": ["TimeMeasure1", test, trial]} for test, trials in tests.items() for trial in trials]
        (folder / "test_list.json").write_text(json.dumps({"data": keys}))
    return folder


def load(name="HA/009/Test5/Trial1"):
    return loaded("mobgap_lab", name)[0]


def test_contacts_strides_and_distance_of_a_bout(root):
    write(root, {"Test5": {"Trial1": trial(optical=bout())}})
    walk = load()
    info, strides = walk.info, walk.reference.strides
    contacts = 1.99 + 0.5 * np.arange(7)
    np.testing.assert_allclose(info["initial_contacts"], contacts)
    np.testing.assert_array_equal(info["initial_contact_sides"], [1, 0, 1, 0, 1, 0, 1])
    np.testing.assert_allclose(info["final_contacts"], contacts[:5] + 0.7)
    np.testing.assert_allclose(strides.start, contacts[:-2])
    np.testing.assert_allclose(strides.end, contacts[2:])
    np.testing.assert_allclose(strides.final_contact, contacts[:-2] + 0.7)
    np.testing.assert_array_equal(strides.side, [1, 0, 1, 0, 1])
    np.testing.assert_allclose([strides.length, strides.speed, 2 * strides.step_length], 1.2)
    assert strides.valid.all()
    bouts = {key: float(value[0]) for key, value in info["bouts"].items()}
    assert bouts == pytest.approx({
        "start": 1.99, "end": 4.99, "distance": 3.6, "distance_feet": 3.66, "speed": 1.2, "cadence": 2.0,
        "straight": 1, "unseen_contacts": 0,
    })  # fmt: skip
    np.testing.assert_allclose(info["straight_parts"], [[1.99, 4.99]])
    reference = walk.reference
    np.testing.assert_allclose(reference.distance[[0, 199, 349, 499, 799]], [0, 0, 1.8, 3.6, 3.6], atol=1e-12)
    np.testing.assert_array_equal(np.flatnonzero(reference.valid), np.arange(199, 500))
    assert info["reference_system"] == "Stereophoto" and list(info["systems"]) == ["Stereophoto"]


# --- the real walks ---


@pytest.fixture(scope="module")
def walks(data):
    return data("mobgap_lab")


def test_axes_are_as_stated(walks):
    for walk in walks:
        imu, info = walk.recording.sensors["lower_back"], walk.info
        if info["straight"] and walk.reference is not None:  # on the circuit people bend down, too
            assert imu.acc.mean(axis=0)[0] > 9, "x up"
            at = np.rint(info["initial_contacts"][:-1] * 100).astype(int)
            before, after = (imu.acc[at[:, None] + span, 2].mean() for span in (np.arange(-15, -4), np.arange(5, 16)))
            assert before - after > 1, "the trunk brakes after a contact, and z points forwards"


def test_the_known_participants(walks):
    by_name = {walk.recording.name: walk for walk in walks}
    if "HA/002/Test5/Trial1" in by_name:
        assert by_name["HA/002/Test5/Trial1"].reference is None
    if "HA/001/Test5/Trial1" in by_name:
        walk = by_name["HA/001/Test5/Trial1"]
        assert walk.info["verified"] is True and walk.info["systems"].keys() == {"Stereophoto", "INDIP"}
        assert walk.info["bouts"]["distance"][0] == pytest.approx(5.164, abs=1e-3)
        assert len(walk.info["initial_contacts"]) == 10 and walk.info["initial_contacts"][0] == pytest.approx(5.02)
        strides = walk.reference.strides
        assert strides.valid.all() and np.nanmean(strides.speed) == pytest.approx(walk.info["bouts"]["speed"][0])
