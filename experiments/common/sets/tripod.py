"""`tripod`: IMUs on shanks, feet and sacrum on a treadmill, with OptoGait and Zebris (Trautmann et al. 2021).

Upstream's repository has one person at three speeds, the full set (15 people) is available on request; both have
`<root>/Sub_XX/<trial>/IMU/*.csv`, with any root. Trials: `PWS` (preferred speed), `PWS+20`, `PWS-20`; two minutes each
after the first step, which is a right step. Sensors: Physilog, 128 Hz, deg/s and g. The shank's gyroscope z is
mediolateral: in swing positive right, negative left. The sacrum is named `pelvis`; `LH` and `RH` are not read.

Reference: the belt's speed; the distance is speed × time, on the belt, from the first swing on. A person on a treadmill
stays in place, so the distance is the path on the belt, and not a displacement. There are no joint angles.
OptoGait gives every step with noise (standard deviation of a stride 6.5–8.3 cm, Zebris 2.6–3.1 cm): compare medians.
Its clock started at another time; jgait shifts it by a constant so that contacts follow the shanks' swings in the
gyroscopes. An error of some 0.1 s remains, different for each leg: use OptoGait's durations, not its instants.

Keys of `Walk.info`:
    speed: [m/s] of the belt; None where neither MetaInfo.csv nor Zebris states it.
    leg_length: [m] greater trochanter to lateral malleolus, or None.
    windows: name → (start, end) [samples], half-open: `standing` (before the first swing), `whole` (from the first
        swing to the last), `steady` (10 s after the first swing to 118 s after it); {} without a shank sensor.
    optogait: {"right": {"time" (of the contact that begins the stride, on the sensors' clock [s], NaN without a shank
        sensor), "stride_length" [m], "stride_time", "stance_time", "swing_time" [s], "kept" (bool): (n,)},
        "left": …}; {} without the file. `kept`: 10 to 118 s after the first contact, and 0.5 m to 2.5 m.
    zebris: name → number: "stride_length" [m], "stride_time" [s], "step_width" [m], "step_length_right", … [m],
        "stance_fraction_right", … [1], "speed" [m/s], each also with "_sd"; {} without the file.
    no_reference: why there is no reference; None where there is one.
    verified: whether every file's sha256 was known and agreed.
"""

from pathlib import Path

import numpy as np
from jaxtyping import PyTree

from jgait.datasets import reading, registry
from jgait.datasets.reading import Files
from jgait.geometry.vectors import GRAVITY
from jgait.io.formats import devices
from jgait.notes import LEFT_OUT, Kind, Note
from jgait.types import SIDES, AnyArray, Estimate, Imu, Legs, Recording, RecordingError, Walk

TABLE_ABSENT = Kind("table_absent", "info", "no {file}", LEFT_OUT.meaning)

RATE_HZ = 128.0
SENSORS = {
    "LS": "shank_left",
    "RS": "shank_right",
    "LF": "foot_left",
    "RF": "foot_right",
    "SA": "pelvis",
}
STEADY = (10.0, 118.0)  # [s] after the first swing or contact; between these times the belt has constant speed
STRIDE_LENGTH = (0.5, 2.5)  # [m]
SWING = 2.0  # [rad/s] smallest peak of the angular rate of a shank in swing
OPTOGAIT = {
    "time": ("Split", 0, 1.0),
    "stride_length": ("Stride", 1, 0.01),
    "stride_time": ("StrideTime\\Cycle", 1, 1.0),
    "stance_time": ("TStance", 0, 1.0),
    "swing_time": ("TSwing", 1, 1.0),
}
"""Upstream's column; its delay in rows of the same foot (a stride is measured when it has ended); factor to SI."""
ZEBRIS = {
    "Stride length": ("stride_length", 0.01),
    "Stride time": ("stride_time", 1.0),
    "Step width": ("step_width", 0.01),
    "Velocity": ("speed", 1 / 3.6),
    **{
        f"{theirs} {side[0].upper()}": (f"{ours}_{side}", factor)
        for side in SIDES
        for theirs, ours, factor in (("Step length", "step_length", 0.01), ("Step time", "step_time", 1.0),
                                     ("Stance phase", "stance_fraction", 0.01))
    },
}  # fmt: skip


def names() -> list[str]:
    """Trials on this computer, for example 'Sub_FZ/PWS+20'."""
    return sorted(_folders())


