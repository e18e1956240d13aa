"""Facts that readers, estimators and commands notice about a recording, as records that programs can read.

A kind of fact is declared once, in the module that detects it: `LOST = Kind("samples_lost", "check", "{placement}:
{lost} samples are lost", "…")`. Calling the kind with the values of one recording gives the note:
`LOST(placement="waist", lost=3)`. Programs read `code`, `severity` and `values`; people read `text` and `meaning`.
"""

import difflib
import html
import json
import math
import textwrap
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple, cast

Severity = Literal["stop", "check", "corrected", "info"]

SEVERITIES: tuple[Severity, ...] = ("stop", "check", "corrected", "info")
"""Gravest first: do not use the result, doubt the result, an error was corrected, a fact about the data's origin."""

LONGEST = 600
"""[characters] Longest sentence of a note; of a longer one the middle is left out."""

type Value = str | int | float | bool | tuple[str, ...] | Range


def printable(text: str, most: int | None = None) -> str:
    """A text with control characters as their codes, and at most `most` characters: middle words are left out."""
    if most is not None and len(text) > most:
        begin, end = text[: 2 * most // 3], text[-(most // 3 - 3) :]
        text = f"{begin.rpartition(' ')[0] or begin} … {end.partition(' ')[2] or end}"
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c == "\n" else c.encode("unicode_escape").decode() for c in text)


def resolved(value: float, spread: float, digits: int = 3) -> str:
    """A number with `digits` significant digits, or as many more as show two of its spread; "–" without a number."""
    if not math.isfinite(value):
        return "–"
    known = value != 0.0 and math.isfinite(spread) and spread > 0.0
    needed = math.floor(math.log10(abs(value))) - math.floor(math.log10(spread)) + 2 if known else 0
    text = f"{value:.{digits}g}" if needed <= digits else f"{value:#.{min(needed, 9)}g}".rstrip(".")
    return text.replace("-", "−")


def brief(value: object, most: int = 90) -> str:
    """A value in at most so many characters: arrays and tables by type and shape, records and mappings by contents."""
    shape = getattr(value, "shape", None)
    if isinstance(shape, tuple):
        large = shape and not (len(shape) == 1 and shape[0] <= 4 and hasattr(value, "tolist"))
        text = f"{getattr(value, 'dtype', type(value).__name__)}{list(shape)}" if large else str(value)
    elif isinstance(value, Mapping):
        entries = [f"{name}: {brief(each, 30)}" for name, each in list(value.items())[:most]]
        text = f"{{{', '.join(entries if sum(map(len, entries)) < most else map(str, value))}}}"
    elif isinstance(value, tuple) and hasattr(value, "_fields"):
        # a `repr` that no class wrote for itself: of NamedTuple, or of `record`
        generated = type(value).__repr__.__module__ in ("collections", __name__)
        parts = _fields(cast(NamedTuple, value), 0) if generated else []
        text = f"{type(value).__name__}({', '.join(parts)})" if parts else repr(value)
    elif isinstance(value, Collection) and not isinstance(value, str | bytes):
        text = f"{len(value)} [{', '.join(brief(each, 30) for each in list(value)[:4])}{', …' * (len(value) > 4)}]"
    else:
        text = getattr(value, "__qualname__", None) or repr(value)
    return printable(" ".join(text.split()), most)


def _fields(values: NamedTuple, most: int) -> list[str]:
    """The fields of a record that are not None, each with its value; with 0 characters, of plain numbers alone."""
    return [
        f"{name}={brief(each, most or 20)}" if most or isinstance(each, int | float | str) else name
        for name, each in values._asdict().items() if each is not None
    ]  # fmt: skip


