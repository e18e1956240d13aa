"""Estimates that no person can have walked are noted; those of people who run, limp or climb are not."""

import numpy as np
import pytest

from jgait.estimators.plausible import implausible
from jgait.types import Estimate, Legs, LegTrajectory, Strides

TIME = np.linspace(0.0, 10.0, 1001)


def estimate(strides=None, knee=None, distance=None, valid=None):
    valid = np.ones(TIME.size, bool) if valid is None else valid
    leg = None if knee is None else LegTrajectory(0.0 * TIME, np.deg2rad(knee), 0.0 * TIME, 0.0 * TIME)
    return Estimate(TIME, Legs(leg, None), None, distance, valid, {}, strides)


def walked(length=1.4, seconds=1.1, rise=0.0, width=0.1, side=1):
    n = 6
    full = lambda value: np.full(n, float(value))  # noqa: E731
    start = seconds * np.arange(n)
    return Strides(
        np.full(n, side), start, None, start + seconds, full(length), full(width), full(rise), np.ones(n, bool)
    )


def codes(result):
    return [note.code for note in implausible(result)]


@pytest.mark.parametrize(
    "strides",
    [
        walked(), walked(2.4, 0.9), walked(0.3, 2.5), walked(3.5, 0.65), walked(0.6, 1.6, rise=0.33),
        walked(width=np.nan), walked(0.3, 1.0, rise=0.05),
    ],
    ids=["usual", "race walker", "shuffling", "runner", "stairs", "no width", "short"],
)  # fmt: skip
def test_what_people_do_is_not_noted(strides):
    assert codes(estimate(strides)) == []


@pytest.mark.parametrize(
    ("strides", "code"),
    [
        (walked(2.6), "strides_implausible"), (walked(4.5, 1.0), "strides_implausible"),
        (walked(6.0, 0.7), "strides_implausible"), (walked(np.inf), "strides_implausible"),
        (walked(width=-0.1), "width_negative"), (walked(rise=1.6), "height_drifts"),
        (walked(rise=-1.6), "height_drifts"),
    ],
)  # fmt: skip
def test_what_no_person_does_is_noted_with_its_side(strides, code):
    notes = implausible(estimate(strides))
    assert [note.code for note in notes] == [code]
    assert "left" in notes[0].text
    assert "Likely causes" in notes[0].meaning


@pytest.mark.parametrize(("knee", "hip", "found"), [(2.0, 20.0, ["knee_stiff"]), (10.0, 20.0, []), (2.0, 5.0, [])])
def test_a_knee_that_does_not_move_while_the_hip_swings_is_noted(knee, hip, found):
    wave = np.deg2rad(np.sin(2 * np.pi * TIME))
    leg = LegTrajectory(hip * wave, knee * wave, 0.0 * TIME, 0.0 * TIME)
    assert codes(estimate()._replace(legs=Legs(leg, None))) == found


def test_padding_rows_of_strides_do_not_count():
    assert codes(estimate(walked(9.0)._replace(valid=np.zeros(6, bool)))) == []


def test_knees():
    walks = 30.0 - 35.0 * np.cos(2.0 * np.pi * TIME)
    assert codes(estimate(knee=walks)) == []
    notes = implausible(estimate(knee=walks + 200.0 * (TIME > 9.0)))
    assert [note.code for note in notes] == ["knee_implausible"]
    assert notes[0].text == "right: the knee reaches -5 to 265°; 10 % of its samples are beyond what a knee does"
    assert codes(estimate(knee=walks + 200.0 * (TIME > 9.0), valid=TIME <= 9.0)) == []


def test_results_that_are_not_finite_and_distances_that_no_runner_covers():
    (lost,) = implausible(estimate(knee=np.where(TIME > 5.0, np.nan, 20.0)))
    assert (lost.code, lost.severity, lost.values["side"]) == ("result_not_finite", "stop", "right")
    assert codes(estimate(distance=1.4 * TIME)) == []
    assert codes(estimate(distance=9.0 * TIME)) == ["speed_implausible"]
    assert codes(estimate(distance=np.where(TIME > 9.0, np.nan, TIME))) == ["speed_implausible"]
