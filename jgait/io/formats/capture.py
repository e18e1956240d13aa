"""Data of a motion capture system: markers, analog signals and events, independent of the file format."""

from typing import NamedTuple

import numpy as np

from jgait.io.files import Tree
from jgait.notes import Note


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
