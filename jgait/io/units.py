"""Units of rates and forces: how files spell them, which one a column's name states, and what states it."""

import re
import unicodedata
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from jgait.geometry.vectors import GRAVITY
from jgait.types import RecordingError

GYR_UNITS = {"deg/s": np.pi / 180.0, "rad/s": 1.0, "mdeg/s": np.pi / 180e3, "mrad/s": 1e-3}
"""Unit of an angular rate → rad/s."""

ACC_UNITS = {"m/s^2": 1.0, "g": GRAVITY, "mg": 1e-3 * GRAVITY}
"""Unit of a specific force → m/s²."""

SPELT = {
    "deg/s": ("°/s", "o/s", "°s-1", "d/s", "dps", "degps", "degs", "degs-1", "grad/s"),
    "rad/s": ("rads", "rads-1", "radps"),
    "mdeg/s": ("mdps", "m°/s"),
    "mrad/s": ("mrads", "mrads-1", "mradps"),
    "m/s^2": ("m/s2", "m/s/s", "ms2", "ms-2", "mps2"),
}
"""Unit → other ways to write it, as `_plain` leaves them."""

LIKE_A_UNIT = r"\S+/s\d?|lsb|rpm"  # what is a unit, known or not, in brackets, as `_plain` leaves it
IN_BRACKETS = r"[(\[{]((?:[^()\[\]{}]|\([^()]*\))*)[)\]}]"  # brackets with one pair of parentheses: "[m/(s^2)]"
BEHIND_AXIS = r"(?<=[xyzXYZ])[\s_.-]+([^\s_.xyzXYZ-].*?)\s*$"  # a unit behind the axis: "gyr_x_dps", "acc_x_m_s2"

STATES = {
    "argument": "given as {}",
    "header": "{} by the header",
    "names": "{} by the names of the columns",
    "file": "{} by the file",
    "signals": "{} by its size",
}
"""What states a unit → the words for it in messages."""


class Unit(NamedTuple):
    """A unit of one signal of one sensor."""

    name: str  #: a key of `GYR_UNITS` or `ACC_UNITS`.
    origin: str = "argument"  #: what states it, a key of `STATES`.

    def __str__(self) -> str:
        return STATES[self.origin].format(self.name)


type Units = Mapping[str, Mapping[str, Unit]]
"""Placement → "gyr", and perhaps "acc" → unit."""


def _plain(unit: str) -> str:
    """A unit in lower case, without blanks, brackets, dots and signs of multiplication or powers, words cut short."""
    plain = re.sub(r"[\s·.*^()\[\]]", "", unicodedata.normalize("NFKC", unit).replace("−", "-")).lower()
    for word, short in (("degrees?", "deg"), ("radians?", "rad"), ("sec(onds?)?", "s")):
        plain = re.sub(word, short, plain)
    return plain


NAMES = {_plain(spelt): unit for unit in (*GYR_UNITS, *ACC_UNITS) for spelt in (unit, *SPELT.get(unit, ()))}
"""Plain spelling → name of a unit in jgait."""


def known_unit(unit: str) -> str | None:
    """The name in jgait of a unit of a rate or a force, such as "°/s" or "m·s⁻²"; None for others."""
    return NAMES.get(_plain(unit))


def unit_scale(unit: str, units: Mapping[str, float], argument: str) -> float:
    """Factor from a unit to SI. Raises ValueError if the unit is unknown; the message lists the known units."""
    known = known_unit(unit) or unit
    if known not in units:
        raise RecordingError(
            f"{{argument}} must be one of {', '.join(map(repr, units))}; got {unit!r}", argument=argument
        )
    return units[known]


def unit_of_columns(columns: Sequence[str], kind: str, name: str) -> str | None:
    """The unit that the names of the three columns of a "gyr" or an "acc" state; None if they state none. Raises
    RecordingError if they state different units, one that is not known, or one of another signal.
    """
    stated = [stated_unit(column) for column in columns]
    if len({unit and (known_unit(unit) or unit) for unit in stated}) > 1:
        each = ", ".join(f"{column!r} {unit or 'none'}" for column, unit in zip(columns, stated, strict=True))
        raise RecordingError(
            f"{name}: the three axes of a sensor must state one unit; {each}; convert columns, or correct the header"
        )
    if stated[0] is None:
        return None
    units = GYR_UNITS if kind == "gyr" else ACC_UNITS
    known = known_unit(stated[0])
    if known not in units:
        raise RecordingError(f"{name}: {columns[0]!r} is in {stated[0]!r}; expected one of {', '.join(units)}")
    return known


def stated_unit(column: str) -> str | None:
    """The last text in the brackets of a column's name that is like a unit, or else the known unit at its end."""
    texts = [text.strip() for text in re.findall(IN_BRACKETS, column)]
    units = [text for text in texts if known_unit(text) or re.fullmatch(LIKE_A_UNIT, _plain(text))]
    return units[-1] if units else split_unit(column)[1]


def split_unit(column: str) -> tuple[str, str | None]:
    """A column's name without the known unit at its end, and this unit; None if there is none, as in "gyr_x"."""
    ends = re.search(BEHIND_AXIS, column)
    # in names of columns, "_" and "per" stand for the stroke
    unit = ends and (known_unit(ends[1]) or known_unit(re.sub(r"_*per_*|_", "/", ends[1])))
    return (column[: ends.start()], unit) if ends and unit else (column, None)
