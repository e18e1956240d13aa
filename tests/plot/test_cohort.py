"""Figures of a cohort show the numbers that the tables hold, and refuse what they cannot draw."""

import numpy as np
import pandas as pd
import pytest

from jgait import evaluate
from jgait.plot import cohort


def table(sizes=(5, 7, 4), seed=0):
    rng = np.random.default_rng(seed)
    codes = np.repeat(np.arange(len(sizes)), sizes)
    reference = rng.normal(1.2, 0.1, codes.size)
    estimate = reference + rng.normal(0.0, 0.03, len(sizes))[codes] + rng.normal(0.01, 0.02, codes.size)
    return pd.DataFrame(
        {"subject": [f"s{c}" for c in codes], "quantity": "length", "estimate": estimate, "reference": reference}
    )


def level_lines(axis):
    return [line.get_ydata()[0] for line in axis.lines if len(set(line.get_ydata())) == 1]


def test_bland_altman_holds_the_limits_and_every_point():
    rows = table()
    rows.loc[3, "estimate"] = np.nan
    figure = cohort.bland_altman(rows, "length", unit="m")
    (axis,) = figure.axes
    assert (axis.get_xlabel()[-4:], axis.get_ylabel()) == (" [m]", "estimate − reference [m]")
    seen = rows.dropna()
    limits = evaluate.limits_of_agreement(seen["estimate"], seen["reference"], subjects=seen["subject"])
    np.testing.assert_allclose(level_lines(axis), [0.0, limits.bias, limits.upper, limits.lower])
    bars = [line.get_ydata() for line in axis.lines if len(set(line.get_ydata())) == 2]
    ends = [limits[1:3], (limits.upper_low, limits.upper_high), (limits.lower_low, limits.lower_high)]
    np.testing.assert_allclose(bars, ends)
    beside = [line.get_xdata()[0] for line in axis.lines if len(set(line.get_ydata())) == 2]
    assert len(set(beside)) == 3  # intervals that overlap stay apart
    low, high = axis.get_ylim()
    assert low < limits.lower_low and high > limits.upper_high
    assert axis.texts[0].get_text() == f"bias\n{limits.bias:+.3g} m".replace("-", "−")
    drawn = [collection.get_offsets() for collection in axis.collections]
    for points, (_, own) in zip(drawn, seen.groupby("subject"), strict=True):
        expected = [(own["estimate"] + own["reference"]) / 2, own["estimate"] - own["reference"]]
        np.testing.assert_allclose(points, np.transpose(expected))
    shapes = {tuple(collection.get_paths()[0].vertices.ravel()) for collection in axis.collections}
    assert len(shapes) == 3  # told apart without colour
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["s0", "s1", "s2"]


def test_many_subjects_share_one_mark():
    figure = cohort.bland_altman(table((2,) * (len(cohort.MARKS) + 1)), "length")
    assert [len(one.get_offsets()) for one in figure.axes[0].collections] == [2 * (len(cohort.MARKS) + 1)]
    assert not figure.legends


def test_each_subject_has_its_row_the_best_on_top():
    rows = table((6, 9, 5, 1), seed=2)
    figure = cohort.per_subject(rows, "length", unit="m")
    (axis,) = figure.axes
    size = (rows["estimate"] - rows["reference"]).abs().groupby(rows["subject"])
    medians = size.median().sort_values()
    assert [text.get_text() for text in axis.get_yticklabels()] == list(medians.index)
    assert axis.yaxis_inverted()
    dots = {line.get_ydata()[0]: line.get_xdata()[0] for line in axis.lines if line.get_marker() == "o"}
    worst = {line.get_ydata()[0]: line.get_xdata()[0] for line in axis.lines if line.get_marker() == "|"}
    np.testing.assert_allclose([dots[row] for row in range(4)], medians)
    np.testing.assert_allclose([worst[row] for row in range(4)], size.max()[medians.index])
    (whole,) = [line for line in axis.lines if line.get_label() == "median of the subjects' medians"]
    assert whole.get_xdata()[0] == pytest.approx(medians.median())
    assert axis.get_xlabel() == "length: |estimate − reference| [m]"
    assert [text.get_text() for text in figure.legends[0].get_texts()][:3] == ["middle half", "median", "worst"]


def test_one_error_a_person_has_no_middle_half():
    figure = cohort.per_subject(table((1, 1, 1)), "length")
    assert [text.get_text() for text in figure.legends[0].get_texts()][:2] == ["median", "worst"]


def test_before_and_after_are_joined_and_the_worse_are_dashed():
    changes = {"error_before": [1.0, 4.0, 2.0, 3.0, 0.5], "error_after": [0.5, 5.0, 1.0, 1.0, 0.5]}
    changes = pd.DataFrame({"subject": ["a", "b", "c", "C ", "d"], **changes})
    figure = cohort.before_after(changes, unit="cm", name="|error of length|", title="tuned")
    (axis,) = figure.axes
    assert [text.get_text() for text in axis.get_yticklabels()] == ["b", "c", "a", "d"]
    before, after = (one.get_offsets()[:, 0] for one in axis.collections)
    np.testing.assert_allclose(before, [4.0, 2.5, 1.0, 0.5])
    np.testing.assert_allclose(after, [5.0, 1.0, 0.5, 0.5])
    joined = axis.lines[:4]
    np.testing.assert_allclose([line.get_xdata() for line in joined], np.stack([before, after], axis=1))
    assert [line.is_dashed() for line in joined] == [True, False, False, False]
    medians = {line.get_label(): line.get_xdata()[0] for line in axis.lines[4:]}
    assert medians == {"median before": 1.75, "median after": 0.75}
    change = evaluate.paired_difference(changes["error_before"], changes["error_after"], changes["subject"], seed=0)
    first, second = axis.get_title().split("\n")
    assert first == "tuned"
    assert second == f"median change −0.25 (−1.5 to +{change.high:.3g}) cm; 2 better, 1 worse"
    assert axis.get_xlabel() == "|error of length| [cm]"


@pytest.mark.parametrize(
    ("draw", "message"),
    [
        (lambda: cohort.bland_altman(table(), "width"), r"quantity must be among \['length'\]; got 'width'"),
        (lambda: cohort.per_subject(table().drop(columns="quantity"), "length"), r"\['quantity'\] missing"),
        (lambda: cohort.per_subject(table().assign(estimate=np.nan), "length"), "none of the 16 rows of 'length'"),
        (lambda: cohort.bland_altman(table((5,)), "length"), "at least two subjects; got 1"),
        (lambda: cohort.before_after(table()), r"\['error_before', 'error_after'\] missing"),
    ],
)
def test_refusals_state_what_was_wrong(draw, message):
    with pytest.raises(ValueError, match=message):
        draw()
