"""The leg estimator on ten thousand walks of a minute, from disk: how long, how much memory, how good.

People of the simulated population with their own legs, straight on, round a corner or back, with the errors of an
MPU-6000 at both thighs and shanks. They are simulated first, outside the time that is measured, and evaluated in a
fresh process, in which compiling, reading, preparing, scoring and writing count. A smaller cohort gives the same
numbers on several devices, in several processes, with Dask, and killed again and again. --figures FOLDER draws.
"""

import argparse
import json
import os
import pickle
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from _cohort_report import figures, quality, stages
from common import Row, main, show

from jgait.evaluate import Cohort

HERE = Path(__file__).resolve().parent
SEED = 20130617


class Scope(NamedTuple):
    """How much is measured.

    Attributes:
        people: in the cohort that is timed.
        seconds: that their walks last, from and to, about.
        checked: people in the cohort that is run in several ways.
        options: of the estimator there: "default", or "paper", which compiles sooner.
        kills: of the run that is killed.
    """

    people: int
    seconds: tuple[float, float]
    checked: int
    options: str
    kills: int


SHORT = (10.2, 11.6)
"""Seconds of walks that all have one padded length at 100 Hz."""
FULL = Scope(10_000, (60.1, 62.9), 32, "default", 5)
QUICK = Scope(48, SHORT, 14, "paper", 2)
BYTES = 16_000
"""That a second of a walk takes on disk, with room to spare."""


def environment(cache: Path | None = None) -> dict[str, str]:
    """For a process: what it imports, float32 unless told, and compiled programs shared with others or with none."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("JAX_", "XLA_"))}
    shared = {} if cache is None else {"JAX_COMPILATION_CACHE_DIR": str(cache),
                                       "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0"}  # fmt: skip
    path = os.pathsep.join([str(HERE), *filter(None, [os.environ.get("PYTHONPATH")])])
    return {**kept, "JAX_PLATFORMS": "cpu", "PYTHONPATH": path, **shared}


def started(script: str, arguments: list[Any], cache: Path | None = None) -> "subprocess.Popen[str]":
    """A script of this folder in a process of its own."""
    command = [sys.executable, str(HERE / script), *map(str, arguments)]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment(cache)
    )  # fmt: skip


def told(*running: "subprocess.Popen[str]") -> list[Any]:
    """What processes say at their end, in JSON."""
    try:
        said = [process.communicate() for process in running]
    finally:
        for process in running:
            process.kill()
    for process, (_, error) in zip(running, said, strict=True):
        if process.returncode:
            raise RuntimeError(f"{process.args} failed: {error[-3000:]}")
    return [json.loads(out.splitlines()[-1]) for out, _ in said]


# --- the walks ---


def simulated(folder: Path, people: int, seconds: tuple[float, float], cache: Path) -> list[str]:
    """Simulate walks into a folder, in two processes; the reasons of those that could not be walked."""
    folder.mkdir()
    needed, free = people * seconds[1] * BYTES, shutil.disk_usage(folder).free
    if needed > free:
        raise RuntimeError(f"{people} walks need {needed / 1e9:.1f} GB in {folder}; {free / 1e9:.1f} GB are free")
    middle = people // 2 if people > 100 else people
    shares = [(first, last) for first, last in ((0, middle), (middle, people)) if last > first]
    running = [started("_cohort_walks.py", [folder, SEED, *share, *seconds], cache) for share in shares]
    return [reason for part in told(*running) for reason in part]


# --- one long run ---


def whole(folder: Path, scratch: Path) -> tuple[dict[str, Any], Cohort]:
    """Evaluate a folder in float32, in a fresh process that compiles for itself; what it took, and its tables."""
    settings = {"folder": str(folder), "out": str(scratch / "results"), "tables": str(scratch / "tables.pickle")}
    (measured,) = told(started("_cohort_run.py", [json.dumps(settings)]))
    return measured, tables_of(scratch / "tables.pickle")


def tables_of(path: Path) -> Cohort:
    """Tables that a run has left."""
    return Cohort(*pickle.loads(path.read_bytes()))


def timed(scope: Scope, scratch: Path, folder: Path | None) -> list[Row]:
    """Simulate, and evaluate with a clock."""
    start = time.perf_counter()
    refused = simulated(scratch / "walks", scope.people, scope.seconds, scratch / "compiled")
    simulating = time.perf_counter() - start
    for reason in refused[:10]:
        print(f"not walked: {reason}")
    load = os.getloadavg()[0]
    measured, tables = whole(scratch / "walks", scratch)
    count = scope.people - len(refused)
    print(f"load before and after: {load:.2f}, {os.getloadavg()[0]:.2f} on {os.cpu_count()} cores")
    columns = ["stage", "thread", "seconds", "of computing", "ms a recording"]
    show(f"Where the time goes: {count} recordings", columns, stages(measured, count))
    lasted = tables.recordings["seconds"]
    split = (f"{count} people × {lasted.mean():.1f} s ({lasted.min():.1f} to {lasted.max():.1f}), thigh and shank of "
             "both legs, 100 Hz, MPU6000, float32, default options, untuned")  # fmt: skip
    rows = quality(tables, split)
    if folder is not None:
        figures(tables, folder)
    seconds = measured["seconds"]
    return [
        Row("cohort_10000x60s_seconds", seconds, "s", None, count, split),
        Row("cohort_peak_rss_gb", measured["peak_rss_gb"], "GB", None, count, split),
        Row("cohort_recordings_per_second", count / seconds, "1/s", None, count, split),
        Row("cohort_compile_seconds", measured["stages"]["compiled"]["wall"], "s", None, 1, "within the seconds"),
        Row("cohort_mean_recording_seconds", float(lasted.mean()), "s", None, count, split),
        Row("cohort_simulating_seconds", simulating, "s", None, count, "before, not within the seconds"),
        Row("cohort_not_walked", float(len(refused)), "people", None, scope.people, "drawn, and unable to walk so"),
        *rows,
    ]


# --- the same, however run ---


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
        process = started("_cohort_run.py", [json.dumps(settings)], cache)
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
    told(started("_cohort_run.py", [json.dumps(settings)], cache))
    return [*seen, parts()]


def same(scope: Scope, scratch: Path) -> list[Row]:
    """A smaller cohort in float64: on one device, on four, in two processes, with Dask, and killed."""
    walks, cache = scratch / "few", scratch / "compiled"
    simulated(walks, scope.checked, SHORT, cache)
    base = {"folder": str(walks), "options": scope.options, "precision": "float64", "batch": 2}

    def settings(name: str, **others: Any) -> dict[str, Any]:
        return {**base, "out": str(scratch / f"out_{name}"), "tables": str(scratch / f"{name}.pickle"), **others}

    def run(*chosen: dict[str, Any]) -> list[Any]:
        return told(*(started("_cohort_run.py", [json.dumps(one)], cache) for one in chosen))

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


def experiment(quick: bool, folder: Path | None) -> list[Row]:
    """All of it, in a folder that is removed at the end."""
    scope = QUICK if quick else FULL
    with tempfile.TemporaryDirectory(prefix="jgait-cohort-") as scratch:
        rows = timed(scope, Path(scratch), folder)
        return [*rows, *same(scope, Path(scratch))]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(add_help=False)
    parser.add_argument("--figures", type=Path)
    own, sys.argv[1:] = parser.parse_known_args()
    about = f"{__doc__.splitlines()[0]} --figures FOLDER: where pictures go"
    main("cohort", about, lambda quick: experiment(quick, own.figures))