def record[T: type](cls: T) -> T:
    """Class decorator: the `repr` of a NamedTuple is at most ten lines, and notebooks show a table of its fields."""

    def __repr__(self: Any) -> str:  # noqa: N807
        text = f"{cls.__name__}({', '.join(_fields(self, 90))})"
        return textwrap.fill(text, 110, subsequent_indent="  ", max_lines=10, placeholder=" …)")

    def _repr_html_(self: Any) -> str:
        rows = "".join(
            f"<tr><th>{name}</th><td>{html.escape(brief(each, 200))}</td></tr>" for name, each in self._asdict().items()
        )
        return f"<table><caption>{cls.__name__}</caption>{rows}</table>"

    for part in (__repr__, _repr_html_):
        setattr(cls, part.__name__, part)
    return cls


class Kind(NamedTuple):
    """A kind of fact; calling it with the values of one recording gives a `Note`."""

    code: str  #: name of the fact for programs, in snake_case; no two kinds share a code.
    severity: Severity  #: one of `SEVERITIES`.
    #: the sentence, with the values in braces as in `str.format`; after a colon, two words are the singular and the
    #: plural for a number: "{gaps} {gaps:gap is|gaps are} filled".
    text: str  #: empty if each note has a sentence of its own, see `note`.
    meaning: str  #: what the fact means for the results, in one or two sentences.
    of_all: bool = False  #: True if the fact is about all sensors of a recording.
    #: True of a number that is not shown where another note has the same meaning for the same sensor, or for all.
    counts: bool = False
    measure: str = ""  #: what alone a "stop" makes unusable, such as "joint angles"; empty: all results.

    def __call__(self, **values: object) -> "Note":
        """The fact about one recording, with a value for every name in braces; sequences become tuples of text."""
        return Note(self, {name: _plain(value) for name, value in values.items()})

    def note(self, sentence: str, /, **values: object) -> "Note":
        """The fact about one recording, of a kind whose notes have sentences of their own.

        The sentence is as `text`; without values it is taken as it is, with `placement` alone behind the placement.
        """
        if not values.keys() - {"placement"}:
            sentence = "{placement}: " * len(values) + sentence.replace("{", "{{").replace("}", "}}")
        return self._replace(text=sentence)(**values)


@dataclass(frozen=True)
class Note:
    """One fact about one recording or result; not a pytree (a NamedTuple would be one), so JAX treats it as one leaf.

    `code`, `severity` and `meaning` are those of its kind.
    """

    kind: Kind
    values: Mapping[str, Value]  #: name → value, such as a placement or a number of samples.

    code = property(lambda self: self.kind.code)
    severity = property(lambda self: self.kind.severity)
    meaning = property(lambda self: self.kind.meaning)

    @property
    def text(self) -> str:
        """The fact as a sentence without its full stop."""
        return printable(self.kind.text.format(**{name: _shown(each) for name, each in self.values.items()}), LONGEST)

    def __str__(self) -> str:
        return self.text

    def __repr__(self) -> str:
        return f"Note({self.code}, {self.severity}: {self.text})"

    def __hash__(self) -> int:
        return hash((self.code, self.text))

    def to_dict(self) -> dict[str, object]:
        """The note for JSON: `code severity values text meaning measure`."""
        values = {name: list(each) if isinstance(each, tuple) else each for name, each in self.values.items()}
        return {
            "code": self.code, "severity": self.severity, "values": values, "text": self.text, "meaning": self.meaning,
            "measure": self.kind.measure,
        }  # fmt: skip

    @classmethod
    def from_dict(cls, content: Mapping[str, object]) -> "Note":
        """The note that `to_dict` wrote, with the stored sentence; KeyError if a part of it is missing."""
        text = str(content["text"]).replace("{", "{{").replace("}", "}}")
        kind = Kind(
            str(content["code"]), cast(Severity, content["severity"]), text, str(content["meaning"]),
            measure=str(content.get("measure", "")),
        )  # fmt: skip
        return kind(**cast(Mapping[str, object], content["values"]))


