"""A cohort on the workers of a Dask cluster; Dask is imported only where it is used."""

import time
from collections.abc import Generator, Iterable
from itertools import islice
from typing import TYPE_CHECKING

import jax
from jaxtyping import PyTree

from jgait.evaluate.buckets import CohortJob, Failed, evaluated, tables
from jgait.evaluate.store import Cohort, joined

if TYPE_CHECKING:
    from distributed import Client, Future

QUEUED = 3
"""Tasks in flight for each thread that the cluster has at the moment; the other items are not read yet."""

POLL = 0.05
"""[s] Time between two looks for workers that joined, while no task is finished."""


def task(job: CohortJob, items: list[tuple[str, PyTree]]) -> Cohort:
    """Evaluate a group of items in a worker, in the precision of the sender."""
    with jax.enable_x64(job.x64):
        return joined(evaluated(job, items))


def on_dask(job: CohortJob, items: Iterable[tuple[str, PyTree]], client: "Client") -> Generator[Cohort]:
    """Submit a task for each group of `job.batch` items; yields the tables of each task when it is finished.

    The number of tasks in flight follows the number of workers, which may join and leave at any time. If a worker dies,
    Dask runs its task on another worker. If the workers of a task die repeatedly, its items are run one by one at the
    end, with no other task on the cluster, so that only the item that kills the worker is lost.
    """
    from distributed import as_completed

    rest = iter(items)
    groups = iter(lambda: list(islice(rest, job.batch)), [])
    # The worker keeps the job, and with the job its compiled programs.
    shared = client.submit(_same, job, pure=False)
    sent: dict[PyTree, list[tuple[str, PyTree]]] = {}
    alone: list[tuple[str, PyTree]] = []
    finished = as_completed()
    while True:
        room = QUEUED * max(1, sum(client.nthreads().values())) - len(sent)
        for group in islice(groups, max(0, room)):
            future = client.submit(task, shared, group, pure=False)
            sent[future] = group
            finished.add(future)
        if not sent:
            break
        if not finished.has_ready():
            time.sleep(POLL)
            continue
        future = next(finished)
        group, part = sent.pop(future), _result(future)
        future.release()
        if part is None:
            alone += group
        else:
            yield part
    for item in alone:
        part = _result(client.submit(task, shared, [item], pure=False))
        killed = Failed(item[0], "", "its worker process died, time and again")
        yield tables([], [killed]) if part is None else part


def _same(job: CohortJob) -> CohortJob:
    return job


def _result(future: "Future[Cohort]") -> Cohort | None:
    from distributed import KilledWorker

    try:
        return future.result()
    except KilledWorker:
        return None
