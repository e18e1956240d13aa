"""Figures of sleeping sensors show every series, on axes with units, and refuse what does not fit together."""

import numpy as np

from experiments.udaya2010 import curves
from experiments.udaya2010.curves import Series

DUTY = np.array([0.9, 0.5, 0.1])


def lines():
    return {
        "paper": Series(DUTY, [0.13, 0.25, 0.3], "paper"),
        "hold": Series(DUTY, [0.3, 0.9, 1.2]),
        "found": Series(DUTY, [0.02, 0.05, 0.08], "found"),
        "policy": Series([0.5], [0.04], "policy"),
    }


def test_both_figures_draw_every_series_in_percent_with_units():
    for draw, options in ((curves.error_over_duty, {}), (curves.error_over_saving, {"power": 30e-3})):
        figure = draw({"a": lines(), "b": lines()}, **options)
        assert len(figure.axes) == 2
        for axis in figure.axes:
            assert [text.get_text() for text in axis.get_legend().get_texts()] == list(lines())
            assert "[%]" in axis.get_xlabel() and "[1]" in axis.get_ylabel()
            for line, series in zip(axis.get_lines(), lines().values(), strict=True):
                np.testing.assert_allclose(np.sort(line.get_xdata()), np.sort(100.0 * np.asarray(series.x)))
            low, high = axis.get_ylim()
            assert low < 0.02 and high > 1.2
        if options:
            above = figure.axes[0].child_axes[0]
            assert "[mW]" in above.get_xlabel()
            assert [t.get_text() for t in above.get_xticklabels()][:2] == ["30", "24"]