def grouped(notes: Iterable[Note]) -> list[Note]:
    """Notes for people: those that state the same of one sensor each become one, with the names of all sensors.

    Numbers that differ become ranges, unless one sensor has several of the notes. Only sentences that begin with the
    sensor and a colon are joined: in others the sensor is the subject.
    """
    groups: dict[object, list[Note]] = {}
    for note in notes:
        words = {name: value for name, value in note.values.items() if name != "placement" and not _number(value)}
        of_sensor = note.kind.text.startswith("{placement}: ")
        groups.setdefault((note.kind, str(words)) if of_sensor else note, []).append(note)
    return [line for same in groups.values() for line in _joined(same)]


def without_repeats(notes: Iterable[Note]) -> tuple[Note, ...]:
    """Notes for people: each once, and without numbers of one sensor that other notes explain, see `Kind.counts`."""
    once = dict.fromkeys(notes)
    explained = {(note.meaning, note.values.get("placement")) for note in once if not note.kind.counts}
    everywhere = {note.meaning for note in once if note.kind.of_all}
    return tuple(
        note for note in once if not note.kind.counts
        or not (note.meaning in everywhere or (note.meaning, note.values["placement"]) in explained)
    )  # fmt: skip


def as_doubts(notes: Iterable[Note], kind: Kind, of: str = "") -> list[Note]:
    """The notes; those of a kind are doubts where something else is known instead, and name what they are `of`."""
    milder = kind._replace(severity="check", text=f"{of}: {kind.text}" if of else kind.text)
    return [replace(note, kind=milder) if note.kind == kind else note for note in notes]


def gravest_first(notes: Iterable[Note]) -> tuple[Note, ...]:
    """Notes in the order of `SEVERITIES`."""
    return tuple(sorted(notes, key=lambda note: SEVERITIES.index(note.severity)))


def by_reason(failures: Iterable[tuple[str, str]]) -> dict[str, str]:
    """Reason → the recordings with this reason, such as "walk.csv and 4 others"; from pairs (recording, reason)."""
    names: dict[str, list[str]] = {}
    for name, reason in failures:
        names.setdefault(reason, []).append(name)
    ends = {1: "", 2: " and 1 other"}
    return {reason: of[0] + ends.get(len(of), f" and {len(of) - 1} others") for reason, of in names.items()}


def of_recordings(many: int, whole: int, singular: str = "", plural: str = "") -> str:
    """How many of all recordings, and a verb: "1 of 3 recordings has", "1 of 1 recording has"."""
    recordings = "recording" if whole == 1 else "recordings"
    return f"{many} of {whole} {recordings} {singular if many == 1 else plural}".strip()


def listed(texts: Iterable[str]) -> str:
    """The first two of several texts, and how many more there are."""
    first, rest = (every := list(texts))[:2], len(every) - 2
    return "; ".join([*first, f"and {rest} more"] if rest > 0 else first)


def meant(name: str, known: Iterable[str], cutoff: float = 0.5) -> str:
    """The end of a message about an unknown name: the known one that is nearest, if one is near."""
    near = difflib.get_close_matches(name, known, 1, cutoff)
    return f"; did you mean {near[0]!r}?" if near else ""


def _joined(same: list[Note]) -> list[Note]:
    """Notes of one kind on several sensors as one, with ranges of numbers; else equal ones."""
    names = tuple(dict.fromkeys(str(note.values.get("placement")) for note in same))
    if len(names) == 1:
        return list(dict.fromkeys(same))
    if len(names) < len(same):
        equal: dict[str, list[Note]] = {}
        for note in dict.fromkeys(same):
            equal.setdefault(str({**note.values, "placement": ""}), []).append(note)
        return [line for group in equal.values() for line in _joined(group)]
    values: dict[str, Value] = {**same[0].values, "placement": names}
    for name in filter(lambda name: _number(values[name]), same[0].values):
        every = [cast(float, note.values[name]) for note in same]
        values[name] = every[0] if min(every) == max(every) else Range(min(every), max(every))
    return [Note(same[0].kind, values)]


def _number(value: Value) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def to_json(notes: Iterable[Note]) -> str:
    """Notes as one JSON text, for a cell of a table."""
    return json.dumps([note.to_dict() for note in notes], ensure_ascii=False)


