"""Files made to do harm: they unpack to gigabytes, lead into other files, or keep a reader busy."""

import gzip
import json
import pickle
import time
import zlib

import h5py
import numpy as np
import pandas as pd
import pytest
from made import files as made_files
from made.misbehaving import content, crash, fail, gone, sleep, swallow
from scipy.io import savemat

from jgait import RecordingError, io
from jgait.io import apart
from jgait.notes import printable


def refuse(path, match, read=io.read):
    begin = time.process_time()
    with pytest.raises(RecordingError, match=match) as told:
        read(path)
    assert time.process_time() - begin < 20.0  # of this process; those that read binary files are limited by themselves
    assert path.name.partition(".")[0] in str(told.value)
    assert len(str(told.value)) <= RecordingError.LONGEST


def hdf5(path, write):
    with h5py.File(path, "w") as file:
        write(file.create_group("Sensors/XI-1"))
    return path


def test_hdf5_that_states_gigabytes(tmp_path):
    path = hdf5(tmp_path / "bomb.h5", lambda group: group.create_dataset(
        "Gyroscope", shape=(400_000_000, 3), dtype="f8", chunks=(1_000_000, 3), compression="gzip"
    ))  # fmt: skip
    assert path.stat().st_size < 100_000
    refuse(path, "Gyroscope holds 9600000000 bytes; expected at most")


def test_hdf5_whose_chunk_unpacks_to_more_than_it_states(tmp_path):
    pack = zlib.compressobj(9)
    stream = b"".join(pack.compress(bytes(10_000_000)) for _ in range(120)) + pack.flush()

    def write(group):
        data = group.create_dataset("Gyroscope", (100, 3), "f8", chunks=(100, 3), compression="gzip")
        data.id.write_direct_chunk((0, 0), stream)

    path = hdf5(tmp_path / "chunk.h5", write)
    refuse(path, "cannot be read")
    assert apart.largest_of_process() < 1e9


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

    refuse(hdf5(tmp_path / "walk.h5", write), "another file; expected a file that holds its data itself")


def test_matlab_parquet_and_gzip_that_unpack_to_much(tmp_path):
    savemat(tmp_path / "data.mat", {"data": {"x": np.zeros(200_000_000, np.int8)}}, do_compression=True)
    pd.DataFrame({f"shank_right_gyr_{axis}": np.zeros(8_000_000) for axis in "xyz"}).to_parquet(tmp_path / "w.parquet")
    stem = tmp_path / "sub-1_task-walk"
    stem.with_name(f"{stem.name}_motion.tsv.gz").write_bytes(gzip.compress(b"0\t0\t0\n" * 30_000_000, 1))
    stem.with_name(f"{stem.name}_motion.json").write_text('{"SamplingFrequency": 100}')
    rows = [f"G{axis}\t{axis}\tGYRO\tfoot\tdeg/s" for axis in "xyz"]
    stem.with_name(f"{stem.name}_channels.tsv").write_text(
        "\n".join(["name\tcomponent\ttype\ttracked_point\tunits", *rows])
    )
    refuse(tmp_path / "data.mat", "holds .* bytes; expected at most")
    refuse(tmp_path / "w.parquet", "holds 192000000 bytes; expected at most")
    refuse(tmp_path / "sub-1_task-walk_motion.tsv.gz", "expected at most|should take at most|more memory")


def test_text_that_keeps_a_reader_busy(tmp_path):
    many = ",".join(f"time{n}" for n in range(20_000))
    (tmp_path / "many.csv").write_text(f"{many}\n" + "1," * 19_999 + "1\n")
    refuse(tmp_path / "many.csv", "a row of 20000 cells; expected at most", io.read_csv)
    (tmp_path / "long.csv").write_text("gyr" * 100_000 + ",time\n1,2\n")
    refuse(tmp_path / "long.csv", "a column name of 300000 characters", io.read_csv)
    (tmp_path / "wide.csv").write_text("time,a\n" + "," * 1_000_000 + "\n")
    refuse(tmp_path / "wide.csv", "a row of 1000001 cells", io.read_csv)
    (tmp_path / "short.csv").write_text("time,a,b,c,d\n" + "1\n" * 1_000_000)
    refuse(tmp_path / "short.csv", "5 columns and 1000001 rows, most of which are cut off", io.read_csv)
    dot = made_files.dot(tmp_path / "dot.csv")
    dot.write_text("a" + " " * 200_000 + "\n" + dot.read_text())
    made_files.check(io.read(dot, format="dot", placement="foot_right"))


def test_time_that_asks_for_samples_without_end(tmp_path):
    """Two of three steps last 0.2 ms, the third 9.9 s."""
    walk = made_files.named(tmp_path / "walk.csv")
    table = pd.read_csv(walk)
    table["time"] = np.cumsum(np.resize([2e-4, 2e-4, 9.9], len(table)))
    table.to_csv(walk, index=False)
    refuse(walk, "time stamps come in bursts", io.read_csv)
    mtw = made_files.mtw(tmp_path / "MT_00B40C48.txt", packets=np.cumsum(np.resize([1, 1, 990], len(table))))
    refuse(mtw, "rows are spread over", lambda path: io.read(path, placement="foot_right"))


def test_json_without_end(tmp_path):
    (tmp_path / "deep.json").write_text("[" * 100_000)
    with pytest.raises(RecordingError, match="RecursionError"):
        io.read_params(tmp_path / "deep.json", None, estimator="leg_ekf")
    (tmp_path / "big.json").write_text(json.dumps({"format": 1})[:-1] + ', "x": ' + "9" * 5000 + "}")
    with pytest.raises(RecordingError, match="expected a file of parameters"):
        io.read_params(tmp_path / "big.json", None, estimator="leg_ekf")


def test_names_in_files_change_no_terminal(tmp_path):
    made_files.named(tmp_path / "walk.csv", prefix="\x1b[2J\x1b]0;owned\x07gyr_")
    with pytest.raises(RecordingError) as told:
        io.read_csv(tmp_path / "walk.csv")
    assert str(told.value).isprintable() and r"\x1b[2J" in str(told.value)
    assert printable("a\u202eb\udce4\nc") == "a\\u202eb\\udce4\nc"
    assert printable("0123456789" * 100, 90).startswith("0123456789" * 6 + " … ") and len(printable("x" * 99, 90)) == 90


# --- the process that reads binary files ---


@pytest.fixture
def file(tmp_path):
    (tmp_path / "file.bin").write_bytes(b"abc")
    return tmp_path / "file.bin"


@pytest.mark.parametrize(
    ("function", "match"),
    [(crash, "ended without an error"), (sleep, "should take at most"), (swallow, "more memory than its size"),
     (fail, "KeyError"), (gone, "NotADirectoryError|Not a directory")],
)  # fmt: skip
def test_whatever_a_library_does_is_an_error_of_the_file(file, function, match):
    with pytest.raises(RecordingError, match=match) as told:
        apart.apart(function, file, "a good file", "numpy")
    assert "file.bin" in str(told.value) and "a good file" in str(told.value)
    assert apart.apart(content, file, "a good file", "numpy") == b"abc"  # the next file is read all the same


def test_a_library_that_is_absent_and_an_error_that_is_sent(file):
    with pytest.raises(ImportError, match="needs the extra io"):
        apart.apart(content, file, "a good file", "no_such_library")
    sent = pickle.loads(pickle.dumps(RecordingError("give {argument}", argument="trial", value="a")))
    assert (str(sent), sent.argument, sent.value) == ("give trial='a'", "trial", "a")
