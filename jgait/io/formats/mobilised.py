"""Mobilise-D's MATLAB files (`data.mat`): one or many trials, each of one or many sensors.

*Format*: Palmerini et al. 2023, Scientific Data 10:38, "Mobility recorded by wearable devices and gold standards: the
Mobilise-D procedure for data standardization". A variable `data` holds nested structs, level by level the time of
measurement, the test and the trial (`data.TimeMeasure1.Test5.Trial1`; data sets differ in how many levels they have).
The level that holds `SU` (the wearable device), `SU_INDIP` (INDIP's sensors) or `Standards` (references) is a trial;
structs of one name, an array in MATLAB, are numbered: `Trial(2)`. A device holds a struct a place, with `Acc` [g],
`Gyr` [deg/s], `Fs.Acc`, `Fs.Gyr` [Hz] and perhaps `Timestamp` [Unix s].

*Units* and *placements* are stated by the specification, by the names of the structs: `LowerBack`, `LeftFoot`, …
*Axes*: those of the device; the trunk's as it is usually worn are x up, y to the right, z forward, mirrored nowhere.
They are kept. *Clock*: `Timestamp` where it disagrees with `Fs` by more than half a sample, else `Fs`.
Version 7.3 of MATLAB's files is refused with how to convert it.
"""

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from jaxtyping import PyTree

from jgait.io.files import Tree, check_file, positive, reading, three_columns
from jgait.io.formats.matlab import read_matlab
from jgait.io.names import placement_of
from jgait.io.part import CLOCKS_APART, Measured, Part, on_one_zero
from jgait.io.recording import settle
from jgait.notes import AS_READ, LEFT_OUT, Note
from jgait.types import Recording, RecordingError

EXPECTED = "a Mobilise-D MATLAB file (data.mat)"
DEVICES = ("SU", "SU_INDIP", "SU_INDIP2")
"""Devices of a trial; if two devices have a sensor at one placement, the first is used."""


def measured(path: Path) -> Measured:
    """The one trial of a file. Raises RecordingError for another format, or many trials, which the message lists."""
    return _measured(path, None)


def mobilised_trials(path: str | os.PathLike[str]) -> tuple[str, ...]:
    """The trials of a Mobilise-D file that hold a sensor, such as 'TimeMeasure1/Test5/Trial1', in the file's order.

    Raises:
        OSError: if the file does not exist, or may not be read.
        RecordingError: if the file is not in this format, or holds no sensor.
    """
    with reading(Path(path), EXPECTED):
        return tuple(_trials(Path(path)))


def read_mobilised(
    path: str | os.PathLike[str], *, trial: str | None = None, name: str | None = None, subject: str | None = None
) -> Recording:
    """One trial of a Mobilise-D file (`data.mat`).

    Args:
        path: the file.
        trial: one of `mobilised_trials`, or the end of its name if only one ends so ('Test5/Trial1'); None: the file
            has one only.
        name: name of the recording in tables and figures; None: the file's folder and the trial.
        subject: name of the person; None: the folder in which the file lies.

    Raises:
        OSError: if the file does not exist, or may not be read.
        RecordingError: if the file is not in this format, lacks the trial or has many, or holds no usable recording.
    """
    with reading(Path(path), EXPECTED):
        content = _measured(Path(path), trial)
        return settle(content, name=name, subject=subject)


def _measured(path: Path, trial: str | None) -> Measured:
    every = _trials(path)
    if trial is None and len(every) > 1:
        raise RecordingError(
            f"{path.name} has {len(every)} trials, of which one is chosen by {{argument}}; they are {', '.join(every)}",
            argument="trial",
            value=next(iter(every)),
        )
    chosen = [key for key in every if trial in (None, key)] or [key for key in every if key.endswith(f"/{trial}")]
    if len(chosen) != 1:
        what = f"has no trial {trial!r}" if not chosen else f"has {len(chosen)} trials that end in {trial!r}"
        raise RecordingError(f"{path.name} {what}; its trials are {', '.join(chosen or every)}")
    return _of_trial(path, chosen[0], every[chosen[0]])


