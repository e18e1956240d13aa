"""The leg estimator on ten thousand walks of a minute, from disk: time, memory, errors.

People of the simulated population with their own legs, straight on, round a corner or back, with the errors of an
MPU-6000 at both thighs and shanks. They are simulated first, outside the time that is measured, and evaluated in a
fresh process, in which compiling, reading, preparing, scoring and writing count.
"""

import json
import os
import pickle
import shutil
import tempfile
import time
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from experiments.cohort.report import figures, quality, stages
from experiments.common.process import answers, started
from experiments.common.row import Row, show
from jgait.evaluate import Cohort

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


def simulated(folder: Path, people: int, seconds: tuple[float, float], cache: Path) -> list[str]:
    """Simulate walks into a folder, in two processes; the reasons of those that could not be walked."""
    folder.mkdir()
    needed, free = people * seconds[1] * BYTES, shutil.disk_usage(folder).free
    if needed > free:
        raise RuntimeError(f"{people} walks need {needed / 1e9:.1f} GB in {folder}; {free / 1e9:.1f} GB are free")
    middle = people // 2 if people > 100 else people
    shares = [(first, last) for first, last in ((0, middle), (middle, people)) if last > first]
    running = [started("experiments.cohort.walks", [folder, SEED, *share, *seconds], cache) for share in shares]
    return [reason for part in answers(*running) for reason in part]


def whole(folder: Path, scratch: Path) -> tuple[dict[str, Any], Cohort]:
    """Evaluate a folder in float32, in a fresh process that compiles for itself; what it took, and its tables."""
    settings = {"folder": str(folder), "out": str(scratch / "results"), "tables": str(scratch / "tables.pickle")}
    (measured,) = answers(started("experiments.cohort.run", [json.dumps(settings)]))
    return measured, tables_of(scratch / "tables.pickle")


def tables_of(path: Path) -> Cohort:
    """Tables that a run has left."""
    return Cohort(*pickle.loads(path.read_bytes()))


@cache
def timed(quick: bool) -> tuple[list[Row], Cohort]:
    """Simulate, and evaluate with a clock; rows and tables."""
    with tempfile.TemporaryDirectory(prefix="jgait-cohort-") as scratch:
        return _timed(QUICK if quick else FULL, Path(scratch))


def _timed(scope: Scope, scratch: Path) -> tuple[list[Row], Cohort]:
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
    seconds = measured["seconds"]
    return [
        Row("cohort_10000x60s_seconds", seconds, "s", None, count, split),
        Row("cohort_peak_rss_gb", measured["peak_rss_gb"], "GB", None, count, split),
        Row("cohort_recordings_per_second", count / seconds, "1/s", None, count, split),
        Row("cohort_compile_seconds", measured["stages"]["compiled"]["wall"], "s", None, 1, "within the seconds"),
        Row("cohort_mean_recording_seconds", float(lasted.mean()), "s", None, count, split),
        Row("cohort_simulating_seconds", simulating, "s", None, count, "before, not within the seconds"),
        Row("cohort_not_walked", float(len(refused)), "people", None, scope.people, "drawn, and unable to walk so"),
        *quality(tables, split),
    ], tables  # fmt: skip


def rows(quick: bool) -> list[Row]:
    """Seconds, memory, and how well the estimator agrees with the truth."""
    return timed(quick)[0]


def draw(_: list[Row], folder: Path, quick: bool) -> None:
    """Agreement of the estimates with the truth."""
    figures(timed(quick)[1], folder)
