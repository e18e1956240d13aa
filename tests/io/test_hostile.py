"""Files that declare more than a reader should make room for, lead into other files, or are none."""

import functools
import gzip
import json
import os
import re

import ezc3d
import h5py
import numpy as np
import pandas as pd
import pytest
import typer
from made import files as made_files
from scipy.io import savemat

from jgait import RecordingError, io
from jgait.commands import cohort_table, options
from jgait.estimators.leg_ekf.params import LegParams
from jgait.io import files
from jgait.notes import printable


def refuse(path, match, read=io.read):
    with pytest.raises(RecordingError, match=match) as told:
        read(path)
    assert path.name.partition(".")[0] in str(told.value)
    assert len(str(told.value)) <= RecordingError.LONGEST


def hdf5(path, write):
    with h5py.File(path, "w") as file:
        write(file.create_group("Sensors/XI-1"))
    return path


WALK = np.zeros((50_000, 3))


def bids(path):
    rows = "".join(f"\nG{axis}\t{axis}\tGYRO\tfoot\tdeg/s" for axis in "xyz")
    path.with_name(path.name.replace("_motion.tsv.gz", "_channels.tsv")).write_text(
        f"name\tcomponent\ttype\ttracked_point\tunits{rows}"
    )
    path.with_name(path.name.replace(".tsv.gz", ".json")).write_text('{"SamplingFrequency": 100}')
    path.write_bytes(gzip.compress(b"0\t0\t0\n" * 200_000))


def c3d(path):
    file = ezc3d.c3d()
    file["parameters"]["POINT"]["RATE"]["value"] = [100.0]
    file["parameters"]["POINT"]["LABELS"]["value"] = ["a", "b"]
    file["data"]["points"] = np.zeros((4, 2, 20_000))
    file.write(str(path))


FILES = {
    "walk.parquet": lambda path: pd.DataFrame(WALK, columns=[f"foot_right_gyr_{a}" for a in "xyz"]).to_parquet(path),
    "walk.h5": lambda path: hdf5(path, lambda group: group.create_dataset("Gyroscope", data=WALK, compression="gzip")),
    "walk.mat": lambda path: savemat(path, {"data": {"x": WALK}}, do_compression=True),
    "sub-1_task-walk_motion.tsv.gz": bids,
    "walk.csv": lambda path: path.write_text("time,a,b\n" + "1,2,3\n" * 50_000),
    "walk.c3d": c3d,
    "walk.mot": lambda path: path.write_text("nRows=9999\nendheader\ntime\tpelvis_tilt\n" + "1\t2\n" * 9999),
}
"""Name of a file → what writes it."""
READERS = {".c3d": io.read_c3d, ".mot": io.read_opensim}


@pytest.mark.parametrize("name", [name for name in FILES if name != "walk.mot"])
def test_a_file_that_declares_more_than_the_budget_is_refused_before_it_is_read(tmp_path, monkeypatch, name):
    """The files are small and good: the budget is smaller."""
    FILES[name](tmp_path / name)
    monkeypatch.setattr(files, "MOST_BYTES", 1_000_000)
    read = READERS.get((tmp_path / name).suffix, io.read)
    refuse(tmp_path / name, "declares a content of .* bytes; expected at most 1000000", read)


def test_a_small_file_that_declares_much_is_refused_before_it_is_read(tmp_path):
    """Of a constant signal, a file holds almost nothing."""
    rows = np.broadcast_to(np.zeros(1), 6_000_000)
    pd.DataFrame({f"foot_right_gyr_{a}": rows for a in "xyz"}).to_parquet(tmp_path / "walk.parquet")
    refuse(tmp_path / "walk.parquet", "declares a content of 144000000 bytes; expected at most 100000000")


