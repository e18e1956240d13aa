"""Notes for tests, and the sentences of notes."""

from collections.abc import Iterable

from jgait.notes import Kind, Note, Severity


def note(text: str, severity: Severity = "info", code: str = "made_for_tests") -> Note:
    """A note with this sentence."""
    return Kind(code, severity, "{text}", "Made for tests.")(text=text)


def texts(notes: Iterable[Note]) -> list[str]:
    """The sentence of every note."""
    return [str(note) for note in notes]
