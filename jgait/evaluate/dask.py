"""A cohort on the workers of a Dask cluster; Dask is imported only where it is used."""

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
"""Tasks submitted at a time for each thread of the cluster; the other items are not read yet."""


def task(job: CohortJob, items: list[tuple[str, PyTree]]) -> Cohort:
    """Evaluate a group of items in a worker, in the precision of the sender."""
    with jax.enable_x64(job.x64):
        return joined(evaluated(job, items))


def on_dask(job: CohortJob, items: Iterable[tuple[str, PyTree]], client: "Client") -> Generator[Cohort]:
    """Submit a task for each group of `job.batch` items; yields the tables of each task when it is finished.

    If a worker dies, Dask runs its task on another worker. If the workers of a task die repeatedly, its items are run
    one by one at the end, with no other task on the cluster, so that only the item that kills the worker is lost.
    """
    from distributed import as_completed

    rest = iter(items)
    groups = iter(lambda: list(islice(rest, job.batch)), [])
    # The worker keeps the job, and with the job its compiled programs.
    shared = client.submit(_same, job, pure=False)
    sent: dict[PyTree, list[tuple[str, PyTree]]] = {}

    def send(group: list[tuple[str, PyTree]]) -> "Future[Cohort]":
        future = client.submit(task, shared, group, pure=False)
        sent[future] = group
        return future

    threads = max(1, sum(client.nthreads().values()))
    finished = as_completed([send(group) for group in islice(groups, QUEUED * threads)])
    alone: list[tuple[str, PyTree]] = []
    for future in finished:
        group = sent.pop(future)
        part = _result(future)
        future.release()
        if part is None:
            alone += group
        else:
            yield part
        for more in islice(groups, 1):
            finished.add(send(more))
    for item in alone:
        future = send([item])
        part = _result(future)
        sent.pop(future)
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
