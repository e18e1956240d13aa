"""gaitmap's and mobgap's data: frames and units (held to the libraries themselves in test_peer_tables)."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from made import files as made_files

from jgait import datasets, io
from jgait.types import RecordingError

GAITMAP = ["acc_pa", "acc_ml", "acc_si", "gyr_pa", "gyr_ml", "gyr_si"]
MOBGAP = ["acc_is", "acc_ml", "acc_pa", "gyr_is", "gyr_ml", "gyr_pa"]


def test_gaitmaps_sensors():
    tables = {"right_sensor": made_files.frame(), "left_sensor": made_files.frame(-1.0)}
    for given in (tables, pd.concat(tables, axis=1)):
        recording = io.recording_from_gaitmap(given, 100.0, name="w", subject="s")
        made_files.check(recording)
        np.testing.assert_allclose(recording.sensors["foot_left"].gyr, -made_files.walk()[1], atol=1e-12)
        assert (recording.name, recording.subject, recording.sampling_rate_hz) == ("w", "s", 100.0)
    other = io.recording_from_gaitmap({"a": tables["right_sensor"]}, 100.0, placements={"a": "shank_left"})
    made_files.check(other, "shank_left")


def test_mobgaps_sensor():
    table = made_files.frame()
    recording = io.recording_from_mobgap(table, 100.0)
    made_files.check(recording, "lower_back")
    made_files.check(io.recording_from_mobgap(table.set_axis(MOBGAP, axis=1), 100.0, placement="waist"), "waist")
    with pytest.raises(RecordingError, match="lacks gyr_x.*: expected columns .* found .*'acc_gx'"):
        io.recording_from_mobgap(table.rename(columns=lambda name: name.replace("_", "_g")), 100.0)
    with pytest.raises(RecordingError, match="w lacks gyr_ml: expected columns .*'gyr_is'"):
        io.recording_from_mobgap(table.set_axis(MOBGAP, axis=1).drop(columns="gyr_ml"), 100.0, name="w")


def test_their_files(tmp_path):
    tables = {"right_sensor": made_files.frame(), "left_sensor": made_files.frame()}
    both = pd.concat(tables, axis=1, names=["sensor", "axis"])
    for name, more in (("gaitmap.csv", {}), ("plain.csv", {"index": False})):
        both.to_csv(tmp_path / name, **more)
        recording = io.read(tmp_path / name, sampling_rate_hz=100.0)
        made_files.check(recording)
        made_files.check(recording, "foot_left")
    both.to_parquet(tmp_path / "gaitmap.parquet")
    made_files.check(io.read(tmp_path / "gaitmap.parquet", sampling_rate_hz=100.0))
    made_files.frame().set_axis(MOBGAP, axis=1).to_csv(tmp_path / "mobgap.csv")
    made_files.check(io.read(tmp_path / "mobgap.csv", sampling_rate_hz=100.0), "lower_back")
    with pytest.raises(RecordingError, match="states neither time stamps nor a sampling rate"):
        io.read(tmp_path / "mobgap.csv")


@pytest.mark.parametrize("dates", [True, False])
@pytest.mark.parametrize("library", ["gaitmap", "mobgap"])
def test_their_times_are_read_and_hold_the_rate(tmp_path, library, dates):
    time, table = made_files.walk()[0], made_files.frame()
    index = pd.Timestamp("2026-05-03 10:00") + pd.to_timedelta(time, unit="s") if dates else time
    table = table.set_axis(pd.Index(index, name="time"))
    if library == "gaitmap":
        table = pd.concat({"right_sensor": table, "left_sensor": table}, axis=1)
        read, where = io.recording_from_gaitmap, "foot_right"
    else:
        table, read, where = table.set_axis(MOBGAP, axis=1), io.recording_from_mobgap, "lower_back"
    table.to_csv(tmp_path / "whole.csv")
    lossy = table.drop(table.index[[60, 61]])
    lossy.to_csv(tmp_path / "lossy.csv")
    made_files.check(io.read(tmp_path / "whole.csv"), where)
    made_files.check(read(table, 100.0), where)
    for recording in (io.read(tmp_path / "lossy.csv"), read(lossy, 100.0)):
        assert list(np.flatnonzero(~made_files.check(recording, where))) == [60, 61]
    for wrong in (lambda: io.read(tmp_path / "whole.csv", sampling_rate_hz=128.0), lambda: read(table, 128.0)):
        with pytest.raises(RecordingError, match="the time stamps run at 100 Hz, but sampling_rate_hz is 128"):
            wrong()


def test_a_unit_that_names_imply_is_held_against_the_signals(tmp_path):
    table = made_files.frame().set_axis(MOBGAP, axis=1)
    rates = [name for name in table if name.startswith("gyr")]
    table[rates] = np.deg2rad(table[rates])
    table.to_csv(tmp_path / "walk.csv", index=False)
    with pytest.raises(
        RecordingError, match="too slow for walking: the gyroscopes seem to be in rad/s; pass gyr_unit="
    ):
        io.read(tmp_path / "walk.csv", sampling_rate_hz=100.0)
    made_files.check(io.read(tmp_path / "walk.csv", sampling_rate_hz=100.0, gyr_unit="rad/s"), "lower_back")


def test_a_real_file_of_gaitmaps(data):
    data("gaitmap_example", "imu_sample")
    file = Path(datasets.path("gaitmap_example")) / "example_data" / "imu_sample.csv"
    recording = io.read(file, sampling_rate_hz=204.8)
    table = pd.read_csv(file, header=[0, 1], index_col=0)
    names = list(made_files.frame().columns)
    for side in ("right", "left"):
        imu, raw = recording.sensors[f"foot_{side}"], table[f"{side}_sensor"][names].to_numpy()
        np.testing.assert_allclose(imu.gyr, np.deg2rad(raw[:, 3:]), atol=1e-12)
        np.testing.assert_array_equal(imu.acc, raw[:, :3])
    same = io.recording_from_gaitmap(table, 204.8)
    np.testing.assert_array_equal(same.sensors["foot_left"].gyr, recording.sensors["foot_left"].gyr)
