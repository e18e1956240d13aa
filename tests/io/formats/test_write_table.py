"""Tables in files: by the ending, and whole or not at all."""

import errno
import resource
import signal

import numpy as np
import pandas as pd
import pytest

from jgait import io


def table(rows=5):
    return pd.DataFrame({"time_s": np.arange(rows) / 7, "side": ["left"] * rows}).rename_axis("s_id")


def test_the_ending_says_the_format(tmp_path):
    for name, read in (("a.csv", pd.read_csv), ("a.parquet", pd.read_parquet), ("a.PQ", pd.read_parquet)):
        again = read(io.write_table(table(), tmp_path / name))
        assert list(again.columns) == ["s_id", "time_s", "side"]
        np.testing.assert_allclose(again["time_s"], table()["time_s"], rtol=1e-8)
    with pytest.raises(ValueError, match=r"written as .csv, .json, .parquet, .pq; got 'a.xlsx'"):
        io.write_table(table(), tmp_path / "a.xlsx")
    with pytest.raises(FileNotFoundError, match="none does not exist"):
        io.write_table(table(), tmp_path / "none" / "a.csv")


def test_all_names_of_rows_are_written(tmp_path):
    double = table().assign(wb_id=1).set_index("wb_id", append=True)
    assert list(pd.read_csv(io.write_table(double, tmp_path / "a.csv")).columns) == ["s_id", "wb_id", "time_s", "side"]
    both = {"right_sensor": table(), "left_sensor": table()}
    again = pd.read_parquet(io.write_table(both, tmp_path / "b.parquet"))
    assert list(again["sensor"]) == ["right_sensor"] * 5 + ["left_sensor"] * 5


@pytest.fixture
def small_disk():
    """No file may grow beyond 64 KiB, as on a full disk."""
    if not hasattr(resource, "RLIMIT_FSIZE"):
        pytest.skip("this system limits no size of files")
    before, handler = resource.getrlimit(resource.RLIMIT_FSIZE), signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (65536, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)
    signal.signal(signal.SIGXFSZ, handler)


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_a_full_disk_leaves_what_was_there_and_nothing_else(tmp_path, small_disk, ending):
    path = io.write_table(table(), tmp_path / f"a.{ending}")
    before = path.read_bytes()
    large = pd.DataFrame({"x": np.random.default_rng(0).normal(size=40_000)})
    with pytest.raises(OSError, match="too large|File too large") as told:
        io.write_table(large, path)
    assert told.value.errno in (errno.EFBIG, None)
    assert path.read_bytes() == before
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]
