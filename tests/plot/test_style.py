"""Margins of figures."""

import itertools

import pytest

pytest.importorskip("matplotlib", reason="figures need matplotlib")

from jgait.plot.style import legend, panels, ready


@pytest.mark.parametrize("shared", [False, True])
@pytest.mark.parametrize(("rows", "columns"), [(1, 1), (2, 2), (4, 1)])
def test_no_text_of_a_figure_with_fixed_margins_leaves_it_or_covers_another(rows, columns, shared):
    figure, axes = panels(rows, columns, 8.6, 1.0 + 2.0 * rows, sharex=shared)
    for number, axis in enumerate(axes.ravel()):
        for line in range(5):
            axis.plot([0.0, 21.0], [-0.125, 0.125 + line], label=f"a line with a name, {line}")
        axis.set_ylabel("two\nlines")
        axis.set_yticks([-100.5, 100.5])
        axis.set_ylim(-120.0, 120.0)
        if number < columns:
            axis.set_title("right leg")
        if not shared or number >= columns * (rows - 1):
            axis.set_xlabel("time [s]")
    legend(figure, "a walk", columns=3)
    with ready(figure):
        figure.draw_without_rendering()
        boxes = [part.get_tightbbox() for part in (*axes.ravel(), *figure.legends, figure._suptitle)]
    for box in boxes:
        assert box.x0 >= 0.0 and box.y0 >= 0.0
        assert box.x1 <= figure.bbox.x1 and box.y1 <= figure.bbox.y1
    for one, other in itertools.combinations(boxes, 2):
        beside = min(one.x1, other.x1) - max(one.x0, other.x0)
        assert beside <= 0.0 or min(one.y1, other.y1) <= max(one.y0, other.y0)
