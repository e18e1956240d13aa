"""`walking5m`: IMUs on both feet, shanks and thighs, straight walks of about 5 m (Marpino/Walking-dataset).

Upstream has twenty young and twenty elderly people, one walk each, 100 Hz, and some additional walks; files are xlsx
with raw counts. No licence is stated: the files are for local use and must never be redistributed; they are downloaded
only when the user calls `fetch("walking5m")`.

Scales: acceleration = raw / 10000 · 9.80665 m/s², rate = raw / 100 deg/s. x runs along the segment, z is mediolateral.
Each sensor has its own time stamps [ms]; all are put on one 100 Hz clock. Gaps of up to 50 ms are interpolated, longer
ones masked. Six left-foot sensors give a new value, and a new time, only every 20 ms. The back sensor
(7) is not synchronised with the others and is left out.

Reference: the authors' foot trajectories are not fetched; the distance is computed from the foot sensors
(`jgait.datasets.foot_reference`), the mean of both feet. Its error is about ±5 % between people.

Leg lengths per person are in upstream's two PDFs, but not which file is which person, so only group means are given:
table 4.3 (young): thigh T 48.5 cm, shank S 44.6 cm; table 4.2 (elderly): T 40.5 cm, S 41.7 cm.

Keys of `Walk.info`:
    group: 'young', 'elderly', or the folder of an additional walk ('marzia', 'long_distance', 'disability').
    lengths: {"right": (thigh, shank), "left": …} [m], the group's mean; None for the additional walks.
    windows: name → (start, end) [samples], half-open: `whole` (from the first stride to the last), `standing` and
        `end_standing` (before and after the walk, if any, not always motionless); {} where there is no reference.
    insoles: {"right": (toe, heel), "left": (toe, heel)}, each (T,) raw pressure counts.
    feet: {"right": FootPath, "left": FootPath}, of the feet with strides.
    no_reference: why there is no reference; None where there is one.
    misplaced: pairs of placements that seem to be exchanged, because the thigh turns faster than the shank:
        (("thigh_left", "shank_left"),) in Elderly/20180417_2 and _4. The recording keeps upstream's labels.
    verified: whether the file's sha256 was known and agreed.
"""

from pathlib import Path

import numpy as np

from jgait.datasets import registry
from jgait.datasets.foot_reference import FootPath, foot_path, walking_strides
from jgait.geometry.vectors import GRAVITY
from jgait.mounting.places import places_in
from jgait.notes import AS_READ, DATA_LOST, LEFT_OUT, Note
from jgait.types import SIDES, Estimate, Imu, Legs, Recording, RecordingError, Walk

RATE_HZ = 100.0
"""[Hz] Sampling rate of all sensors, by upstream."""

ROOT = "Dataset"
SENSORS = {1: "foot_right", 2: "shank_right", 3: "thigh_right", 4: "thigh_left", 5: "shank_left", 6: "foot_left"}
"""Number of a sensor in the names of the columns → its placement."""

ACC_SCALE = GRAVITY / 10000.0
"""[m/s²] One raw count of an accelerometer, by upstream."""

GYR_SCALE = np.pi / 180.0 / 100.0
"""[rad/s] One raw count of a gyroscope, by upstream."""

LENGTHS = {"young": (0.485, 0.446), "elderly": (0.405, 0.417)}
"""[m] Group → mean length of thigh and shank, upstream's tables 4.3 and 4.2."""


def names() -> list[str]:
    """Recordings on this computer, for example 'Young/20180518_1'."""
    files = registry.listing("walking5m", ROOT, "*.xlsx")
    return [file.removeprefix(f"{ROOT}/").removesuffix(".xlsx") for file in files]


def load_one(name: str) -> Walk:
    """One walk: six sensors, and the distance from the feet as an `Estimate`."""
    path, verified = registry.file("walking5m", f"{ROOT}/{name}.xlsx")
    table = _read_table(path)
    group = Path(name).parent.name.lower().replace(" ", "_")
    sensors, insoles, notes = _sensors(table, path.name)
    # In the two groups each file is another person; the additional walks of a folder are of one person.
    subject = name if group in LENGTHS else f"Additional/{group}"
    places = places_in(sensors)
    swapped = tuple((name, label) for name, label in places.worn.items() if name > label) if places else ()
    notes += places.notes() if places and swapped else []
    recording = Recording(sensors, RATE_HZ, name, subject, tuple(notes))
    reference, feet, why = distance_reference(sensors)
    lengths, windows = LENGTHS.get(group), {}
    if reference is not None:
        start, end = min(path.start[0] for path in feet.values()), max(path.end[-1] for path in feet.values()) + 1
        parts = {"whole": (start, end), "standing": (0, start), "end_standing": (end, len(reference.time))}
        windows = {part: (int(a), int(b)) for part, (a, b) in parts.items() if b > a}
    return Walk(recording, reference, {
        "group": group,
        "lengths": None if lengths is None else dict.fromkeys(SIDES, lengths),
        "windows": windows,
        "insoles": insoles,
        "feet": feet,
        "no_reference": why,
        "misplaced": swapped,
        "verified": verified,
    })  # fmt: skip


