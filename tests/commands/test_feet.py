"""Feet on the command line: strides, ways and widths of a user's file, and of sets whose references tell strides."""

import numpy as np
import pandas as pd
import pytest
from made.command import run
from made.foot import foot
from made.track import step

from jgait import io
from jgait.types import Imu, RangeReadings, Recording

HZ, APART, OFFSET = 100.0, 0.2, 0.08
LENGTHS = {"right": np.r_[0.6, np.full(5, 1.2)], "left": np.full(6, 1.2)}
RESTS = {"right": 1.5, "left": 2.05}


def two_feet():
    """Six strides of each foot, the left one half a stride later, and the range as one passes the other."""
    made = {side: foot(strides=6, length=LENGTHS[side], rest=RESTS[side], side=side) for side in LENGTHS}
    samples = made["left"].recording.sensors["foot_left"].time.size
    time, sensors, along = np.arange(samples) / HZ, {}, {}
    for side, one in made.items():
        imu = one.recording.sensors[f"foot_{side}"]
        more = [(0, samples - imu.time.size), (0, 0)]
        sensors[f"foot_{side}"] = Imu(
            time, np.pad(imu.gyr, more), np.pad(imu.acc, more, mode="edge"), np.ones(samples, bool)
        )
        along[side] = step((time[:, None] - one.lift_off) / (one.contact - one.lift_off)) @ one.length
    heard = (np.abs(along["right"] - along["left"]) < 0.06) & (np.abs(time - 5.0) < 3.4)
    uneven = APART - OFFSET + 0.001 * np.sin(40.0 * time)  # a range that repeats one reading is stuck
    read = RangeReadings(time, np.where(heard, uneven, 0.0), heard)
    return Recording(sensors, HZ, "made", feet_range=read), made


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    recording, _ = two_feet()
    assert recording.feet_range.mask.sum() >= 8
    return io.write_csv(recording, tmp_path_factory.mktemp("feet") / "walk.csv")


def test_strides_and_ways_of_both_feet(walk, tmp_path):
    code, said = run("estimate", walk, "--estimator", "foot_ins", "--option", "pivot=0", "--out", tmp_path / "out")
    assert code == 0, said
    assert {path.name for path in (tmp_path / "out").glob("[!.]*")} == {
        "walk_feet.csv", "walk_strides.csv", "walk_strides.png", "walk_paths.png", "walk_height.png",
    }  # fmt: skip
    assert "strides │ 12, " in said and "stride length │ 1.20" in said
    strides = pd.read_csv(tmp_path / "out" / "walk_strides.csv")
    for side, lengths in LENGTHS.items():
        own = strides[strides["side"] == side]
        np.testing.assert_allclose(own["stride_length_m"], lengths, atol=0.01)
        assert (own["stride_length_std_m"] > 0.0).all() and own["stride_width_m"].isna().all()
    ways = pd.read_csv(tmp_path / "out" / "walk_feet.csv")
    assert ways["position_x_left_m"].iloc[-1] == pytest.approx(7.2, abs=0.03)


def test_widths_where_the_feet_hear_each_other(walk, tmp_path):
    words = ("--estimator", "stride_width_ekf", "--option", "pivot=0", "--out", tmp_path / "out")
    code, said = run("estimate", walk, *words, "--notes")
    assert code == 0, said
    assert f"Check: No --option range-offset: the default of {OFFSET} m is taken" in said
    assert "walk_widths.png" in said and "stride width │ " in said
    strides = pd.read_csv(tmp_path / "out" / "walk_strides.csv")
    good = strides[strides["width_valid"]]
    assert len(good) >= 6
    np.testing.assert_allclose(good["stride_width_m"], APART, atol=0.03)
