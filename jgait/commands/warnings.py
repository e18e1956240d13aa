"""The warnings of `jgait evaluate` and `jgait tune`: what the notes of a cohort's recordings say, gravest first."""

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
    kinds: dict[tuple[str, str], dict[str, list[Note]]] = {}  # severity and code → recording → notes
    every = list(recordings)
    for name, text in every:
        for warning in grouped(from_json(text)):
            if warning.severity in ADVICE:
                kinds.setdefault((warning.severity, warning.code), {}).setdefault(name, []).append(warning)
    if not kinds:
        return

    def rank(kind: tuple[str, str]) -> tuple[int, bool, bool, int]:
        meaning = next(iter(kinds[kind].values()))[0].meaning
        of_reference = kind[1].startswith("reference_")  # all errors against it are wrong
        return SEVERITIES.index(kind[0]), not of_reference, meaning in USUAL, -len(kinds[kind])

    doubted = {name for of_kind in kinds.values() for name in of_kind}
    unusable = {name for (severity, _), of_kind in kinds.items() for name in of_kind if severity == "stop"}
    more = f"; the results of {len(unusable)} should not be used" if unusable else ""
    note(f"\n{of_recordings(len(doubted), len(every), 'has', 'have')} warnings{more}:")
    ordered = sorted(kinds, key=rank)
    for kind in ordered[:MOST_KINDS]:
        name, same = next(iter(kinds[kind].items()))
        sentences = listed((" ".join(warning.text.split()) for warning in same), LONGEST_EXAMPLE)
        many = count(len(kinds[kind]), "recording", "recordings")
        note(f"  {ADVICE[kind[0]]}, {many}, such as {name}: {sentences}")
    left = len(ordered) - MOST_KINDS
    rest = f"{count(left, 'more kind', 'more kinds')}, and all sentences" if left > 0 else "all sentences"
    note(f"{rest}: {where}")
