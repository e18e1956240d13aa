"""Recordings in batches of one padded length: a thread reads and prepares them while a compiled program runs."""

import functools
from collections import deque
from collections.abc import Callable, Generator, Hashable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from typing import TYPE_CHECKING, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
import numpy.typing as npt
from jax.sharding import Mesh, PartitionSpec
from jaxtyping import PyTree

from jgait.estimators.interface import Estimator, Prepared, pad
from jgait.estimators.programs import BUCKET, bucket
from jgait.evaluate.scores import Scores
from jgait.evaluate.statistics import with_errors
from jgait.evaluate.store import Cohort, frame
from jgait.geometry.arrays import compiled
from jgait.notes import to_json, without_repeats
from jgait.params import check_params
from jgait.types import Estimate, RecordingError, Walk, reason_of

if TYPE_CHECKING:
    import pandas as pd

    from jgait.tune import Lessons


class CohortJob(NamedTuple):
    """How each recording is read, estimated and scored: arguments of `cohort`."""

    estimator: Estimator[PyTree, PyTree]
    params: PyTree
    body_measures: Callable[[Walk], dict[str, PyTree]] | None
    read: Callable[[PyTree], Walk] | None
    score: Callable[[Estimate, Walk], Scores]
    batch: int
    mesh: PyTree
    x64: bool


class Failed(NamedTuple):
    """A recording that gave no result; a row of the table of failures."""

    recording: str
    subject: str
    reason: str


class Ready(NamedTuple):
    """A prepared recording that waits for its batch."""

    name: str  #: the recording's name in the tables.
    walk: Walk  #: the walk; its recording has no sensor data, so that many recordings fit in memory.
    made: Prepared[PyTree]  #: what was prepared, with the recording's notes; times in float64.
    params: PyTree  #: the estimator's parameters, as arrays in the precision of the computation.
    bucket: Hashable  #: recordings with equal `bucket` can be stacked in one batch.


def padded_length(samples: int) -> int:
    """The smallest padded length that holds the samples: `BUCKET` times a power of two, or times 1.5 and such a power;
    there are few, for a program costs as much as some thousand recordings.
    """
    above = bucket(samples)
    return above * 3 // 4 if above > BUCKET and samples <= above * 3 // 4 else above


def prepared(job: CohortJob, name: str, item: PyTree) -> Ready | Failed:
    """Read and prepare one recording; exceptions become a `Failed`, but for ImportError of an installation."""
    subject = ""
    try:
        walk = item if job.read is None else job.read(item)
        if not isinstance(walk, Walk):
            raise TypeError(f"read must give a jgait.types.Walk; got {type(walk).__name__}")
        recording = walk.recording
        subject = recording.subject
        params = job.params(walk) if callable(job.params) else job.params
        if job.body_measures is not None:
            params = job.estimator.with_body(params, job.body_measures(walk))
        check_params(params, job.estimator.transforms, job.estimator.params)
        made = job.estimator.prepared(recording)
        time = np.asarray(made.inputs.time, np.float64)
        if not time.size:
            raise RecordingError("the recording holds no samples")
        params = jax.tree.map(_lowered, params)
        leaves, structure = jax.tree.flatten((_padded(job, made), params))
        bucket = (made.options, structure, tuple((leaf.shape, leaf.dtype) for leaf in leaves))
        kept = walk._replace(recording=recording._replace(sensors={}))
        made = made._replace(inputs=jax.tree.map(np.asarray, made.inputs)._replace(time=time))
        return Ready(name, kept, made, params, bucket)
    except ImportError:
        raise
    except Exception as error:
        return Failed(name, subject, reason_of(error))


def _padded(job: CohortJob, made: Prepared[PyTree]) -> PyTree:
    """The inputs of `run`, padded, in the precision of the computation."""
    return jax.tree.map(_lowered, pad(made.inputs, padded_length(np.size(made.inputs.time))))


def _lowered(leaf: npt.ArrayLike) -> np.ndarray:
    """A leaf in JAX's floating-point precision; Python's integers become floating-point numbers."""
    array = np.asarray(leaf)
    kind = array.dtype if array.dtype.kind == "b" or isinstance(leaf, np.ndarray | jax.Array) else np.float64
    return array.astype(jax.dtypes.canonicalize_dtype(kind), copy=False)


