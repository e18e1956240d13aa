"""Comparison of a sensor's mounting with the stated axes, to detect a sensor upside down or on the other leg."""

import numpy as np

from jgait.estimators.ankle_stride.prepare import placement_of
from jgait.mounting import shank
from jgait.notes import Note
from jgait.types import SIDES, Recording

AXES = {"x": 0, "y": 1, "z": 2}


def axes_of(text: str) -> np.ndarray:
    """(3, 3) forward, left and up in a sensor's axes, from a text such as "x,-z,y".

    Raises:
        ValueError: if these are not three right-handed axes.
    """
    rows = []
    for word in text.split(","):
        name = word.strip().lower().removeprefix("+")
        at = AXES.get(name.removeprefix("-"))
        if at is None:
            break
        rows.append(np.eye(3)[at] * (-1.0 if name.startswith("-") else 1.0))
    if len(rows) != 3 or np.linalg.det(np.stack(rows)) < 0.5:
        raise ValueError(
            f"--axes names the axes that look forward, left and up, right-handed, such as x,y,z or -z,y,x; got {text!r}"
        )
    return np.stack(rows)


def worn_otherwise(recording: Recording, believed: np.ndarray) -> tuple[Note, ...]:
    """Notes about sensors whose mounting differs from the stated axes: forward, left and up, see `axes_of`."""
    notes: list[Note] = []
    for side in SIDES:
        name = placement_of(recording, side)
        functional = None if name is None else shank.functional_axes(recording.sensors[name])
        wrong = None if functional is None else shank.mounting(functional, believed, str(name))
        if wrong is not None:
            notes.append(wrong)
    return tuple(notes)
