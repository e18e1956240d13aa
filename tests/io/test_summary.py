"""The summary of strides: means, variability within a side, asymmetry, and the stated error beside them."""

import numpy as np
import pandas as pd
import pytest

from jgait.io.summary import CONTACT_S, SUMMARY, summary

FINAL = np.array([0.6, 1.0] * 6) + np.repeat(np.arange(6.0), 2)
"""[s] Final contacts: each foot stands for 0.6 s."""

RIGHT, LEFT = (0.9, 1.30, 1.34, 1.32, 1.36, 1.1), (0.8, 1.20, 1.26, 1.22, 1.24, 1.0)


def strides(right=RIGHT, left=LEFT, **more):
    """Strides of one second that alternate: a left contact is 0.4 s after a right one, and 0.6 s before the next.

    The first and the last of each side are not steady.
    """
    rows = [("right", float(i), length) for i, length in enumerate(right)]
    rows += [("left", i + 0.4, length) for i, length in enumerate(left)]
    side, start, length = zip(*sorted(rows, key=lambda row: row[1]), strict=True)
    table = pd.DataFrame({"side": side, "start_s": start, "end_s": np.add(start, 1.0), "stride_length_m": length})
    return table.assign(**{"stride_duration_s": 1.0, "regular": True, "source": "feet", **more})


def rows(table):
    return summary(table).set_index("measure")


def test_mean_variability_and_asymmetry_of_the_length():
    right, left = np.array(RIGHT[1:-1]), np.array(LEFT[1:-1])
    one = rows(strides(stride_length_std_m=0.02)).loc["stride_length"]
    assert one["unit"] == "m" and one["n_strides"] == 8
    assert (one["right"], one["left"]) == pytest.approx((1.33, 1.23))
    assert one["mean"] == pytest.approx(1.28)
    assert one["median"] == pytest.approx(np.median([*RIGHT, *LEFT]))  # of those that are not steady, too
    within = np.sqrt(0.5 * (right.var(ddof=1) + left.var(ddof=1)))  # not the difference of the sides
    assert one["std"] == pytest.approx(within)
    assert one["cv_pct"] == pytest.approx(100.0 * within / 1.28)
    assert one["asymmetry_pct"] == pytest.approx(100.0 * 0.1 / 1.28)
    assert one["error_std"] == pytest.approx(0.02)
    assert one["asymmetry_std_pct"] == pytest.approx(100.0 * np.sqrt(2.0) * 0.02 / 1.28)


def test_sides_are_compared_over_the_same_time_and_strides_within_a_bout():
    """The left sensor stops after a slow bout; the right one goes on in a faster one."""
    slow, fast = strides(), strides(right=tuple(0.3 + np.array(RIGHT)))
    fast = fast[fast["side"] == "right"].assign(
        start_s=lambda t: t["start_s"] + 20.0, end_s=lambda t: t["end_s"] + 20.0
    )
    one, both = rows(slow).loc["stride_length"], rows(pd.concat([slow, fast], ignore_index=True)).loc["stride_length"]
    assert both["n_strides"] == 12 and one["n_strides"] == 8
    assert both["right"] == pytest.approx(one["right"]) and both["left"] == pytest.approx(one["left"])
    assert both["mean"] == pytest.approx(0.5 * (one["right"] + 0.15 + one["left"]))
    right, left = np.array(RIGHT[1:-1]), np.array(LEFT[1:-1])
    assert both["std"] == pytest.approx(np.sqrt(0.5 * (right.var(ddof=1) + left.var(ddof=1))))


def test_variability_below_half_of_the_error_is_not_stated():
    known, hidden = (rows(strides(stride_length_std_m=error)).loc["stride_length"] for error in (0.045, 0.055))
    assert known["std"] > 0.0
    assert hidden[["std", "cv_pct"]].isna().all()
    assert hidden["mean"] == known["mean"] and hidden["error_std"] == pytest.approx(0.055)


def test_a_step_lasts_from_the_contact_of_the_other_foot():
    steps = rows(strides()).loc["step_duration"]
    assert steps["asymmetry_std_pct"] == pytest.approx(100.0 * 2.0 * np.sqrt(2.0) * CONTACT_S / 0.5)
    assert (steps["right"], steps["left"]) == pytest.approx((0.6, 0.4))
    assert steps["asymmetry_pct"] == pytest.approx(40.0)
    assert steps["n_strides"] == 8
    assert steps["std"] == pytest.approx(0.0, abs=1e-9)


def test_strides_beside_a_turn_are_not_steady():
    table = strides(right=(*RIGHT[:-1], 9.0, 7.0, 9.0, *RIGHT[1:]), left=())
    table.loc[table["stride_length_m"] == 7.0, "regular"] = False  # beside it 9 m
    one = rows(table).loc["stride_length"]
    assert one["n_strides"] == 8
    assert one["mean"] == pytest.approx(1.33)
    apart = strides(right=RIGHT, left=())
    apart.loc[3:, ["start_s", "end_s"]] += 5.0  # a break: two strides before it, two after it are not steady
    assert rows(apart).loc["stride_length", "n_strides"] == 6  # too few: the regular ones


def test_strides_in_which_a_person_slows_down_are_not_steady():
    lasts = np.array([1.3, 1.1, 1.0, 1.02, 0.98, 1.25, 1.0, 1.01, 1.0, 1.1, 1.25, 1.4, 1.6])
    ends = 2.0 + np.cumsum(lasts)
    table = pd.DataFrame({
        "side": "right", "source": "feet", "start_s": ends - lasts, "end_s": ends, "stride_duration_s": lasts,
        "regular": True,
    })  # fmt: skip
    row = summary(table).set_index("measure").loc["stride_duration"]
    kept = lasts[1:10]  # one slow stride between others is part of how the person walks
    assert row["n_strides"] == len(kept) and row["mean"] == pytest.approx(kept.mean())


