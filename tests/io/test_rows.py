"""A file that ends within a row, lines above the header and units below it, as they are stated."""

import numpy as np
import pytest
from made.frames import table
from made.notes import of_code, texts

from jgait import io
from jgait.types import RecordingError


def written(tmp_path, text):
    path = tmp_path / "walk.csv"
    path.write_text(text)
    return io.read_csv(path)


def cut_notes(recording):
    return [note for note in recording.notes if "ends within a row" in note.text]


def text_of(frame=None, **options):
    return (table() if frame is None else frame).to_csv(index=False, float_format="%.5f", **options)


@pytest.mark.parametrize("end", ["", "\n", "\r\n\n"])
def test_a_last_row_with_fewer_cells_is_left_out_and_noted(tmp_path, end):
    whole = text_of()
    lines = whole.splitlines()
    last = lines[-1].split(",")
    recording = written(tmp_path, "\n".join([*lines[:-1], ",".join([*last[:4], last[4][:3]])]) + end)
    (note,) = cut_notes(recording)
    assert note.values["line"] == 601 and note.values["rows"] == 599
    assert f"line 601 has 5 of 13 values, the last of them '{last[4][:3]}'; this row is left out" in note.text
    assert not [one for one in recording.notes if "missing" in one.code]
    assert all(imu.mask.all() and len(imu.time) == 599 for imu in recording.sensors.values())
    expected = written(tmp_path, "\n".join(lines[:-1]) + "\n")
    assert cut_notes(expected) == []
    np.testing.assert_array_equal(recording.sensors["shank_right"].acc, expected.sensors["shank_right"].acc)


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_whole_files_are_not_noted(tmp_path, separator):
    text = text_of(sep=separator)
    for same in (text, text.rstrip("\n"), text + "\n\n"):
        recording = written(tmp_path, same)
        assert cut_notes(recording) == [] and len(recording.sensors["shank_right"].time) == 600
    ranged = table().assign(feet_range=np.where(np.arange(600) % 7 == 0, 0.2, np.nan))
    assert cut_notes(written(tmp_path, ranged.to_csv(index=False, sep=separator).rstrip("\n"))) == []


def test_lines_above_the_header_and_comments_are_left_out_and_noted(tmp_path):
    expected = written(tmp_path, text_of())
    for above in (
        "# recorded 2026\n# rate, 100\n",
        "Subject: 12,,,,\nRate [Hz]: 100,,,,\n\n",
        "Name" + 12 * "," + "\n\n",
    ):
        recording = written(tmp_path, above + text_of())
        lines = sum(map(bool, above.splitlines()))
        assert f"lines above the header not read: {lines}: {above.splitlines()[0]}, …" in texts(recording.notes)
        np.testing.assert_array_equal(recording.sensors["shank_right"].acc, expected.sensors["shank_right"].acc)
    saved = written(tmp_path, "# made by a program\n# " + text_of())  # as by numpy.savetxt
    np.testing.assert_array_equal(saved.sensors["shank_right"].acc, expected.sensors["shank_right"].acc)
    path = tmp_path / "walk.csv"
    path.write_text("Subject: 12;;\nRate [Hz]: 100;;\n" + text_of(sep=";", decimal=","))
    np.testing.assert_array_equal(io.read(path).sensors["shank_right"].acc, expected.sensors["shank_right"].acc)


def test_a_row_of_units_below_the_header_sets_them_or_agrees(tmp_path):
    head, *lines = text_of(table().assign(time=1000 * table().time)).splitlines()
    units = ",".join(["[ms]"] + 2 * (3 * ["deg/s"] + 3 * ["m/s²"]))
    expected = written(tmp_path, text_of())
    for header in (head, head.replace("gyr_x", "gyr_x (deg/s)").replace("time", "time_ms")):
        recording = written(tmp_path, "\n".join([header, units, *lines]))
        np.testing.assert_allclose(recording.sensors["shank_right"].gyr, expected.sensors["shank_right"].gyr)
        for stated in ("the row below the header has units: ", "units by the header: "):
            assert any(text.startswith(stated) for text in texts(recording.notes))
        assert not of_code(recording.notes, "data_lost")
    for right, wrong in (("gyr_x", "gyr_x (rad/s)"), ("time", "time_us")):
        with pytest.raises(RecordingError, match="in the row below the header; correct one of the two units"):
            written(tmp_path, "\n".join([head.replace(right, wrong), units, *lines]))
