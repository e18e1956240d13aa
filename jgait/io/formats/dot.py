"""Movella (Xsens) DOT CSV, one file a sensor, as its app and its exporter write it.

*Format* (Movella DOT user manual, "Data exporter"): perhaps `sep=,`; lines such as `DeviceTag:,Right thigh`,
`FirmwareVersion:`, `SyncStatus:`, `OutputRate:,60Hz`; a header `PacketCounter,SampleTimeFine,Acc_X,…,Gyr_X,…` with
other columns before, between and after (`Euler_X`, `Quat_W`, `FreeAcc_X`, `Mag_X`, `Status`).

*Units*: the manual states m/s² with gravity, deg/s and µs. `FreeAcc` is without gravity: a file that has no other
acceleration is refused. *Clock*: `SampleTimeFine` (32 bits, wrapping), which sensors share once they were synchronised.
*Placement*: not stated; the sensor is called by its `DeviceTag`, which the user may have chosen, or else by the file's
name. *Axes*: the sensor's, printed on its case.
"""

import re
from collections.abc import Sequence
from pathlib import Path

from jgait.io.formats.mtw import COUNTER, counted, is_header, signals, starts
from jgait.io.formats.text import Rows, TextFormat
from jgait.io.part import Measured, Part, joined
from jgait.io.text import first_lines
from jgait.notes import DEDUCED
from jgait.types import RecordingError

TIME, TIME_BITS, MICROSECONDS = "SampleTimeFine", 32, 1e-6
FACT = re.compile(r'^"?([A-Za-z ]+?)\s*:?\s*[:,;\t]\s*(.*?)["\s,;]*$')
UNSYNCED = re.compile(r"^(un|not)[\s_-]*sync", re.IGNORECASE)


def measured(path: Path) -> Measured:
    """One sensor, or all of a folder; errors as of `TextFormat.measured`, and for sensors that are not synchronised."""
    if not path.is_dir():
        return FORMAT.measured(path)
    files = FORMAT.files(path)
    states = {file.name: _facts(first_lines(file)[0]).get("syncstatus", "") for file in files}
    for name, state in states.items() if len(files) > 1 else ():
        if UNSYNCED.match(state):
            why = "sensors of one recording need one clock"
            raise RecordingError(
                f"{path.name}: the clock of {name} was not synchronised with the others' (SyncStatus {state!r}); {why}"
            )
    whole = joined([FORMAT.measured(file) for file in files], path.name)
    if len(files) > 1 and not all(states.values()):
        assumed = DEDUCED.note("the files do not state that the sensors' clocks were synchronised; one is assumed")
        whole = whole._replace(notes=(*whole.notes, assumed))
    return whole


def _facts(lines: Sequence[str]) -> dict[str, str]:
    """What the first lines state: "devicetag" → "Right thigh"."""
    matches = map(FACT.match, lines)
    return {fact.group(1).replace(" ", "").lower(): fact.group(2) for fact in matches if fact}


def _content(rows: Rows) -> Measured:
    facts = _facts(rows.before)
    gyr, acc = signals(rows)
    stamps = counted(rows, TIME, TIME_BITS)
    stated = re.match(r"[\d.]+", facts.get("outputrate", ""))
    rate = float(stated.group()) if stated else None
    part = Part(
        facts.get("devicetag") or rows.path.stem, gyr, acc,
        time=None if stamps is None else MICROSECONDS * stamps,
        sampling_rate_hz=rate if stamps is None else None,
        gyr_unit="deg/s", acc_unit="m/s^2",
        packets=counted(rows, COUNTER, TIME_BITS) if stamps is None else None,
    )  # fmt: skip
    return Measured([part], rows.path.stem)


FORMAT = TextFormat(
    "Movella DOT CSV with a header PacketCounter, SampleTimeFine, …, Acc_X, …, Gyr_X, …", (".csv",), is_header,
    _content, accepts=lambda path, head: not starts(path, head),
)  # fmt: skip
recognises = FORMAT.recognises
