"""Notes as the sentences that people read."""

from collections.abc import Iterable

from jgait.notes import Note


def texts(notes: Iterable[Note]) -> list[str]:
    """The sentence of every note."""
    return [str(note) for note in notes]