def load_one(name: str) -> Walk:
    """One trial: up to five sensors, and the belt's distance as an `Estimate`."""
    folder = _folders()[name]
    files, tables = Files("tripod"), {}
    for code, placement in SENSORS.items():
        path = files.find(f"{folder}/IMU/{code}.csv", LEFT_OUT.note(f"no file for {placement}"))
        if path is not None:
            tables[placement] = _read_sensor(path)
    if not tables:
        raise RecordingError(f"{name} has none of the sensors {', '.join(SENSORS)}")
    sensors = _on_one_clock(tables, files.notes)
    time = next(iter(sensors.values())).time
    swings = {side: _swings(sensors[f"shank_{side}"].gyr[:, 2], side) for side in SIDES if f"shank_{side}" in sensors}
    windows = _windows(swings, len(time))
    zebris = _optional(files, f"{folder}/Zebris/gait_report/parameters.csv", _read_zebris)
    optogait = _optional(files, f"{folder}/OptoGait/optogait.csv", _read_optogait)
    _shift_clock(optogait, swings)
    subject, trial = name.split("/")
    person = _optional(files, str(Path(folder).parent.parent / "MetaInfo.csv"), _read_people)
    about = person.get(subject.removeprefix("Sub_"), {})
    speed = about.get(trial, zebris.get("speed"))
    reference, why = _reference(time, windows, speed)
    return Walk(Recording(sensors, RATE_HZ, name, subject, tuple(files.notes)), reference, {
        "speed": speed,
        "leg_length": about.get("leg_length"),
        "windows": windows,
        "optogait": optogait,
        "zebris": zebris,
        "no_reference": why,
        "verified": files.verified,
    })  # fmt: skip


def _folders() -> dict[str, str]:
    """Name → upstream folder of each trial that has a sensor file; the first root is used."""
    folders: dict[str, str] = {}
    for file in registry.listing("tripod", "", "*.csv"):
        folder, parent, stem = Path(file).parent.parent, Path(file).parent.name, Path(file).stem
        if parent == "IMU" and stem in SENSORS and folder.parent.name.startswith("Sub_"):
            folders.setdefault(f"{folder.parent.name}/{folder.name}", folder.as_posix())
    return folders


def _optional(files: Files, path: str, read: PyTree) -> dict[str, PyTree]:
    """The content of a file; {} where the file is missing."""
    local = files.find(path, TABLE_ABSENT(file=Path(path).name))
    return {} if local is None else read(local)


def _read_sensor(path: Path) -> np.ndarray:
    """(n, 7): time [s], gyroscope [rad/s], accelerometer [m/s²]."""
    (part,) = devices.FORMATS["physilog"].measured(path).parts
    if part.acc is None or part.time is None or len(part.time) < 2:
        raise RecordingError(f"{path.name} has no accelerometer, or less than two rows")
    return np.column_stack([part.time, np.deg2rad(part.gyr), GRAVITY * part.acc])


def _on_one_clock(tables: dict[str, np.ndarray], notes: list[Note]) -> dict[str, Imu]:
    """Sensors on the time that all of them cover; missing samples of a sensor are masked."""
    for table in tables.values():
        table[:, 0] = np.rint(table[:, 0] * RATE_HZ)
    first = max(int(table[0, 0]) for table in tables.values())
    length = min(int(table[-1, 0]) for table in tables.values()) + 1 - first
    if length < RATE_HZ:
        raise RecordingError(f"the sensors have {max(length, 0) / RATE_HZ:.2f} s in common; 1 s is needed")
    return reading.on_counter(tables, first, length, RATE_HZ, notes)


def _swings(rate: AnyArray, side: str) -> np.ndarray:
    """(n,) [s] times of the middles of a shank's swings."""
    from scipy.signal import butter, filtfilt, find_peaks

    numerator, denominator = butter(2, 6.0 / (RATE_HZ / 2))
    smooth = filtfilt(numerator, denominator, rate if side == "right" else -rate)
    return find_peaks(smooth, height=SWING, distance=round(0.6 * RATE_HZ))[0] / RATE_HZ


def _windows(swings: dict[str, np.ndarray], samples: int) -> dict[str, tuple[int, int]]:
    middles = np.concatenate([np.zeros(0), *swings.values()])
    if len(middles) < 2:
        return {}
    first, last = round(middles.min() * RATE_HZ), round(middles.max() * RATE_HZ)
    steady = tuple(first + round(seconds * RATE_HZ) for seconds in STEADY)
    windows = {"standing": (0, first), "whole": (first, last + 1), "steady": (steady[0], min(steady[1], last + 1))}
    return {name: window for name, window in windows.items() if window[1] > window[0]}