def _trials(path: Path) -> dict[str, Tree]:
    """Trial → its struct, of the trials that hold a sensor."""
    check_file(path, EXPECTED)
    data = read_matlab(path, ("data",), expected=EXPECTED, simplify_cells=True)["data"]
    if not isinstance(data, dict | list):
        kind = f"an array {np.shape(data)}" if np.ndim(data) else type(data).__name__
        raise RecordingError(f"{path.name} is not {EXPECTED}: its variable 'data' should be a struct, it is {kind}")
    every = dict(_descend(data, ()))
    trials = {key: tree for key, tree in every.items() if any(isinstance(tree.get(device), dict) for device in DEVICES)}
    if not trials:
        there = f"its trials without are {', '.join(every)}" if every else f"'data' has {', '.join(data) or 'nothing'}"
        raise RecordingError(f"{path.name} has no trial with a struct {', '.join(DEVICES)}; {there}")
    return trials


def _descend(tree: PyTree, above: tuple[str, ...]) -> Iterator[tuple[str, Tree]]:
    """Trials below a struct, or a list of structs of one name, which are numbered as in MATLAB: `Trial(2)`."""
    if isinstance(tree, list):
        for number, below in enumerate(tree, 1):
            yield from _descend(below, (*above[:-1], f"{above[-1] if above else 'data'}({number})"))
    elif isinstance(tree, dict) and any(key in tree for key in (*DEVICES, "Standards")):
        yield "/".join(above) or "data", tree
    elif isinstance(tree, dict):
        for key, below in tree.items():
            yield from _descend(below, (*above, key))


def _of_trial(path: Path, trial: str, tree: Tree) -> Measured:
    """The sensors of one trial."""
    where = f"{path.name}, {trial}"
    notes, left_out = list[Note](), list[str]()
    parts, worn = list[Part](), set[str]()
    for device in (device for device in DEVICES if isinstance(tree.get(device), dict)):
        for place, sensor in tree[device].items():
            if not isinstance(sensor, dict) or "Gyr" not in sensor:
                left_out.append(f"{device}.{place} (no gyroscope)")
            elif {place, placement_of(place)} & worn:
                left_out.append(f"{device}.{place} (another device was worn there)")
            else:
                parts.append(_part(place, sensor, f"{where}: {device}.{place}", notes))
                worn |= {place, placement_of(place) or place}
    if not parts:
        raise RecordingError(f"{where} has no sensor with a gyroscope, Gyr; it has {', '.join(left_out) or 'none'}")
    if left_out:
        notes.append(LEFT_OUT.note(f"left out: {', '.join(left_out)}"))
    if any(part.begin_s is None for part in parts):
        parts = [part._replace(time=None, begin_s=None) for part in parts]
    folder = path.absolute().parent.name
    return Measured(on_one_zero(parts, where), f"{folder}/{trial}", folder, tuple(notes))


def _part(place: str, sensor: Tree, where: str, notes: list[Note]) -> Part:
    """One sensor on a clock from 0, and when that was; without time stamps on none."""
    gyr = three_columns(sensor["Gyr"], f"{where}.Gyr")
    acc = three_columns(sensor["Acc"], f"{where}.Acc", len(gyr)) if "Acc" in sensor else None
    rates = sensor.get("Fs")
    if not isinstance(rates, dict) or "Gyr" not in rates:
        raise RecordingError(f"{where} has no sampling rate Fs.Gyr; it has {', '.join(sensor)}")
    rate = positive(rates["Gyr"])
    if rate is None:
        raise RecordingError(f"{where}.Fs must be positive; it is {rates['Gyr']}")
    if acc is not None and positive(rates.get("Acc", rate)) != rate:
        raise RecordingError(f"{where}: Acc and Gyr must share a rate; Fs states {rates['Acc']} and {rates['Gyr']} Hz")
    part = Part(place, gyr, acc, np.arange(len(gyr)) / rate, rate, "deg/s", "g")
    if "Timestamp" not in sensor or not len(gyr):
        return part
    stamps = np.asarray(sensor["Timestamp"], np.float64).ravel()
    if stamps.shape != (len(gyr),):
        raise RecordingError(f"{where}.Timestamp must have shape ({len(gyr)},); it has {stamps.shape}")
    since = stamps - stamps[0]
    if not np.abs(since - part.time).max() <= CLOCKS_APART / rate:
        differs = f"Timestamp differs from samples at {rate:g} Hz by more than half a sample; it is used"
        notes.append(AS_READ.note(differs, placement=place))
        part = part._replace(time=since)
    return part._replace(begin_s=float(stamps[0]))
