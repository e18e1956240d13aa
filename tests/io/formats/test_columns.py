"""Tables with columns named as here: units told from the signals, one sensor a file, Parquet."""

import numpy as np
import pandas as pd
import pytest
from made import files as made_files
from made.notes import of_code, texts

from jgait import io
from jgait.types import Imu, RangeReadings, Recording, RecordingError


def named(folder):
    """The known walk in a file, and its table."""
    path = made_files.named(folder / "walk.csv")
    return path, pd.read_csv(path)


@pytest.mark.parametrize("unit", ["", " (deg/s)"])
def test_sensors_that_are_named_by_no_place_are_placed_by_the_caller(tmp_path, unit):
    path, table = named(tmp_path)
    spelt = {c: c.replace("foot_right", "IMU1").replace("gyr", "Gyro") for c in table}
    table = table.rename(columns={c: new + (unit if "Gyro" in new else "") for c, new in spelt.items()})
    table.assign(**{f"IMU10_Gyro_{axis}{unit}": 0.0 for axis in "xyz"}).to_csv(path, index=False)
    recording = io.read(path, placements={"IMU1": "foot_right"})
    assert made_files.check(recording).all()
    assert list(recording.sensors) == ["foot_right"]
    assert "left out: 'IMU10' (its place is not known)" in texts(recording.notes)
    assert not any("head_" in text for text in texts(recording.notes))
    asked = io.read(path, placements={"IMU1": "foot_right", "IMU10": "none"})
    assert list(asked.sensors) == ["foot_right"] and "left out: 'IMU10' (as asked)" in texts(asked.notes)
    with pytest.raises(RecordingError, match="there is no placement 'footright'; did you mean 'foot_right'?"):
        io.read(path, placements={"IMU1": "footright"})
    with pytest.raises(RecordingError, match=r"pass placements=.*; its sensors are IMU1, IMU10; places are waist"):
        io.read(path)
    with pytest.raises(RecordingError, match="io.read and the commands place sensors by placements={'IMU1': 'PLACE'"):
        io.read_csv(path)


@pytest.mark.parametrize("name", ["PacketCounter", "time"])
def test_numbers_of_samples_are_a_clock_if_the_rate_is_given(tmp_path, name):
    path, table = named(tmp_path)
    count = (np.arange(len(table)) + 2**16 - 50) % (2**16 if name == "PacketCounter" else 2**20)
    table.rename(columns={"time": name}).assign(**{name: count}).drop(index=[60, 61]).to_csv(path, index=False)
    recording = io.read(path, sampling_rate_hz=100.0)
    assert list(np.flatnonzero(~made_files.check(recording))) == [60, 61]
    again = io.recording_from_dataframe(pd.read_csv(path), sampling_rate_hz=100.0)
    np.testing.assert_array_equal(again.sensors["foot_right"].mask, recording.sensors["foot_right"].mask)
    with pytest.raises(RecordingError, match="give sampling_rate_hz .a 'time' in steps of 1 counts the samples"):
        io.read(path)


@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize("spelt", ["foot_right_{kind}_{n}{unit}", "{kind}{n}{unit}", "Foot R {kind} {n}{unit}"])
def test_axes_that_are_numbered_are_x_y_z(tmp_path, spelt, first):
    path, table = named(tmp_path)
    words, units = {"gyr": "Gyro", "acc": "Acc"}, {"gyr": " [deg/s]", "acc": " (m/s²)"}
    table.columns = [
        spelt.format(kind=words[c.split("_")[2]], n=first + "xyz".index(c[-1]), unit=units[c.split("_")[2]])
        if c != "time" else c for c in table
    ]  # fmt: skip
    table.to_csv(path, index=False)
    made_files.check(io.read(path, placement="foot_right"))
    made_files.check(io.read_csv(path, placement=None if "oot" in spelt else "foot_right"))
    more = spelt.format(kind="Gyro", n=first + 3, unit=units["gyr"])  # four sensors with one axis each
    table.assign(**{more: 0.0}).to_csv(path, index=False)
    with pytest.raises(RecordingError, match="no column that is recognised|lacks"):
        io.read(path, placement="foot_right")


def test_one_sensor_a_file(tmp_path):
    for name in ("foot_right.csv", "Left Foot.csv"):
        made_files.named(tmp_path / name, prefix="", time=False)
    (tmp_path / "readme.csv").write_text("nothing\n1\n")
    recording = io.read(tmp_path, sampling_rate_hz=100.0)
    assert sorted(recording.sensors) == ["foot_left", "foot_right"]
    made_files.check(recording, "foot_left")
    path = made_files.named(tmp_path / "sensor7.csv", prefix="")
    with pytest.raises(RecordingError, match=r"does not state where its sensors sat: pass placements=\{'sensor7'"):
        io.read(path)
    made_files.check(io.read(path, placement="shank_left"), "shank_left")
    made_files.check(io.read({"thigh_left": path}), "thigh_left")


def dated(folder, starts, form="%Y-%m-%d %H:%M:%S.%f"):
    """Files of one sensor each, of the same walk, that begin some rows late, with dates."""
    for place, start in starts.items():
        path = made_files.named(folder / f"{place}.csv", prefix="")
        rows = pd.read_csv(path)
        stamps = pd.Timestamp("2026-05-03 10:00") + pd.to_timedelta(rows["time"], unit="s")
        rows.assign(time=stamps.dt.strftime(form) if form else rows["time"])[start:].to_csv(path, index=False)


