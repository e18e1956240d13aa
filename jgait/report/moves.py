"""What moves a number of a recording, as a part of the page."""

from jgait import plot
from jgait.estimators.labels import words
from jgait.report.page import Cell, Section, Table, picture, significant
from jgait.tune import Explanation

SOURCES = {
    "sensor": "sensor", "tape": "measured with a tape", "proportions": "people of one height", "given": "given",
}  # fmt: skip
"""Source of a deviation → its words; others are names of priors and parameters."""


def table(explained: Explanation) -> Table:
    """The assumptions with a stated deviation, the largest effect first."""
    unit = f" [{explained.small[1]}]"
    rows = [
        [
            Cell(a.words), Cell(f"{100.0 * a.share:.1f} %", a.share), Cell(_text(explained, a.effect)),
            Cell(significant(a.deviation, 2)), Cell(a.unit), Cell(_text(explained, a.without) if a.remedy else "–"),
            Cell(a.remedy or "–"), Cell(SOURCES.get(a.source) or words(a.source)),
        ]
        for a in explained.assumptions if a.share >= 5e-4
    ]  # fmt: skip
    columns = (
        "assumption", "share", f"moves it by{unit}", "deviation", "unit", f"± with the remedy{unit}", "remedy",
        "deviation from",
    )  # fmt: skip
    caption = (
        "Each assumption is wrong by its standard deviation; shares are of the variance of the number. Decisions, such "
        "as when a foot stands, stay as they are."
    )
    factor, unit = explained.small
    if each := [f"{a.words} {significant(factor * a.tenth, 2)}" for a in explained.unstated[:5]]:
        more = len(explained.unstated) - 5
        caption += (
            f" No deviation is stated for these parameters; a tenth more of one moves the number [{unit}] by: "
            f"{', '.join(each)}{f' and {more} others that move it less' if more > 0 else ''}."
        )
    return Table(caption, columns, rows, words=2)


def _text(explained: Explanation, value: float) -> str:
    return significant(abs(explained.small[0] * value), 2)


def section(explained: Explanation) -> Section:
    """The section "What moves this number": a bar chart and a table."""
    drawn = plot.explanation(explained)
    text = f"By {explained.estimator}, mean of the regular strides or the whole recording: {explained.sentence}."
    alt = f"Bars of the assumptions that move the {explained.column.words}"
    return Section("What moves this number", text, [picture(drawn, alt, explained.sentence), table(explained)])
