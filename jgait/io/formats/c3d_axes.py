"""A motion capture; from its markers, where the file does not state it: unit, and axis that points up."""

import re
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from jgait.io.files import Tree
from jgait.notes import Note, record


class CaptureEvent(NamedTuple):
    """One event of a capture.

    Attributes:
        time: [s] on the clock of `Capture.time`.
        kind: 'initial_contact', 'final_contact', or the file's label where that is neither.
        side: 'right', 'left', or None for neither.
    """

    time: float
    kind: str
    side: str | None


@record
class Capture(NamedTuple):
    """Data of a motion capture.

    Attributes:
        time: (T,) [s] of the markers, 0 at the first captured frame.
        rate_hz: [Hz] of the markers.
        markers: name → (T, 3) [m], NaN where not visible; z points up where `up` is known.
        up: the file's axis that points up: '+x', …, '-z'; None: not known, the axes are the file's.
        outputs: name → (T, 3) outputs of a model, in the file's units.
        analog_time: (A,) [s] on the same clock.
        analog_rate_hz: [Hz], 0 where there is no analog signal.
        analog: name → (A,) in the unit of `analog_units`.
        analog_units: name → unit as written in the file; empty if the file has none.
        events: in order of time.
        force_plates: parameters of the group FORCE_PLATFORM, as they are, in the file's units and axes.
        name: of the recording.
        subject: name of the person.
        notes: notes about deduced units, changes and doubtful data.
    """

    time: np.ndarray
    rate_hz: float
    markers: dict[str, np.ndarray]
    up: str | None
    outputs: dict[str, np.ndarray]
    analog_time: np.ndarray
    analog_rate_hz: float
    analog: dict[str, np.ndarray]
    analog_units: dict[str, str]
    events: tuple[CaptureEvent, ...]
    force_plates: Tree
    name: str
    subject: str
    notes: tuple[Note, ...]


UPRIGHT = {
    "+z": np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
    "+y": np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
    "+x": np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
    "-z": np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]),
    "-y": np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]),
    "-x": np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]]),
}
"""The axis of a file that points up → the rotation from the file's axes to those with z up."""

APART = {"m": (0.3, 2.5), "mm": (300.0, 2500.0)}
"""Unit → range of the largest distance between the markers of a person, in this unit; in cm it would be 30 to 250."""
HIGH = re.compile(
    r"^[LR]?_?(ASIS?|PSIS?|HJC|FEP|SACR|CLAV|C7|T10|STRN|HEAD|[LR]?[FB]HD|I[AP]S|[CT]V\d+|S[XJ]S|SJN|SAE)$",
    re.IGNORECASE,
)
LOW = re.compile(r"^[LR]?_?(HEEL?|TOE|ANK|AJC|TIO|MT[15]|CAL|FCC|FM[125]|FAL|TAM)$", re.IGNORECASE)
SURE = 0.8
"""[1] Smallest share of the distance from feet to trunk along the vertical axis."""
FLOOR = 0.15
"""[m] Largest height above or below 0 of the lowest markers on a floor."""


def told_unit(markers: Mapping[str, np.ndarray]) -> tuple[str | None, float]:
    """The unit in which the distances between markers (T, 3), NaN where not visible, fit a person.

    Returns:
        'm', 'mm' or None where neither fits, and the distance that decides: the median over time of the longest side
        of the box around all markers.
    """
    places = np.stack(list(markers.values()))
    visible = np.isfinite(places).all(axis=(0, 2))
    if not visible.any():
        return None, float("nan")
    box = np.ptp(places[:, visible], axis=0).max(axis=1)
    apart = float(np.median(box))
    return next((unit for unit, (least, most) in APART.items() if least <= apart <= most), None), apart


OPPOSITE = {axis: ("-" if axis[0] == "+" else "+") + axis[1] for axis in UPRIGHT}
"""Axis → the other way along it."""


def told_up(markers: Mapping[str, np.ndarray], stated: str = "") -> tuple[str | None, str, bool]:
    """The axis that points up, by markers (T, 3) [m] and by the axis that the file states, '+x', …, '-z', or nothing.

    Returns:
        The axis, or None where neither shows it; why; and whether the markers overrule the file: nobody walks on the
        head, or below the floor.
    """
    trunk, feet = ([_middle(place) for label, place in markers.items() if words.match(label)] for words in (HIGH, LOW))
    trunk, feet = ([place for place in each if np.isfinite(place).all()] for each in (trunk, feet))
    if trunk and feet:
        way = np.mean(trunk, axis=0) - np.mean(feet, axis=0)
        axis = int(np.argmax(np.abs(way)))
        if abs(way[axis]) >= SURE * np.linalg.norm(way):
            return (
                f"{'-' if way[axis] < 0 else '+'}{'xyz'[axis]}",
                "the trunk's markers are above the feet's there",
                True,
            )
        return None, "", False
    places = [place[np.isfinite(place).all(axis=1)] for place in markers.values()]
    every = np.concatenate(places) if places else np.zeros((0, 3))
    if not len(every):
        return None, "", False
    low, high = np.percentile(every, [1.0, 99.0], axis=0)
    fits = []
    for axis in range(3):
        for sign, least, most in (("+", low[axis], high[axis]), ("-", -high[axis], -low[axis])):
            if abs(least) < FLOOR and 2.0 * FLOOR < most < APART["m"][1]:
                fits.append(f"{sign}{'xyz'[axis]}")
    if stated not in fits and OPPOSITE.get(stated) in fits:
        return OPPOSITE[stated], "all markers are above a floor at 0 there", True
    return (fits[0], "only there are all markers above a floor at 0", False) if len(fits) == 1 else (None, "", False)


def _middle(place: np.ndarray) -> np.ndarray:
    visible = place[np.isfinite(place).all(axis=1)]
    return np.median(visible, axis=0) if len(visible) else np.full(3, np.nan)