def test_of_a_short_walk_the_regular_strides_count_and_no_variability_is_stated():
    one = rows(strides(right=RIGHT[:4], left=LEFT[:4])).loc["stride_length"]
    assert one["n_strides"] == 8
    assert one["right"] == pytest.approx(np.mean(RIGHT[:4]))
    assert not one["steady"] and one[["std", "cv_pct", "asymmetry_pct"]].isna().all()


def test_one_side_alone_has_no_asymmetry_and_no_steps():
    found = rows(strides(left=(), stride_length_std_m=0.02))
    assert found.loc["stride_length", "mean"] == pytest.approx(1.33)
    assert found.loc["stride_length", ["left", "asymmetry_pct", "asymmetry_std_pct"]].isna().all()
    assert "step_duration" not in found.index


def test_sides_of_different_sensors_are_not_compared():
    table = strides(stride_length_std_m=0.02, final_contact_s=FINAL)
    table.loc[table["side"] == "left", "source"] = "shanks"
    found = rows(table)
    assert found.loc["stride_length", ["asymmetry_pct", "asymmetry_std_pct"]].isna().all()
    assert found.loc["stride_length", "left"] == pytest.approx(1.23)
    assert "step_duration" not in found.index
    assert np.isnan(found.loc["stance", "left"]) and found.loc["stance", "right"] == pytest.approx(60.0)


@pytest.mark.parametrize(
    ("error", "source", "counts"), [(0.08, "waist", False), (0.03, "waist", True), (0.08, "feet", True)]
)
def test_a_side_that_another_sensor_measures_far_less_exactly_does_not_count(error, source, counts):
    """The mean with strides of the waist was worse than that of the shoe alone."""
    table = strides(stride_length_std_m=0.02)
    left = table["side"] == "left"
    table.loc[left, ["source", "stride_length_std_m"]] = source, error
    found = rows(table).loc["stride_length"]
    assert [found["mean"], found["right"]] == pytest.approx([1.28 if counts else 1.33, 1.33])
    assert np.isnan(found["left"]) != counts
    assert rows(table).loc["stride_duration", ["right", "left"]].notna().all()


def test_steps_stances_and_step_lengths_need_shoes():
    table = strides(final_contact_s=FINAL, step_length_m=0.6, source="waist")
    assert {"step_duration", "stance", "step_length"}.isdisjoint(rows(table).index)
    with_range = strides(step_length_m=0.6, stride_width_m=0.1)
    assert rows(with_range).loc["step_length", "mean"] == pytest.approx(0.6)


def test_widths_and_step_lengths_that_are_not_usable_are_not_stated():
    usable = np.arange(len(FINAL)) < 8
    of_some = rows(strides(step_length_m=np.where(usable, 0.6, 0.2), stride_width_m=0.1, width_valid=usable))
    assert of_some.loc["step_length", "mean"] == pytest.approx(0.6)
    of_none = rows(strides(step_length_m=0.6, stride_width_m=0.1, width_valid=False))
    assert not {"step_length", "stride_width"} & set(of_none.index)


def test_angles_have_no_ratios_and_unusable_ones_do_not_count():
    usable = np.tile([True, False], 6)  # the right leg's
    one = rows(strides(knee_flexion_max_deg=60.0, angles_valid=usable)).loc["knee_flexion_max"]
    assert one["n_strides"] == 4 and np.isnan(one["left"])
    assert one[["cv_pct", "asymmetry_pct"]].isna().all()
    assert "knee_flexion_max" not in rows(strides(knee_flexion_max_deg=60.0, angles_valid=False)).index


def test_the_error_of_the_standing_pose_hides_no_variability_of_angles():
    bends = 60.0 + np.resize([0.0, 1.0, 2.0], 12)
    one = rows(strides(knee_flexion_max_deg=bends, knee_flexion_max_std_deg=4.5)).loc["knee_flexion_max"]
    assert one["error_std"] == pytest.approx(4.5) and 0.5 < one["std"] < 1.5


def test_the_stance_is_a_share_of_the_stride():
    assert rows(strides(final_contact_s=FINAL)).loc["stance", "mean"] == pytest.approx(60.0)


def test_without_regular_strides_there_are_no_rows():
    found = summary(strides().assign(regular=False))
    assert list(found.columns) == SUMMARY and not len(found)


def test_strides_of_a_guessed_side_are_of_neither():
    one = rows(strides(side_known=False)).loc["stride_length"]
    assert one["n_strides"] == 8 and one["mean"] == pytest.approx(1.28)
    assert one[["right", "left", "asymmetry_pct"]].isna().all()
    assert one["std"] == pytest.approx(np.std([*RIGHT[1:-1], *LEFT[1:-1]], ddof=1))


def test_the_cadence_counts_steps():
    assert rows(strides()).loc["cadence", "mean"] == pytest.approx(120.0)


def test_a_measure_that_only_strides_which_are_not_steady_have_is_a_median_alone():
    table = strides()
    ends = table["start_s"].isin([0.0, 0.4, 5.0, 5.4])
    one = rows(table.assign(lift_m=np.where(ends, 0.01, np.nan))).loc["lift"]
    assert one["median"] == 0.01 and one["n_strides"] == 0
    assert one[["mean", "std", "right", "left"]].isna().all()
