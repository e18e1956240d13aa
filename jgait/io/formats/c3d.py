"""C3D: markers, analog signals and events of a motion capture, as a reference beside inertial sensors.

*Format*: the C3D file format (c3d.org), read by ezc3d. *Units*: POINT:UNITS, each analog signal's in ANALOG:UNITS;
where the file states none, how far the markers are apart decides. *Frames*: the laboratory's axes; which one points up
comes from the markers (the pelvis above the feet, or all above a floor), or from POINT:Y_SCREEN, and is noted.
Markers are turned, not mirrored, so that z points up: x stays horizontal, the file's own axes follow in cyclic order.
*Clock*: the first captured frame is 0 s, which may be before the first that is stored; events count from it too.
Points that a model put beside the markers (angles, moments, powers) are kept apart, in the file's units. Force plates
are left as they are: their signals are among the analog ones, their corners and types in `force_plates`.
"""

import math
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jgait.io.files import Tree, check_file, check_size, library, numbered, plain, reading
from jgait.io.part import UP_UNSURE
from jgait.notes import AS_READ, DEDUCED, Note, record
from jgait.types import RecordingError

EXPECTED = "a C3D file"
UNITS = {
    "m": 1.0, "mm": 1e-3, "cm": 1e-2, "dm": 0.1, "in": 0.0254,
    "meter": 1.0, "meters": 1.0, "metre": 1.0, "metres": 1.0,
    "millimeters": 1e-3, "millimetres": 1e-3, "inches": 0.0254,
}  # fmt: skip
"""Name of a unit of length in POINT:UNITS → metres."""
OUTPUTS = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS")
"""Parameters of POINT that list points which are not positions."""
OUTPUT_NAME = re.compile(r"(angles?|forces?|moments?|powers?)$", re.IGNORECASE)
EVENTS = {
    "foot strike": "initial_contact", "heel strike": "initial_contact", "initial contact": "initial_contact",
    "foot off": "final_contact", "toe off": "final_contact", "final contact": "final_contact",
}  # fmt: skip
MOST_FRAMES = 65535
"""[1] Largest number of frames that the header of a file can hold: its fields have 16 bits."""

UPRIGHT = {
    f"{sign}{axis}": np.diag([1.0, way, way]) @ np.roll(np.eye(3), by, axis=0)
    for sign, way in (("+", 1.0), ("-", -1.0)) for by, axis in enumerate("zyx")
}  # fmt: skip
"""The axis of a file that points up → the rotation from the file's axes to those with z up."""

APART = {"m": (0.3, 2.5), "mm": (300.0, 2500.0)}
"""Unit → range of the largest distance between the markers of a person, in this unit; in cm it would be 30 to 250."""
HIGH = re.compile(
    r"^[LR]?_?(ASIS?|PSIS?|HJC|FEP|SACR|CLAV|C7|T10|STRN|HEAD|[LR]?[FB]HD|I[AP]S|[CT]V\d+|S[XJ]S|SJN|SAE)$",
    re.IGNORECASE,
)
LOW = re.compile(r"^[LR]?_?(HEEL?|TOE|ANK|AJC|TIO|MT[15]|CAL|FCC|FM[125]|FAL|TAM)$", re.IGNORECASE)
FLOOR = 0.15
"""[m] Largest height above or below 0 of the lowest markers on a floor; chosen by hand."""


class CaptureEvent(NamedTuple):
    """One event of a capture."""

    time: float  #: [s] on the clock of `Capture.time`.
    kind: str  #: 'initial_contact', 'final_contact', or the file's label where that is neither.
    side: str | None  #: 'right', 'left', or None for neither.


@record
class Capture(NamedTuple):
    """Data of a motion capture."""

    time: np.ndarray  #: (T,) [s] of the markers, 0 at the first captured frame.
    rate_hz: float  #: [Hz] of the markers.
    markers: dict[str, np.ndarray]  #: name → (T, 3) [m], NaN where not visible; z points up where `up` is known.
    up: str | None  #: the file's axis that points up: '+x', …, '-z'; None: not known, the axes are the file's.
    outputs: dict[str, np.ndarray]  #: name → (T, 3) outputs of a model, in the file's units.
    analog_time: np.ndarray  #: (A,) [s] on the same clock.
    analog_rate_hz: float  #: [Hz], 0 where there is no analog signal.
    analog: dict[str, np.ndarray]  #: name → (A,) in the unit of `analog_units`.
    analog_units: dict[str, str]  #: name → unit as written in the file; empty if the file has none.
    events: tuple[CaptureEvent, ...]  #: in order of time.
    force_plates: Tree  #: parameters of the group FORCE_PLATFORM, as they are, in the file's units and axes.
    name: str  #: of the recording.
    subject: str  #: name of the person.
    notes: tuple[Note, ...]  #: notes about deduced units, changes and doubtful data.


