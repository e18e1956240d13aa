"""A reference on another clock is noted, one on the same clock is not, whatever its errors."""

import numpy as np
import pytest

from jgait.evaluate.clocks import clock_notes
from jgait.types import Estimate, Feet, FootTrajectory, Legs, LegTrajectory, Strides

TIME = np.arange(0.0, 20.0, 0.01)


def knee(late=0.0, noise=0.0, stride=1.1):
    """A knee that stands for 3 s and then bends once a stride, most at 0.7 of it."""
    at = TIME - 3.0 - late
    walks = np.clip(at, 0.0, 1.0)
    bends = walks * np.deg2rad(30.0) * (1.0 + np.cos(2.0 * np.pi * (at / stride - 0.7)))
    return np.where(at > 0.0, bends, 0.0) + noise * np.random.default_rng(0).normal(size=TIME.size)


def legs(**made):
    angle = knee(**made)
    leg = LegTrajectory(0.0 * angle, angle, 0.0 * angle, 0.0 * angle)
    return Estimate(TIME, Legs(leg, None), None, None, np.ones(TIME.size, bool), {})


def strides(late=0.0, drop=(), stride=1.1):
    start = np.delete(3.0 + stride * np.arange(12) + 0.1 * np.sin(np.arange(12)), list(drop)) + late
    nothing = np.full(start.size, np.nan)
    table = Strides(np.zeros(start.size, int), start, start + 0.7, start + stride, nothing + 1.2, nothing, nothing,
                    np.ones(start.size, bool))  # fmt: skip
    return Estimate(TIME, Legs(None, None), None, None, np.ones(TIME.size, bool), {}, table)


def feet(**made):
    """A foot that swings as the knee bends, in one direction."""
    way = np.cumsum(3.0 * np.maximum(knee(**made), 0.0)) * 0.01
    place = np.stack([np.cos(1.0) * way, np.sin(1.0) * way, 0.0 * way], axis=1)
    return legs()._replace(legs=Legs(None, None), feet=Feet(FootTrajectory(place, None, None), None))


MADE = [(legs, "the knee's angles"), (strides, "contacts"), (feet, "speeds of the feet")]


@pytest.mark.parametrize("late", [-1.3, 0.8, 0.3])
@pytest.mark.parametrize(("made", "what"), MADE)
def test_another_clock_is_noted_with_its_offset(made, what, late):
    (note,) = clock_notes(made(), made(late=late))
    assert note.values["what"] == what and note.values["when"] == ("earlier" if late > 0.0 else "later")
    assert note.values["seconds"] == pytest.approx(abs(late), abs=0.1)


def test_exchanged_sides_are_noted_and_not_taken_for_another_clock():
    """Half a stride later the left leg moves as the right one does, but for the first and the last stride."""
    right, left = legs(), legs(late=0.55)
    both = right._replace(legs=Legs(right.legs.right, left.legs.right))
    (note,) = clock_notes(both, both._replace(legs=Legs(left.legs.right, right.legs.right)))
    assert note.code == "reference_sides" and note.values["what"] == "the knee's angles"
    one, other = strides().strides, strides(late=0.55).strides
    table = Strides(*(None if a is None else np.concatenate([a, b]) for a, b in zip(one, other, strict=True)))
    table = table._replace(side=np.repeat([0, 1], one.side.size))
    walked = strides()._replace(strides=table)
    (note,) = clock_notes(walked, walked._replace(strides=table._replace(side=1 - table.side)))
    assert note.code == "reference_sides" and note.values["what"] == "contacts"
    later = table._replace(start=table.start + 0.3, end=table.end + 0.3)
    (note,) = clock_notes(walked, walked._replace(strides=later))
    assert note.code == "reference_clock"


@pytest.mark.parametrize(("made", "what"), MADE)
def test_a_reference_of_another_walk_agrees_at_no_time(made, what):
    for one, other in (({}, {"stride": 1.4}), ({"stride": 1.3}, {})):
        (note,) = clock_notes(made(**one), made(**other))
        assert note.code == "reference_other" and note.values == {"what": what, "seconds": 5.0}
    assert str(note) == f"{what} of the reference agree with the estimate at no time within 5 s"


def test_strides_beside_the_samples_of_a_reference_are_compared_too():
    """A knee is bent most in the swings of the strides, whichever of both the estimate has."""
    knees, own, other = legs(), strides(), strides(stride=1.4)
    assert not clock_notes(knees, knees._replace(strides=own.strides))
    (note,) = clock_notes(knees, knees._replace(strides=other.strides))
    assert note.code == "reference_other" and note.values["what"] == "contacts"
    (note,) = clock_notes(own, legs(stride=1.4)._replace(strides=own.strides))
    assert note.code == "reference_other" and note.values["what"] == "the knee's angles"
    for late in (-0.3, 0.5):  # less than half a stride: a whole one later, both are alike again
        (note,) = clock_notes(knees, strides(late=late))
        assert note.code == "reference_clock" and note.values["seconds"] == pytest.approx(abs(late), abs=0.1)
        assert note.values["when"] == ("earlier" if late > 0.0 else "later")


def test_errors_on_the_same_clock_are_not():
    assert not clock_notes(feet(), feet(noise=np.deg2rad(2.0)))
    assert not clock_notes(legs(), legs(noise=np.deg2rad(12.0)))
    assert not clock_notes(legs(), legs(late=0.05))
    assert not clock_notes(strides(drop=(0, 1, 2, 3, 4)), strides())
    assert not clock_notes(strides(), legs())
