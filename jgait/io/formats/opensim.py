"""OpenSim's motions (`.mot`, `.sto`): joint angles of inverse kinematics, as a reference beside inertial sensors.

*Format*: OpenSim's documentation, "Storage (.sto) Files" and "Motion (.mot) Files": lines `key=value` down to
`endheader`, then the names of the columns and one row a sample, the first column time [s]. *Units*: metres and seconds;
angles in degrees or radians as `inDegrees` states; without it the size of the hip and knee angles decides.
*Signs*: those of the model. `hip_flexion` counts from the pelvis and is positive in flexion in all common models;
`knee_angle` is negative in flexion in gait2392 and its kin, positive in Rajagopal's; the sign follows from the range of
a walk, and it is noted. `pelvis_tilt` turns about the axis to the right, so a pelvis that leans back is positive.
Files of orientations (a quaternion a cell, from OpenSense) are no angles and are refused.
"""

import os
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jgait.io.files import check_columns, check_file, library, numbered, numbers, reading
from jgait.io.text import first_lines
from jgait.notes import DEDUCED, Note, record
from jgait.types import SIDES, Estimate, Legs, LegTrajectory, RecordingError

EXPECTED = "an OpenSim motion (.mot, .sto)"
NO_ANGLE = re.compile(
    r"_[tvp]?[0-9]*[xyz]$|force|torque|moment|activation|excitation|fiber|tendon|length|power|reserve|emg",
    re.IGNORECASE,
)
"""Columns that are lengths, forces or states of muscles, whatever `inDegrees` states."""
BENT = np.deg2rad(25.0)
"""[rad] In walking, the largest knee flexion is above it; chosen by hand."""

STRAIGHT = np.deg2rad(15.0)
"""[rad] In walking, the largest hyperextension of the knee is below it; chosen by hand."""


@record
class OpenSimMotion(NamedTuple):
    """Content of a file of OpenSim."""

    time: np.ndarray  #: (T,) [s].
    #: name → (T,), angles in radians, lengths in metres, all else as it is; NaN where the file has nan.
    columns: dict[str, np.ndarray]
    angles: tuple[str, ...]  #: the columns that are angles.
    name: str  #: of the motion.
    notes: tuple[Note, ...]  #: what was deduced or is doubtful.


def read_opensim(path: str | os.PathLike[str], *, degrees: bool | None = None) -> OpenSimMotion:
    """The columns of an OpenSim motion in SI units; `opensim_reference` makes an `Estimate` of them.

    Args:
        path: the file.
        degrees: whether angles are in degrees, overrules the file.

    Raises:
        OSError: if the file does not exist, or may not be read.
        RecordingError: if it is no motion of OpenSim's, is truncated, holds orientations, or neither states whether
            angles are in degrees nor lets it be told.
    """
    file = Path(path)
    check_file(file, EXPECTED)
    with reading(file, EXPECTED):
        return _motion(file, degrees)


def _motion(file: Path, degrees: bool | None) -> OpenSimMotion:
    header, skipped, names = _header(file)
    kind = header.get("datatype", "double").lower()
    if kind != "double":
        raise _refusal(file, kind)
    values, notes = _values(file, skipped, names, header), list[Note]()
    names = numbered(names, notes)
    time = values[:, 0]
    if not (np.isfinite(time).all() and (np.diff(time) > 0.0).all()):
        raise RecordingError(f"{file.name}: time must increase from row to row; it does not")
    columns = dict(zip(names[1:], values[:, 1:].T, strict=True))
    angles = tuple(
        column for column in columns
        if not NO_ANGLE.search(_base(column).partition("#")[0]) and "/forceset" not in column
    )  # fmt: skip
    stated = header.get("indegrees", "").lower()
    if degrees is None and stated in ("yes", "no"):
        degrees = stated == "yes"
    if degrees is None and angles:
        degrees = _told_degrees(file, columns, notes)
    if degrees:
        columns |= {column: np.deg2rad(columns[column]) for column in angles}
    return OpenSimMotion(time, columns, angles, file.stem, tuple(notes))


