"""Feet and strides as tables, gaitmap's stride lists, and the range between the feet in a file."""

import numpy as np
import pytest
from made.frames import NEEDED, table
from made.notes import texts

from jgait import io
from jgait.types import Estimate, Feet, FootTrajectory, Legs, RecordingError, Strides

RATE = 200.0


def strides(**more):
    """Right, left, right (from standing), a row of padding, left; not in order of time."""
    start = np.array([1.10, 0.50, 0.02, 0.0, 1.70])
    given = {
        "side": np.array([0, 1, 0, 0, 1]), "start": start, "final_contact": start + 0.7, "end": start + 1.1,
        "length": np.array([1.4, 1.3, 0.7, 9.0, 1.5]), "width": np.array([0.1, np.nan, np.nan, 9.0, -0.02]),
        "height": np.zeros(5), "valid": np.array([True, True, True, False, True]),
        "standing": start + 0.3, "standing_end": start + 1.4, "speed": np.full(5, 1.25),
        "contact_angle": np.full(5, 0.4),
    }  # fmt: skip
    given["standing"][2] = 0.0  # it stood before the toes left
    return Strides(**given | more)


def estimate(own=None, **more):
    time = np.arange(0.0, 3.5, 1.0 / RATE)
    return Estimate(time, Legs(None, None), None, None, time >= 0.0, {}, strides() if own is None else own, **more)


def test_strides_are_a_table_in_order_of_time():
    spread = Strides(strides().side, None, None, None, np.array([0.01, 0.02, 0.03, 9.0, 0.0]), None, None,
                     strides().valid, contact_angle=np.full(5, 0.1))  # fmt: skip
    found = io.strides_to_dataframe(estimate(strides_stddev=spread))
    assert list(found.columns) == [
        "s_id", "side", "start_s", "final_contact_s", "end_s", "standing_s", "standing_end_s",
        "stride_length_m", "stride_length_std_m", "stride_width_m", "stride_duration_s", "walking_speed_mps",
        "stride_height_m", "contact_angle_deg", "contact_angle_std_deg",
    ]  # fmt: skip
    assert list(found["side"]) == ["right", "left", "right", "left"] and list(found["s_id"]) == [0, 1, 2, 3]
    np.testing.assert_array_equal(found["stride_length_m"], [0.7, 1.3, 1.4, 1.5])
    np.testing.assert_array_equal(found["stride_length_std_m"], [0.03, 0.02, 0.01, np.nan])  # 0: none is stated
    np.testing.assert_array_equal(found["stride_width_m"], [np.nan, np.nan, 0.1, -0.02])
    np.testing.assert_allclose(found["stride_duration_s"], 1.1)
    np.testing.assert_allclose(found["contact_angle_deg"], np.rad2deg(0.4))
    np.testing.assert_allclose(found["contact_angle_std_deg"], np.rad2deg(0.1))


def test_a_first_stride_from_standing_has_no_duration_because_it_begins_with_the_toe_off():
    own = strides()
    toe_off = np.where(np.arange(5) == 2, own.start, own.final_contact)
    found = io.strides_to_dataframe(estimate(strides(final_contact=toe_off)))
    np.testing.assert_allclose(found["stride_duration_s"], [np.nan, 1.1, 1.1, 1.1])
    assert found["walking_speed_mps"].notna().all()


def test_no_gait_is_an_empty_table_and_no_strides_an_error():
    nobody = estimate(strides(valid=np.zeros(5, bool)))
    assert io.strides_to_dataframe(nobody).shape == (0, 13)
    for one in io.to_gaitmap(nobody, RATE).values():
        assert one.empty and one["start"].dtype == np.int64
    with pytest.raises(ValueError, match="has no strides"):
        io.strides_to_dataframe(estimate()._replace(strides=None))
    with pytest.raises(ValueError, match="sampling_rate_hz must be positive; got 0"):
        io.to_gaitmap(estimate(), 0.0)


