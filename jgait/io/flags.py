"""Facts that a reader should know before using a number, with their meaning; the most serious first.

The page and the terminal have the same facts, of `of_result`.
"""

import re
from collections.abc import Iterable
from itertools import zip_longest
from typing import NamedTuple

import numpy as np

from jgait.estimators.stride_flags import FEW_REGULAR, STRIDE_FLAGS, UNEVEN_DURATION, stride_notes
from jgait.io.results import Results, Total
from jgait.notes import DEFAULT_MEASURE, FEW_RESTS, LOSSES, Note, grouped, without_repeats
from jgait.types import PLACEMENTS


class Flag(NamedTuple):
    """A fact that a reader should know before using a number: its grade of `GRADES`, text in lines, and its meaning."""

    grade: str
    text: str
    meaning: str
    measure: str = ""  #: what alone a "stop" makes unusable; empty: all results.


GRADES = {"stop": "Do not use", "check": "Check", "corrected": "Corrected", "info": "For information"}
"""Grade of a flag → its name on the page; the most serious first."""

DOUBTS = ("stop", "check")
"""Grades of flags that put numbers in doubt."""

USUAL = (LOSSES, FEW_RESTS, DEFAULT_MEASURE, FEW_REGULAR.meaning)
"""Meanings of notes that most recordings have without any fault; of one severity they come last."""

REASONS, LONGEST_REASON = 3, 90
"""Largest number of reasons of a verdict, and [characters] longest reason with several clauses; chosen by hand."""


def of_result(results: Results, notes: Iterable[Note]) -> list[Flag]:
    """All flags of one recording, the most serious first: of its notes, its samples and its strides."""
    notes = [*notes, *stride_notes(results.marks, results.regular)]
    known = [flag for flag in STRIDE_FLAGS if flag.name in results.marks and flag != UNEVEN_DURATION]  # it has a note
    many = sorted(((int(results.marks[flag.name].sum()), flag) for flag in known), key=lambda each: -each[0])
    raised = explained(without_repeats(notes))
    raised += [Flag(f.grade, f"{n} of {len(results.base)} strides: {f.label}", f.meaning) for n, f in many if n]
    valid = np.asarray(results.estimate.valid, bool)
    if (share := float(np.mean(valid)) if valid.size else 0.0) < 0.95:
        text = f"Results for {100.0 * share:.0f} % of the recording"
        meaning = (
            "The other part has no results, and figures have gaps there: before the first rest, or where data are lost."
        )
        raised.append(Flag("check" if share > 0.5 else "stop", text, meaning))
    return ordered(raised)


def marked(totals: Iterable[Total], flags: Iterable[Flag]) -> list[Total]:
    """The numbers, with "not usable" behind those that are not, or that a flag stops; counts of strides and time walked
    stay, and angles of a side that is in order where those of the other are not usable.
    """
    totals, stops = list(totals), {flag.measure for flag in flags if flag.grade == "stop"}
    if any(total.quantity == "joint angles" and not total.usable for total in totals):
        stops.discard("joint angles")

    def usable(total: Total) -> bool:
        measure = total.quantity or total.words
        stays = total.text == "–" or measure in ("strides", "walking")
        return total.usable and (stays or not stops & {"", measure})

    return [total if usable(total) else total._replace(text=f"{total.text}, not usable") for total in totals]


def explained(notes: Iterable[Note]) -> list[Flag]:
    """Notes as flags: each note once, notes of the same meaning together, the most serious first, without folders."""
    lines: dict[tuple[str, str, str], dict[str, None]] = {}
    for note in grouped(notes):
        lines.setdefault((note.severity, note.meaning, note.kind.measure), {})[sentence(note)] = None
    return ordered(Flag(grade, "\n".join(texts), *about) for (grade, *about), texts in lines.items())


def without_folders(text: str) -> str:
    """A text with file names without folders, because folders contain names of people and machines."""
    return re.sub(r"(?<![\w.:/\\])(?:~|[A-Za-z]:)?[/\\](?:[^\s'\"<>|/\\]+[/\\])+(?=[^\s/\\])", "", text)


def sentence(note: Note) -> str:
    """The text without folders and with a capital letter, unless it begins with a name of a file, column or sensor."""
    text, file = without_folders(note.text), str(note.values.get("file", ""))
    first = text.partition(" ")[0]
    named = "_" in first or first.removesuffix(":") in PLACEMENTS or (file and note.text.startswith(file))
    return text if named else text[:1].upper() + text[1:]


def ordered(flags: Iterable[Flag]) -> list[Flag]:
    """The flags, the most serious first; of one grade first those of all results, last those of most recordings."""
    return sorted(flags, key=lambda flag: (list(GRADES).index(flag.grade), flag.measure, flag.meaning in USUAL))


def verdict(flags: Iterable[Flag]) -> str:
    """One sentence on how far to trust the numbers, with up to `REASONS` reasons, the most serious first; those of
    other meanings come before a second one of the same meaning.
    """
    doubts = [flag for flag in ordered(flags) if flag.grade in DOUBTS]
    if not doubts:
        return "Good."
    each = [flag.text.splitlines() for flag in doubts if flag.grade == doubts[0].grade]
    lines = [line for same in zip_longest(*each) for line in same if line is not None]
    more = [f"{len(lines) - REASONS} more"] if len(lines) > REASONS else []
    reasons = [_within(line) for line in lines[:REASONS]]
    measures = dict.fromkeys(flag.measure for flag in doubts if flag.grade == "stop")
    of = f" the {' and the '.join(measures)}" if all(measures) else ""
    trust = f"Do not use{of}" if measures else "Usable with care"
    return f"{trust}: {'; '.join([*reasons, *more])}."


def _within(line: str) -> str:
    """A sentence as a part of another: whole, or of a long one what stands before its first semicolon or full stop; in
    small letters but for names; many sensors are counted.
    """
    named, _, fact = line.partition(": ")
    if len(sensors := named.lower().split(", ")) > REASONS and set(sensors) <= set(PLACEMENTS):
        line = f"{len(sensors)} sensors: {fact}"
    if len(line) > LONGEST_REASON:
        line = re.split(r"[;.] ", line)[0]
    word = line.partition(" ")[0]
    return line[:1].lower() + line[1:] if "_" not in word and (word[1:].islower() or word == "A") else line
