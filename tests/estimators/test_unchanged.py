"""Estimates of real recordings are those stored in `unchanged.json`, to rounding: moving code changes no number.

JGAIT_WRITE_UNCHANGED=1 python -m pytest -n 0 tests/estimators/test_unchanged.py writes the numbers anew; -k narrows
it down to the recordings and estimators that a change of method is meant to move. The commit that writes them says why.
"""

import json
import math
import os
import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from jgait import datasets
from jgait.estimators import ankle_stride, duty_cycled_gyro, foot_ins, leg_ekf, stride_width_ekf, waist
from jgait.types import RangeReadings, Recording, Walk

FILE = Path(__file__).with_name("unchanged.json")
WRITE = bool(os.environ.get("JGAIT_WRITE_UNCHANGED"))

MODULES = {
    "leg_ekf": leg_ekf, "foot_ins": foot_ins, "ankle_stride": ankle_stride, "waist": waist,
    "stride_width_ekf": stride_width_ekf, "duty_cycled_gyro": duty_cycled_gyro, "duty_cycled_gyro asleep":
    duty_cycled_gyro,
}  # fmt: skip
ASLEEP = duty_cycled_gyro.DEFAULT._replace(schedule=0.5, warm_up=6.0)
"""The shank's gyroscope sleeps half of the time after 6 s, so that the filler of gaps has something to fill."""


class Part(NamedTuple):
    """Which recordings of a data set, and how much of each."""

    names: tuple[str, ...]  #: of the recordings.
    seconds: float | None  #: length of the part from the first sample [s]; None: the whole recording.
    estimators: tuple[str, ...]  #: which can use them.


PARTS = {
    "neura_sparse": Part(("S02-Trial-Walk-1",), 20.0, (
        "leg_ekf", "foot_ins", "ankle_stride", "waist", "duty_cycled_gyro", "duty_cycled_gyro asleep")),
    "walking5m": Part(("Elderly/20180417_10", "Young/20180518_1"), None, (
        "leg_ekf", "foot_ins", "ankle_stride", "duty_cycled_gyro", "duty_cycled_gyro asleep")),
    "gaitmap_example": Part(("imu_sample", "imu_sample_healthy_stair_down"), 20.0, ("foot_ins",)),
    "gaitmap_example with a range": Part(("imu_sample", "imu_sample_not_rotated"), 20.0, ("stride_width_ekf",)),
    "tripod": Part(("Sub_FZ/PWS", "Sub_FZ/PWS+20"), 16.0, (
        "foot_ins", "ankle_stride", "waist", "duty_cycled_gyro", "duty_cycled_gyro asleep")),
    "footprints": Part(("SensorConnectData_31", "SensorConnectData_33"), 20.0, ("foot_ins",)),
    "pyshoe_vicon": Part(("2017-11-22-11-22-03", "2017-11-22-11-22-46"), 20.0, ("foot_ins",)),
    "xio_gait": Part(("short_walk",), 20.0, ("foot_ins",)),
    "ipol_gait": Part(("1-1", "2-1"), 20.0, ("foot_ins", "waist")),
    "mobgap_lab": Part(("HA/001/Test5/Trial1", "HA/001/Test5/Trial2"), None, ("waist",)),
}  # fmt: skip

OFTEN = ("neura_sparse", "gaitmap_example with a range", "mobgap_lab")
"""Parts with all estimators between them; the others belong to the release group."""

TOLERANCE = 1e-8
"""[1] Largest difference from a stored number, as a share of the mean absolute value of its array.

XLA's optimisations move the numbers by at most 1e-11: no estimator amplifies rounding beyond that.
"""

SAMPLES, FEWER = 5, 1
"""Values stored of an array beside its mean; fewer of times, standard deviations and diagnostics."""


def first(recording: Recording, seconds: float | None) -> Recording:
    """The recording up to a time after its first sample."""
    if seconds is None:
        return recording

    def cut(record: Any) -> Any:
        kept = np.asarray(record.time) < start + seconds
        return type(record)(*(None if values is None else np.asarray(values)[kept] for values in record))

    start = min(float(sensor.time[0]) for sensor in recording.sensors.values())
    sensors = {placement: cut(sensor) for placement, sensor in recording.sensors.items()}
    between = None if recording.feet_range is None else cut(recording.feet_range)
    return recording._replace(sensors=sensors, feet_range=between)


def with_range(walk: Walk) -> Recording:
    """The recording with a range at 30 Hz: the distance between the markers of both feet while it is below 0.25 m."""
    time = np.arange(0.0, walk.reference.time[-1], 1 / 30)
    right, left = (
        np.stack([np.interp(time, walk.reference.time, foot.position[:, axis]) for axis in range(3)], axis=1)
        for foot in (walk.reference.feet.right, walk.reference.feet.left)
    )
    distance = np.linalg.norm((right - left)[:, :2], axis=1)
    close = distance < 0.25
    return walk.recording._replace(feet_range=RangeReadings(time, np.where(close, distance, 0.0), close))


