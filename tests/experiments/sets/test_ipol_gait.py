"""A walk there and back with three sensors: packets, events and gaps by files written here, axes by the real ones."""

import json

import numpy as np
import pytest
from made.notes import texts
from made.sets import loaded

from experiments.common.sets import ipol_gait

HEADER = "PacketCounter\tAcc_X\tAcc_Y\tAcc_Z\tGyr_X\tGyr_Y\tGyr_Z\tMag_X\tMag_Y\tMag_Z\n"
ABOUT = {
    "Subject": 3, "Trial": 1, "Age": 40, "Gender": "F", "Height": 170.0, "Weight": 60.0,
    "TrialBoundaries": [40, 260], "UTurnBoundaries": [140, 170],
    "RightFootEvents": [[40, 60], [90, 110], [150, 165], [200, 220]],
    "LeftFootEvents": [[65, 85], [115, 135], [172, 192], [240, 260]],
}  # fmt: skip


@pytest.fixture
def folder(data_dir):
    folder = data_dir / "ipol_gait" / "GaitData"
    folder.mkdir(parents=True)
    return folder


def table(samples=300, first=0):
    values = np.tile([0.0, 9.5, -0.5, 2.0, 0.1, 0.2, -0.3, 0.0, 0.0, 0.0], (samples, 1))
    values[:, 0] = first + np.arange(samples)
    return values


def write(folder, name="3-1", about=ABOUT, rate="Acquisition frequency: 100 Hz\n", header=HEADER, **tables):
    for code in ipol_gait.SENSORS:
        given = tables.get(code, table())
        if given is not None:
            lines = ["\t".join(map(str, row)) for row in given]
            (folder / f"{name}_{code}.txt").write_text(rate + header + "\n".join(lines) + "\n")
    if about is not None:
        (folder / f"{name}.json").write_text(json.dumps(about))


def load():
    return loaded("ipol_gait", "3-1")[0]


def test_contacts_strides_and_the_turn(folder):
    write(folder)
    walk = load()
    info, strides = walk.info, walk.reference.strides
    np.testing.assert_allclose(info["initial_contacts"], [0.6, 0.85, 1.1, 1.35, 1.65, 1.92, 2.2, 2.6])
    np.testing.assert_array_equal(info["initial_contact_sides"], [0, 1, 0, 1, 0, 1, 0, 1])
    np.testing.assert_allclose(info["final_contacts"], [0.4, 0.65, 0.9, 1.15, 1.5, 1.72, 2.0, 2.4])
    np.testing.assert_array_equal(info["final_contact_sides"], info["initial_contact_sides"])
    np.testing.assert_array_equal(strides.side, [0, 0, 0, 1, 1, 1])
    np.testing.assert_allclose(strides.start, [0.6, 1.1, 1.65, 0.85, 1.35, 1.92])
    np.testing.assert_allclose(strides.final_contact, [0.9, 1.5, 2.0, 1.15, 1.72, 2.4])
    np.testing.assert_allclose(strides.end, [1.1, 1.65, 2.2, 1.35, 1.92, 2.6])
    assert strides.valid.all() and np.isnan(strides.length).all()
    assert info["trial"] == (0.4, 2.6)
    np.testing.assert_array_equal(np.flatnonzero(walk.reference.valid), np.arange(40, 261))
    assert walk.reference.distance is None
    np.testing.assert_allclose([info["turns"]["start"], info["turns"]["end"]], [[1.4], [1.7]])
    np.testing.assert_allclose(info["straight_parts"], [[0.6, 1.4], [1.7, 2.6]])
    np.testing.assert_allclose([info["bouts"]["start"], info["bouts"]["end"]], [[0.6], [2.6]])
    assert not info["bouts"]["straight"].any() and np.isnan(info["bouts"]["distance"]).all()


