"""Movella DOT CSV: units, the clock of 32 bits, names that users give, what is refused."""

import numpy as np
import pytest
from made import files as made_files
from made.notes import texts

from jgait import io
from jgait.types import RecordingError


@pytest.mark.parametrize("tear", [",Acc_X", "Acc_X", "cc_X"])
def test_a_header_that_is_torn_in_two_is_joined(tmp_path, tear):
    path = made_files.dot(tmp_path / "a.csv")
    path.write_text(path.read_text().replace(tear, f"\n{tear}", 1) if tear != "Acc_X" else
                    path.read_text().replace(",Acc_X", ",\nAcc_X", 1))  # fmt: skip
    made_files.check(io.read(path))


def test_a_written_file_is_the_known_walk_and_its_tag_the_placement(tmp_path):
    # The clock wraps after a second.
    recording = io.read(made_files.dot(tmp_path / "a.csv", start=2**32 - 1_000_000))
    assert made_files.check(recording).all()
    assert "the sensor 'Right foot' is taken to have sat at foot_right" in texts(recording.notes)
    assert recording.sampling_rate_hz == pytest.approx(100.0)


def test_without_time_stamps_without_facts_above_the_header_and_in_windows_own_code(tmp_path):
    path = made_files.dot(tmp_path / "a.csv", stamps=False)
    recording = io.read(path)
    made_files.check(recording)
    assert recording.sampling_rate_hz == 100.0  # as stated
    lines = made_files.dot(path).read_text().splitlines()
    made_files.put(path, lines[next(k for k, line in enumerate(lines) if line.startswith("PacketCounter")) :])
    made_files.check(io.read(path, placement="foot_right"))
    made_files.dot(path)
    path.write_bytes(path.read_text(encoding="utf-8").encode("cp1252"))
    made_files.check(io.read(path))


def test_a_folder_of_sensors_on_one_clock(tmp_path):
    made_files.dot(tmp_path / "1.csv")
    made_files.dot(tmp_path / "2.csv", tag="Left foot", start=50_000)
    (tmp_path / "notes.csv").write_text("a,b\n1,2\n")
    recording = io.read(tmp_path)
    assert sorted(recording.sensors) == ["foot_left", "foot_right"]
    # What begins 50 ms later is behind by five samples.
    _, gyr, _ = made_files.walk()
    np.testing.assert_allclose(recording.sensors["foot_right"].gyr, gyr[5:], atol=1e-9)
    np.testing.assert_allclose(recording.sensors["foot_left"].gyr, gyr[:-5], atol=1e-9)


def test_sensors_with_the_same_tag_are_called_by_their_files(tmp_path):
    for name in ("one.csv", "two.csv"):
        made_files.dot(tmp_path / name, tag="Xsens DOT")
    made_files.check(io.read(tmp_path, placements={"one": "foot_right", "two": "foot_left"}))
    with pytest.raises(RecordingError, match=r"its sensors are \['one', 'two'\]"):
        io.read(tmp_path)


def test_clocks_that_were_not_synchronised_are_not_joined(tmp_path):
    made_files.dot(tmp_path / "1.csv")
    made_files.dot(tmp_path / "2.csv", tag="Left foot", synced="Unsynced")
    with pytest.raises(RecordingError, match=r"the clock of 2.csv was not synchronised .* 'Unsynced'"):
        io.read(tmp_path)
    made_files.check(io.read(tmp_path / "2.csv"), "foot_left")


def test_acceleration_without_gravity_and_increments_are_refused(tmp_path):
    with pytest.raises(RecordingError, match="a.csv holds only acceleration from which gravity was taken off"):
        io.read(made_files.dot(tmp_path / "a.csv", free_only=True))
    path = made_files.put(tmp_path / "a.csv", ["PacketCounter,SampleTimeFine,dq_W,dq_X,dq_Y,dq_Z,dv[1],dv[2],dv[3]",
                                               "1,2,1,0,0,0,0,0,0"])  # fmt: skip
    with pytest.raises(RecordingError, match="holds increments"):
        io.read(path, placement="foot_right")