def test_gaitmaps_stride_list():
    found = io.to_gaitmap(estimate(), RATE)
    assert list(found) == ["right_sensor", "left_sensor"]
    right, left = found.values()
    for one in found.values():
        assert list(one.columns) == ["start", "end", "min_vel", "pre_ic", "tc", "ic"]
        assert set(one.dtypes) == {np.dtype(np.int64)}
        assert one.index.name == "s_id" and one.index.is_unique
    # s_id is that of the table; the right foot's first stride, from standing, has no contact before it
    assert list(right.index) == [2] and list(left.index) == [1, 3]
    np.testing.assert_array_equal(right.to_numpy(), [[280, 500, 280, 220, 360, 440]])
    np.testing.assert_array_equal(left.loc[1], [160, 380, 160, 100, 240, 320])


def test_table_of_a_foot():
    place, speed = np.arange(6.0).reshape(2, 3), np.ones((2, 3))
    foot = FootTrajectory(place, speed, np.array([[1.0, 0.0, 0.0, 0.0]] * 2))
    spread = FootTrajectory(0.1 * place, 0.1 * speed, np.full((2, 3), np.pi / 180.0))
    feet = Estimate(np.array([0.0, 0.01]), Legs(None, None), None, None, np.array([True, False]), {},
                    feet=Feet(foot, None), feet_stddev=Feet(spread, None))  # fmt: skip
    found = io.to_dataframe(feet)
    names = ("position_{}_right_m", "velocity_{}_right_mps", "orientation_{}_right", "position_{}_right_std_m",
             "velocity_{}_right_std_mps", "orientation_{}_right_std_deg")  # fmt: skip
    axes = [name.format(axis) for name in names for axis in ("wxyz" if name.endswith("right") else "xyz")]
    assert list(found.columns) == ["time_s", *axes, "valid"]
    assert found["position_y_right_m"][0] == 1.0 and found["orientation_w_right"][0] == 1.0
    assert found["orientation_z_right_std_deg"][0] == pytest.approx(1.0)
    assert found.iloc[1].drop(["time_s", "valid"]).isna().all()


# --- the range between the feet ---


def with_range(scale=1.0, samples=600):
    heard = np.arange(samples) % 50 == 7
    return table(samples).assign(feet_range=np.where(heard, scale * 0.15, np.nan)), heard


@pytest.mark.parametrize(("unit", "scale"), [("m", 1.0), ("cm", 100.0), ("mm", 1000.0)])
def test_a_range_is_read_where_it_was_heard(tmp_path, unit, scale):
    frame, heard = with_range(scale)
    frame.to_csv(tmp_path / "walk.csv", index=False)
    recording = io.read_csv(tmp_path / "walk.csv", range_unit=unit)
    read = recording.feet_range
    np.testing.assert_array_equal(read.mask, heard)
    np.testing.assert_allclose(read.distance, np.where(heard, 0.15, 0.0))
    np.testing.assert_allclose(read.time, recording.sensors[NEEDED[0]].time)
    assert not any("feet_range" in note for note in texts(recording.notes))
    again = io.recording_from_dataframe(io.recording_to_dataframe(recording)).feet_range
    np.testing.assert_array_equal(again.mask, read.mask)
    np.testing.assert_allclose(again.distance, read.distance)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda r: 100.0 * r, r"feet_range is 15 m in the median \(given as m\).*it seems to be in cm"),
        (lambda r: 1000.0 * r, r"pass range_unit='mm'"),
        (lambda r: 1e-6 * r, "check the unit"),
        (lambda r: r.fillna(0.0), "588 readings are not. Leave the cell empty where nothing was measured"),
    ],
)
def test_a_range_that_feet_cannot_have(change, message):
    frame, _ = with_range()
    with pytest.raises(RecordingError, match=message):
        io.recording_from_dataframe(frame.assign(feet_range=change(frame["feet_range"])))
