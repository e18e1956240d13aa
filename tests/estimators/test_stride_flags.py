"""Strides of another duration than those around them: a pause, or a missed contact."""

import jax
import numpy as np
import pytest
from made.estimators import only

from jgait import simulate
from jgait.estimators import ankle_stride
from jgait.estimators.stride_flags import (
    CLIPPED,
    DOUBTFUL,
    EVERY,
    STRIDE_FLAGS,
    durations,
    half_strides,
    in_order,
    marks,
    regular,
    stride_notes,
    uneven_strides,
    without,
)
from jgait.io import Results
from jgait.simulate.sensors import MPU6000
from jgait.types import Estimate, Legs, Strides


def test_a_stride_is_compared_with_those_around_it():
    lasts = np.array([1.0, 1.1, 1.0, 2.0, 1.0, 1.1, 0.5, 1.0, 1.0])
    assert list(np.flatnonzero(uneven_strides(lasts))) == [3, 6]
    slower = np.linspace(1.0, 2.0, 15)  # who becomes slower is not uneven
    assert not uneven_strides(slower).any()
    assert not uneven_strides(np.array([1.0, 3.0, 1.0])).any()  # too few
    assert list(uneven_strides(np.array([np.nan, 1.0, 1.0, 1.0, 3.0]))) == [False] * 4 + [True]


def test_uneven_strides_and_few_that_count_have_notes():
    uneven = np.arange(12) < 2
    texts = [note.text for note in stride_notes({"uneven": uneven}, ~uneven & (np.arange(12) < 3))]
    assert texts == ["2 of 12 strides: uneven", "only 1 regular stride"]
    assert not stride_notes({"uneven": np.zeros(12, bool)}, np.ones(12, bool))


def test_half_steps_of_a_short_walk_are_short_beside_its_whole_strides():
    side = np.array([0, 1, 0, 1, 0])
    start = np.array([3.4, 4.0, 3.8, 4.4, 4.9])
    end, length = np.array([3.8, 4.4, 4.9, 5.5, 5.8]), np.array([0.62, 1.25, 1.24, 1.27, 0.63])
    walked = Strides(side, start, None, end, length, *[np.full(5, np.nan)] * 2, np.ones(5, bool))
    order = np.argsort(start)
    assert sorted(order[half_strides(walked, order)]) == [0, 4]
    few = Strides(*(None if v is None else v[[1, 4]] for v in walked[:8]))  # none between others: beside the longest
    assert list(half_strides(few, np.arange(2))) == [False, True]
    alone = Strides(*(None if v is None else v[[4]] for v in walked[:8]))
    assert not half_strides(alone, np.arange(1)).any()


@pytest.mark.parametrize("seconds", [0.2, 0.4])
def test_a_hesitation_that_shanks_do_not_see_as_standing_is_in_no_regular_stride(seconds):
    person = simulate.person_of(simulate.population(jax.random.key(60), 1, recorded=False), 0)
    bouts = [simulate.straight(7.0)] * 3
    walked, truth = simulate.with_breaks(
        jax.random.key(8), person, bouts, [seconds] * 2, MPU6000, placements=("shank_right", "shank_left")
    )
    found = ankle_stride.estimate(ankle_stride.AnkleParams(), only(walked, "shank_right", "shank_left"))
    flags = ankle_stride.estimator().about.flags
    lasts = durations(found.strides)[in_order(found)]
    longest = np.nanmax(durations(truth.strides)[np.asarray(truth.strides.valid)])
    assert np.nanmax(lasts) > 1.5 * longest and marks(found, flags)["uneven"].any()
    assert np.nanmax(lasts[regular(found, flags)]) < 1.2 * longest


@pytest.mark.parametrize("flag", STRIDE_FLAGS, ids=lambda flag: flag.name)
def test_a_flag_leaves_out_the_measures_that_it_touches_and_no_others(flag):
    """Strides of one second; those without the flag of 1.2 m, those with it of 2 m."""
    count = 12
    flagged = np.arange(count) >= 4
    first = 0.5 * np.arange(count)
    values = {name: np.where(flagged, 2.0, 1.2) for name in ("length", "width", "step_length", "speed")}
    strides = Strides(np.arange(count) % 2, first, first + 0.6, first + 1.0, height=np.zeros(count),
                      valid=np.ones(count, bool), **values)  # fmt: skip
    none = np.zeros(0)
    estimate = Estimate(none, Legs(None, None), None, None, none, {}, strides)
    flag = flag._replace(read=lambda _: flagged)
    results = Results(estimate)
    results.marks = marks(estimate, (flag,))
    table = results.counted
    for column in ("stride_length_m", "walking_speed_mps", "stride_width_m", "stride_duration_s", "final_contact_s"):
        assert table[column].notna().sum() == (4 if column in flag.leaves_out else count), column
        assert regular(estimate, (flag,), column).sum() == table[column].notna().sum()
    printed = {total.words: total.text for total in results.totals}
    assert printed["cadence"] == "120 steps/min"
    assert printed["stride length"].startswith("1.2" if "stride_length_m" in flag.leaves_out else "2.0")


def test_a_doubt_about_lengths_leaves_cadence_and_stride_time_of_a_recording():
    every = np.ones(12, bool)
    marked = {DOUBTFUL.name: every, CLIPPED.name: every}
    known = [column for column in EVERY if without(marked, STRIDE_FLAGS, 12, column).any()]
    assert known == ["stride_duration_s", "cadence_spm"]
    del marked[CLIPPED.name]  # of which no angle is certain
    assert without(marked, STRIDE_FLAGS, 12, "knee_flexion_max_deg").all()
