"""`gaitmap_example`: IMUs on both shoes with motion capture of the feet (Küderle et al. 2024, mad-lab-fau/gaitmap).

The main walk, `imu_sample`: 20 m out and 20 m back, 204.8 Hz, sensors' axes x forward, y left, z up. `_not_rotated` is
the same walk in the axes of the sensors' cases, and is loaded only by its name. The others have no motion capture: two
stairs (204.8 Hz), strides cut at initial contact (`_ic_stride`; 102.4 Hz, else a stride took 0.57 s), and a person with
multiple sclerosis (102.4 Hz; left and right are not synchronised, so each foot is a separate recording). Upstream m/s²
and deg/s; the accelerometers clip at 16 g.

Reference: heel, toe and fifth metatarsal of both feet, 100 Hz, mm; no lag against the IMUs. The distance is the path
of the midpoint of the heels, smoothed so that sway does not count. A foot's position is the mean of its markers; its
velocity and orientation are not given. Strides are those of the events. There are no joint angles.

Keys of `Walk.info`; keys of the reference are {} (or None) where there is no reference:
    mocap: {"right": {"heel" | "toe" | "fm5": (M, 3) [m]}, "left": …}, z up, 100 Hz.
    mocap_time: (M,) [s] on the clock of the sensors; None where there is no motion capture.
    stride_borders: {"right": (n, 2) [samples], "left": …}, by hand, at the gyroscope's extremum before toe-off.
    events: {"right": {"start", "end", "ic", "tc", "min_vel", "pre_ic": (n,) [samples]}, "left": …}: each stride from
        standing to standing, the terminal and initial contact in the stride, and the initial contact before the stride.
    strides: {"right": {"length", "width", "width_toe", "step_length", "height" [m], "time" [s], "stance_fraction" [1],
        "straight" (bool): (n,)}, "left": …}: of the events' strides. Length: horizontal displacement of the heel from
        standing to standing; width: distance of the other, standing heel from the line of this displacement, NaN where
        the other foot does not stand in between; step_length: position of the other heel along this line; `width_toe`:
        width by the toes, twice the width, because the feet are turned out; height: rise of the heel; time: from
        initial contact to initial contact; `straight`: False in the turn and in the strides next to it.
    no_reference: why there is no reference; None where there is one.
    verified: whether every file's sha256 was known and agreed.
"""

from pathlib import Path
from typing import Any

import numpy as np

from jgait.datasets import reading, registry
from jgait.datasets.reading import Files, foot_imu
from jgait.geometry.sagittal import path_walked
from jgait.io.formats import columns
from jgait.io.names import placement_of
from jgait.notes import LEFT_OUT, Kind
from jgait.types import (
    SIDES,
    Estimate,
    Feet,
    FootTrajectory,
    Imu,
    Legs,
    Recording,
    RecordingError,
    Strides,
    Walk,
    as_float,
)

ROOT = "example_data"
RATE_HZ = 204.8
SLOW_HZ = 102.4
MOCAP_HZ = 100.0
CAPTURED = ("imu_sample", "imu_sample_not_rotated")
MARKERS = {"heel": "FCC", "toe": "TOE", "fm5": "FM5"}
EVENTS = ("start", "end", "ic", "tc", "min_vel", "pre_ic")
PATH_SMOOTHING = 0.3  # [s] width of the Gaussian that smooths the midpoint of the heels
STRAIGHT = np.deg2rad(15.0)  # [rad] largest angle of a straight stride to the walkway
SHORT = 0.8  # [1] of the median length; a shorter stride is a first stride, a last stride, or in a turn

FOOT_ABSENT = Kind("foot_absent", "info", "no sensor on the {side} foot", LEFT_OUT.meaning)


def names() -> list[str]:
    """Recordings on this computer: files `imu_sample*.csv`, without the extension."""
    return [Path(file).stem for file in registry.listing("gaitmap_example", ROOT, "imu_sample*.csv")]


