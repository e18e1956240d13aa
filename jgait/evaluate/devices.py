"""A cohort on more than one device, process or machine; Dask is imported only where it is used."""

import itertools
from collections.abc import Callable, Generator, Iterable
from itertools import islice
from typing import TYPE_CHECKING, Any

import jax
from jax._src import distributed
from jax.sharding import Mesh, PartitionSpec

if TYPE_CHECKING:
    from jgait.evaluate.buckets import Job
    from jgait.evaluate.store import Cohort

QUEUED = 3
"""Tasks for each thread of a Dask cluster that are handed out at a time; the others wait unread."""


def checked_mesh(mesh: Mesh | None) -> Mesh | None:
    """The devices of a mesh that belong to this process.

    Raises:
        ValueError: if the mesh has more than one axis, or no device here.
    """
    if mesh is None:
        return None
    if not isinstance(mesh, Mesh) or len(mesh.axis_names) != 1:
        raise ValueError(f"mesh must be a jax.sharding.Mesh of one axis; got {mesh!r}")
    own = mesh.local_mesh if mesh.is_multi_process else mesh
    if not own.size:
        raise ValueError("mesh has no device of this process")
    return own


def sharded(mapped: Callable[..., Any], mesh: Mesh) -> Callable[..., Any]:
    """A function over batches with the batch divided among the devices of a mesh; they exchange nothing."""
    along = PartitionSpec(mesh.axis_names[0])
    # A scan's carry starts with constants, the same on every device, and ends different: that is meant.
    return jax.shard_map(mapped, mesh=mesh, in_specs=along, out_specs=along, check_vma=False)


PATIENCE = 7 * 24 * 3600
"""How long a process waits for the others [s]; one that dies is noticed sooner."""

_barriers = itertools.count()


def barrier(name: str) -> None:
    """Wait until every process has come here, however much longer the others take."""
    if jax.process_count() == 1:
        return
    # JAX's public `sync_global_devices` is a collective, which on CPUs gives up when another is half a minute late.
    client = distributed.global_state.client
    if client is None:
        raise RuntimeError("several processes need jax.distributed.initialize()")
    client.wait_at_barrier(f"{name}-{next(_barriers)}", 1000 * PATIENCE)


def task(job: "Job", items: list[tuple[str, Any]]) -> "Cohort":
    """Evaluate a group of items in a worker, in the precision of whoever sent them."""
    from jgait.evaluate.buckets import evaluated
    from jgait.evaluate.store import joined

    with jax.enable_x64(job.x64):
        return joined(evaluated(job, items))


def on_dask(job: "Job", items: Iterable[tuple[str, Any]], client: Any) -> Generator["Cohort"]:
    """A task for each group of `job.batch` items; the tables of each as it is finished.

    A task whose worker dies is run again by Dask, elsewhere. If its workers keep dying, its items are tried one by
    one at the end, alone on the cluster, so that only the one that kills is lost.
    """
    from distributed import as_completed

    rest = iter(items)
    groups = iter(lambda: list(islice(rest, job.batch)), [])
    # The worker keeps the job, and with it what it has compiled.
    shared = client.submit(_same, job, pure=False)
    sent: dict[Any, list[tuple[str, Any]]] = {}

    def send(group: list[tuple[str, Any]]) -> Any:
        future = client.submit(task, shared, group, pure=False)
        sent[future] = group
        return future

    finished = as_completed([send(group) for group in islice(groups, QUEUED * _threads(client))])
    alone: list[tuple[str, Any]] = []
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
        yield _killed(item[0]) if part is None else part


def _same(job: "Job") -> "Job":
    return job


def _threads(client: Any) -> int:
    return max(1, sum(client.nthreads().values()))


def _result(future: Any) -> "Cohort | None":
    """What a task gave; None if its workers died of it."""
    from distributed import KilledWorker

    try:
        return future.result()
    except KilledWorker:
        return None


def _killed(name: str) -> "Cohort":
    from jgait.evaluate.buckets import Failed, _tables

    return _tables([], [Failed(name, "", "its worker process died, time and again")])
