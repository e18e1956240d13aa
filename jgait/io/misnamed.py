"""Errors about tables whose columns are not recognised: they name what may be meant."""

import difflib
from collections.abc import Mapping

from jgait.io.names import CHANNELS, COLUMNS, column_of, sensor_of
from jgait.types import PLACEMENTS, RecordingError

ALMOST = 0.8
"""[1] Least share of equal characters of a name that is taken for another one misspelt."""

FEW = 4
"""[1] Largest number of columns that a message lists."""


def lacking_columns(
    lacking: list[str], expected: list[str], position: Mapping[str, int], given: list[str], name: str
) -> RecordingError:
    """The error about a sensor without some of its columns; it names unrecognised columns that may be meant."""
    unknown = _unrecognised(position, given)
    meant = []
    for column in lacking:
        likely = [column]
        for sibling in (other for other in expected if other in position):  # the lab's own spelling of this axis
            spelt = given[position[sibling]].lower()
            last = spelt.rfind(sibling[-1])
            likely.append(f"{spelt[:last]}{column[-1]}{spelt[last + 1 :]}")
        near = _nearest(likely, unknown)
        meant += [f"{near!r} looks like {column!r}"] if near else []
    hint = f"; {', '.join(meant)}: correct the header of the file" if meant else ""
    rest = f"; columns not recognised: {_few(unknown)}" if unknown else ""
    return RecordingError(f"{name} lacks {', '.join(lacking)}{hint}; expected columns {expected}{rest}")


def without_gyroscope(placement: str, position: Mapping[str, int], given: list[str], name: str) -> RecordingError:
    """The error about a sensor of which only the accelerometer is recognised; it names columns that may be meant."""
    unknown = _unrecognised(position, given)
    meant = [column for column in unknown if sensor_of(column)] or unknown
    rest = f"; columns not recognised: {_few(meant)}" if meant else ""
    return RecordingError(
        f"{name} has {placement}_acc_x, _y, _z but no {placement}_gyr_x, _y, _z; a sensor needs its gyroscope{rest}"
    )


def no_sensor(position: Mapping[str, int], given: list[str], name: str) -> RecordingError:
    """The error about a table in which no column is recognised as a sensor's; it says how columns are named."""
    if any(column_of(column) in CHANNELS for column in given):
        return RecordingError(
            f"{name} lacks the place of its sensor: found {_few(given)}; for one sensor with bare names give its "
            "place, such as {argument}",
            argument="placement",
            value="waist",
        )
    signals = sorted(COLUMNS - {"time", "feet_range"})
    sensors = {column: found[0] for column in _unrecognised(position, given) if (found := sensor_of(column))}
    strange = [sensor for sensor in sensors.values() if not _nearest([sensor.lower()], list(PLACEMENTS))]
    near = {
        column: _nearest([column.strip().lower()], signals)
        for column in _unrecognised(position, given) if sensors.get(column) not in strange
    }  # fmt: skip
    meant = [f"{column!r} looks like {known!r}" for column, known in near.items() if known]
    hint = f"; {', '.join(meant[:3])}: correct the header of the file" if meant else ""
    named = "; io.read and the commands place sensors by {argument}" if strange and not hint else ""
    return RecordingError(
        f"{name} has no column that is recognised as a sensor's: found {_few(given)}{hint}; columns are named "
        f"<placement>_gyr_x to <placement>_acc_z, such as foot_left_gyr_x{named}",
        argument="placements" if named else "",
        value={strange[0]: "shank_right"} if named else "",
    )


def _unrecognised(position: Mapping[str, int], given: list[str]) -> list[str]:
    known = {index for column, index in position.items() if column in COLUMNS}
    return [column for index, column in enumerate(given) if index not in known]


def _nearest(likely: list[str], among: list[str]) -> str | None:
    """The name among some that is spelt almost as one of the likely names (lower case); None if there is none."""
    alike = {
        name: max(difflib.SequenceMatcher(None, one, name.strip().lower()).ratio() for one in likely) for name in among
    }
    best = max(alike, key=lambda name: alike[name], default=None)
    return best if best is not None and alike[best] > ALMOST else None


def _few(names: list[str]) -> str:
    """The first few of some names, and how many more there are."""
    more = f" and {len(names) - FEW} more" if len(names) > FEW else ""
    return ", ".join(map(repr, names[:FEW])) + more
