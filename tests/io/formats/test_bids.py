"""BIDS motion, written by this test as the specification says."""

import gzip
import json

import numpy as np
import pytest
from made.known_walk import GRAVITY, PLACES, RATE, SAMPLES, agrees, signals
from made.notes import texts

from jgait import RecordingError, io
from jgait.io.formats import bids, registry

POINTS = {"lower_back": "lowerBack", "foot_right": "rightFoot", "foot_left": "leftFoot"}
STEM = "sub-pp002_task-walk_tracksys-imu"
GYR_UNITS = {"rad/s": 1.0, "deg/s": 180.0 / np.pi, "n/a": 180.0 / np.pi}
ACC_UNITS = {"m/s^2": 1.0, "g": 1.0 / GRAVITY, "n/a": 1.0 / GRAVITY}


def table(points=POINTS, *, gyr_unit="rad/s", acc_unit="m/s^2", latency=None):
    """Rows of channels.tsv and columns of motion.tsv; the channels stand by kind, as in the examples of BIDS."""
    rows, columns = [], []
    if latency is not None:
        rows.append(["latency", "n/a", "LATENCY", "n/a", "s"])
        columns.append(latency)
    for kind, index, unit, factor in (
        ("ACCEL", 1, acc_unit, ACC_UNITS.get(acc_unit, 1.0)),
        ("GYRO", 0, gyr_unit, GYR_UNITS.get(gyr_unit, 1.0)),
    ):
        for place, point in points.items():
            for axis in (2, 0, 1):
                rows.append([f"{point}_{kind}_{'xyz'[axis]}", "xyz"[axis], kind, point, unit])
                columns.append(factor * signals(place)[index][:, axis])
    rows.append(["lowerBack_MAGN_x", "x", "MAGN", "lowerBack", "T"])
    columns.append(np.full(SAMPLES, 1e-5))
    return rows, np.stack(columns, axis=1)


def lines(rows):
    return "".join("\t".join(map(str, row)) + "\n" for row in rows)


def write(root, rows, values, *, about=None, extra=(), header=False, stem=STEM, head=None):
    """A data set with one walk; `extra`: name and values of more columns of channels.tsv."""
    folder = root / "sub-pp002" / "motion"
    folder.mkdir(parents=True, exist_ok=True)
    (root / "dataset_description.json").write_text("{}")
    names = head or ["name", "component", "type", "tracked_point", "units"]
    names = [*names, *(name for name, _ in extra)]
    body = [[*row, *(value for _, value in extra)] for row in rows]
    (folder / f"{stem}_channels.tsv").write_text(lines([names, *body]))
    if about is not None:
        (folder / f"{stem}_motion.json").write_text(json.dumps(about))
    text = lines([["n/a" if np.isnan(cell) else repr(float(cell)) for cell in row] for row in values])
    path = folder / f"{stem}_motion.tsv"
    path.write_text(("\t".join(row[0] for row in rows) + "\n" if header else "") + text)
    return path


@pytest.mark.parametrize("gyr_unit, acc_unit", [("rad/s", "m/s^2"), ("deg/s", "g"), ("n/a", "n/a")])
def test_every_sample_of_every_point_comes_back(tmp_path, gyr_unit, acc_unit):
    path = write(tmp_path, *table(gyr_unit=gyr_unit, acc_unit=acc_unit), about={"SamplingFrequency": RATE})
    assert registry.format_of(path) == "bids"
    recording = io.read(path)
    assert set(recording.sensors) == set(PLACES)
    for place in PLACES:
        agrees(recording.sensors[place], place)
    assert (recording.sampling_rate_hz, recording.subject, recording.name) == (RATE, "pp002", STEM)
    questioned = [note for note in texts(recording.notes) if "states no unit" in note]
    assert len(questioned) == (6 if gyr_unit == "n/a" else 0)


def test_latency_is_the_clock_and_lost_samples_are_masked(tmp_path):
    latency = np.arange(SAMPLES) / RATE + np.where(np.arange(SAMPLES) >= 100, 0.03, 0.0)
    rows, values = table({"lower_back": "lowerBack"}, latency=latency)
    values[40, 4] = np.nan
    imu = io.read(write(tmp_path, rows, values, about={"SamplingFrequency": RATE})).sensors["lower_back"]
    assert len(imu.time) == SAMPLES + 3
    assert list(np.flatnonzero(~imu.mask)) == [40, 100, 101, 102]
    np.testing.assert_allclose(imu.gyr[103:], signals("lower_back")[0][100:], atol=1e-12)


