"""Estimates that no person can have walked are noted; those of people who run, limp or climb are not."""

import numpy as np
import pytest
from made.notes import codes

from jgait.estimators.plausible import implausible
from jgait.types import Estimate, Legs, LegTrajectory, Strides

TIME = np.linspace(0.0, 10.0, 1001)
WALKS = 30.0 - 35.0 * np.cos(2.0 * np.pi * TIME)


def estimate(strides=None, knee=None, distance=None, valid=True, hip=0.0):
    leg = None if knee is None else LegTrajectory(np.deg2rad(hip + 0.0 * TIME), np.deg2rad(knee), *[0.0 * TIME] * 2)
    return Estimate(TIME, Legs(leg, None), None, distance, np.broadcast_to(valid, TIME.shape), {}, strides)


def walked(length=1.4, seconds=1.1, rise=0.0, width=0.1, valid=True):
    start, ones = seconds * np.arange(6), np.ones(6)
    return Strides(np.ones(6, int), start, None, start + seconds, length * ones, width * ones, rise * ones,
                   np.full(6, valid))  # fmt: skip


WAVE = np.sin(2 * np.pi * TIME)
USUAL = {
    "usual": estimate(walked()), "race walker": estimate(walked(2.4, 0.9)), "shuffling": estimate(walked(0.3, 2.5)),
    "runner": estimate(walked(3.5, 0.65)), "tall": estimate(walked(1.65, 1.2)), "pauses": estimate(walked(0.9, 2.5)),
    "stairs": estimate(walked(0.6, 1.6, rise=0.33)),
    "no width": estimate(walked(width=np.nan)), "padding": estimate(walked(9.0, valid=False)),
    "knee": estimate(knee=WALKS), "not valid": estimate(knee=WALKS + 200.0 * (TIME > 9.0), valid=TIME <= 9.0),
    "knee with hip": estimate(knee=10.0 * WAVE, hip=20.0 * WAVE), "rest": estimate(knee=2.0 * WAVE, hip=5.0 * WAVE),
    "distance": estimate(distance=1.4 * TIME),
}  # fmt: skip
IMPOSSIBLE = {
    "long": (estimate(walked(2.6)), "left: 6 of 6 strides are longer or faster"),
    "fast": (estimate(walked(4.5, 1.0)), "left: 6 of 6 strides are longer or faster"),
    "fast run": (estimate(walked(6.0, 0.7)), "left: 6 of 6 strides are longer or faster"),
    "slow clock": (estimate(walked(2.0, 1.4)), "left: strides of 2.00 m that last 1.40 s; nobody takes so long steps"),
    "infinite": (estimate(walked(np.inf)), "left: 6 of 6 strides are longer or faster"),
    "width": (estimate(walked(width=-0.1)), "negative width: left and right may be exchanged"),
    "rise": (estimate(walked(rise=-1.6)), "left: the foot rises by -9.60 m over 8.4 m, steeper than stairs"),
    "speed": (estimate(distance=9.0 * TIME), "90 m in 10 s is faster than a person walks"),
    "no distance": (estimate(distance=np.where(TIME > 9.0, np.nan, TIME)), "nan m in 10 s"),
    "knee": (estimate(knee=WALKS + 200.0 * (TIME > 9.0)), "right: the knee reaches -5 to 265°; 10 % of its samples"),
    "no knee": (estimate(knee=np.where(TIME > 5.0, np.nan, 20.0)), "right: 500 valid samples of the knee are not"),
    "stiff": (estimate(knee=2.0 * WAVE, hip=20.0 * WAVE), "right: the knee moves by 4° only, while the hip swings"),
}


@pytest.mark.parametrize("name", USUAL)
def test_what_people_do_is_not_noted(name):
    assert implausible(USUAL[name]) == ()


@pytest.mark.parametrize("name", IMPOSSIBLE)
def test_what_no_person_does_is_noted(name):
    found, words = IMPOSSIBLE[name]
    (note,) = implausible(found)
    assert words in note.text
    assert codes([note]) == ["knee_implausible" if "knee" in name else "implausible"]
