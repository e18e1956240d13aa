"""The model's equations, and what is decided before it runs: readings, turns, contacts, bad input."""

import jax
import numpy as np
import pytest
from made.footsteps import drifting, footsteps
from made.notes import texts

from jgait.estimators import stride_width_ekf as sw
from jgait.estimators.stride_width_ekf import model
from jgait.estimators.stride_width_ekf.model import PathControl, WidthControl, WidthState
from jgait.types import Feet, RangeReadings, RecordingError

STATE = WidthState(1.0, 2.0, 0.3, -0.2, 0.4, -0.4, 0.1, 0.2, 0.3, 0.4)
CONTROL = WidthControl(PathControl(0.5, 0.1, 0.2, 0.6, 1.0), PathControl(0.4, -0.2, -0.3, 0.5, 0.0))


@pytest.fixture(scope="module")
def walk():
    return drifting(footsteps(before=9, turn=3, after=6), 1)


def ready(walk, **changes):
    options = changes.pop("options", sw.DEFAULT)
    given = walk._replace(**changes)
    return sw.prepare_from_feet(given.time, given.feet, given.mids, given.read, options)


def solved(made):
    return sw.estimator().solve(sw.WidthParams(), made)


def rotated(angle, dx, dy):
    return np.array([np.cos(angle) * dx - np.sin(angle) * dy, np.sin(angle) * dx + np.cos(angle) * dy])


def test_equation_3():
    p = sw.WidthParams()
    moved = model.transition(p, STATE, CONTROL, 1.0)
    np.testing.assert_allclose([moved.x_right, moved.y_right], [1.0, 2.0] + rotated(0.5, 0.5, 0.1), atol=1e-12)
    left = [moved.x_right + moved.apart_x, moved.y_right + moved.apart_y]
    np.testing.assert_allclose(left, [0.8, 2.4] + rotated(-0.7, 0.4, -0.2), atol=1e-12)
    assert (moved.heading_right, moved.heading_left) == pytest.approx((0.5, -0.7))
    # The right foot has just left, the left one moves on.
    np.testing.assert_allclose([moved.moved_x_right, moved.moved_y_right], rotated(0.5, 0.5, 0.1), atol=1e-12)
    np.testing.assert_allclose(
        [moved.moved_x_left, moved.moved_y_left], [0.3, 0.4] + rotated(-0.7, 0.4, -0.2), atol=1e-12
    )


def test_equation_6():
    p = sw.WidthParams()
    z = model.observation(p, STATE, CONTROL)
    x, y, s, c = 0.2, -0.4, np.sin(-0.4), np.cos(-0.4)
    assert tuple(z) == pytest.approx((x * s - y * c, x * c + y * s))
    # 0.3 m to the right of the left foot and 0.1 m ahead of it.
    beside = WidthState(0.0, 0.0, 0.0, -0.1, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0)
    assert tuple(model.between(beside)) == pytest.approx((0.3, 0.1))


def test_a_passing_counts_once_and_a_late_echo_not(walk):
    before = ready(walk)
    heard = np.flatnonzero(walk.read.mask)
    distance = walk.read.distance.copy()
    passing = before.inputs.time[before.inputs.range_measured][5]
    late = heard[np.abs(walk.time[heard] - passing) < 0.15]
    distance[late] += 0.2
    after = ready(walk, read=walk.read._replace(distance=distance))
    assert np.sum(before.inputs.range_measured) - np.sum(after.inputs.range_measured) == 1
    assert any("unlike those around" in note for note in texts(after.notes))
    assert np.sum(before.inputs.range_measured) < len(heard)
    assert np.max(before.inputs.distance) < 0.3
    # Feet that stand side by side are heard all the time.
    still = walk.time < walk.time[walk.mids[1][0]] - 0.2
    crowded = RangeReadings(walk.time, np.where(still, 0.2, walk.read.distance), walk.read.mask | still)
    more = ready(walk, read=crowded).inputs
    assert np.sum(more.range_measured) == np.sum(before.inputs.range_measured) + 1


def test_ranges_in_turns_are_left_out(walk):
    prepared = ready(walk)
    inputs = prepared.inputs
    assert not np.any(inputs.range_measured & inputs.turning)
    assert any("ranges in turns" in note for note in texts(prepared.notes))
    kept = ready(walk, options=sw.DEFAULT._replace(turn=3.0)).inputs
    assert np.sum(kept.range_measured) > np.sum(inputs.range_measured)
    assert not np.any(kept.turning)
    turning = inputs.time[inputs.turning]
    assert 3.0 < np.ptp(turning) < 8.0  # three strides of 1.12 s and those next to them


def test_fewer_than_two_strides_are_an_empty_table(walk):
    for mids in ((walk.mids[0][:2], walk.mids[1]), (walk.mids[0], walk.mids[1][:0])):
        estimate = solved(ready(walk, mids=mids))
        assert estimate.strides.width.shape == estimate.strides_stddev.width.shape == (0,)
        assert not np.any(estimate.valid)
        assert any("two of each are needed" in note for note in texts(estimate.diagnostics["notes"]))


def test_lost_samples_are_bridged_and_their_ranges_left_out(walk):
    whole = ready(walk)
    first = int(walk.mids[1][5]) + 4
    hole = walk.places[0].copy()
    hole[first : first + 40] = np.nan
    read = walk.read._replace(distance=np.where(walk.read.mask, walk.read.distance, np.nan))
    prepared = ready(walk, places=(hole, walk.places[1]), read=read)
    assert "the right foot is not known at 40 samples; bridged" in texts(prepared.notes)
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(prepared.inputs))
    lost = set(np.round(whole.inputs.time[whole.inputs.range_measured], 6)) - set(
        np.round(prepared.inputs.time[prepared.inputs.range_measured], 6)
    )
    assert all(walk.time[first] - 0.02 <= t <= walk.time[first + 40] for t in lost)
    estimate = solved(prepared)
    assert np.all(np.isfinite(np.asarray(estimate.diagnostics["z1"])))


def test_what_cannot_be_used_is_refused(walk):
    right, left = walk.feet
    n = walk.time.size

    def refused(message, time=walk.time, feet=walk.feet, mids=walk.mids, read=walk.read):
        with pytest.raises(RecordingError, match=message):
            sw.prepare_from_feet(time, feet, mids, read)

    refused("needs both feet; the left one was not measured", feet=Feet(right, None))
    refused(
        rf"right foot needs positions of shape \({n}, 3\)", feet=Feet(right._replace(position=np.zeros((n, 2))), left)
    )
    refused("needs finite positions; got 0 of", feet=Feet(right._replace(position=np.full((n, 3), np.nan)), left))
    refused("time must increase; got", time=walk.time[::-1])
    refused("needs times", time=np.zeros(1))
    refused("increasing samples from 0 to", mids=(walk.mids[0][::-1], walk.mids[1]))
    refused("increasing samples from 0 to", mids=(walk.mids[0], walk.mids[1] + n))
    refused("must be samples, whole numbers", mids=(walk.mids[0] + 0.5, walk.mids[1]))
    refused("stances must be given for the right and the left foot; got 1", mids=(walk.mids[0],))
    refused("times, distances and mask of one length", read=walk.read._replace(distance=np.zeros(3)))
    with pytest.raises(ValueError, match="takes range_offset and passing_offset of a person; got 'thigh_length'"):
        sw.with_body(sw.WidthParams(), {"thigh_length": 0.4})
    assert sw.with_body(sw.WidthParams(), {"range_offset": 0.1}).range_offset == 0.1
