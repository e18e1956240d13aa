"""Pictures of feet show places, footholds, strides and widths as they are, and refuse what is not there."""

import numpy as np
import pytest

from jgait import plot
from jgait.plot.style import FOOT, RED
from jgait.types import SIDES, Estimate, Feet, FootTrajectory, Legs, Strides

WIDTH, STRIDE, SECONDS = 0.2, 1.2, 1.0
COUNT = 12
"""Strides of each foot, forward along x, the left foot half a stride later."""


def walked(*, turn_at=None):
    time = np.arange(0.0, COUNT + 2.0, 0.01)
    feet, tables = [], []
    for number, late in ((0, 0.0), (1, 0.5)):
        n = (time - late) / SECONDS
        phase = np.clip(n - np.floor(n) - 0.4, 0.0, 0.5) / 0.5  # stands, swings, stands
        moves = np.clip(np.floor(n) + phase, 0.0, COUNT)
        place = np.stack(
            [STRIDE * moves, np.full(time.size, WIDTH * (number - 0.5)), 0.15 * np.sin(np.pi * (moves % 1.0))], axis=1
        )
        feet.append(FootTrajectory(place, None, None))
        k = np.arange(COUNT)
        standing = late + SECONDS * (k + 0.2)
        width = np.where(k == (0 if number else COUNT - 1), np.nan, WIDTH)
        turn = np.where(k == turn_at, 0.5, 0.0) if turn_at else np.zeros(COUNT)
        tables.append((np.full(COUNT, number), standing, standing + SECONDS, width, turn))
    side, standing, ends, width, turn = (np.concatenate(column) for column in zip(*tables, strict=True))
    n = side.size
    strides = Strides(side, standing - 0.3, standing + 0.3, standing + 0.7, np.full(n, STRIDE), width, np.zeros(n),
                      np.ones(n, bool), standing, ends, turn=turn)  # fmt: skip
    spread = strides._replace(length=np.full(n, 0.02), width=np.full(n, 0.01), height=None)
    return Estimate(time, Legs(None, None), None, None, time >= 0.0, {}, strides, Feet(*feet), None, spread)


def test_feet_from_above_with_equal_axes_and_a_fitted_reference(tmp_path):
    estimate = walked()
    turned = [FootTrajectory(foot.position[:, [1, 0, 2]] * [-1.0, 1.0, 1.0] + 3.0, None, None)
              for foot in estimate.feet]  # fmt: skip
    reference = estimate._replace(feet=Feet(*turned), strides=None, strides_stddev=None)
    figure = plot.foot_paths(estimate, reference, title="walk")
    (axis,) = figure.axes
    assert axis.get_aspect() == 1.0 and "[m]" in axis.get_xlabel() and "[m]" in axis.get_ylabel()
    for side, foot in zip(SIDES, estimate.feet, strict=True):
        own = [line for line in axis.lines if line.get_color() == FOOT[side]["color"]]
        np.testing.assert_array_equal(own[0].get_xydata(), foot.position[:, :2])
        np.testing.assert_allclose(own[1].get_xdata(), STRIDE * np.arange(COUNT + 1), atol=1e-9)
        (known,) = [line for line in axis.lines if line.get_label() == f"reference, {side}"]
        np.testing.assert_allclose(known.get_xydata(), foot.position[:, :2], atol=1e-9)
    assert plot.save(figure, tmp_path / "paths.png").stat().st_size > 10_000


def test_feet_from_the_side():
    for axis in plot.foot_height(walked()).axes:
        line, holds = axis.lines
        assert line.get_xdata()[-1] == pytest.approx(COUNT * STRIDE)
        assert line.get_ydata().max() == pytest.approx(15.0, rel=1e-3)
        np.testing.assert_allclose(holds.get_ydata(), 0.0, atol=1e-9)
        np.testing.assert_allclose(holds.get_xdata(), STRIDE * np.arange(COUNT + 1), atol=1e-9)


def test_strides_over_time_with_their_deviations():
    estimate = walked()
    trusted = np.ones(2 * COUNT, bool)
    trusted[2] = False
    figure = plot.stride_series(estimate._replace(diagnostics={"width_valid": trusted}))
    assert [axis.get_ylabel() for axis in figure.axes] == ["stride length [m]", "stride width [cm]", "rise [cm]"]
    length, width, _ = figure.axes
    bars = [c.get_segments() for c in length.collections]
    np.testing.assert_allclose([np.ptp(segment[:, 1]) for segment in bars[0]], 0.08)
    hollow = [line for line in width.lines if line.get_markerfacecolor() == "white" and line.get_xdata().size]
    (doubtful,) = hollow
    np.testing.assert_allclose(doubtful.get_xydata(), [[estimate.strides.end[2], 100.0 * WIDTH]])
    bare = plot.stride_series(estimate._replace(strides_stddev=None, strides=estimate.strides._replace(
        width=np.full(2 * COUNT, np.nan))))  # fmt: skip
    assert [axis.get_ylabel() for axis in bare.axes] == ["stride length [m]", "rise [cm]"]


@pytest.mark.parametrize("draw", [plot.stride_series, plot.leg_strides])
def test_every_figure_of_strides_marks_what_the_table_marks(draw):
    estimate, row = walked(turn_at=6), np.arange(2 * COUNT)
    told = estimate._replace(diagnostics={"side_unknown": row == 3, "doubtful": row == 8, "unsure": row > 90})
    ends = np.asarray(estimate.strides.end)
    for axis in draw(told).axes:
        drawn = {line.get_label(): line for line in axis.lines if line.get_markerfacecolor() == "none"}
        assert set(drawn) == {"side not known", "in doubt", "in a turn"}
        np.testing.assert_allclose(drawn["side not known"].get_xdata(), ends[[3]])
        np.testing.assert_allclose(np.sort(drawn["in a turn"].get_xdata()), np.sort(ends[[6, COUNT + 6]]))


def test_widths_are_drawn_as_long_as_they_are():
    figure = plot.two_feet(walked(turn_at=6))
    above, *rest = figure.axes
    drawn = [line for line in above.lines if line.get_color() == RED]
    assert len(drawn) == 2 * COUNT - 2
    for line in drawn:
        np.testing.assert_allclose(np.hypot(*np.diff(line.get_xydata(), axis=0)[0]), WIDTH, atol=1e-9)
    assert above.get_aspect() == 1.0
    titles = [axis.get_title() for axis in rest if axis.get_title()]
    assert titles == ["0 to 7 s", "7 to 13 s"]  # before and after the stride that turns
    moving = next(axis for axis in rest if "SD" in axis.get_ylabel())
    np.testing.assert_allclose(moving.lines[0].get_ydata()[9:], 0.0, atol=1e-9)


def test_what_is_not_there_is_refused():
    estimate = walked()
    with pytest.raises(ValueError, match="has no feet; use an estimate of foot_ins"):
        plot.foot_paths(estimate._replace(feet=None))
    with pytest.raises(ValueError, match="has the left one alone"):
        plot.two_feet(estimate._replace(feet=Feet(None, estimate.feet.left)))
    with pytest.raises(ValueError, match="no stride of the estimate has a width"):
        plot.two_feet(estimate._replace(strides=estimate.strides._replace(width=np.full(2 * COUNT, np.nan))))
    with pytest.raises(ValueError, match="no stride is valid"):
        plot.stride_series(estimate._replace(strides=estimate.strides._replace(valid=np.zeros(2 * COUNT, bool))))
    with pytest.raises(ValueError, match="has no strides"):
        plot.stride_series(estimate._replace(strides=None))
