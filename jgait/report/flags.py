"""What a recording's and an estimator's notes mean for the numbers, in a sentence each; the gravest first."""

import re
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from jgait.estimators.about import StrideFlag
from jgait.report.page import GRADES, Flag, without_folders
from jgait.types import Estimate


class Meaning(NamedTuple):
    """Notes that match `pattern` have one grade and one meaning."""

    pattern: str
    grade: str
    meaning: str


MEANINGS = (
    Meaning(
        r"nobody walks|does not walk|found no walking", "stop",
        "Where there is no walking there are no strides; numbers that depend on them are missing.",
    ),
    Meaning(
        r"should not be used", "stop",
        "The estimator itself says that its uncertainty is too large for the number to be of use.",
    ),
    Meaning(
        r"exchanged|swapped|changed places|upside down|on the other leg", "check",
        "Sensors seem not to be where their labels say. Check how they were worn: with wrong labels, sides or "
        "segments are mixed up.",
    ),
    Meaning(
        r"widths cannot be told|no widths|no range is left|feet_range holds no reading|heard nothing", "check",
        "Without distances measured between the feet, the two feet share no common place: stride widths and step "
        "lengths are missing or worthless.",
    ),
    Meaning(
        r"strides of .* are left out", "check",
        "So much of these strides was lost that they are missing here; totals and the distance are too small by them.",
    ),
    Meaning(
        r"the other way than gravity", "check",
        "The sensor's axes or signs are not as the file says. Lengths hold, but left and right may be mixed up.",
    ),
    Meaning(
        r"clip", "check",
        "The movement was faster or harder than the sensor can measure, and its peaks are cut off. Lengths and angles "
        "around them are too small; a sensor with a larger range avoids this.",
    ),
    Meaning(
        r" is constant at ", "check",
        "One axis of a sensor gives the same value all the time: it is broken, or was not recorded.",
    ),
    Meaning(
        r"which way is forward", "check",
        "The direction of walking could not be told clearly from the movement. Signs of turns and of left and right "
        "may be wrong; a longer straight walk settles it.",
    ),
    Meaning(
        r"no accelerometer", "check",
        "Without gravity to hold on to, angles drift by degrees a minute; short walks suffer least.",
    ),
    Meaning(
        r"never (rests|stands still)|nobody stands still|not start standing still|quietest standing still", "check",
        "Standing still shows the sensors' zero and what upright is. With little or none of it, angles and directions "
        "are less certain; next time, stand for two seconds before walking off.",
    ),
    Meaning(
        r"does not begin from standing", "check",
        "The speed at its beginning is not known. Contacts are told all the same.",
    ),
    Meaning(
        r"default (length|height|of)|is taken to (be|sit)", "check",
        "A measure of the person was not given, and a usual one stands in for it: lengths and distances are off as "
        "much as the person differs from it. Measure it and make the page again.",
    ),
    Meaning(
        r"% of gravity at rest; corrected", "corrected",
        "The accelerometer's scale is a little off, as it often is; the still moments show by how much, and it was "
        "taken out.",
    ),
    Meaning(
        r"range's clock", "corrected",
        "The range sensor ran behind the inertial sensors; its times were shifted.",
    ),
    Meaning(
        r"left out \d+ ranges", "corrected",
        "Distances between the feet that cannot be right, or come at the wrong moment, were not used.",
    ),
    Meaning(
        r"\blags\b", "corrected",
        "Two measuring systems began at different moments; they were put on one clock.",
    ),
    Meaning(
        r"\b(missing|lost|masked|inserted|bridged|dropped|gaps? in time)\b", "check",
        "Part of the data did not arrive. Short losses are bridged, with a larger standard deviation; strides across "
        "long ones are missing or less certain.",
    ),
    Meaning(
        r"corrected|put right|taken the other way round|taken off", "corrected",
        "Found in the data and put right; nothing needs to be done.",
    ),
    Meaning(
        r"time taken to be in|sampling rate .* from the time stamps|taken to be in", "info",
        "The file does not state this; it was worked out from its numbers. Check that it is what the device does.",
    ),
)  # fmt: skip
"""What notes mean; the first that matches counts."""

GOES_ON = (
    "corrected", "taken ", "turned round", "bridged", "interpolated", "the filter goes on", "strides across",
    "strides are told", r"\d+ samples inserted",
)  # fmt: skip
"""How the second half of a note begins that has a semicolon inside."""

FEW = 10
"""Below so many strides means are said to be of few."""

MOSTLY = 0.95
"""Below this share of samples at which something is known, it is said."""


def explained(notes: Iterable[str]) -> list[Flag]:
    """Notes as flags: each once, those of one meaning together, the gravest first, without names of folders.

    Args:
        notes: in words, as readers and estimators give them.
    """
    found: dict[tuple[str, str], list[str]] = {}
    for note in dict.fromkeys(without_folders(str(note)) for note in notes):
        known = next((one for one in MEANINGS if re.search(one.pattern, note)), None)
        grade, meaning = ("info", "Noticed while the recording was read or computed.") if known is None else known[1:]
        found.setdefault((grade, meaning), []).append(_sentence(note))
    return ordered(Flag(grade, "\n".join(lines), meaning) for (grade, meaning), lines in found.items())


def apart(text: str) -> list[str]:
    """Notes that a table keeps as one text, joined by "; ", each for itself; some have one inside.

    Args:
        text: as in the column `notes` of a cohort's recordings.
    """
    return [note for note in re.split(f"; (?!{'|'.join(GOES_ON)})", text) if note]


def _sentence(note: str) -> str:
    """With a capital, unless it begins with the name of a column."""
    return note if "_" in note.partition(" ")[0] else note[:1].upper() + note[1:]


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