def read_c3d(path: str | os.PathLike[str], *, unit: str | None = None, up: str | None = None) -> Capture:
    """Markers, analog signals and events of a C3D file.

    Args:
        path: the file.
        unit: of the markers, 'mm', 'm', 'cm' or 'in', overrules the file.
        up: the file's axis that points up, such as '+y', overrules the file.

    Returns:
        The capture in metres and seconds, called by the file, the person by the file's labels.

    Raises:
        OSError: if the file does not exist, or may not be read.
        ValueError: for an unknown unit or axis.
        RecordingError: if it is no whole C3D file, or neither the file nor the markers decide the unit.
    """
    if unit is not None and unit not in UNITS:
        raise ValueError(f"unit must be one of {', '.join(UNITS)}; got {unit!r}")
    if up is not None and up not in UPRIGHT:
        raise ValueError(f"up must be one of {', '.join(UPRIGHT)}; got {up!r}")
    file = Path(path)
    check_file(file, EXPECTED)
    with reading(file, EXPECTED):
        return _capture(file, _load(file), unit, up)


def _capture(file: Path, raw: Tree, unit: str | None, up: str | None) -> Capture:
    """The capture in ezc3d's tree; arguments as of `read_c3d`."""
    parameters = raw["parameters"]
    notes: list[Note] = []
    stated = parameters.get("POINT", {}).get("RATE", {"value": []})["value"]
    rate = float(stated[0]) if len(stated) and stated[0] > 0 else float(raw["header"]["points"]["frame_rate"])
    if not (np.isfinite(rate) and rate > 0.0):
        raise RecordingError(f"{file.name} states no rate of its frames: POINT:RATE is {list(stated)}")
    first = int(raw["header"]["points"]["first_frame"])
    values = np.moveaxis(np.asarray(raw["data"]["points"], np.float64)[:3], 0, 2)  # (markers, T, 3)
    samples = values.shape[1]
    labels, subject = _labels(_texts(parameters, "POINT", "LABELS"), len(values), notes)
    markers, outputs = _apart(parameters, labels, values)
    # two words of the group TRIAL hold a number of frames that the header cannot
    trial = (parameters.get("TRIAL", {}).get(f"ACTUAL_{end}_FIELD", {}).get("value", ()) for end in ("START", "END"))
    begin, end = (sum((int(word) & 0xFFFF) << 16 * i for i, word in enumerate(words)) for words in trial)
    if (stored := end - begin + 1 if end >= begin > 0 else 0) > samples >= MOST_FRAMES:
        raise RecordingError(
            f"{file.name} holds {stored} frames, by TRIAL:ACTUAL_END_FIELD, of which ezc3d reads {samples}: write "
            f"parts of fewer than {MOST_FRAMES} frames"
        )
    metres = UNITS[unit] if unit is not None else _metres(parameters, markers, file, notes)
    markers = {label: metres * place for label, place in markers.items()}
    axis = up or _up(parameters, markers, notes)
    if axis is not None:
        markers = {label: place @ UPRIGHT[axis].T for label, place in markers.items()}
    analog, units, analog_rate = _analog(raw, notes)
    count = len(next(iter(analog.values()), ()))
    if not samples and not count:
        raise RecordingError(f"{file.name} holds neither markers nor analog signals")
    return Capture(
        (first + np.arange(samples)) / rate, rate, markers, axis, outputs,
        first / rate + np.arange(count) / (analog_rate or 1.0), analog_rate, analog, units, _events(parameters, file),
        {key: each["value"] for key, each in parameters.get("FORCE_PLATFORM", {}).items() if "value" in each},
        file.stem, subject or "subject", tuple(notes),
    )  # fmt: skip


def _load(file: Path) -> Tree:
    """ezc3d's tree, once the file is known to be whole: ezc3d itself gives what a truncated file still holds."""
    stored = _frames_in_header(file)
    ezc3d = library("ezc3d", EXPECTED)
    try:
        raw = ezc3d.c3d(str(file))
    except Exception as error:  # ezc3d may raise any exception
        raise RecordingError(f"{file.name} is no whole C3D file: {error}") from error
    frames = raw["data"]["points"].shape[2]
    if stored is not None and frames < stored and raw["data"]["points"].shape[1]:
        raise RecordingError(f"{file.name} is truncated: its header states {stored} frames, {frames} are there")
    return {key: raw[key] for key in ("header", "parameters", "data")}


