"""The error about a table whose columns are not recognised: it names those that may be meant."""

import difflib
from collections.abc import Mapping

from jgait.io.names import CHANNELS, COLUMNS, column_of, sensor_of, states
from jgait.types import PLACEMENTS, RecordingError

ALMOST = 0.8
"""[1] Least share of equal characters of a name that is taken for another one misspelt."""

FEW = 4
"""[1] Largest number of columns that a message lists."""


def not_recognised(lacking: list[str], position: Mapping[str, int], given: list[str], name: str) -> RecordingError:
    """The error about columns that are lacking, or about a table in which no column is that of a sensor.

    Args:
        lacking: names of columns that are expected; empty if no sensor is recognised.
        position: recognised name → number of the column.
        given: names of all columns.
        name: of the table.
    """
    signals = {kind: [column for column in given if states(column, kind)] for kind in ("gyr", "acc")}
    if signals["acc"] and not signals["gyr"]:
        return RecordingError(f"{name} holds no gyroscope, which every method needs; found {_few(signals['acc'])}")
    known = {index for column, index in position.items() if column in COLUMNS}
    unknown = [column for index, column in enumerate(given) if index not in known]
    if not lacking and any(column_of(column) in CHANNELS for column in given):
        return RecordingError(
            f"{name} lacks the place of its sensor: found {_few(given)}; for one sensor with bare names give its "
            "place, such as {argument}",
            argument="placement",
            value="waist",
        )
    sensors = [label_and_channel[0] for column in unknown if (label_and_channel := sensor_of(column))]
    strange = [sensor for sensor in sensors if _nearest(sensor, PLACEMENTS) is None]
    # the lab's own names of the other axes, with the letter of one that lacks
    spelt = {_with_axis(given[index], wanted[-1]): wanted for wanted in lacking
             for column, index in position.items() if column[:-1] == wanted[:-1]}  # fmt: skip
    likely = spelt | {column: column for column in lacking or sorted(COLUMNS - {"time", "feet_range"})}
    meant = {column: near for column in unknown if (near := _nearest(column, likely))}
    hint = ", ".join(f"{column!r} looks like {likely[near]!r}" for column, near in list(meant.items())[:3])
    hint = f"; {hint}: correct the header of the file" if hint else ""
    if lacking:
        rest = f"; columns not recognised: {_few([c for c in unknown if sensor_of(c)] or unknown)}" if unknown else ""
        place = lacking[0].rpartition("_gyr_")[0]
        if len(lacking) == 3 and place:
            have = f"has {place}_acc_x, _y, _z but no {place}_gyr_x, _y, _z; a sensor needs its gyroscope"
            return RecordingError(f"{name} {have}{hint}{rest}")
        expected = [f"{lacking[0][:-1]}{axis}" for axis in "xyz"]
        return RecordingError(f"{name} lacks {', '.join(lacking)}{hint}; expected columns {expected}{rest}")
    named = "; io.read and the commands place sensors by {argument}" if strange and not hint else ""
    return RecordingError(
        f"{name} has no column that is recognised as a sensor's: found {_few(given)}{hint}; columns are named "
        f"<placement>_gyr_x to <placement>_acc_z, such as foot_left_gyr_x{named}",
        argument="placements" if named else "",
        value={strange[0]: "shank_right"} if named else "",
    )


def _with_axis(spelt: str, axis: str) -> str:
    """A lab's name of a column, in lower case, with another axis at its last x, y or z."""
    last = max(spelt.lower().rfind(letter) for letter in "xyz")
    return f"{spelt[:last]}{axis}{spelt[last + 1 :]}".lower()


def _nearest(spelt: str, among: Mapping[str, str] | tuple[str, ...]) -> str | None:
    """The name among some (lower case) that is almost as spelt; None if there is none."""
    near = difflib.get_close_matches(spelt.strip().lower(), list(among), 1, ALMOST)
    return near[0] if near else None


def _few(names: list[str]) -> str:
    """The first few of some names, and how many more there are."""
    more = f" and {len(names) - FEW} more" if len(names) > FEW else ""
    return ", ".join(map(repr, names[:FEW])) + more
