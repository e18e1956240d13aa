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
from pathlib import Path

import numpy as np

from jgait.io.files import Tree, check_file, check_size, library, numbered, plain, reading
from jgait.io.formats.c3d_axes import UPRIGHT, Capture, CaptureEvent, told_unit, told_up
from jgait.notes import DEDUCED, Kind, Note
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
BIG_ENDIAN = 86
"""The processor of a file whose numbers begin with their most significant byte: MIPS; Intel is 84, DEC 85."""

MOST_FRAMES = 65535
"""Largest number of frames that the header of a file can hold."""

PARAMETERS_END = 2**19
"""[bytes] Largest possible end of the parameters: they begin within 255 blocks of 512 and have no more."""

UP_UNSURE = Kind(
    "up_unsure", "check", "",
    "With a wrong vertical, heights and directions are wrong. POINT:Y_SCREEN is the vertical of a program's view, "
    "which some programs write otherwise than the laboratory's.",
)  # fmt: skip


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
    rate, first = _rate(raw, file), int(raw["header"]["points"]["first_frame"])
    values = np.moveaxis(np.asarray(raw["data"]["points"], np.float64)[:3], 0, 2)  # (markers, T, 3)
    samples = values.shape[1]
    labels, subject = _labels(_texts(parameters, "POINT", "LABELS"), len(values), notes)
    markers, outputs = _apart(parameters, labels, values)
    if (stored := _stored(parameters)) > samples >= MOST_FRAMES:
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
    """How many frames the header states; None where 16 bits do not hold it.

    Raises:
        RecordingError: if this is no C3D file, or its parameters are not there in full, of which ezc3d would seek the
            end for ever.
    """
    with file.open("rb") as stream:
        content = stream.read(PARAMETERS_END)
    if len(content) < 512 or content[1] != 0x50:
        raise RecordingError(f"{file.name} is not {EXPECTED}: it does not begin with the header of one")
    place = max(content[0] - 1, 1) * 512
    order = ">u2" if content[place + 3 : place + 4] == bytes([BIG_ENDIAN]) else "<u2"
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
    check_size(8 * (4 * points + analog) * max(last - first + 1, 0), file.name)
    return last - first + 1 if first <= last < 65535 else None


def _texts(parameters: Tree, group: str, key: str) -> list[str]:
    """A parameter of many strings, with its continuations: LABELS, LABELS2, … hold 255 each."""
    texts: list[str] = []
    for number in ("", *map(str, range(2, 100))):
        each = parameters.get(group, {}).get(f"{key}{number}")
        if each is None:
            break
        texts += [plain(value) for value in each["value"]]
    return texts


def _stored(parameters: Tree) -> int:
    """How many frames the group TRIAL states, in which two words hold a number; 0 where it states none."""
    fields = (parameters.get("TRIAL", {}).get(f"ACTUAL_{end}_FIELD", {}).get("value", ()) for end in ("START", "END"))
    first, last = (sum((int(word) & 0xFFFF) << 16 * i for i, word in enumerate(words)) for words in fields)
    return last - first + 1 if last >= first > 0 else 0


def _rate(raw: Tree, file: Path) -> float:
    stated = raw["parameters"].get("POINT", {}).get("RATE", {"value": []})["value"]
    rate = float(stated[0]) if len(stated) and stated[0] > 0 else float(raw["header"]["points"]["frame_rate"])
    if not (np.isfinite(rate) and rate > 0.0):
        raise RecordingError(f"{file.name} states no rate of its frames: POINT:RATE is {list(stated)}")
    return rate


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
    markers, outputs = {}, {}
    for label, value in zip(labels, values, strict=True):
        if label in listed or OUTPUT_NAME.search(label):
            outputs[label] = value
        else:
            # Many writers store a marker that was not visible as exactly 0, 0, 0.
            markers[label] = np.where((value == 0.0).all(axis=1, keepdims=True), np.nan, value)
    return markers, outputs


def _metres(parameters: Tree, markers: dict[str, np.ndarray], file: Path, notes: list[Note]) -> float:
    stated = next(iter(_texts(parameters, "POINT", "UNITS")), "")
    if stated.lower() in UNITS or not markers:
        return UNITS.get(stated.lower(), 1.0)
    if stated:
        raise RecordingError(
            f"{file.name}: the markers are in {stated!r}; expected one of {', '.join(UNITS)}; give unit"
        )
    deduced, apart = told_unit(markers)
    if deduced is None:
        raise RecordingError(
            f"{file.name} states no unit of its markers, and their distance, {apart:.4g}, does not decide it; give unit"
        )
    notes.append(DEDUCED.note(f"the file states no unit of its markers; {deduced}, for they are {apart:.4g} apart"))
    return UNITS[deduced]


def _up(parameters: Tree, markers: dict[str, np.ndarray], notes: list[Note]) -> str | None:
    """The file's axis that points up."""
    stated = next(iter(_texts(parameters, "POINT", "Y_SCREEN")), "").lower()
    stated = stated if stated[:1] in ("+", "-") else f"+{stated}"
    stated = stated if stated in UPRIGHT else ""
    deduced, why, overrules = told_up(markers, stated)
    if stated and deduced not in (None, stated) and overrules:
        notes.append(
            UP_UNSURE.note(
                f"{deduced} points up, for {why}; POINT:Y_SCREEN states {stated}: pass up={stated!r} if right"
            )
        )
        return deduced
    if stated:
        notes.append(DEDUCED.note(f"{stated} points up by POINT:Y_SCREEN"))
        if deduced is not None and deduced != stated:
            notes.append(UP_UNSURE.note(f"but by the markers {deduced} points up: {why}; pass up={deduced!r} if right"))
        return stated
    if deduced is None:
        notes.append(UP_UNSURE.note("neither the file nor its markers show which axis points up; pass up"))
        return None
    notes.append(DEDUCED.note(f"{deduced} points up, for {why}"))
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
    group = parameters.get("EVENT", {})
    if "TIMES" not in group:
        return ()
    minutes = np.asarray(group["TIMES"]["value"], np.float64)
    if not minutes.size:
        return ()
    if minutes.ndim != 2 or minutes.shape[0] != 2:
        raise RecordingError(f"{file.name}: EVENT:TIMES must be minutes and seconds, (2, n); it has {minutes.shape}")
    labels, contexts = _texts(parameters, "EVENT", "LABELS"), _texts(parameters, "EVENT", "CONTEXTS")
    events = []
    for i, (minute, second) in enumerate(minutes.T):
        label = labels[i] if i < len(labels) else ""
        side = contexts[i].lower() if i < len(contexts) else ""
        kind = EVENTS.get(label.lower(), label)
        events.append(CaptureEvent(float(60.0 * minute + second), kind, side if side in ("right", "left") else None))
    return tuple(sorted(events, key=lambda event: event.time))
