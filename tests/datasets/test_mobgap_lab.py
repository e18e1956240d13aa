"""Walks with a sensor on the back: units, bouts and unseen contacts by files written here, axes by the real ones."""

import json

import numpy as np
import pytest
from made.notes import texts
from made.sets import loaded, refused

from jgait.datasets import mobgap_lab

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


def several(*bouts):
    """An array of structs."""
    found = np.empty(len(bouts), dtype=[(key, object) for key in bouts[0]])
    for number, one in enumerate(bouts):
        found[number] = tuple(one.values())
    return found


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


def test_units_and_the_person(root):
    write(root, {"Test5": {"Trial1": trial(optical=bout())}})
    walk = load()
    imu = walk.recording.sensors["lower_back"]
    np.testing.assert_allclose(imu.acc[0], [9.80665, 0, -0.980665])
    np.testing.assert_allclose(imu.gyr[0], [np.pi / 2, 0, -np.pi])
    np.testing.assert_allclose(imu.time, np.arange(800) / 100)
    assert (walk.recording.subject, walk.recording.sampling_rate_hz) == ("HA/009", 100.0)
    info = walk.info
    assert (info["height"], info["sensor_height"], info["mass"]) == pytest.approx((1.7, 0.985, 65))
    assert (info["test"], info["trial_name"], info["straight"], info["verified"]) == ("Test5", "Trial1", True, False)


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


def test_turns_unseen_contacts_and_bouts_without_a_length(root):
    turn = {"Turning_Flag": 1, "Turn_Start": 3.0, "Turn_End": 4.0, "Turn_Angle": -90.0}
    first = bout(unseen=[2], **turn)
    # Upstream's stride over a contact that was not seen.
    first["Stride_InitialContacts"][0] = [2.0, 4.0]
    write(root, {"Test11": {"Trial1": trial(2000, optical=several(first, bout(10.0, Length=EMPTY)))}})
    walk = load("HA/009/Test11/Trial1")
    info, strides = walk.info, walk.reference.strides
    assert info["straight"] is False
    np.testing.assert_array_equal(info["initial_contact_bouts"], [0] * 6 + [1] * 7)
    np.testing.assert_array_equal(info["bouts"]["unseen_contacts"], [1, 0])
    np.testing.assert_array_equal(info["bouts"]["straight"], [False, True])
    np.testing.assert_allclose(info["bouts"]["distance"], [3.6, np.nan])
    np.testing.assert_allclose([info["turns"][key][0] for key in ("start", "end", "angle")], [2.99, 3.99, -np.pi / 2])
    np.testing.assert_allclose(info["straight_parts"], [[9.99, 12.99]])
    np.testing.assert_array_equal(strides.valid, [False] + [True] * 8)
    np.testing.assert_allclose(strides.start[:4], [1.99, 2.49, 3.49, 3.99])
    assert np.isnan(strides.final_contact).sum() == 0, "its stride has no start and is left out"
    assert walk.reference.valid.sum() == 301 and walk.reference.distance[-1] == pytest.approx(3.6)
    assert any(
        note.startswith("Stereophoto, bout 0: 1 of 7 initial contacts left out") for note in texts(walk.recording.notes)
    )


def test_the_indip_s_strides_count_samples_and_it_stands_in(root):
    write(root, {"Test5": {"Trial1": trial(indip=bout(counts=True)), "Trial2": trial(optical=bout(), indip=bout(3.0))}})
    walk = load()
    assert walk.info["reference_system"] == "INDIP"
    np.testing.assert_allclose(walk.reference.strides.start, 1.99 + 0.5 * np.arange(5))
    assert walk.reference.strides.valid.all() and np.isnan(walk.reference.strides.step_length).all()
    walk = load("HA/009/Test5/Trial2")
    assert walk.info["reference_system"] == "Stereophoto" and walk.info["initial_contacts"][0] == pytest.approx(1.99)
    assert walk.info["systems"]["INDIP"]["initial_contacts"][0] == pytest.approx(2.99)


def test_without_a_reference(root):
    write(root, {"Test5": {"Trial1": trial()}}, person=False)
    walk = load()
    assert walk.reference is None
    assert walk.info["no_reference"] == "Stereophoto saw no walking bout; INDIP saw no walking bout"
    assert len(walk.info["initial_contacts"]) == 0 and walk.info["straight_parts"].shape == (0, 2)
    assert walk.info["systems"] == {} and walk.info["height"] is None
    assert any("infoForAlgo.mat" in note for note in texts(walk.recording.notes))