def ahead[T](source: Iterator[T], room: int, x64: bool) -> Generator[T]:
    """The items of `source`, computed in a thread up to `room` in advance, in the precision of `x64`; exceptions are
    raised.
    """
    end = object()

    def following() -> T | object:
        with jax.enable_x64(x64):
            return next(source, end)

    pool = ThreadPoolExecutor(1, "jgait-cohort")
    try:
        waiting = deque(pool.submit(following) for _ in range(room))
        while (value := waiting.popleft().result()) is not end:
            waiting.append(pool.submit(following))
            yield cast(T, value)
    finally:
        pool.shutdown(cancel_futures=True)


def evaluated(job: CohortJob, items: Iterable[tuple[str, PyTree]]) -> Generator[Cohort]:
    """The tables of each batch as soon as it is finished. While one batch computes, the next one is read, the last one
    scored.
    """
    failures: list[Failed] = []
    before: tuple[list[Ready], PyTree] | None = None
    with closing(_full(job, items, failures)) as buckets:
        for bucket in buckets:
            try:
                now = (bucket, _started(job, bucket))
            except Exception as error:
                error.add_note(f"in a batch of {len(bucket)} recordings from {bucket[0].name!r}")
                raise
            if before is not None:
                yield _finished(job, *before, failures)
            before = now
    if before is not None:
        yield _finished(job, *before, failures)
    if failures:
        yield tables([], failures)


def _full(job: CohortJob, items: Iterable[tuple[str, PyTree]], failures: list[Failed]) -> Generator[list[Ready]]:
    """Yields each bucket when it is full; unfilled buckets at the end, or when too many recordings wait."""
    waiting: dict[PyTree, list[Ready]] = {}
    with closing(ahead((prepared(job, *item) for item in items), job.batch, job.x64)) as ready:
        for recording in ready:
            if isinstance(recording, Failed):
                failures.append(recording)
                continue
            bucket = waiting.setdefault(recording.bucket, [])
            bucket.append(recording)
            if len(bucket) == job.batch:
                yield waiting.pop(recording.bucket)
            elif sum(map(len, waiting.values())) >= 3 * job.batch:  # the fullest runs unfilled, for the memory
                yield waiting.pop(max(waiting, key=lambda key: len(waiting[key])))
    yield from waiting.values()


def checked_mesh(mesh: Mesh | None) -> Mesh | None:
    """The devices of a mesh that belong to this process. Raises ValueError if it has none, or more than one axis."""
    if mesh is None:
        return None
    if not isinstance(mesh, Mesh) or len(mesh.axis_names) != 1:
        raise ValueError(f"mesh must be a jax.sharding.Mesh of one axis; got {mesh!r}")
    local = mesh.local_mesh if mesh.is_multi_process else mesh
    if not local.size:
        raise ValueError("mesh has no device of this process")
    return local


@functools.lru_cache(maxsize=64)
def program(run: Callable[..., Estimate], options: PyTree, mesh: Mesh | None) -> Callable[..., PyTree]:
    """The compiled estimator over a batch; cached for equal arguments, so that no program is compiled twice."""
    mapped = jax.vmap(lambda params, inputs: run(params, inputs, options))
    if mesh is not None:  # each batch is divided among the devices, which exchange no data
        along = PartitionSpec(mesh.axis_names[0])
        # The carry of a scan begins with constants, equal on all devices, and ends different: this is intended.
        mapped = jax.shard_map(mapped, mesh=mesh, in_specs=along, out_specs=along, check_vma=False)
    return compiled(mapped)


def _started(job: CohortJob, bucket: list[Ready]) -> PyTree:
    """Begin to compute a batch, filled with copies of a recording; one alone is computed as a single recording is."""
    if job.batch == 1 and job.mesh is None:
        (row,) = bucket
        return jax.tree.map(lambda leaf: np.asarray(leaf)[None], job.estimator.computed(row.params, row.made))
    pairs = [(row.params, _padded(job, row.made)) for row in bucket]
    pairs += pairs[:1] * (job.batch - len(bucket))
    params, inputs = jax.tree.map(lambda *leaves: np.stack(leaves), *pairs)
    return program(job.estimator.run, bucket[0].made.options, job.mesh)(params, inputs)


