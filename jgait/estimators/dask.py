"""Work on the workers of a Dask cluster; Dask is imported only where it is used."""

import time
from collections.abc import Callable, Generator, Iterable
from itertools import batched, islice
from typing import TYPE_CHECKING

import jax
from jaxtyping import PyTree

if TYPE_CHECKING:
    from distributed import Client, Future

DIED = "its worker process died, time and again"
"""Why an item has no result."""


def on_dask[Item, T](
    function: Callable[[tuple[Item, ...]], T], items: Iterable[Item], client: "Client", size: int = 1
) -> Generator[tuple[tuple[Item, ...], T | None]]:
    """Apply a function to groups of items; yields each group with its result when it is finished.

    Three tasks are in flight for each thread that the cluster has at the moment, whose workers may join and leave at
    any time; items are taken as there is room. The function, sent once by cloudpickle, runs in the precision of the
    caller. If a worker dies, Dask runs its tasks on another worker. If the workers of a task die repeatedly, its items
    are run one by one at the end, with no other task on the cluster, so that only the item that kills its worker has no
    result, but None.
    """
    from distributed import as_completed

    groups = batched(items, size)
    # The worker keeps the function, and with the function its compiled programs.
    shared = client.submit(lambda: function, pure=False)
    wide = bool(jax.config.jax_enable_x64)
    sent: dict[PyTree, tuple[Item, ...]] = {}
    alone: list[Item] = []
    finished = as_completed()
    while True:
        room = 3 * max(1, sum(client.nthreads().values())) - len(sent)
        for group in islice(groups, max(0, room)):
            future = client.submit(_applied, shared, group, wide, pure=False)
            sent[future] = group
            finished.add(future)
        if not sent:
            break
        if not finished.has_ready():
            time.sleep(0.05)  # then workers may have joined
            continue
        future = next(finished)
        group, result = sent.pop(future), _result(future)
        future.release()
        if result is None:
            alone += group
        else:
            yield group, result
    for item in alone:
        yield (item,), _result(client.submit(_applied, shared, (item,), wide, pure=False))


def _applied[Item, T](function: Callable[[tuple[Item, ...]], T], group: tuple[Item, ...], wide: bool) -> T:
    with jax.enable_x64(wide):
        return function(group)


def _result[T](future: "Future[T]") -> T | None:
    from distributed import KilledWorker

    try:
        return future.result()
    except KilledWorker:
        return None
