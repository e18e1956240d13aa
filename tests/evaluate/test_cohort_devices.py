"""A cohort on several devices, processes and machines gives what one device gives."""

import jax
import numpy as np
import pandas as pd
import pytest
from made.cohort import FAKE, read, read_or_die, walk
from made.dask import two_workers
from made.process import ran, two

from jgait import evaluate

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
def client():
    """Two worker processes; the second death of a task's worker is the last, for each start of one takes seconds."""
    with two_workers(allowed_failures=1) as one:
        yield one


@pytest.mark.release
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