def distance_reference(sensors: dict[str, Imu]) -> tuple[Estimate | None, dict[str, FootPath], str | None]:
    """Distance as the mean of both feet, of which one may start or stop before the body; the strides of each foot; and
    why there is no distance.
    """
    feet, reasons = {}, []
    for side in SIDES:
        try:
            if f"foot_{side}" not in sensors:
                raise ValueError("there is no foot sensor")
            feet[side] = foot_path(sensors[f"foot_{side}"], RATE_HZ)
        except ValueError as error:
            reasons.append(f"{side}: {error}")
    if reasons:
        return None, feet, "; ".join(reasons)
    feet = walking_strides(feet, RATE_HZ)
    if not all(len(path.length) for path in feet.values()):
        return None, feet, "neither foot walks: all strides are steps on the spot"
    time, distance = next(iter(sensors.values())).time, (feet["right"].distance + feet["left"].distance) / 2
    source = {"source": "mean of both foot sensors, strapdown between stances"}
    return Estimate(time, Legs(None, None), None, distance, np.ones(len(time), bool), source), feet, None


def _read_table(path: Path) -> dict[str, np.ndarray]:
    """Column → (n,) values; cells without a number become NaN."""
    import pandas as pd
    from python_calamine import CalamineWorkbook

    rows = CalamineWorkbook.from_path(path).get_sheet_by_index(0).to_python()
    if len(rows) < 3:
        raise RecordingError(f"{path.name} has {max(len(rows) - 1, 0)} rows of data; at least 2 are needed")
    header = [str(cell).strip() for cell in rows[0]]
    columns = zip(*(row for row in rows[1:]), strict=True)
    return {
        name: pd.to_numeric(pd.Series(cells, dtype=object), errors="coerce").to_numpy(np.float64)  # some are text
        for name, cells in zip(header, columns, strict=True) if name
    }  # fmt: skip


def _columns(number: int) -> list[str]:
    return [f"{kind}_read_{axis}_{number}" for kind in ("Gyro", "Acc") for axis in "xyz"]


def _sensors(
    table: dict[str, np.ndarray], file: str
) -> tuple[dict[str, Imu], dict[str, tuple[np.ndarray, np.ndarray]], list[Note]]:
    """Every sensor on one clock, the insoles, and notes."""
    notes: list[Note] = []
    raw = {}
    for number, placement in SENSORS.items():
        lacking = [column for column in [f"Time_{number}", *_columns(number)] if column not in table]
        if lacking:
            notes.append(LEFT_OUT.note(f"{placement} left out: no column {lacking[0]}"))
            continue
        extra = [column for column in (f"Ext1_{number}", f"Ext2_{number}") if column in table]
        time = table[f"Time_{number}"] / 1000.0
        values = np.stack([table[column] for column in [*_columns(number), *extra]], axis=1)
        kept = np.isfinite(time) & np.isfinite(values).all(axis=1)
        kept[kept] = np.diff(np.maximum.accumulate(time[kept]), prepend=-np.inf) > 0.0
        if kept.sum() < 2:
            notes.append(LEFT_OUT.note(f"{placement} left out: its time does not run"))
            continue
        if (dropped := int((~kept).sum())) > 1:  # the last row of sensor 1 always repeats the time before it
            why = "they lack a number, or their time is not later than the one before"
            notes.append(AS_READ.note(f"{placement}: {dropped} of {len(time)} rows are not read: {why}"))
        raw[placement] = time[kept], values[kept]
    if not raw:
        raise RecordingError(f"{file} has no leg sensor; expected columns such as {', '.join(_columns(1)[:2])}")
    if "Time_7" in table:
        notes.append(LEFT_OUT.note("back sensor left out: it is not synchronised with the others"))
    # The time that all sensors cover; they start and stop within a few samples of each other.
    first = max(time[0] for time, _ in raw.values())
    last = min(time[-1] for time, _ in raw.values())
    if last - first < 1.0:
        raise RecordingError(f"the sensors of {file} have {max(last - first, 0.0):.2f} s in common; 1 s is needed")
    clock = np.arange(round((last - first) * RATE_HZ) + 1) / RATE_HZ
    sensors, insoles = {}, {}
    for placement, (time, values) in raw.items():
        signals, mask = _on_clock(time - first, values, clock)
        if not mask.all():
            notes.append(DATA_LOST.note(f"samples masked: {(~mask).sum()} of {len(mask)}", placement=placement))
        sensors[placement] = Imu(clock, signals[:, :3] * GYR_SCALE, signals[:, 3:6] * ACC_SCALE, mask)
        if signals.shape[1] == 8:
            insoles[placement.split("_")[1]] = (signals[:, 6], signals[:, 7])
    return sensors, insoles, notes


def _on_clock(time: np.ndarray, values: np.ndarray, clock: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values interpolated on the clock, 0 and masked where the samples around lie more than 50 ms apart."""
    tick = 1e-6  # [s] tolerance; time stamps are whole milliseconds
    right = np.clip(np.searchsorted(time, clock - tick), 0, len(time) - 1)
    left = np.clip(np.searchsorted(time, clock + tick, side="right") - 1, 0, len(time) - 1)
    mask = time[right] - time[left] <= 0.05 + tick
    signals = np.stack([np.interp(clock, time, column) for column in values.T], axis=1)
    return np.where(mask[:, None], signals, 0.0), mask