def person(walk: Walk, estimator: str) -> dict[str, Any]:
    """The person's measures that an estimator takes."""
    if estimator == "waist":
        known = {name: walk.info.get(name) for name in ("height", "sensor_height")}
        return {name: value for name, value in known.items() if value is not None and math.isfinite(value)}
    return datasets.body(walk) if estimator.startswith(("leg", "duty")) else {}


def estimate(part: str, name: str, walk: Walk) -> Any:
    module = MODULES[name]
    recording = first(with_range(walk) if "range" in part else walk.recording, PARTS[part].seconds)
    record = module.estimator()
    p = record.with_body(record.params, person(walk, name))
    return module.estimate(p, recording, ASLEEP if "asleep" in name else module.DEFAULT)


# --- what is stored of an estimate ---


def arrays(record: Any, prefix: str = "") -> dict[str, np.ndarray]:
    """Path, as "legs.right.x", → array, of every number in nested records and dictionaries."""
    if hasattr(record, "_asdict") or isinstance(record, dict):
        fields = record if isinstance(record, dict) else record._asdict()
        fields = {key: value for key, value in fields.items() if key != "notes"}
        return {path: leaf for key, value in fields.items() for path, leaf in arrays(value, f"{prefix}.{key}").items()}
    leaf = np.asarray(record) if record is not None else np.array("")
    return {prefix[1:]: leaf} if leaf.dtype.kind in "biuf" and leaf.size else {}


def fingerprint(values: np.ndarray, valid: np.ndarray, samples: int) -> list[Any]:
    """Shape; of counts and flags their sum; else finite values, mean absolute value, and samples spread over the rows.

    Of an array with a row for each sample of the recording only the valid rows count. The samples of a matrix go
    through its columns in turn.
    """
    shape = list(values.shape)
    if values.dtype.kind in "biu":
        return [shape, int(values.sum())]
    if not shape:
        return [shape, int(np.isfinite(values)), number(values)]
    rows = (values[valid] if shape[:1] == [valid.size] else values).reshape(-1, math.prod(shape[1:]))
    finite = rows[np.isfinite(rows)]
    at = np.unique(np.linspace(0, len(rows) - 1, samples + 2).round().astype(int)[1:-1]) if len(rows) else []
    picked = [number(rows[row, k % rows.shape[1]]) for k, row in enumerate(at)]
    return [shape, finite.size, number(np.mean(np.abs(finite))) if finite.size else 0.0, *picked]


def number(value: Any) -> float | None:
    return float(value) if math.isfinite(value) else None


def summary(result: Any) -> dict[str, list[Any]]:
    valid = np.asarray(result.valid)
    numbers = {path: fingerprint(values, valid, FEWER if re.search("stddev|diagnostics|time", path) else SAMPLES)
               for path, values in arrays(result).items()}  # fmt: skip
    if result.distance is not None:
        numbers["distance at the end"] = fingerprint(np.asarray(result.distance)[valid][-1], valid, 0)
    if result.strides is not None:
        numbers["sum of the lengths"] = fingerprint(np.nansum(result.strides.length), valid, 0)
    return numbers


def differences(stored: dict[str, list[Any]], result: dict[str, list[Any]]) -> dict[str, float]:
    """Path → largest difference of its numbers as a share of the array's mean; infinite where it is another array."""
    gaps = {}
    for path, before in stored.items():
        now = result.get(path, [])
        pairs = list(zip(before[2:], now[2:], strict=False))
        if before[:2] != now[:2] or len(before) != len(now) or any((a is None) != (b is None) for a, b in pairs):
            gaps[path] = math.inf
            continue
        largest = max((abs(a - b) for a, b in pairs if a is not None), default=0.0)
        gaps[path] = largest and (largest / abs(before[2]) if before[2] else math.inf)
    return gaps


# --- the test ---


@pytest.mark.parametrize(
    "part, name",
    [
        pytest.param(part, name, marks=[pytest.mark.release] * (part not in OFTEN))
        for part in PARTS
        for name in PARTS[part].estimators
    ],
    ids=lambda text: text,
)
def test_estimates_are_those_stored(data, part, name):
    names, seconds, _ = PARTS[part]
    data_set = part.split()[0]
    walks = data(data_set, *names)
    assert not walks.failures
    stored = json.loads(FILE.read_text()) if FILE.exists() else {}
    moved = {}
    for walk in walks:
        length = "whole" if seconds is None else f"first {seconds:g} s"
        key = f"{part} | {walk.recording.name}, {length} | {name}"
        result = summary(estimate(part, name, walk))
        if WRITE:
            stored[key] = result
            continue
        gaps = differences(stored[key], result)
        moved |= {f"{key} | {path}": gap for path, gap in gaps.items() if not gap <= TOLERANCE}
    if WRITE:
        write(stored)
        pytest.skip(f"written to {FILE.name}")
    assert not moved, "\n".join(f"{path}: by {gap:.2g} of the mean" for path, gap in moved.items())


def write(stored: dict[str, dict[str, list[Any]]]) -> None:
    """One line for each recording and estimator."""
    lines = (
        f"{json.dumps(key)}: {json.dumps(numbers, allow_nan=False, separators=(',', ':'))}"
        for key, numbers in sorted(stored.items())
    )
    FILE.write_text("{\n" + ",\n".join(lines) + "\n}\n")