def _finished(job: CohortJob, bucket: list[Ready], result: PyTree, failures: list[Failed]) -> Cohort:
    """Wait for a batch and score it; its tables also contain `failures`, which is then emptied."""
    result = jax.device_get(result)
    good: list[tuple[Ready, Estimate, Scores]] = []
    for number, ready in enumerate(bucket):
        row = jax.tree.map(lambda leaf, number=number: leaf[number], result)
        time = ready.made.inputs.time  # in float64, before an estimator's `finish` puts moments on samples
        row = row._replace(time=np.pad(time, (0, row.time.size - time.size), "edge"))
        estimate = job.estimator.finished(row, ready.made)
        bad = _unusable(estimate)
        if bad is None:
            try:
                good.append((ready, estimate, job.score(estimate, ready.walk)))
                continue
            except ImportError:
                raise
            except Exception as error:
                bad = f"score: {reason_of(error)}"
        failures.append(Failed(ready.name, ready.walk.recording.subject, bad))
    part = tables(good, failures)
    failures.clear()
    return part


def _unusable(estimate: Estimate) -> str | None:
    """The reason why an estimate cannot be used; None where it can."""
    valid = np.asarray(estimate.valid, bool)
    if not valid.any():
        return "the estimate is valid at no sample"
    for name in ("legs", "stddev", "distance", "feet", "feet_stddev"):
        for leaf in jax.tree.leaves(getattr(estimate, name)):
            if lost := int(np.sum(~np.isfinite(leaf[valid]))):
                return f"{name} of the estimate is not finite at {lost} of {int(valid.sum())} valid samples"
    return None


def tables(good: list[tuple[Ready, Estimate, Scores]], failures: list[Failed]) -> Cohort:
    """The tables of a batch: estimates with their scores, and failures."""
    import pandas as pd

    whose = [(ready.name, ready.walk.recording.subject, estimate, scores) for ready, estimate, scores in good]
    recordings = [
        (*who, estimate.time.size, estimate.time[-1] - estimate.time[0], np.mean(estimate.valid),
         to_json(without_repeats((*estimate.diagnostics["notes"], *scores.notes))))
        for *who, estimate, scores in whose
    ]  # fmt: skip
    quantities = [
        (*who, name, *pair, *[np.nan] * 3) for *who, _, scores in whose for name, pair in scores.quantities.items()
    ]  # fmt: skip
    strides = [pd.DataFrame({**scores.strides, "recording": name, "subject": subject})
               for name, subject, _, scores in whose if scores.strides]  # fmt: skip
    return Cohort(
        frame("recordings", recordings),
        with_errors(frame("quantities", quantities)),
        with_errors(frame("strides", pd.concat(strides) if strides else [])),
        frame("failures", failures),
    )


def judged[P](estimator: Estimator[P, PyTree], p: P, lessons: "Lessons", names: Sequence[str]) -> "pd.DataFrame":
    """The error of every lesson in each of the losses `names`, with parameters `p`: columns `recording subject` and one
    for each loss, in the unit of `tune.LOSSES`. Raises ValueError if the estimator or the references cannot answer a
    loss.
    """
    import pandas as pd

    from jgait.tune import LOSSES, lacking, objective

    reasons = [reason for name in names if (reason := lacking(name, lessons.data.reference))]
    if reasons:
        raise ValueError("; ".join(reasons))
    objective(estimator, lessons.options, dict.fromkeys(names, 1.0))
    data = lessons.data

    def subject_params(body: dict[str, PyTree], _: PyTree) -> PyTree:
        return jax.tree.map(jnp.asarray, estimator.with_body(p, body))

    each = jax.vmap(subject_params)(data.body, jnp.arange(len(lessons.names)))
    estimates = program(estimator.run, lessons.options, None)(each, data.inputs)  # which losses of one cohort share
    rows: dict[str, PyTree] = {"recording": list(lessons.names), "subject": list(lessons.subjects)}
    for name in names:
        rows[name] = np.asarray(jax.jit(jax.vmap(LOSSES[name].error))(estimates, data))
    return pd.DataFrame(rows)
