"""A cohort on a Dask cluster that begins without workers, as on SLURM, takes as long as one whose workers are there."""

import contextlib
import logging
import threading
import time

from experiments.common.row import Row, show
from jgait import evaluate
from jgait.estimators import foot_ins
from jgait.types import RecordingError, Walk

TASKS, SECONDS, WORKERS = 60, 0.3, 8
START = 1.0
"""[s] After which the late workers join."""


def slow(number: int) -> Walk:
    """Reading that takes its time; the recording has no result, so that scheduling alone is measured."""
    time.sleep(SECONDS)
    raise RecordingError(f"recording {number} was only read")


def seconds(late: bool) -> float:
    """Time of all tasks with workers that are there, or from the moment at which late workers join."""
    import distributed

    settings = {"threads_per_worker": 1, "processes": False, "dashboard_address": None,
                "silence_logs": logging.CRITICAL}  # fmt: skip
    with contextlib.ExitStack() as stack:
        cluster = stack.enter_context(distributed.LocalCluster(n_workers=0 if late else WORKERS, **settings))
        client = stack.enter_context(distributed.Client(cluster))
        begin = time.perf_counter()
        if late:
            begin += START
            threading.Timer(START, cluster.scale, (WORKERS,)).start()
        else:
            client.wait_for_workers(WORKERS)
        found = evaluate.cohort(foot_ins.estimator(), range(TASKS), read=slow, batch=1, client=client)
        if len(found.failures) != TASKS:
            raise RuntimeError(f"{len(found.failures)} of {TASKS} tasks came back")
        return time.perf_counter() - begin


def rows(quick: bool) -> list[Row]:
    """Both, the present ones first; the first task of a process is slower, so that one round is not counted."""
    del quick
    seconds(late=False)
    present, late = seconds(late=False), seconds(late=True)
    show("workers of Dask", ["present [s]", "joined late [s]"], [[present, late]])
    split = f"{TASKS} tasks of {SECONDS} s, {WORKERS} workers that join {START:g} s after the start"
    return [Row("late_workers_over_present", late / present, "ratio", None, TASKS, split, of="tasks")]