def from_json(text: str) -> tuple[Note, ...]:
    """The notes that `to_json` wrote. Raises ValueError if the text is not JSON of notes."""
    try:
        return tuple(map(Note.from_dict, json.loads(text)))
    except (TypeError, KeyError, AttributeError) as error:
        raise ValueError(f"these are no notes in JSON: {text[:60]!r}") from error


class Range(NamedTuple):
    """The numbers of several notes, in the sentence of all of them."""

    low: float
    high: float

    def __format__(self, spec: str) -> str:
        if "|" in spec:
            return format(_Count(int(self.high)), spec)
        low, high = format(self.low, spec), format(self.high, spec)
        return low if low == high else f"{low} to {high}"


class _Count(int):
    """A whole number that chooses between two words, see `Kind.text`."""

    def __format__(self, spec: str) -> str:
        singular, bar, plural = spec.partition("|")
        return (singular if self == 1 else plural) if bar else super().__format__(spec)


def _shown(value: Value) -> object:
    """A value as sentences have it."""
    if isinstance(value, tuple) and not isinstance(value, Range):
        return ", ".join(value)
    return _Count(value) if type(value) is int else value


def _plain(value: object) -> Value:
    """A value of a type that JSON can store; a sequence becomes a tuple of text."""
    if hasattr(value, "item"):
        return cast(Value, value.item())
    if isinstance(value, list | tuple | set | dict):
        return tuple(map(str, value))
    return value if isinstance(value, str | int | float) else str(value)


# Meanings that several kinds share.

LOSSES = (
    "Part of the data did not arrive, or cannot have been measured. Short losses are bridged, with a larger standard "
    "deviation; strides across long ones are missing or less certain. The distance of one estimator, and its "
    "deviation, do not contain what is walked in long ones; those of all sensors together do."
)

CLIPPING = (
    "The movement was faster or harder than the sensor can measure, and its peaks are cut off. What is missing is "
    "estimated from their flanks, and lengths have larger deviations for it. Lengths and angles are rather too small; "
    "a sensor with a larger range avoids this."
)

WRONG_PLACE = (
    "Sensors seem not to be where their labels say. Check how they were worn: with wrong labels, sides or segments are "
    "mixed up."
)

NO_RANGE = (
    "Without distances measured between the feet, stride widths have the mean of usual people, with the spread between "
    "people as their deviation; only their changes from stride to stride are measured."
)

FEW_RESTS = (
    "Standing still shows the sensors' zero and what upright is. With little or none of it, angles and directions are "
    "less certain; next time, stand for two seconds before walking off."
)

NO_GRAVITY = "Without an accelerometer, angles drift by degrees a minute; short walks suffer least."

NO_WALKING = "Where there is no walking there are no strides; numbers that depend on strides are missing."

UNSURE_FORWARD = (
    "The direction of walking could not be computed clearly from the movement. Signs of turns and of left and right "
    "may be wrong; a longer straight walk settles it."
)

DEFAULT_MEASURE = (
    "A measure of the person was not given, and a usual one is used: lengths and distances are off as much as the "
    "person differs from it. Measure it and compute the result again."
)

SCALE = (
    "The accelerometer's scale is a little off, as it often is; the moments of rest show by how much, and the error "
    "was corrected."
)

DATA_LOST = Kind("data_lost", "check", "", LOSSES)
"""Rows, samples or values that a file lacks, or that a reader left out."""

DEDUCED = Kind("deduced", "info", "", "The file does not state this. Check it against the device.")
"""What a reader computed from the numbers of a file, or assumed."""

BY_NAME = Kind("by_name", "info", "", "This follows from names in the file. Check that they mean what is written here.")
"""What a reader recognised by a name."""

AS_READ = Kind("as_read", "info", "", "This says how the data were read; nothing needs to be done.")
"""The source of the data, and how they were read."""

LEFT_OUT = Kind("left_out", "info", "", "Nothing is computed from these parts of the data.")
"""Parts that were left out of a recording or its reference."""
