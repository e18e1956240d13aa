"""The warnings of `jgait evaluate` and `jgait tune`: what the notes of a cohort's recordings say, gravest first."""

from collections import Counter
from collections.abc import Iterable

from jgait.commands.console import count, note
from jgait.notes import DEFAULT_MEASURE, FEW_RESTS, LOSSES, SEVERITIES, Note, from_json, grouped, listed, of_recordings

ADVICE = {"stop": "do not use the result", "check": "check"}
"""Severity that is printed → what to do."""

USUAL = (LOSSES, FEW_RESTS, DEFAULT_MEASURE)
"""Meanings of notes that most cohorts have without any fault; of one severity they come last."""

MOST_KINDS = 5
"""Largest number of kinds that are printed."""

LONGEST_EXAMPLE = 200
"""[characters] Longest text that is printed of a kind, of one or two sentences."""


def say_warnings(recordings: Iterable[tuple[str, str]], where: str) -> None:
    """Print how many recordings (name, notes in JSON) have notes of the severities in `ADVICE`, their kinds, and
    `where` all sentences are; nothing if there are none.
    """
    kinds: Counter[tuple[str, str]] = Counter()
    example: dict[tuple[str, str], tuple[str, list[Note]]] = {}
    doubted = unusable = whole = 0
    for name, text in recordings:
        grave: dict[tuple[str, str], tuple[str, list[Note]]] = {}
        for warning in grouped(from_json(text)):
            if warning.severity in ADVICE:
                grave.setdefault((warning.severity, warning.code), (name, []))[1].append(warning)
        kinds.update(grave.keys())
        example = grave | example
        whole += 1
        doubted += bool(grave)
        unusable += any(severity == "stop" for severity, _ in grave)
    if not kinds:
        return

    def rank(kind: tuple[str, str]) -> tuple[int, bool, bool, int]:
        warning = example[kind][1][0]
        of_reference = warning.code.startswith("reference_")  # all errors against it are wrong
        return SEVERITIES.index(warning.severity), not of_reference, warning.meaning in USUAL, -kinds[kind]

    more = f"; the results of {unusable} should not be used" if unusable else ""
    note(f"\n{of_recordings(doubted, whole, 'has', 'have')} warnings{more}:")
    ordered = sorted(kinds, key=rank)
    for kind in ordered[:MOST_KINDS]:
        name, same = example[kind]
        sentences = listed((" ".join(warning.text.split()) for warning in same), LONGEST_EXAMPLE)
        note(f"  {ADVICE[kind[0]]}, {count(kinds[kind], 'recording', 'recordings')}, such as {name}: {sentences}")
    left = len(ordered) - MOST_KINDS
    rest = f"{count(left, 'more kind', 'more kinds')}, and all sentences" if left > 0 else "all sentences"
    note(f"{rest}: {where}")