def _frames_in_header(file: Path) -> int | None:
    """How many frames the header states; None where 16 bits do not hold it. Raises RecordingError where the parameters
    are not there in full, of which ezc3d would seek the end for ever.
    """
    with file.open("rb") as stream:
        content = stream.read(2**19)  # parameters begin within 255 blocks of 512 bytes, and have no more blocks
    if len(content) < 512 or content[1] != 0x50:
        raise RecordingError(f"{file.name} is not {EXPECTED}: it does not begin with the header of one")
    place = max(content[0] - 1, 1) * 512
    # processor 86, MIPS, writes the most significant byte first; Intel is 84, DEC 85
    order = ">u2" if content[place + 3 : place + 4] == b"V" else "<u2"
    words = np.frombuffer(content[:512], order)
    place += 4
    while True:
        # Each parameter says how far the next is: length of its name, group, name, distance; 0 ends the list.
        name = abs(int(np.frombuffer(content[place : place + 1].ljust(1, b"\0"), np.int8)[0]))
        at = place + 2 + name
        if place + 2 > len(content) or (name and at + 4 > len(content)):
            raise RecordingError(f"{file.name} is truncated: its parameters do not end within {len(content)} bytes")
        distance = int(np.frombuffer(content[at : at + 2], order)[0]) if name else 0
        if distance == 0:
            break
        values = np.frombuffer(content[at + 2 : at + 3], np.int8)  # -1 or the bytes of each value; then the dimensions
        held = abs(int(values[0])) * math.prod(content[at + 4 : at + 4 + content[at + 3]])
        if content[place + 1] < 128 and 5 + content[at + 3] + held > distance:
            raise RecordingError(f"{file.name} is damaged: a parameter declares {held} bytes in {distance}")
        place = at + distance
    points, analog, first, last = map(int, words[1:5])
    if place > 512 * max(int(words[8]) - 1, 1):
        raise RecordingError(f"{file.name} is damaged: its parameters end at byte {place}, within its data")
    check_size(8 * (4 * points + analog) * max(last - first + 1, 0), file)
    return last - first + 1 if first <= last < MOST_FRAMES else None


def _texts(parameters: Tree, group: str, key: str) -> list[str]:
    """A parameter of many strings, with its continuations: LABELS, LABELS2, … hold 255 each."""
    texts: list[str] = []
    for number in ("", *map(str, range(2, 100))):
        each = parameters.get(group, {}).get(f"{key}{number}")
        if each is None:
            break
        texts += [plain(value) for value in each["value"]]
    return texts


def _labels(texts: list[str], count: int, notes: list[Note]) -> tuple[list[str], str | None]:
    """One name a point, none twice, and the subject whose name they all bear."""
    labels = [texts[i] if i < len(texts) and texts[i] else f"*{i + 1}" for i in range(count)]
    before = {label.split(":", 1)[0] for label in labels if ":" in label}
    subject = next(iter(before)) if len(before) == 1 else None
    if subject is not None:
        labels = [label.split(":", 1)[-1] for label in labels]
    return numbered(labels, notes), subject