@pytest.mark.parametrize("form", ["%Y-%m-%d %H:%M:%S.%f", "%d.%m.%Y %H:%M:%S.%f", "%H:%M:%S.%f", None])
def test_sensors_of_files_with_dates_are_on_one_clock(tmp_path, form):
    dated(tmp_path, {"foot_left": 0, "foot_right": 8, "shank_right": 3}, form)
    files = {place: tmp_path / f"{place}.csv" for place in ("foot_left", "foot_right", "shank_right")}
    for recording in (io.read(tmp_path), io.read(files)):
        assert {len(imu.time) for imu in recording.sensors.values()} == {len(made_files.walk()[0]) - 8}
        for imu in recording.sensors.values():
            np.testing.assert_allclose(imu.gyr, made_files.walk()[1][8:], atol=1e-6)
        starts = any("times count from the first sample" in text for text in texts(recording.notes))
        assert starts is (form in ("%H:%M:%S.%f", None))  # a date is no number that could be added
        dates = [note.values["date"] for note in of_code(recording.notes, "clock_begins") if "date" in note.values]
        assert dates == ([] if starts else ["2026-05-03 10:00:00.080"])


def test_a_quiet_sensor_has_the_unit_of_the_others(tmp_path):
    path, table = named(tmp_path)
    for axis in "xyz":
        table[f"sternum_gyr_{axis}"] = 0.01 * table[f"foot_right_gyr_{axis}"]
    table.to_csv(path, index=False)
    recording = io.read(path)
    np.testing.assert_allclose(recording.sensors["sternum"].gyr, 0.01 * made_files.walk()[1], atol=1e-9)
    assert "sternum: the file states no unit of angular rate; deg/s, as foot_right" in texts(recording.notes)
    for axis in "xyz":
        table[f"sternum_gyr_{axis}"] *= 0.2
    table[["time", *(f"sternum_gyr_{axis}" for axis in "xyz")]].to_csv(path, index=False)
    with pytest.raises(RecordingError, match="the size of sternum does not decide"):
        io.read(path)


def with_range():
    time, gyr, acc = made_files.walk()
    mask = np.ones(len(time), bool)
    mask[40:43] = False
    heard = np.arange(len(time)) % 5 == 0
    apart = np.where(heard, 0.2 + 0.05 * np.sin(time), 0.0)
    imu = Imu(time, np.where(mask[:, None], gyr, 0.0), acc, mask)
    return Recording({"foot_right": imu}, 100.0, "w", feet_range=RangeReadings(time, apart, heard))


@pytest.mark.parametrize("ending", ["csv", "parquet", "pq"])
def test_a_written_recording_reads_back(tmp_path, ending):
    recording = with_range()
    again = io.read(io.write_table(recording, tmp_path / f"walk.{ending}"))
    kept = made_files.check(again)
    assert list(np.flatnonzero(~kept)) == [40, 41, 42]
    np.testing.assert_array_equal(again.feet_range.mask, recording.feet_range.mask)
    np.testing.assert_allclose(again.feet_range.distance, recording.feet_range.distance, atol=1e-9)
    assert any(note.startswith("feet_range: the file states no unit of distances; m") for note in texts(again.notes))


@pytest.mark.parametrize(
    ("kind", "per_unit"),
    [("gyr", 16.4), ("gyr", 131.0), ("acc", 2048.0 / made_files.G), ("acc", 1024.0 / made_files.G)],
)
def test_whole_numbers_without_a_unit_are_counts(tmp_path, kind, per_unit):
    path, table = named(tmp_path)
    for name in (name for name in table if f"_{kind}_" in name):
        table[name] = (table[name] * per_unit).round()
    table.to_csv(path, index=False)
    for read in (io.read, io.read_csv):
        with pytest.raises(RecordingError, match=f"has whole numbers and no unit, .* state their unit by {kind}_unit$"):
            read(path)


@pytest.mark.parametrize("number", [-9999.0, -999.0, 1e6, -32768.0])
@pytest.mark.parametrize("share", [0.004, 0.03])
def test_a_number_for_missing_samples_chooses_no_unit(tmp_path, number, share):
    path, table = named(tmp_path)
    rows = np.arange(20, 20 + max(round(share * len(table)), 2))
    signals = [name for name in table if name != "time"]
    table.loc[rows, signals] = number
    table.to_csv(path, index=False)
    kept = made_files.check(io.read(path))
    assert list(np.flatnonzero(~kept)) == list(rows)


@pytest.mark.parametrize(
    ("columns", "factor", "said"),
    [("_gyr_", 3.5, "unit of angular rate; deg/s"), ("_gyr_", 1e3 * np.pi / 180.0, "unit of angular rate; mrad/s"),
     ("_gyr_", 1e3, "unit of angular rate; mdeg/s"), ("_acc_", 1.0 / made_files.G, "unit of acceleration; g"),
     ("_acc_", 5.0, "the size of foot_right does not decide .median"), ("time", 1e3, "time taken to be in ms, because"),
     ("feet_range", 100.0, "size of feet_range does not decide .* use read_csv and give range_unit")],
)  # fmt: skip
def test_the_size_of_signals_decides_their_unit_or_does_not(tmp_path, columns, factor, said):
    path = io.write_table(with_range(), tmp_path / "walk.csv")
    table = pd.read_csv(path)
    names = [name for name in table if columns in name]
    table.assign(**{name: factor * table[name] for name in names}).to_csv(path, index=False)
    if "decide" in said:
        with pytest.raises(RecordingError, match=said):
            io.read(path)
    else:
        assert said in str(texts(io.read(path).notes))