def test_what_lies_outside_the_recording_is_left_out(root):
    late = bout(2.0, FinalContact_Event=np.array([2.7, 3.2, 3.7, 4.2, 99.0]))
    late["InitialContact_Event"][1] = -1.0
    write(root, {"Test5": {"Trial1": trial(optical=several(late, bout(6.0)))}})
    walk = load()
    notes = " / ".join(texts(walk.recording.notes))
    assert "Stereophoto: 1 of 2 bouts left out, outside the recording" in notes
    assert "bout 0: 1 of 7 initial contacts left out" in notes and "bout 0: 1 of 5 final contacts left out" in notes
    assert "bout 0: strides left out, as they do not begin with the contacts" in notes
    assert len(walk.info["initial_contacts"]) == 6 and len(walk.reference.strides.side) == 0


def test_lost_samples_and_a_clock_that_drifts(root):
    acc = np.ones((800, 3))
    acc[7, 1] = np.nan
    write(root, {"Test5": {"Trial1": trial(Acc=acc, Timestamp=np.arange(800) / 99)}})
    walk = load()
    imu = walk.recording.sensors["lower_back"]
    assert np.flatnonzero(~imu.mask).tolist() == [7] and np.all(imu.acc[7] == 0)
    assert "lower_back: 1 of 800 samples is masked" in texts(walk.recording.notes)
    assert any("time stamps differ" in note for note in texts(walk.recording.notes))


def test_trials_are_known_without_the_list_and_bad_files_are_named(root):
    good = {"Test5": {"Trial1": trial(optical=bout())}}
    write(root, good, "XX/001", index=False)
    folder = write(root, good, "XX/002", index=False)
    (folder / "data.mat").write_bytes((folder / "data.mat").read_bytes()[:300])
    folder = write(root, good, "XX/003")
    (folder / "data.mat").write_bytes(b"not MATLAB")
    (write(root, good, "XX/004") / "test_list.json").write_text("{")
    write(root, {"Test5": {"Trial1": trial(Gyr=np.zeros((3, 3)))}}, "XX/005")
    write(
        root, {"Test5": {"Trial1": trial(optical=bout(InitialContact_LeftRight=np.array(["Left"], object)))}}, "XX/006"
    )
    write(root, {"Test5": {"Trial1": trial(Fs={"Acc": 100, "Gyr": 50})}}, "XX/007")
    folder = write(root, good, "XX/008", index=False)
    (folder / "test_list.json").write_text('{"data": [{"key": ["TimeMeasure1", "Test5", "Trial9"]}]}')
    (root / "XX" / "010").mkdir()
    expected = {
        "XX/002": "XX/002/data.mat is no whole MATLAB file", "XX/003/Test5/Trial1": "data.mat is no whole MATLAB file",
        "XX/005/Test5/Trial1": r"gyroscope \(T, 3\)", "XX/006/Test5/Trial1": "InitialContact_LeftRight must be Left or",
        "XX/007/Test5/Trial1": "accelerometer and gyroscope must share a rate",
        "XX/008/Test5/Trial9": "XX/008/data.mat has no Trial9; it has Trial1",
    }  # fmt: skip
    refused("mobgap_lab", ["XX/001/Test5/Trial1", "XX/004/Test5/Trial1"], expected)


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


def test_turns_to_the_left_are_positive_as_in_the_gyroscope(walks):
    seen = []
    for walk in walks:
        if walk.info["reference_system"] != "Stereophoto":
            continue  # the INDIP's signs cannot be trusted
        turns, imu = walk.info["turns"], walk.recording.sensors["lower_back"]
        for start, end, angle in zip(*turns.values(), strict=True):
            turned = imu.gyr[round(start * 100) : round(end * 100) + 1, 0].sum() / 100
            seen.append((angle, turned))
    if not seen:
        pytest.skip("none of the recordings that are there has a turn")
    angle, turned = np.array(seen).T
    large = np.abs(angle) > np.pi / 4
    assert np.mean(np.sign(angle[large]) == np.sign(turned[large])) >= 0.85
    assert np.median(np.abs(angle - turned)) < 0.3


def test_references_agree_with_themselves_and_each_other(walks):
    apart = []
    for walk in walks:
        for system, of in walk.info["systems"].items():
            for number, steps in enumerate(of["bouts"]["distance"]):
                inside = of["initial_contact_bouts"] == number
                contacts = of["initial_contacts"][inside]
                assert of["bouts"]["unseen_contacts"][number] or np.ptp(contacts) == pytest.approx(
                    of["bouts"]["end"][number] - of["bouts"]["start"][number]
                ), system
                assert np.isnan(steps) or 1 < steps < 12
        systems = walk.info["systems"]
        if len(systems) == 2 and walk.info["straight"]:
            apart.append(np.diff([of["bouts"]["distance"][0] for of in systems.values()])[0])
            late = systems["INDIP"]["initial_contacts"][:, None] - systems["Stereophoto"]["initial_contacts"]
            assert np.median(np.abs(late).min(axis=1)) < 0.06
    assert not apart or np.abs(apart).max() < 0.3


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