def _apart(
    parameters: Tree, labels: list[str], values: np.ndarray
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Markers, NaN where not visible, and outputs of a model."""
    listed = {label.split(":", 1)[-1] for group in OUTPUTS for label in _texts(parameters, "POINT", group)}
    every = dict(zip(labels, values, strict=True))
    outputs = {label: value for label, value in every.items() if label in listed or OUTPUT_NAME.search(label)}
    # Many writers store a marker that was not visible as exactly 0, 0, 0.
    markers = {label: np.where((value == 0.0).all(axis=1, keepdims=True), np.nan, value)
               for label, value in every.items() if label not in outputs}  # fmt: skip
    return markers, outputs


def _metres(parameters: Tree, markers: dict[str, np.ndarray], file: Path, notes: list[Note]) -> float:
    stated = next(iter(_texts(parameters, "POINT", "UNITS")), "")
    if stated.lower() in UNITS or not markers:
        return UNITS.get(stated.lower(), 1.0)
    if stated:
        expected = ", ".join(UNITS)
        raise RecordingError(f"{file.name}: the markers are in {stated!r}; expected one of {expected}; give unit")
    deduced, apart = told_unit(markers)
    if deduced is None:
        undecided = f"and their distance, {apart:.4g}, does not decide it; give unit"
        raise RecordingError(f"{file.name} states no unit of its markers, {undecided}")
    notes.append(DEDUCED.note(f"the file states no unit of its markers; {deduced}, for they are {apart:.4g} apart"))
    return UNITS[deduced]


def _up(parameters: Tree, markers: dict[str, np.ndarray], notes: list[Note]) -> str | None:
    """The file's axis that points up."""
    stated = next(iter(_texts(parameters, "POINT", "Y_SCREEN")), "").lower()
    stated = stated if stated[:1] in ("+", "-") else f"+{stated}"
    stated = stated if stated in UPRIGHT else ""
    deduced, why, overrules = told_up(markers, stated)
    if not stated and deduced is None:
        notes.append(UP_UNSURE.note("neither the file nor its markers show which axis points up; pass up"))
    elif not stated:
        notes.append(DEDUCED.note(f"{deduced} points up, for {why}"))
    elif deduced not in (None, stated) and overrules:
        states = f"POINT:Y_SCREEN states {stated}: pass up={stated!r} if right"
        notes.append(UP_UNSURE.note(f"{deduced} points up, for {why}; {states}"))
    else:
        notes.append(AS_READ.note(f"{stated} points up by POINT:Y_SCREEN"))
        if deduced not in (None, stated):
            notes.append(UP_UNSURE.note(f"but by the markers {deduced} points up: {why}; pass up={deduced!r} if right"))
        return stated
    return deduced


def _analog(raw: Tree, notes: list[Note]) -> tuple[dict[str, np.ndarray], dict[str, str], float]:
    values = np.asarray(raw["data"]["analogs"], np.float64)[0]
    if not values.size:
        return {}, {}, 0.0
    parameters = raw["parameters"]
    labels, _ = _labels(_texts(parameters, "ANALOG", "LABELS"), len(values), notes)
    units = _texts(parameters, "ANALOG", "UNITS")
    unit_of = {label: units[i] if i < len(units) else "" for i, label in enumerate(labels)}
    return dict(zip(labels, values, strict=True)), unit_of, float(raw["header"]["analogs"]["frame_rate"])


def _events(parameters: Tree, file: Path) -> tuple[CaptureEvent, ...]:
    minutes = np.asarray(parameters.get("EVENT", {}).get("TIMES", {"value": []})["value"], np.float64)
    if not minutes.size:
        return ()
    if minutes.ndim != 2 or minutes.shape[0] != 2:
        raise RecordingError(f"{file.name}: EVENT:TIMES must be minutes and seconds, (2, n); it has {minutes.shape}")
    count = minutes.shape[1]
    labels, contexts = ([*_texts(parameters, "EVENT", key), *[""] * count][:count] for key in ("LABELS", "CONTEXTS"))
    events = [
        CaptureEvent(float(60.0 * time[0] + time[1]), EVENTS.get(label.lower(), label),
                     side.lower() if side.lower() in ("right", "left") else None)
        for time, label, side in zip(minutes.T, labels, contexts, strict=True)
    ]  # fmt: skip
    return tuple(sorted(events, key=lambda event: event.time))


def told_unit(markers: Mapping[str, np.ndarray]) -> tuple[str | None, float]:
    """The unit in which the distances between markers (T, 3) fit a person, or None; and the distance that decides: the
    median over time of the longest side of the box around all markers.
    """
    places = np.stack(list(markers.values()))
    visible = np.isfinite(places).all(axis=(0, 2))
    if not visible.any():
        return None, float("nan")
    apart = float(np.median(np.ptp(places[:, visible], axis=0).max(axis=1)))
    return next((unit for unit, (least, most) in APART.items() if least <= apart <= most), None), apart


def told_up(markers: Mapping[str, np.ndarray], stated: str = "") -> tuple[str | None, str, bool]:
    """The axis that points up, or None, by markers (T, 3) [m], NaN where not visible, and by the axis that the file
    states, if any; why; and whether the markers overrule the file: nobody walks on the head, or below the floor.
    """
    visible = {label: place[np.isfinite(place).all(axis=1)] for label, place in markers.items()}
    visible = {label: place for label, place in visible.items() if len(place)}
    trunk, feet = ([np.median(place, axis=0) for label, place in visible.items() if words.match(label)]
                   for words in (HIGH, LOW))  # fmt: skip
    if trunk and feet:
        way = np.mean(trunk, axis=0) - np.mean(feet, axis=0)
        axis = int(np.argmax(np.abs(way)))
        sure = abs(way[axis]) >= 0.8 * np.linalg.norm(way)
        up = f"{'-' if way[axis] < 0 else '+'}{'xyz'[axis]}"
        return (up, "the trunk's markers are above the feet's there", True) if sure else (None, "", False)
    if not visible:
        return None, "", False
    low, high = np.percentile(np.concatenate(list(visible.values())), [1.0, 99.0], axis=0)
    ends = [(f"{sign}{'xyz'[axis]}", *each) for axis in range(3)
            for sign, each in (("+", (low[axis], high[axis])), ("-", (-high[axis], -low[axis])))]  # fmt: skip
    fits = [axis for axis, least, most in ends if abs(least) < FLOOR and 2.0 * FLOOR < most < APART["m"][1]]
    opposite = stated.translate(str.maketrans("+-", "-+"))
    if stated not in fits and opposite in fits:
        return opposite, "all markers are above a floor at 0 there", True
    return (fits[0], "only there are all markers above a floor at 0", False) if len(fits) == 1 else (None, "", False)
