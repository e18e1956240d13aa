"""References from tables are what was written, and tables that cannot be one are refused in words."""

import numpy as np
import pandas as pd
import pytest
from made.foot import foot

from jgait import io
from jgait.estimators import foot_ins
from jgait.tune.losses import TrajectoryWeights, trajectory
from jgait.types import Estimate, Legs, LegTrajectory, RecordingError

TIME = np.linspace(0.0, 10.0, 501)


def angles():
    leg = LegTrajectory(np.sin(TIME), 0.5 + 0.4 * np.cos(TIME), 0.1 * TIME, 0.0 * TIME - 0.8)
    return Estimate(TIME, Legs(None, leg), None, 1.3 * TIME, TIME > 1.0, {})


@pytest.fixture(scope="module")
def feet():
    return foot_ins.estimate(foot_ins.FootParams(), foot(strides=4).recording)


def test_samples_come_back_at_other_times():
    made, at = angles(), np.linspace(0.0, 12.0, 1201)
    back = io.reference_from_tables(at, io.to_dataframe(made))
    there = (at > 1.02) & (at < 9.98)
    assert back.valid[there].all() and not back.valid[(at < 0.95) | (at > 10.05)].any()
    assert back.legs.right is None and back.feet is None and back.strides is None
    for ours, theirs in zip(back.legs.left, made.legs.left, strict=True):
        np.testing.assert_allclose(ours[there], np.interp(at[there], TIME, theirs), atol=1e-9)
    np.testing.assert_allclose(back.distance[there], 1.3 * at[there], atol=1e-9)


def test_angles_alone_are_a_reference_without_a_foot_path_and_enough_for_their_loss():
    made = angles()
    back = io.reference_from_tables(
        TIME, io.to_dataframe(made)[["time_s", "hip_angle_left_deg", "knee_angle_left_deg"]]
    )
    assert np.isnan(back.legs.left.x).all() and back.distance is None
    assert back.valid[TIME > 1.0].all() and not back.valid[TIME < 0.95].any()  # empty cells before
    assert float(trajectory(made, back, TrajectoryWeights(x=0.0, y=0.0))) < 1e-9
    assert np.isnan(float(trajectory(made, back)))


def test_a_distance_alone_is_a_reference_of_the_whole_recording():
    """It is what a table row of a cohort with `distance_m` gives; a table of a few samples leads to it."""
    back = io.reference_from_tables(TIME, distance=12.0)
    assert back.distance[0] == 0.0 and back.distance[-1] == 12.0
    assert back.valid[0] and back.valid[-1] and not back.valid[100:400].any()
    few = pd.DataFrame({"time_s": [0.0, 2.0, 9.0, 10.0], "distance_m": [0.0, 0.0, 12.0, 12.0]})
    with pytest.raises(RecordingError, match="known at the end alone, give distance= without samples"):
        io.reference_from_tables(TIME, few)
    for wrong in ({"distance": 0.0}, {"distance": float("nan")}, {"distance": 12.0, "samples": few}):
        with pytest.raises(RecordingError, match="distance is that of the whole recording"):
            io.reference_from_tables(TIME, **wrong)


def test_strides_and_positions_come_back(feet):
    table = io.strides_to_dataframe(feet)
    table["side"] = table["side"].str.upper().str[0]  # R and L
    back = io.reference_from_tables(feet.time, io.to_dataframe(feet), table)
    np.testing.assert_array_equal(back.strides.side, feet.strides.side)
    for name in ("start", "final_contact", "end", "length", "height", "turn", "lift", "standing", "contact_angle"):
        np.testing.assert_allclose(getattr(back.strides, name), getattr(feet.strides, name), atol=1e-9)
    shown = feet.valid & back.valid
    np.testing.assert_allclose(back.feet.right.position[shown], feet.feet.right.position[shown], atol=1e-9)
    assert back.feet.left is None