def load_one(name: str) -> Walk:
    """One recording: the sensors of one or both shoes, and motion capture where available."""
    files = Files("gaitmap_example")
    path = files.need(f"{ROOT}/{name}.csv")
    rate = SLOW_HZ if "_ms_" in name or name.endswith("_ic_stride") else RATE_HZ
    sensors = _read_sensors(path, rate)
    # The main walk, the stairs, the cut strides and the person with multiple sclerosis are different people.
    subject = name.removeprefix("imu_sample").strip("_") if name not in CAPTURED else "healthy"
    subject = subject.removesuffix("_left").removesuffix("_right")
    files.notes += [FOOT_ABSENT(side=side) for side in SIDES if f"foot_{side}" not in sensors]
    details: dict[str, Any] = {"mocap": {}, "mocap_time": None, "stride_borders": {}, "events": {}, "strides": {}}
    reference: Estimate | None = None
    why: str | None = "no motion capture was recorded"
    if name in CAPTURED:
        reference, why = _add_reference(details, as_float(next(iter(sensors.values())).time), rate, files)
    elif name.endswith("_ic_stride"):
        _add_borders(details, "stride_borders_sample_ic_stride.csv", files)
    recording = Recording(sensors, rate, name, subject, tuple(files.notes))
    return Walk(recording, reference, {**details, "no_reference": why, "verified": files.verified})


def _read_sensors(path: Path, rate_hz: float) -> dict[str, Imu]:
    """Placement → sensor; the name of a file of one foot states which."""
    sensors = {}
    for part in columns.measured(path).parts:
        place = part.placement or placement_of(path.stem.rpartition("_")[2] + "_foot")
        if place is None or part.acc is None:
            raise RecordingError(f"{path.name} has no column left_sensor or right_sensor, and no side in its name")
        time = np.arange(len(part.gyr)) / rate_hz
        sensors[place], _ = foot_imu(path.name, time, np.deg2rad(part.gyr), part.acc)
    return {f"foot_{side}": sensors[f"foot_{side}"] for side in SIDES if f"foot_{side}" in sensors}


def _add_reference(
    details: dict[str, Any], time: np.ndarray, rate_hz: float, files: Files
) -> tuple[Estimate | None, str | None]:
    """Add motion capture and strides to `details`; returns the reference, and why there is none."""
    _add_borders(details, "stride_borders_sample.csv", files)
    try:
        path = files.need(f"{ROOT}/mocap_sample.csv")
    except registry.DatasetUnavailable as error:
        return None, str(error)
    details["mocap"] = _read_mocap(path)
    samples = len(details["mocap"]["right"]["heel"])
    mocap_time = details["mocap_time"] = np.arange(samples) / MOCAP_HZ
    events = files.find(f"{ROOT}/stride_events_sample.csv")
    if events is not None:
        details["events"] = _read_by_foot(events, EVENTS)
        details["strides"] = _strides(details["events"], details["mocap"], mocap_time, rate_hz)
    heels = [markers["heel"][:, :2] for markers in details["mocap"].values()]
    walked = path_walked(np.mean(heels, axis=0), MOCAP_HZ, PATH_SMOOTHING)
    estimate = Estimate(
        time=time,
        legs=Legs(None, None),
        stddev=None,
        distance=np.interp(time, mocap_time, walked),
        valid=time <= mocap_time[-1],
        diagnostics={"source": "path of the middle of the heel markers"},
        strides=_table(details["events"], details["strides"], rate_hz) if details["strides"] else None,
        feet=Feet(*(_foot(details["mocap"][side], mocap_time, time) for side in SIDES)),
    )
    return estimate, None


def _add_borders(details: dict[str, Any], file: str, files: Files) -> None:
    path = files.find(f"{ROOT}/{file}")
    if path is None:
        return
    borders = _read_by_foot(path, ("start", "end"))
    details["stride_borders"] = {
        side: np.stack([of["start"], of["end"]], axis=1).astype(np.int64) for side, of in borders.items()
    }


def _read_mocap(path: Path) -> dict[str, dict[str, np.ndarray]]:
    """Side → marker → (M, 3) [m]."""
    import pandas as pd

    table = pd.read_csv(path, header=[0, 1], index_col=0)
    wanted = {side: {key: f"{side[0].upper()}_{marker}" for key, marker in MARKERS.items()} for side in SIDES}
    lacking = [column for of in wanted.values() for column in of.values() if column not in table.columns]
    if lacking:
        raise RecordingError(f"{path.name} has no marker {lacking[0]}")
    return {
        side: {key: table[column][["x", "y", "z"]].to_numpy(np.float64) / 1000.0 for key, column in of.items()}
        for side, of in wanted.items()
    }


def _read_by_foot(path: Path, names: tuple[str, ...]) -> dict[str, dict[str, np.ndarray]]:
    table = reading.table(path, ("foot", *names))
    return {
        side: {name: table.loc[table["foot"] == side, name].to_numpy(np.float64) for name in names} for side in SIDES
    }


