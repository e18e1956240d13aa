"""A cohort on several devices, processes and machines gives what one device gives."""

import logging
import warnings

import jax
import numpy as np
import pandas as pd
import pytest
from made.cohort import FAKE, read, read_or_die, walk
from made.command import run
from made.process import environment, ran, two

from jgait import evaluate
from jgait.commands import evaluate as command

WIDE = {"JAX_ENABLE_X64": "1"}


def close(one, two):
    for name in one._fields:
        pd.testing.assert_frame_equal(getattr(one, name), getattr(two, name), rtol=1e-9, atol=1e-9)


def test_devices_share_each_batch(tmp_path):
    whole = evaluate.cohort(FAKE, range(18), read=read, out=tmp_path / "one", batch=6)
    script = f"""
import jax
from made.cohort import FAKE, TRACED, read
from jgait import evaluate
mesh = jax.make_mesh((4,), ("recordings",), axis_types=(jax.sharding.AxisType.Auto,))
jax.config.update("jax_numpy_rank_promotion", "raise")
tables = evaluate.cohort(FAKE, range(18), read=read, out={str(tmp_path / "four")!r}, batch=6, mesh=mesh)
# Rounded up to 8; one program a bucket.
print(jax.device_count(), len(tables.recordings), len(TRACED) == len(set(TRACED)))
from jgait.evaluate import buckets
job = buckets.CohortJob(FAKE, FAKE.params, None, read, None, 4, mesh, True)
made = [buckets.prepared(job, str(i), 1) for i in range(4)]
result = buckets._started(job, made)
print(len(result.distance.sharding.device_set), result.distance.addressable_shards[0].data.shape[0])
"""
    assert ran(script, devices=4, **WIDE).split() == ["4", "17", "True", "4", "1"]
    # The same arguments but for the devices: it is the same evaluation, and all of it is there.
    four = evaluate.cohort(
        FAKE, range(18), read=read, out=tmp_path / "four", progress=lambda *n: pytest.fail("ran again")
    )
    close(four, whole)


def test_processes_take_their_shares_and_return_all(tmp_path):
    whole = evaluate.cohort(FAKE, range(21), read=read, batch=4)
    script = """
import sys
import jax
*folders, port, number = sys.argv[1:]
number = int(number)
jax.distributed.initialize(f"127.0.0.1:{port}", 2, number)
from made.cohort import FAKE, read
from jgait import evaluate
mine = []
def load(item):
    mine.append(item)
    return read(item)
try:
    evaluate.cohort(FAKE, range(21), read=load)
except ValueError as error:
    print(error)
tables = evaluate.cohort(FAKE, range(21), read=load, out=folders[0], batch=4)
assert mine == list(range(number, 21, 2)), mine
for name, table in tables._asdict().items():
    table.to_pickle(f"{folders[1]}/{name}-{number}")
"""
    (tmp_path / "tables").mkdir()
    said = two(script, tmp_path / "out", tmp_path / "tables", **WIDE)
    assert all("2 processes need a folder out" in text for text in said)
    for number in range(2):
        tables = evaluate.Cohort(*(pd.read_pickle(tmp_path / "tables" / f"{n}-{number}") for n in whole._fields))
        close(tables, whole)
    written = {p.name.split("-")[1] for p in (tmp_path / "out").glob("part-*")}
    assert written == {"0", "1"}


@pytest.fixture
def client(monkeypatch):
    """Two worker processes on this machine."""
    distributed = pytest.importorskip("distributed")
    # What JAX computes with comes with the task and not from here.
    for name, value in environment().items():
        monkeypatch.setenv(name, value)
    with warnings.catch_warnings():
        # Workers that are killed leave sockets and event loops behind, and say so late.
        warnings.simplefilter("ignore", ResourceWarning)
        warnings.filterwarnings("ignore", category=DeprecationWarning, module=r"(distributed|tornado|dask)\b.*")
        settings = {
            "n_workers": 2,
            "threads_per_worker": 1,
            "dashboard_address": None,
            "silence_logs": logging.CRITICAL,
            # The second death of a task's worker is the last: each start of a process takes seconds.
            "scheduler_kwargs": {"allowed_failures": 1},
        }
        with distributed.LocalCluster(**settings) as cluster, distributed.Client(cluster) as one:
            yield one


def test_dask_workers_may_die(tmp_path, client):
    (tmp_path / "die").touch()
    items = [f"{i}:{tmp_path}" for i in range(24)]
    before = set(client.scheduler_info()["workers"])
    result = evaluate.cohort(FAKE, items, read=read_or_die, out=tmp_path / "out", batch=4, client=client)
    # One died on the way and its batch was run again; 7 kills whoever reads it, and costs nobody else.
    assert not (tmp_path / "die").exists()
    assert set(client.scheduler_info()["workers"]) != before
    assert list(result.failures["recording"]) == [items[7]]
    assert result.failures["reason"][0] == "its worker process died, time and again"
    well = evaluate.cohort(FAKE, [item for item in items if item != items[7]], read=read_or_die)
    for name in ("recordings", "quantities", "strides"):
        pd.testing.assert_frame_equal(getattr(result, name), getattr(well, name), rtol=1e-9, atol=1e-9)
    # In float64, though the workers were started in float32.
    one = evaluate.cohort(FAKE, [walk(3)], client=client).quantities["estimate"]
    assert np.array_equal(one, evaluate.cohort(FAKE, [walk(3)]).quantities["estimate"])
    with pytest.raises(ValueError, match="give no mesh then"):
        evaluate.cohort(FAKE, [], client=client, mesh=jax.make_mesh((1,), ("recordings",)))


@pytest.mark.slow
def test_the_command_takes_the_workers_of_a_scheduler(tmp_path, client):
    words = ("evaluate", "--simulated", 3, "--estimator", "leg_ekf", "--paper", "--batch", 1)
    numbers = []
    for name, more in (("alone", ()), ("shared", ("--dask", client.scheduler.address))):
        code, said = run(*words, "--out", tmp_path / name, *more)
        assert code == 0, said
        numbers.append(pd.read_csv(tmp_path / name / "quantities.csv"))
    pd.testing.assert_frame_equal(*numbers, rtol=1e-9)


def test_a_scheduler_that_does_not_answer_is_named(tmp_path, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr(command, "CONNECT_S", 1)
    code, said = run("evaluate", "--simulated", 1, "--dask", "tcp://127.0.0.1:9", "--out", tmp_path / "out")
    assert code == 2 and "--dask: no Dask scheduler answers at tcp://127.0.0.1:9" in said
