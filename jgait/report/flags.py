"""What notes, strides and samples mean for the numbers, in a sentence each; the gravest first."""

from collections.abc import Iterable

import numpy as np

from jgait.estimators.about import StrideFlag
from jgait.notes import Note
from jgait.report.page import GRADES, Flag, without_folders
from jgait.types import Estimate

FEW = 10
"""Below so many strides means are said to be of few."""

MOSTLY = 0.95
"""Below this share of samples at which something is known, it is said."""


def explained(notes: Iterable[Note]) -> list[Flag]:
    """Notes as flags: each once, those of one meaning together, the gravest first, without names of folders.

    Args:
        notes: of readers, estimators and commands.
    """
    lines: dict[tuple[str, str], dict[str, None]] = {}
    for note in notes:
        sentence = _sentence(without_folders(note.text))
        lines.setdefault((note.severity, note.meaning), {})[sentence] = None
    return ordered(Flag(severity, "\n".join(own), meaning) for (severity, meaning), own in lines.items())


def _sentence(text: str) -> str:
    """With a capital, unless it begins with the name of a column."""
    return text if "_" in text.partition(" ")[0] else text[:1].upper() + text[1:]


def ordered(flags: Iterable[Flag]) -> list[Flag]:
    """The gravest first."""
    return sorted(flags, key=lambda flag: list(GRADES).index(flag.grade))


def of_strides(rows: int, marks: dict[str, np.ndarray], regular: int, flags: Iterable[StrideFlag]) -> list[Flag]:
    """What is to be said of the strides: how many are special, and whether enough are left.

    Args:
        rows: how many strides there are.
        marks: flag → (rows,) bool.
        regular: how many of them the means are over.
        flags: what the flags mean.
    """
    found = []
    for flag in flags:
        many = int(marks[flag.name].sum()) if flag.name in marks else 0
        if many:
            found.append(Flag(flag.grade, f"{many} of {rows} strides: {flag.label}", flag.meaning))
    if 0 < regular < FEW:
        meaning = "Means and standard deviations of few strides vary from walk to walk; a longer walk makes them firm."
        found.append(Flag("check", f"Only {regular} regular strides", meaning))
    return found


def of_samples(estimate: Estimate) -> list[Flag]:
    """Whether much of the recording gave no result."""
    share = float(np.mean(np.asarray(estimate.valid, bool))) if np.size(estimate.valid) else 0.0
    if share >= MOSTLY:
        return []
    meaning = "In the rest nothing is known, and figures have gaps: before the first rest, or where data are lost."
    return [Flag("check" if share > 0.5 else "stop", f"Results for {100.0 * share:.0f} % of the recording", meaning)]


def verdict(flags: Iterable[Flag]) -> str:
    """All flags in a sentence."""
    grades = [flag.grade for flag in flags]
    stop, check = grades.count("stop"), grades.count("check")
    if stop:
        return "At least one of the numbers must not be relied on; what is wrong stands first."
    if check:
        thing = "One thing needs" if check == 1 else f"{check} things need"
        return f"{thing} a look before the numbers are relied on."
    if grades:
        return "Nothing stands against the numbers; what was noticed and put right is listed."
    return "Nothing was noticed that stands against the numbers."
