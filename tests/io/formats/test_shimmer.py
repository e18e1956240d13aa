"""Shimmer's Consensys CSV: units, several devices, which accelerometer, what is refused."""

import numpy as np
import pytest
from made import files as made_files
from made.notes import texts

from jgait import io
from jgait.types import RecordingError


@pytest.mark.parametrize("separator", ["\t", ","])
def test_a_written_file_is_the_known_walk(tmp_path, separator):
    path = made_files.shimmer(tmp_path / "a.csv", separator=separator)
    recording = io.read(path, placement="foot_right")
    assert made_files.check(recording).all()
    assert recording.sampling_rate_hz == pytest.approx(100.0, abs=1e-3)
    assert "Shimmer_8665: Accel_LN taken" in texts(recording.notes)


def test_decimal_commas_between_semicolons(tmp_path):
    path = made_files.shimmer(tmp_path / "a.csv", separator=";")
    path.write_text(path.read_text().replace(".", ","))
    made_files.check(io.read(path, placement="foot_right"))


def test_devices_that_are_called_by_their_places(tmp_path):
    recording = io.read(made_files.shimmer(tmp_path / "a.csv", devices=("RightFoot", "L_shank", "Spare")))
    assert sorted(recording.sensors) == ["foot_right", "shank_left"]
    made_files.check(recording, "shank_left")
    assert "left out: 'Spare' (its place is not known)" in texts(recording.notes)


def test_the_wide_range_accelerometer_where_the_other_is_at_its_limit(tmp_path):
    _, _, acc = made_files.walk()
    assert np.abs(acc).max() > 2 * made_files.G  # the foot's is
    recording = io.read(made_files.shimmer(tmp_path / "a.csv", wide=acc), placement="foot_right")
    made_files.check(recording)
    assert any("Accel_WR taken, for Accel_LN is at its limit" in note for note in texts(recording.notes))
    path = made_files.shimmer(tmp_path / "b.csv", wide=0.5 * acc)
    clipped = path.read_text().replace("Accel_WR", "Accel_Other")
    path.write_text(clipped)
    alone = io.read(path, placement="foot_right").sensors["foot_right"].acc
    np.testing.assert_allclose(alone, np.clip(acc, -2 * made_files.G, 2 * made_files.G), atol=1e-9)


def test_uncalibrated_signals_are_refused(tmp_path):
    with pytest.raises(RecordingError, match=r"gyroscope of Shimmer_8665 is not calibrated \(found RAW, expected CAL"):
        io.read(made_files.shimmer(tmp_path / "a.csv", kind="RAW"), placement="foot_right")
    path = made_files.shimmer(tmp_path / "b.csv")
    path.write_text(path.read_text().replace("LN_X_CAL", "LN_X_RAW").replace("LN_Y_CAL", "LN_Y_RAW"))
    path.write_text(path.read_text().replace("LN_Z_CAL", "LN_Z_RAW"))
    with pytest.raises(RecordingError, match="accelerometer of Shimmer_8665 is not calibrated"):
        io.read(path, placement="foot_right")


def test_times_of_day(tmp_path):
    time, _, _ = made_files.walk()
    path = made_files.shimmer(tmp_path / "a.csv")
    lines = path.read_text().replace("Timestamp_Unix", "TimestampSync_FormattedUnix").splitlines()
    days = np.datetime64("2021-06-01T10:11:12.000") + np.round(1e3 * time).astype("timedelta64[ms]")
    stamps = [str(day).replace("T", " ").replace("-", "/") for day in days]
    lines[3:] = [f"{at}\t{line.split(chr(9), 1)[1]}" for at, line in zip(stamps, lines[3:], strict=True)]
    made_files.check(io.read(made_files.put(path, lines), placement="foot_right"))
    lines[10] = "soon\t" + lines[10].split("\t", 1)[1]
    with pytest.raises(RecordingError, match="must hold times of day; found 'soon'"):
        io.read(made_files.put(path, lines), placement="foot_right")
