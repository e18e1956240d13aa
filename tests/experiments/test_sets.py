"""What is known of the recordings that only experiments use: units, axes, contacts and distances."""

import numpy as np
import pytest


def test_the_main_walk_is_twice_twenty_metres(data):
    walk = data("gaitmap_example", "imu_sample")[0]
    assert walk.info["verified"] is True
    assert walk.reference.distance[-1] == pytest.approx(40.65, abs=0.15)
    lengths = np.concatenate([of["length"][of["straight"]] for of in walk.info["strides"].values()])
    assert len(lengths) == 55, "28 and 29 strides without one turn each"
    assert np.percentile(lengths, 5) > 1.28 and np.percentile(lengths, 95) < 1.46
    for side in ("right", "left"):
        toes = walk.info["strides"][side]["width_toe"]
        assert np.nanmedian(toes) == pytest.approx(0.11, abs=0.01)


LACKING = {"2-3": 1, "17-2": 1, "18-3": 2}
"""Contacts that the reference lacks outside the U-turn, by recording."""
BEFORE, AFTER = np.arange(-15, -4), np.arange(5, 16)  # samples about a contact


def test_axes_of_the_back_with_a_turn_are_as_stated(data):
    walks = data("ipol_gait")
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


def test_contacts_alternate_and_last_as_long_as_swings_do(data):
    """Within the trial. After its end the person stands, and takes single steps in 12 recordings (3-3, 12-3 …)."""
    walks = data("ipol_gait")
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


def test_axes_of_the_lower_back_are_as_stated(data):
    walks = data("mobgap_lab")
    for walk in walks:
        imu, info = walk.recording.sensors["lower_back"], walk.info
        if info["straight"] and walk.reference is not None:  # on the circuit people bend down, too
            assert imu.acc.mean(axis=0)[0] > 9, "x up"
            at = np.rint(info["initial_contacts"][:-1] * 100).astype(int)
            before, after = (imu.acc[at[:, None] + span, 2].mean() for span in (np.arange(-15, -4), np.arange(5, 16)))
            assert before - after > 1, "the trunk brakes after a contact, and z points forwards"


def test_belt_times_stride_time_is_zebris_and_optogaits_stride(data):
    walks = data("tripod")
    for walk in walks:
        if not walk.info["zebris"]:
            continue
        for side in ("right", "left"):
            of = walk.info["optogait"][side]
            kept = of["kept"]
            assert kept.sum() > 80
            by_belt = walk.info["speed"] * np.median(of["stride_time"][kept])
            assert by_belt == pytest.approx(walk.info["zebris"]["stride_length"], rel=0.015)
            assert np.median(of["stride_length"][kept]) == pytest.approx(by_belt, rel=0.025)
            assert np.median(of["stance_time"][kept] / of["stride_time"][kept]) == pytest.approx(0.7, abs=0.02)


def test_numbers_of_the_short_walk(data):
    walk = data("xio_gait", "short_walk")[0]
    imu = walk.recording.sensors["foot_right"]
    assert walk.info["verified"] is True and walk.info["closes"] is True
    assert len(imu.time) == 16539 - 205 and imu.time[-1] == pytest.approx(41.618, abs=1e-3)
    assert walk.recording.sampling_rate_hz == pytest.approx(398.3, abs=0.1)
    assert np.diff(imu.time).max() == pytest.approx(0.01255, abs=1e-4)
    rest = imu.acc[imu.time < 15].mean(axis=0)
    assert np.linalg.norm(rest) == pytest.approx(9.81, abs=0.01) and rest[2] > 8, "gravity's reaction points up"