def opensim_reference(
    motion: OpenSimMotion,
    *,
    knee_flexion: int | None = None,
    thigh_length: float | None = None,
    shank_length: float | None = None,
    upright_pelvis: bool = False,
) -> Estimate:
    """Hip and knee angles of a motion with the signs of jgait.

    hip = pelvis_tilt + hip_flexion,  knee = ± knee_angle,  x = a sin hip + b sin(hip − knee),
    y = −a cos hip − b cos(hip − knee), with a and b the lengths of thigh and shank. The thigh's angle from the vertical
    is this sum in the sagittal plane; list, rotation and adduction of some degrees change it by their squares.

    Args:
        motion: with `hip_flexion_r`, `knee_angle_r` and the same with `_l`, or of one leg; and `pelvis_tilt`.
        knee_flexion: 1 if `knee_angle` is positive in flexion, −1 if negative; None: deduced from its range.
        thigh_length: [m] of the model, for the ankle's place; None: it is NaN.
        shank_length: [m] likewise.
        upright_pelvis: take the pelvis as upright where the file has no `pelvis_tilt`.

    Returns:
        The legs that are there; valid where their angles are known. `diagnostics["source"]` states file and sign.

    Raises:
        ValueError: for another sign, or one length without the other.
        RecordingError: if no leg is there, the pelvis' tilt is not, or the knee's sign cannot be told.
    """
    if knee_flexion not in (None, 1, -1):
        raise ValueError(f"knee_flexion must be 1, -1 or None; got {knee_flexion!r}")
    if (thigh_length is None) != (shank_length is None):
        raise ValueError("thigh_length and shank_length must be given together, or neither")
    angles = {_base(column): values for column, values in motion.columns.items() if not column.endswith("/speed")}
    there = [side for side in SIDES if {f"hip_flexion_{side[0]}", f"knee_angle_{side[0]}"} <= angles.keys()]
    if not there:
        raise RecordingError(
            f"{motion.name} has no leg: expected hip_flexion_r and knee_angle_r, or with _l; it has {', '.join(angles)}"
        )
    if "pelvis_tilt" not in angles and not upright_pelvis:
        raise RecordingError(
            f"{motion.name} has no pelvis_tilt, from which hip_flexion counts; jgait's hip angle counts from the "
            "vertical: give upright_pelvis=True to take the pelvis as upright"
        )
    tilt = angles.get("pelvis_tilt", np.zeros_like(motion.time))
    sign = knee_flexion or _told_sign(motion.name, [angles[f"knee_angle_{side[0]}"] for side in there])
    a, b = (float("nan") if length is None else length for length in (thigh_length, shank_length))
    legs: dict[str, LegTrajectory | None] = dict.fromkeys(SIDES)
    valid = np.ones(len(motion.time), bool)
    for side in there:
        hip, knee = tilt + angles[f"hip_flexion_{side[0]}"], sign * angles[f"knee_angle_{side[0]}"]
        x, y = a * np.sin(hip) + b * np.sin(hip - knee), -a * np.cos(hip) - b * np.cos(hip - knee)
        legs[side] = LegTrajectory(hip, knee, x, y)
        valid &= np.isfinite(hip) & np.isfinite(knee)
    how = "given" if knee_flexion is not None else "deduced from its range"
    word = "positive" if sign > 0 else "negative"
    source = {"source": f"OpenSim: {motion.name}; knee_angle is {word} in flexion, {how}"}
    return Estimate(motion.time, Legs(**legs), None, None, valid, source)


def _base(column: str) -> str:
    """The coordinate's name, of which newer files give the whole path: /jointset/hip_r/hip_flexion_r/value."""
    parts = [part for part in column.split("/") if part]
    return next((part for part in reversed(parts) if part not in ("value", "speed")), column)


def _header(file: Path) -> tuple[dict[str, str], int, list[str]]:
    """Its keys in small letters, how many lines before the table's rows, and the names of its columns."""
    lines, _ = first_lines(file, 200)
    end = next((number for number, line in enumerate(lines) if line.strip().lower() == "endheader"), None)
    if end is None:
        raise RecordingError(f"{file.name} is not {EXPECTED}: none of its first {len(lines)} lines is endheader")
    pairs = (line.partition("=") for line in lines[:end])
    header = {key.strip().lower(): value.strip() for key, equal, value in pairs if equal}
    at = next((number for number in range(end + 1, len(lines)) if lines[number].strip()), len(lines))
    names = lines[at].split("\t" if "\t" in lines[at] else None) if at < len(lines) else []
    names = [name.strip() for name in names if name.strip()]
    if not names or names[0].lower() != "time":
        there = ", ".join(names) or "none"
        raise RecordingError(f"{file.name}: the first column must be time; the columns are {there}")
    check_columns(names, file.name)
    return header, at + 1, names