def test_events_are_packets_and_lost_packets_are_masked(folder):
    lost, late = np.delete(table(), [30, 31], axis=0), table(299, first=1)
    late[50, 4] = np.nan
    write(folder, lb=lost, lf=late)
    walk = load()
    masks = {name: np.flatnonzero(~imu.mask).tolist() for name, imu in walk.recording.sensors.items()}
    assert masks == {"lower_back": [30, 31], "foot_right": [], "foot_left": [0, 51]}
    assert np.all(walk.recording.sensors["foot_left"].gyr[51] == 0)
    assert "lower_back: 2 of 300 samples are masked" in texts(walk.recording.notes)
    assert walk.info["initial_contacts"][0] == pytest.approx(0.6)
    write(folder, **{code: table(295, first=5) for code in ipol_gait.SENSORS})
    walk = load()
    assert walk.info["initial_contacts"][0] == pytest.approx(0.55) and walk.info["trial"] == pytest.approx((0.35, 2.55))


# --- the real walks ---

LACKING = {"2-3": 1, "17-2": 1, "18-3": 2}
"""Contacts that the reference lacks outside the U-turn, by recording."""
BEFORE, AFTER = np.arange(-15, -4), np.arange(5, 16)  # samples about a contact


@pytest.fixture(scope="module")
def walks(data):
    return data("ipol_gait")


def test_axes_of_the_back_are_as_stated(walks):
    for walk in walks:
        imu, info = walk.recording.sensors["lower_back"], walk.info
        contacts = np.rint(info["initial_contacts"] * 100).astype(int)
        before, after = (np.mean([imu.acc[at + span, 2].mean() for at in contacts]) for span in (BEFORE, AFTER))
        assert after - before > 1, "the trunk brakes after a contact, and z points backwards"
        rest = imu.acc[50:250].mean(axis=0)
        assert rest[0] > 8 and np.linalg.norm(rest) == pytest.approx(9.9, abs=0.3)
        turn = slice(*(round(info["turns"][end][0] * 100) for end in ("start", "end")))
        turned = np.sum(imu.gyr[turn] @ rest / np.linalg.norm(rest)) / 100
        assert abs(turned) == pytest.approx(np.pi, abs=0.6), "gravity tells the axis of the U-turn"


def test_contacts_alternate_and_last_as_long_as_swings_do(walks):
    """Within the trial. After its end the person stands, and takes single steps in 12 recordings (3-3, 12-3 …)."""
    for walk in walks:
        info, name = walk.info, walk.recording.name
        start, end = info["trial"]
        inside = info["initial_contacts"] < end + 0.005
        contacts, sides = info["initial_contacts"][inside], info["initial_contact_sides"][inside]
        np.testing.assert_allclose((start, end), (info["final_contacts"][0], contacts[-1]))
        again = np.flatnonzero(np.diff(sides) == 0)
        turning = (contacts[again] > info["turns"]["start"]) & (contacts[again] < info["turns"]["end"])
        # but in the U-turn, and in three recordings elsewhere
        assert (~turning).sum() == LACKING.get(name, 0), f"{name}: one foot twice at {contacts[again]}"
        strides = walk.reference.strides
        late = strides.end > end + 0.005
        assert not strides.valid[late].any(), "what a person who stands does is no stride"
        over = [
            (strides.start < a) & (strides.end > b) for a, b in zip(contacts[again], contacts[again + 1], strict=True)
        ]
        lacks = np.any(over, axis=0) if over else np.zeros(len(late), bool)
        np.testing.assert_array_equal(strides.valid[~late], ~lacks[~late], "a stride over a contact that is lacking")
        assert np.all((strides.start < strides.final_contact) & (strides.final_contact < strides.end))
        swing = (strides.end - strides.final_contact) / (strides.end - strides.start)
        # 0.35 in person 18, 0.41 in person 17
        assert np.median(swing[~late]) == pytest.approx(0.38, abs=0.04)
        parts = info["straight_parts"]
        assert parts.shape == (2, 2) and np.all(np.diff(parts) > 5) and np.all(np.diff(parts) < 15)
        np.testing.assert_allclose((parts[1, 1], info["bouts"]["end"][0]), end)
