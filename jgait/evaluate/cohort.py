"""One estimator on a cohort: a bad recording does not stop the others, and an interrupted run can be continued."""

import json
from collections.abc import Callable, Generator, Iterable, Iterator, Sized
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import jax
import numpy as np
from jaxtyping import PyTree

from jgait import __version__
from jgait.estimators.dask import DIED, on_dask
from jgait.estimators.interface import Estimator
from jgait.evaluate import scores
from jgait.evaluate.buckets import CohortJob, Failed, checked_mesh, evaluated, tables
from jgait.evaluate.scores import Scores
from jgait.evaluate.store import Cohort, Folder, joined
from jgait.params import check_params
from jgait.types import Estimate, Recording, Walk

if TYPE_CHECKING:
    from distributed import Client

Progress = Callable[[int, int], None]
"""Called after every batch with the number of recordings finished in this run, and the number that failed."""

BATCH = 64
"""Number of recordings that run at once; chosen by hand, as memory grows with it."""

FEW = 32
"""Largest number of recordings that run one after another: the program of a batch takes as long to compile as some
tens of recordings take by the programs of one, which `jgait estimate` compiles too."""


def cohort(
    estimator: Estimator[PyTree, PyTree],
    items: Iterable[PyTree],
    params: PyTree = None,
    *,
    body: Callable[[Walk], dict[str, PyTree]] | None = None,
    read: Callable[[PyTree], Walk] | None = None,
    score: Callable[[Estimate, Walk], Scores] = scores.score,
    out: Path | str | None = None,
    batch: int | None = None,
    mesh: jax.sharding.Mesh | None = None,
    client: "Client | None" = None,
    progress: Progress | None = None,
) -> Cohort:
    """Run an estimator on many recordings, and compare each with its reference.

    Recordings are padded to a few lengths, and as many as `batch` of one length run together, compiled once a length.
    They are read one at a time during the computation, and freed when scored: a cohort may be larger than memory.
    A recording that cannot be read, prepared, estimated or scored is a row of `failures` with its reason.

    With `out` every finished batch is written to disk at once. If an interrupted run is started again with the same
    arguments, finished recordings (failures included) are not read again, and the final tables are the same. After
    `jax.distributed.initialize()`, as under SLURM's `srun`, each process takes its share of the items, all write to one
    `out`, and each returns the tables of all.

    With Dask, give paths and `read`, since walks would be sent over the network. Sort the paths by length: a task of
    `batch` items compiles every length in it. Set `jax_compilation_cache_dir` to a folder that all workers share.

    Args:
        estimator: from `jgait.estimators`.
        items: walks, or items that `read` converts to walks (paths, names); any iterable, taken one by one. The name
            of a walk is its recording's name, that of another item is `str(item)`; names must be unique.
        params: the estimator's parameters, natural units; None for its defaults; or walk → parameters, such as
            `lambda walk: fit.of(walk.recording.subject)` of a fit with values per subject.
        body: walk → body measures to put into the parameters by `estimator.with_body`; None does not change them.
        read: item → walk.
        score: (estimate, walk) → `Scores`, on the host; the estimate has no padding, the walk no sensor data.
        out: folder for the results; None keeps them in memory. Functions are compared by name and source: give
            another folder when the functions that they call, or what they read, has changed.
        batch: number of recordings that run at once; memory grows with it. Rounded up to a multiple of the number of
            devices of `mesh`. None: 64; a list of at most 32 runs one after another.
        mesh: devices that share each batch, with one axis, such as `jax.make_mesh((n,), ("recordings",))`.
        client: a `dask.distributed.Client` (the extra `cluster`), whose workers compute.
        progress: called after every batch.

    Raises:
        ValueError: if two items have one name, a parameter is outside its range, `out` holds results of another
            evaluation, several processes have no `out`, or arguments contradict each other.
        TypeError: if an item is no walk and `read` is None, or an argument has the wrong type.
    """
    if not isinstance(estimator, Estimator):
        raise TypeError(f"estimator must be a jgait.Estimator, such as leg_ekf.estimator(); got {estimator!r}")
    if isinstance(items, Walk | Recording):
        raise TypeError(f"items must be several walks in a list; got one {type(items).__name__}")
    if batch is not None and batch < 1:
        raise ValueError(f"batch must be at least 1; got {batch}")
    processes = jax.process_count()
    if client is not None and (mesh is not None or processes > 1):
        raise ValueError("client hands recordings to Dask's workers: give no mesh then, and one process")
    if processes > 1 and out is None:
        raise ValueError(f"{processes} processes need a folder out that all of them see, to put their results together")
    params = estimator.params if params is None else params
    if not callable(params):
        check_params(params, estimator.transforms, estimator.params)
    local = checked_mesh(mesh)
    if isinstance(items, Sized):
        share = max(1, -(-len(items) // processes))
        alone = batch is None and share <= FEW and local is None and client is None
        batch = 1 if alone else min(batch or BATCH, share)
    batch = batch or BATCH
    if local is not None:
        batch = -(-batch // local.size) * local.size
    job = CohortJob(estimator, params, body, read, score, batch, local, bool(jax.config.jax_enable_x64))
    rank = jax.process_index() if processes > 1 else 0
    store = None if out is None else Folder(Path(out), _description(job), rank)
    names: set[str] = set()
    named = _named(items, read is not None, frozenset() if store is None else store.done(), rank, processes, names)
    kept: list[Cohort] = []
    finished = failed = 0
    with closing(evaluated(job, named) if client is None else _on_dask(job, named, client)) as parts:
        for part in parts:
            kept.append(part) if store is None else store.append(part)
            finished += len(part.recordings) + len(part.failures)
            failed += len(part.failures)
            if progress is not None:
                progress(finished, failed)
    if store is None:
        return joined(kept)
    if processes > 1:
        store.wait(names)
    return store.tables()


def _on_dask(job: CohortJob, items: Iterable[tuple[str, PyTree]], client: "Client") -> Generator[Cohort]:
    """The tables of each group of `job.batch` items, from the workers of a cluster."""
    with closing(on_dask(partial(_evaluated, job), items, client, job.batch)) as results:
        for group, part in results:
            yield tables([], [Failed(name, "", DIED) for name, _ in group]) if part is None else part


def _evaluated(job: CohortJob, items: tuple[tuple[str, PyTree], ...]) -> Cohort:
    return joined(evaluated(job, items))


def _named(
    items: Iterable[PyTree], can_read: bool, done: frozenset[str], rank: int, processes: int, names: set[str]
) -> Iterator[tuple[str, PyTree]]:
    """This process's share of the unfinished items, each with its name; `names` gets those of all items."""
    for number, item in enumerate(items):
        if not can_read and not isinstance(item, Walk):
            kind = type(item).__name__
            raise TypeError(
                f"items must be walks, Walk(recording, reference, info), or come with read=; item {number} is {kind}"
            )
        name = str(item.recording.name) if isinstance(item, Walk) else str(item)
        if name in names:
            raise ValueError(f"items must have names of their own; item {number} is a second {name!r}")
        names.add(name)
        if number % processes == rank and name not in done:
            yield name, item


def _description(job: CohortJob) -> dict[str, str]:
    """The settings on which the results in a folder depend, as text; batch size and devices are not among them."""
    from jgait.tune.checkpoint import described

    estimator = job.estimator
    leaves = [] if callable(job.params) else jax.tree_util.tree_leaves_with_path(job.params)
    params = {jax.tree_util.keystr(path).lstrip("."): leaf for path, leaf in leaves}
    numbers = {name: described(leaf) if np.ndim(leaf) else float(leaf) for name, leaf in params.items()}
    return {
        "jgait": __version__,
        "estimator": estimator.name,
        "functions": ", ".join(described(f) for f in (estimator.prepare, estimator.run)),
        "params": json.dumps(described(job.params) if callable(job.params) else numbers),
        "body": described(job.body_measures),
        "with_body": described(estimator.with_body),
        "read": described(job.read),
        "score": described(job.score),
        "precision": "float64" if job.x64 else "float32",
    }
