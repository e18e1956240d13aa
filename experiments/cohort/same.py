"""A smaller cohort gives the same tables on several devices, in several processes, with Dask, and when it is killed."""

import json
import signal
import socket
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from experiments.cohort.timed import FULL, QUICK, SEED, SHORT, Scope, simulated, tables_of
from experiments.common.process import answers, started
from experiments.common.row import Row
from jgait.evaluate import Cohort


def difference(one: Cohort, two: Cohort) -> float:
    """The largest relative difference of two numbers in tables that must otherwise be equal: |a − b| / max(|a|, |b|).

    Raises:
        ValueError: if a text, the shape of a table, or whether there is a number differs.
    """
    largest = 0.0
    for name in Cohort._fields:
        ours, theirs = getattr(one, name), getattr(two, name)
        if ours.shape != theirs.shape or list(ours.columns) != list(theirs.columns):
            raise ValueError(f"{name} differ: {ours.shape} and {theirs.shape}")
        for column in ours.columns:
            a, b = ours[column].to_numpy(), theirs[column].to_numpy()
            if a.dtype.kind not in "if":
                if list(a) != list(b):
                    raise ValueError(f"{name} differ in {column}")
                continue
            a, b = a.astype(float), b.astype(float)
            if not np.array_equal(np.isfinite(a), np.isfinite(b)):
                raise ValueError(f"{name} differ in where {column} is a number")
            size = np.maximum(np.abs(a), np.abs(b))
            apart = np.where(np.isfinite(a) & (a != b), np.abs(a - b) / np.where(size > 0.0, size, 1.0), 0.0)
            largest = max(largest, float(apart.max(initial=0.0)))
    return largest


def port() -> int:
    """One that is free."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


def killed(settings: dict[str, Any], cache: Path, kills: int) -> list[int]:
    """Evaluate, killed at random moments and started again; how many batches were finished at each kill."""
    rng, out, seen = np.random.default_rng(SEED), Path(settings["out"]), []

    def parts() -> int:
        return len(list(out.glob("part-*")))

    for _ in range(kills):
        before = parts()
        process = started("experiments.cohort.run", [json.dumps(settings)], cache)
        try:
            # Within the batches after the first one that is new, some while writing.
            while parts() == before and process.poll() is None:
                time.sleep(0.002)
            time.sleep(float(rng.uniform(0.0, settings["batch"] * settings["pause"])))
        finally:
            process.kill()
            process.communicate()
        if process.returncode != -signal.SIGKILL:
            break
        seen.append(parts())
    answers(started("experiments.cohort.run", [json.dumps(settings)], cache))
    return [*seen, parts()]


def same(scope: Scope, scratch: Path) -> list[Row]:
    """A smaller cohort in float64: on one device, on four, in two processes, with Dask, and killed."""
    walks, cache = scratch / "few", scratch / "compiled"
    simulated(walks, scope.checked, SHORT, cache)
    base = {"folder": str(walks), "options": scope.options, "precision": "float64", "batch": 2}

    def settings(name: str, **others: Any) -> dict[str, Any]:
        return {**base, "out": str(scratch / f"out_{name}"), "tables": str(scratch / f"{name}.pickle"), **others}

    def run(*chosen: dict[str, Any]) -> list[Any]:
        return answers(*(started("experiments.cohort.run", [json.dumps(one)], cache) for one in chosen))

    run(settings("one"))
    # Four recordings a device.
    run(settings("mesh", how="mesh", batch=16))
    shared = {"how": "processes", "port": port(), "out": str(scratch / "out_processes")}
    run(*(settings(f"process_{rank}", rank=rank, **shared) for rank in range(2)))
    run(settings("dask", how="dask", out=""))
    finished = killed(settings("killed", pause=0.1), cache, scope.kills)
    reference = tables_of(scratch / "one.pickle")
    if len(reference.recordings) < scope.checked // 2:
        raise RuntimeError(f"too few recordings to compare: {reference.failures}")
    ways = ("mesh", "process_0", "process_1", "dask", "killed")
    apart = {name: difference(tables_of(scratch / f"{name}.pickle"), reference) for name in ways}
    kills = len(finished) - 1
    print(f"killed {kills} times; batches finished at each kill, and at the end: {', '.join(map(str, finished))}")
    split = f"{len(reference.recordings)} walks of 10 s, float64, {scope.options} options, all numbers of all tables"
    n = sum(table.select_dtypes("number").size for table in reference)
    return [
        Row("sharded_max_difference", apart["mesh"], "relative", None, n, f"4 devices against 1; {split}"),
        Row("processes_max_difference", max(apart["process_0"], apart["process_1"]), "relative", None, n,
            f"2 processes against 1; {split}"),
        Row("dask_max_difference", apart["dask"], "relative", None, n, f"2 workers of Dask against none; {split}"),
        Row("resumed_max_difference", apart["killed"], "relative", None, n,
            f"killed {kills} times against not; {split}"),
    ]  # fmt: skip


def rows(quick: bool) -> list[Row]:
    """In a folder that is removed at the end."""
    with tempfile.TemporaryDirectory(prefix="jgait-cohort-") as scratch:
        return same(QUICK if quick else FULL, Path(scratch))