def _reference(
    time: AnyArray, windows: dict[str, tuple[int, int]], speed: float | None
) -> tuple[Estimate | None, str | None]:
    """The distance on the belt, valid while the belt has constant speed; or why there is none."""
    if speed is None:
        return None, "neither MetaInfo.csv nor Zebris states the belt's speed"
    if "steady" not in windows:
        return None, "no shank sensor shows when the walk begins"
    start, (first, last) = time[windows["whole"][0]], windows["steady"]
    valid = np.zeros(len(time), bool)
    valid[first:last] = True
    distance = speed * np.clip(time - start, 0.0, time[last - 1] - start)
    source = {"source": "speed of the belt × time"}
    return Estimate(time, Legs(None, None), None, distance, valid, source), None


def _read_zebris(path: Path) -> dict[str, float]:
    """Numbers of a Zebris file; its header has names and units in turn, its second row only the values."""
    lines = path.read_text(encoding="utf-8-sig").splitlines()
    header, values = (line.split(",") for line in lines[:2])
    numbers = {}
    for name, value in zip(header[1::2], values[1:], strict=False):
        base, sd = name.removesuffix(" SD"), "_sd" if name.endswith(" SD") else ""
        if base in ZEBRIS and value:
            ours, factor = ZEBRIS[base]
            numbers[ours + sd] = float(value) * factor
    return numbers


def _read_optogait(path: Path) -> dict[str, dict[str, np.ndarray]]:
    """Side → strides; each row of the file is a contact with the stride that ends at the contact."""
    table = reading.table(path, [*(column for column, _, _ in OPTOGAIT.values()), "L/R"])
    strides = {}
    begin = table.loc[table["L/R"].isin(["L", "R"]), "Split"].to_numpy(np.float64)[:1]
    for side in SIDES:
        rows = table[table["L/R"] == side[0].upper()]
        of = {
            ours: rows[column].shift(-late).to_numpy(np.float64) * factor
            for ours, (column, late, factor) in OPTOGAIT.items()
        }
        walked = of["time"] - begin
        plausible = (of["stride_length"] >= STRIDE_LENGTH[0]) & (of["stride_length"] <= STRIDE_LENGTH[1])
        whole = np.isfinite(of["stride_time"]) & np.isfinite(of["stance_time"]) & np.isfinite(of["swing_time"])
        strides[side] = {**of, "kept": (walked >= STEADY[0]) & (walked <= STEADY[1]) & plausible & whole}
    return strides


def _shift_clock(optogait: dict[str, dict[str, np.ndarray]], swings: dict[str, np.ndarray]) -> None:
    """Put OptoGait's contacts on the sensors' clock, in place; NaN without a shank sensor.

    Candidate shifts put the first steady contact after one of the swings of its leg. The shift is chosen at which the
    time from the nearest swing to each contact varies least, because the strides' durations differ. Both legs are used:
    with one leg, a shift by one more stride sometimes fits nearly as well. The angular rate of a shank in swing is
    largest about 0.16 of a stride before the initial contact.
    """
    legs, guesses = [], []
    for side, middles in swings.items():
        contacts = optogait[side]["time"][optogait[side]["kept"]] if optogait else np.zeros(0)
        if len(contacts) >= 10 and len(middles) >= 10:
            landing = middles + 0.16 * np.median(np.diff(contacts))
            legs.append((contacts, landing))
            guesses.extend(contacts[0] - landing)
    trials = []
    for guess in guesses:
        late = [c - landing[np.abs(c[:, None] - guess - landing).argmin(axis=1)] for c, landing in legs]
        trials.append((float(np.std(np.concatenate(late))), float(np.median(np.concatenate(late)))))
    for of in optogait.values():
        of["time"] = of["time"] - (min(trials)[1] if trials else np.nan)


def _read_people(path: Path) -> dict[str, dict[str, float]]:
    """Alias → leg length [m] and belt speeds [m/s] by trial; the file has semicolons and decimal commas."""
    import pandas as pd

    table = pd.read_csv(path, sep=";", decimal=",", encoding="utf-8-sig")
    columns = {"leg_length": ("Leg length (cm)", 0.01)}
    columns |= {trial: (f"{trial} (km/h)", 1 / 3.6) for trial in ("PWS", "PWS+20", "PWS-20")}
    return {
        str(row["Subject Alias"]): {
            ours: float(row[theirs]) * factor
            for ours, (theirs, factor) in columns.items()
            if theirs in table.columns and pd.notna(row[theirs])
        }
        for _, row in table.iterrows()
    }