def later(table, seconds):
    """The strides, so many seconds later, as those of the other foot are."""
    return table.assign(start_s=table["start_s"] + seconds, end_s=table["end_s"] + seconds)


STRIDES = [
    (lambda t: t.drop(columns="end_s"), "needs a column 'end_s'; it has 's_id', 'side'"),
    (lambda t: t.assign(side="middle"), "has 'right' or 'left'; got 'middle'"),
    (lambda t: t.assign(stride_length_m="long"), "column 'stride_length_m' of a reference must have numbers"),
    (lambda t: t.assign(stride_length_m=100.0 * t["stride_length_m"]), "is in metres; the median of the table is"),
    (lambda t: t.assign(start_s=1e3 * t["start_s"], end_s=1e3 * t["end_s"]), "are in seconds; a stride of the table"),
    (lambda t: t.assign(end_s=t["start_s"]), "must end .* after it starts"),
    (lambda t: t.assign(stride_length_m=-t["stride_length_m"]), r"has no negative lengths; got -1\."),
    (lambda t: t.assign(stride_length_m=0.0), "lengths that are 0; leave cells of lengths that are not"),
    (lambda t: pd.concat([t, t.iloc[2:3]]), "strides of the right foot overlap, .* is twice in the table"),
    (lambda t: pd.concat([t, later(t, 0.5)]), "strides of the right foot overlap, .* or has the wrong side"),
    (lambda t: t.rename(columns={"turn_deg": "turns_deg"}), "a column 'turns_deg', .* did you mean 'turn_deg'"),
]


@pytest.mark.parametrize(("change", "message"), STRIDES)
def test_strides_that_are_none_are_refused(feet, change, message):
    with pytest.raises(RecordingError, match=message):
        io.reference_from_tables(feet.time, None, change(io.strides_to_dataframe(feet)))


KNEE = "knee_angle_left_deg"
SAMPLES = [
    (lambda t: t.drop(columns="time_s"), "needs a column 'time_s'"),
    (lambda t: t.iloc[::-1], "'time_s' of a reference must have two times or more, which increase"),
    (lambda t: t[["time_s"]], "needs a sample in which every column of the reference has a number"),
    (lambda t: None, "needs a table of samples or of strides, or a distance; got none"),
    (lambda t: t.rename(columns={KNEE: "knee_angel_left_deg"}), f"did you mean '{KNEE}'"),
    (lambda t: t.assign(time_s=1e3 * t["time_s"]), "is in seconds.*; its samples are 20 s apart"),
    (lambda t: t.assign(time_s=t["time_s"] + 60.0), "from 60 to 70 s, the recording from 0 to 10 s: no time in common"),
    (lambda t: t.assign(distance_m=1e3 * t["distance_m"]), "'distance_m' is in metres"),
    (lambda t: t.assign(**{KNEE: np.deg2rad(t[KNEE])}), "is in degrees; it varies by 0.8"),
]


@pytest.mark.parametrize(("change", "message"), SAMPLES)
def test_samples_that_are_none_are_refused(change, message):
    with pytest.raises(RecordingError, match=message):
        io.reference_from_tables(TIME, change(io.to_dataframe(angles())))


def test_lengths_of_steps_are_refused_where_the_distance_is_known(feet):
    samples = io.to_dataframe(feet)
    whole = io.strides_to_dataframe(feet)
    sides = [whole.assign(side="right"), later(whole, 0.5).assign(side="left")]
    both = pd.concat(sides).loc[lambda t: t["end_s"] < feet.time[-1]]
    found = io.reference_from_tables(feet.time, samples, both)
    assert found.strides.valid.all() and len(both) > 4
    with pytest.raises(
        RecordingError, match=r"lengths of the table are 0\.\d+ of 'distance_m' in the same time: .* of steps"
    ):
        io.reference_from_tables(feet.time, samples, both.assign(stride_length_m=0.5 * both["stride_length_m"]))
