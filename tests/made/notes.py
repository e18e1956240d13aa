"""Notes for tests, their sentences, and all kinds that the library declares."""

import importlib
import pkgutil
from collections.abc import Iterable

import jgait
from jgait.notes import Kind, Note, Severity


def note(text: str, severity: Severity = "info", code: str = "made_for_tests") -> Note:
    """A note with this sentence."""
    return Kind(code, severity, "{text}", f"Made for tests, {severity}.")(text=text)


def texts(notes: Iterable[Note]) -> list[str]:
    """The sentence of every note."""
    return [str(note) for note in notes]


def codes(notes: Iterable[Note]) -> list[str]:
    """The code of every note."""
    return [note.code for note in notes]


def of_code(notes: Iterable[Note], *wanted: str) -> list[Note]:
    """The notes with these codes."""
    return [note for note in notes if note.code in wanted]


def kinds() -> dict[str, Kind]:
    """Module and name → every kind, where it is declared or imported first."""
    found: dict[str, Kind] = {}
    seen: set[int] = set()
    for module in sorted(m.name for m in pkgutil.walk_packages(jgait.__path__, "jgait.")):
        for name, value in vars(importlib.import_module(module)).items():
            if isinstance(value, Kind) and id(value) not in seen:
                seen.add(id(value))
                found[f"{module}.{name}"] = value
    return found