def _strides(
    events: dict[str, dict[str, np.ndarray]],
    mocap: dict[str, dict[str, np.ndarray]],
    mocap_time: np.ndarray,
    rate_hz: float,
) -> dict[str, dict[str, np.ndarray]]:
    """Length, width, time and stance fraction of every stride of the events."""
    stands = {side: np.unique(np.concatenate([of["start"], of["end"]])) / rate_hz for side, of in events.items()}
    ways = {}
    for side, of in events.items():
        heel = mocap[side]["heel"]
        ways[side] = (_at(heel, mocap_time, of["start"] / rate_hz), _at(heel, mocap_time, of["end"] / rate_hz))
    whole = np.concatenate([end - start for start, end in ways.values()])
    walkway = np.linalg.svd(whole, full_matrices=False)[2][0]
    typical = np.median(np.linalg.norm(whole, axis=1))
    strides = {}
    for side, of in events.items():
        start, end = ways[side]
        length = np.linalg.norm(end - start, axis=1)
        other = "left" if side == "right" else "right"
        cosine = np.abs((end - start) @ walkway) / np.maximum(length, 1e-9)
        first, last = of["start"] / rate_hz, of["end"] / rate_hz
        width, step = _across(first, last, stands[other], mocap[side]["heel"], mocap[other]["heel"], mocap_time)
        heights = mocap[side]["heel"][:, 2]
        strides[side] = {
            "length": length,
            "width": width,
            "width_toe": _across(first, last, stands[other], mocap[side]["toe"], mocap[other]["toe"], mocap_time)[0],
            "step_length": step,
            "height": np.interp(last, mocap_time, heights) - np.interp(first, mocap_time, heights),
            "time": (of["ic"] - of["pre_ic"]) / rate_hz,
            "stance_fraction": (of["tc"] - of["pre_ic"]) / (of["ic"] - of["pre_ic"]),
            "straight": (cosine > np.cos(STRAIGHT)) & (length > SHORT * typical),
        }
    return strides


def _across(
    first: np.ndarray, last: np.ndarray, stands: np.ndarray, this: np.ndarray, other: np.ndarray, mocap_time: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Position of the other foot's standing marker: distance from the line of each stride, and along the line [m].

    NaN where the other foot does not stand during the stride.
    """
    start, end = _at(this, mocap_time, first), _at(this, mocap_time, last)
    width, step = np.full(len(start), np.nan), np.full(len(start), np.nan)
    for k, (begins, ends) in enumerate(zip(first, last, strict=True)):
        between = stands[(stands > begins) & (stands < ends)]
        way = end[k] - start[k]
        if len(between) and np.linalg.norm(way) > 0:
            there = _at(other, mocap_time, between[:1])[0] - start[k]
            width[k] = abs(way[0] * there[1] - way[1] * there[0]) / np.linalg.norm(way)
            step[k] = way @ there / np.linalg.norm(way)
    return width, step


def _table(
    events: dict[str, dict[str, np.ndarray]], strides: dict[str, dict[str, np.ndarray]], rate_hz: float
) -> Strides:
    """The strides of both feet of the reference, from contact to contact."""
    times = {name: np.concatenate([events[side][name] for side in SIDES]) / rate_hz for name in EVENTS}
    of = {name: np.concatenate([strides[side][name] for side in SIDES]) for name in strides["right"]}
    length, standing, standing_end = of["length"], times["start"], times["end"]
    return Strides(
        side=np.repeat([0, 1], [len(strides[side]["length"]) for side in SIDES]), start=times["pre_ic"],
        final_contact=times["tc"], end=times["ic"], length=length, width=of["width"], height=of["height"],
        valid=np.ones(length.size, bool), standing=standing, standing_end=standing_end,
        speed=length / (standing_end - standing), step_length=of["step_length"],
    )  # fmt: skip


def _foot(markers: dict[str, np.ndarray], mocap_time: np.ndarray, time: np.ndarray) -> FootTrajectory:
    """The mean of a foot's markers on the clock of the sensors; constant after the end of the motion capture."""
    middle = np.mean(list(markers.values()), axis=0)
    position = np.stack([np.interp(time, mocap_time, middle[:, axis]) for axis in range(3)], axis=1)
    return FootTrajectory(position, None, None)


def _at(marker: np.ndarray, mocap_time: np.ndarray, time: np.ndarray) -> np.ndarray:
    """(n, 2) [m] horizontal position at given times."""
    return np.stack([np.interp(time, mocap_time, marker[:, axis]) for axis in (0, 1)], axis=1)