def _refusal(file: Path, kind: str) -> RecordingError:
    if kind == "quaternion":
        how = "run OpenSense's inverse kinematics on it, and read the motion that it writes"
        return RecordingError(f"{file.name} holds orientations of sensors (a quaternion w,x,y,z a cell): {how}")
    return RecordingError(f"{file.name} holds cells of type {kind}, expected one number a cell")


def _values(file: Path, skipped: int, names: list[str], header: dict[str, str]) -> np.ndarray:
    """(T, columns), after names and rows were found to be as many as the header states."""
    pandas = library("pandas", EXPECTED)
    try:
        table = pandas.read_csv(file, sep=r"\s+", skiprows=skipped, header=None, encoding="utf-8-sig")
    except (pandas.errors.ParserError, pandas.errors.EmptyDataError) as error:
        raise RecordingError(f"{file.name} has no rows, or not all of one length: {error}") from error
    values = np.zeros(table.shape)
    for name, column in table.items():
        values[:, name], wrong = numbers(column)
        if len(wrong):
            if any(str(cell).count(",") == 3 for cell in table.iloc[0]):
                raise _refusal(file, "quaternion")
            cell = f"{wrong.iloc[0]!r} in row {wrong.index[0]}"
            raise RecordingError(f"{file.name}: column {name} holds {cell}, no number")
    for key, there, what in (("nrows", len(table), "rows"), ("ncolumns", table.shape[1], "columns")):
        stated = header.get(key, header.get(key.replace("n", "data", 1), ""))
        if stated.isdigit() and int(stated) != there:
            raise RecordingError(f"{file.name} is truncated: its header states {stated} {what}, {there} are there")
    if table.shape[1] != len(names):
        raise RecordingError(f"{file.name} names {len(names)} columns, and its rows have {table.shape[1]}")
    if np.isnan(values[-1, -1]) and not np.isnan(values[:-1, -1]).any():
        raise RecordingError(f"{file.name} is truncated: its last row has {int(np.isfinite(values[-1]).sum())} values")
    return values


def _told_degrees(file: Path, columns: dict[str, np.ndarray], notes: list[Note]) -> bool:
    """Whether angles are in degrees, by the size of those of the legs."""
    legs = [v for c, v in columns.items() if re.match(r"(hip_flexion|knee_angle|ankle_angle)_[rl]$", _base(c))]
    largest = max((float(np.nanmax(np.abs(values))) for values in legs if np.isfinite(values).any()), default=0.0)
    degrees = largest > 2.0 * np.pi
    if degrees or BENT < largest < np.pi:
        unit = "degrees" if degrees else "radians"
        why = f"for the largest angle of the legs is {largest:.4g}"
        notes.append(DEDUCED.note(f"the file does not state inDegrees; {unit}, {why}"))
        return degrees
    undecided = f"and the largest angle of the legs, {largest:.4g}, does not decide; give degrees"
    raise RecordingError(f"{file.name} does not state inDegrees, {undecided}")


def _told_sign(name: str, knees: list[np.ndarray]) -> int:
    """1 where a knee's angle is positive in flexion, −1 where it is negative."""
    every = np.concatenate(knees)
    every = every[np.isfinite(every)]
    least, most = np.percentile(every, [1.0, 99.0]) if len(every) else (0.0, 0.0)
    if most > BENT and least > -STRAIGHT:
        return 1
    if least < -BENT and most < STRAIGHT:
        return -1
    between = f"from {np.rad2deg(least):.0f} to {np.rad2deg(most):.0f}°"
    undecided = "which does not decide the sign of flexion; give knee_flexion=1 or -1"
    raise RecordingError(f"{name}: knee_angle goes {between}, {undecided}")