@pytest.mark.parametrize("name", FILES)
def test_what_is_missing_empty_cut_off_or_something_else_gets_one_sentence(tmp_path, name):
    path = tmp_path / name
    read = READERS.get(path.suffix, io.read)
    with pytest.raises(FileNotFoundError, match=re.escape(name)):
        read(path)
    FILES[name](path)
    whole = path.read_bytes()
    for content in (b"", whole[:300], whole[: len(whole) // 2], b"frame,x\n" * 200, bytes(range(128, 256)) * 20):
        path.write_bytes(content)
        refuse(path, name.partition(".")[0], read)
    path.unlink()
    path.mkdir()
    refuse(path, "is a folder", read)


def test_a_pipe_is_no_file(tmp_path):
    os.mkfifo(tmp_path / "walk.csv")
    read_params = functools.partial(io.read_params, params=LegParams(), estimator="leg_ekf")
    for read in (io.read, io.read_csv, io.read_c3d, io.read_opensim, io.read_mobilised, io.read_table, read_params):
        refuse(tmp_path / "walk.csv", "not a regular file", read)
    os.mkfifo(tmp_path / "person.json")
    with pytest.raises(typer.Exit):
        options.person_in(tmp_path / "person.json")
    assert not cohort_table.is_cohort(tmp_path / "walk.csv")


@pytest.mark.parametrize("value", [float("nan"), float("inf"), "0.4", True, None, [], {}, -0.4, 0.0, 4.0])
def test_a_parameter_that_is_no_number_in_its_range_is_named(tmp_path, value):
    path = io.write_params(tmp_path / "p.json", LegParams(), estimator="leg_ekf")
    content = json.loads(path.read_text())
    content["parameters"]["shank_length.left"]["value"] = value
    path.write_text(json.dumps(content))
    with pytest.raises(RecordingError, match="shank_length.left must be (a finite number|0.2 to 0.7 m); it is"):
        io.read_params(path, LegParams(), estimator="leg_ekf")


@pytest.mark.parametrize("write", [made_files.named, made_files.dot, made_files.mtw, made_files.shimmer])
def test_one_very_long_line_is_refused_before_it_is_parsed(tmp_path, write):
    path = write(tmp_path / "MT_00B40C48.csv")
    path.write_text(path.read_text() + "1" * 1_000_001 + ",2\n")
    refuse(path, "a line of more than 1000000 characters", lambda path: io.read(path, placement="foot_right"))


@pytest.mark.parametrize("way", ["link", "external", "virtual"])
def test_hdf5_that_leads_into_another_file(tmp_path, way):
    (tmp_path / "secret").write_bytes(np.ones((100, 3)).tobytes())
    hdf5(tmp_path / "other.h5", lambda group: group.create_dataset("Gyroscope", data=np.ones((100, 3))))

    def write(group):
        if way == "link":
            group["Gyroscope"] = h5py.ExternalLink(str(tmp_path / "other.h5"), "/Sensors/XI-1/Gyroscope")
        elif way == "external":
            group.create_dataset("Gyroscope", (100, 3), "f8", external=[(str(tmp_path / "secret"), 0, 2400)])
        else:
            layout = h5py.VirtualLayout((100, 3), "f8")
            layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "Sensors/XI-1/Gyroscope", (100, 3))
            group.create_virtual_dataset("Gyroscope", layout)

    refuse(hdf5(tmp_path / "walk.h5", write), "in another file; expected one that holds")


def test_text_with_too_many_columns_or_too_long_lines(tmp_path):
    many = ",".join(f"time{n}" for n in range(20_000))
    (tmp_path / "many.csv").write_text(f"{many}\n" + "1," * 19_999 + "1\n")
    refuse(tmp_path / "many.csv", "20000 columns; expected at most", io.read_csv)
    (tmp_path / "long.csv").write_text("gyr" * 100_000 + ",time\n1,2\n")
    refuse(tmp_path / "long.csv", "a column name of 300000 characters", io.read_csv)
    (tmp_path / "wide.csv").write_text("time,a\n" + "," * 1_000_000 + "\n")
    refuse(tmp_path / "wide.csv", "a line of more than 1000000 characters", io.read_csv)
    dot = made_files.dot(tmp_path / "dot.csv")
    dot.write_text("a" + " " * 200_000 + "\n" + dot.read_text())
    made_files.check(io.read(dot, format="dot", placement="foot_right"))


def test_time_that_asks_for_samples_without_end(tmp_path):
    """Two of three steps last 0.2 ms, the third 9.9 s."""
    walk = made_files.named(tmp_path / "walk.csv")
    table = pd.read_csv(walk)
    table["time"] = np.cumsum(np.resize([2e-4, 2e-4, 9.9], len(table)))
    table.to_csv(walk, index=False)
    refuse(walk, "samples are 3.3.* s apart", lambda path: io.read_csv(path, time_unit="s"))
    mtw = made_files.mtw(tmp_path / "MT_00B40C48.txt", packets=np.cumsum(np.resize([1, 1, 990], len(table))))
    refuse(mtw, "rows are spread over", lambda path: io.read(path, placement="foot_right"))


def test_names_in_files_change_no_terminal(tmp_path):
    made_files.named(tmp_path / "walk.csv", prefix="\x1b[2J\x1b]0;owned\x07gyr_")
    with pytest.raises(RecordingError) as told:
        io.read_csv(tmp_path / "walk.csv")
    assert str(told.value).isprintable() and r"\x1b[2J" in str(told.value)
    assert printable("a\u202eb\udce4\nc") == "a\\u202eb\\udce4\nc"
    assert printable("0123456789" * 100, 90).startswith("0123456789" * 6 + " … ") and len(printable("x" * 99, 90)) == 90
    assert set(printable("word " * 40, 90).split()) == {"word", "…"}