def test_what_lies_further_up_is_inherited_and_overruled(tmp_path):
    path = write(tmp_path, *table(), about={"SamplingFrequencyEffective": RATE})
    (tmp_path / "task-walk_motion.json").write_text(json.dumps({"SamplingFrequency": 1.04 * RATE}))
    (tmp_path / "task-run_motion.json").write_text(json.dumps({"SamplingFrequency": 7.0}))
    recording = io.read(path)
    agrees(recording.sensors["foot_left"], "foot_left")
    assert f"motion.json: SamplingFrequencyEffective {RATE:g} Hz beside {1.04 * RATE:g} Hz" in texts(recording.notes)
    channels = path.with_name(f"{STEM}_channels.tsv")
    channels.rename(tmp_path / "task-walk_tracksys-imu_channels.tsv")
    agrees(io.read(path).sensors["foot_left"], "foot_left")


def test_placement_status_and_other_systems_are_told(tmp_path):
    extra = [("placement", "left foot"), ("status", "bad")]
    rows, values = table({"foot_left": "imu3"})
    path = write(tmp_path, rows, values, about={"SamplingFrequency": RATE}, extra=extra)
    path.with_name("sub-pp002_task-walk_tracksys-omc_motion.tsv").write_text("0\n")
    recording = io.read(path)
    agrees(recording.sensors["foot_left"], "foot_left")
    every = "\n".join(texts(recording.notes))
    for said in (
        "imu3: at foot_left by the column placement",
        "calls imu3_ACCEL_z, imu3_ACCEL_x",
        "other systems too: sub-pp002_task-walk_tracksys-omc_motion.tsv",
        "lowerBack (no gyroscope)",
    ):
        assert said in every


def test_a_header_and_a_compressed_file_are_read_too(tmp_path):
    path = write(tmp_path, *table(), about={"SamplingFrequency": RATE}, header=True)
    packed = path.with_name(path.name + ".gz")
    packed.write_bytes(gzip.compress(path.read_bytes()))
    path.unlink()
    recording = io.read(packed)
    agrees(recording.sensors["foot_right"], "foot_right")
    assert any("has a header" in note for note in texts(recording.notes))


def replaced(rows, kind, position, value):
    """Rows of channels.tsv with another cell in those whose name has the kind."""
    return [[*row[:position], value, *row[position + 1 :]] if kind in row[0] else row for row in rows]


MALFORMED = {
    "columns": (lambda rows: {"rows": rows[:-1]}, f"{STEM}_motion.tsv has 7 columns, its channels.tsv 6 rows"),
    "about": (lambda rows: {"about": None}, "needs sub-pp002_task-walk_tracksys-imu_motion.json"),
    "axis": (
        lambda rows: {"rows": replaced(rows, "GYRO_y", 2, "MISC")},
        "GYRO of 'leftFoot' must have the components x, y and z, once each; it has z, x ",
    ),
    "unit": (
        lambda rows: {"rows": replaced(rows, "ACCEL", 4, "furlong")},
        "leftFoot_ACCEL_x .ACCEL. is in 'furlong'; expected one of m/s",
    ),
    "units": (lambda rows: {"rows": replaced(rows, "GYRO_x", 4, "deg/s")}, "must share a unit; they have deg/s, rad/s"),
    "gyroscope": (
        lambda rows: {"rows": replaced(rows, "GYRO", 2, "MISC")},
        "no gyroscope: expected channels of type GYRO, found ACCEL, MAGN, MISC",
    ),
    "head": (
        lambda rows: {"head": ["name", "component", "type", "point", "u"]},
        "lacks units; expected name, component, type, units",
    ),
    "json": (lambda rows: {"about": ""}, "_motion.json must be a JSON object; it is a str"),
}


@pytest.mark.parametrize("name", MALFORMED)
def test_malformed_files_are_named_with_what_was_expected(tmp_path, name):
    change, message = MALFORMED[name]
    rows, values = table({"foot_left": "leftFoot"})
    given = {"rows": rows, "about": {"SamplingFrequency": RATE}} | change(rows)
    with pytest.raises(RecordingError, match=message):
        bids.measured(write(tmp_path, given.pop("rows"), values, **given))
