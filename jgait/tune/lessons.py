"""Walks prepared for `tune.fit`: inputs and reference at the same times, padded to the same length and stacked."""

from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Iterator
from typing import NamedTuple

import jax
import numpy as np
import numpy.typing as npt
from jaxtyping import Bool, Int, PyTree

from jgait.estimators.interface import Estimator, Prepared, pad
from jgait.notes import by_reason, record
from jgait.types import (
    AnyArray,
    Estimate,
    Feet,
    FootTrajectory,
    RecordingError,
    Strides,
    Walk,
    as_float,
    check_kind,
    people,
    reason_of,
)


@record
class Windows(NamedTuple):
    """The parts of a walk that a loss uses, in samples of the prepared inputs, half-open."""

    look: tuple[int, int] | None = None  #: samples compared with the reference; None for the whole walk.
    #: quiet standing, whose mean is subtracted from trajectories; None: trajectories are absolute.
    standing: tuple[int, int] | None = None


@record
class Lesson(NamedTuple):
    """A walk as one item of a fit; every leaf is an array, so lessons can be stacked and mapped over."""

    inputs: PyTree  #: prepared inputs of the estimator.
    reference: PyTree  #: reference at the times of the inputs, or None.
    look: Bool[AnyArray, "*walk time"]  #: (T,) bool, samples that are compared with the reference.
    #: (T,) bool, standing whose mean is subtracted from trajectories; all False without standing.
    standing: Bool[AnyArray, "*walk time"]
    first: Int[AnyArray, "*walk"]  #: first sample of the part whose walked distance is compared.
    last: Int[AnyArray, "*walk"]  #: last sample of that part.
    body: dict[str, PyTree]  #: body measures of the person, for `Estimator.with_body`; empty if there are none.


class Lessons(NamedTuple):
    """The lessons of several walks."""

    data: Lesson  #: a `Lesson` whose leaves have a leading axis (n,), for `tune.fit` and `tune.cross_validate`.
    options: PyTree  #: options of the estimator, the same for all walks.
    subjects: tuple[str, ...]  #: (n,) subject of each walk, one name for each person, see `jgait.types.people`.
    days: tuple[str, ...]  #: (n,) day of each walk as its set or table names it, "" where it is not known.
    names: tuple[str, ...]  #: (n,) names of the recordings.
    failures: tuple[tuple[str, str], ...]  #: (name, reason) of every walk that could not be used.

    def __repr__(self) -> str:
        left = "; ".join(f"{names}: {reason}" for reason, names in by_reason(self.failures).items())
        left_out = f"; {len(self.failures)} left out, {left}" if left else ""
        return f"Lessons({len(self.names)} walks of {len(set(self.subjects))} people{left_out})"

    def lesson(self, number: int) -> Lesson:
        """The lesson with this number."""
        return jax.tree.map(lambda leaf: leaf[number], self.data)


class _Item(NamedTuple):
    """A lesson before padding, with the name, subject, day and options of its walk."""

    name: str
    subject: str
    day: str
    options: Hashable
    lesson: Lesson


def resampled(estimate: Estimate, time: npt.ArrayLike) -> Estimate:
    """An estimate at other times (T,) [s], linear between its samples; valid between valid samples.

    Of the feet only positions are kept, of the diagnostics only scalars; strides do not change.
    """
    theirs, ours = as_float(estimate.time), as_float(time)
    # Times that differ by rounding only, at either end, count as equal.
    inside = np.clip(ours, theirs[0], theirs[-1])
    at = np.where(np.abs(ours - inside) < 1e-6, inside, ours)

    def here(values: AnyArray) -> np.ndarray:
        columns = as_float(values).reshape(theirs.size, -1).T
        return np.stack([np.interp(at, theirs, c) for c in columns], 1).reshape(at.size, *np.shape(values)[1:])

    places = [None if foot is None else FootTrajectory(foot.position, None, None) for foot in estimate.feet or ()]
    legs, way, feet = jax.tree.map(here, (estimate.legs, estimate.distance, Feet(*places) if places else None))
    valid = np.interp(at, theirs, as_float(estimate.valid), left=0.0, right=0.0) > 1.0 - 1e-6
    numbers = {
        name: as_float(v) for name, v in estimate.diagnostics.items()
        if v is not None and np.ndim(v) == 0 and np.asarray(v).dtype.kind in "fiub"
    }  # fmt: skip
    return Estimate(ours, legs, None, way, valid, numbers, estimate.strides, feet)


def _mask(span: tuple[int, int] | None, samples: int, otherwise: bool) -> np.ndarray:
    index = np.arange(samples)
    return np.full(samples, otherwise) if span is None else (index >= span[0]) & (index < span[1])


def _item(
    estimator: Estimator[PyTree, PyTree], walk: Walk, body_measures: Callable[[Walk], dict[str, PyTree]] | None,
    windows: Callable[[Walk, Prepared[PyTree]], Windows] | None, reference: bool,
) -> _Item:  # fmt: skip
    """A lesson of one walk. Raises RecordingError if the walk cannot be used."""
    truth = walk.reference if reference else None
    if reference and truth is None:
        raise RecordingError("there is no reference to learn from")
    made = estimator.prepared(walk.recording)
    where = Windows(None, made.standing) if windows is None else windows(walk, made)
    truth = None if truth is None else resampled(truth, made.inputs.time)
    samples = np.shape(made.inputs.time)[0]
    look = _mask(where.look, samples, True)
    judged = np.flatnonzero(look if truth is None else look & truth.valid)
    if not judged.size:
        raise RecordingError("the reference has no valid sample in the window that is compared")
    body = {} if body_measures is None else {name: as_float(value) for name, value in body_measures(walk).items()}
    standing = _mask(where.standing, samples, False)
    first, last = np.asarray(judged[0]), np.asarray(judged[-1])
    lesson = Lesson(made.inputs, truth, look, standing, first, last, body)
    return _Item(walk.recording.name, walk.recording.subject, str(walk.info.get("day") or ""), made.options, lesson)


def _form(item: _Item) -> dict[str, Hashable]:
    """What is equal for lessons that can be stacked: the options, and of each array the axes, of a body's the shape."""
    truth = item.lesson.reference
    bare = None if truth is None else truth._replace(diagnostics={}, strides=None)  # may differ
    leaves, _ = jax.tree_util.tree_flatten_with_path(item.lesson._replace(reference=bare, body={}))
    fields = item.options._asdict() if hasattr(item.options, "_asdict") else {"options": item.options}
    axes = {jax.tree_util.keystr(path[:3]).lstrip("."): np.ndim(leaf) for path, leaf in leaves}
    return fields | axes | {f"body.{name}": np.shape(value) for name, value in item.lesson.body.items()}


def _difference(form: dict[str, Hashable], usual: dict[str, Hashable]) -> str:
    """Why a lesson cannot be stacked with the usual ones, in words."""
    each = [
        f"it lacks {name}" if name not in form else f"it alone has {name}" if name not in usual
        else f"{name} is {form[name]} here, {usual[name]} there"
        for name in sorted(form.keys() | usual.keys()) if form.get(name) != usual.get(name)
    ]  # fmt: skip
    return f"it cannot be stacked with most of the walks ({'; '.join(each)})"


def lengthened(lesson: Lesson, samples: int) -> Lesson:
    """A lesson with invalid samples at its end, up to a number of samples; they change no loss."""
    more = samples - lesson.look.size
    inputs, truth = pad(lesson.inputs, samples), lesson.reference
    if truth is not None:
        bare = truth._replace(time=None, valid=None, diagnostics=None, strides=None)
        longer = jax.tree.map(lambda v: np.pad(v, [(0, more)] + [(0, 0)] * (np.ndim(v) - 1), mode="edge"), bare)
        truth = longer._replace(
            time=as_float(inputs.time), valid=np.pad(truth.valid, (0, more)), diagnostics=truth.diagnostics,
            strides=truth.strides,
        )  # fmt: skip
    look, standing = (np.pad(mask, (0, more)) for mask in (lesson.look, lesson.standing))
    return lesson._replace(inputs=inputs, reference=truth, look=look, standing=standing)


def _alike(lessons: list[Lesson]) -> Iterator[Lesson]:
    """The lessons with as many samples as the longest has, and their references with the diagnostics and the columns of
    strides that all have, and as many strides as the longest table has.
    """
    samples = max(lesson.look.size for lesson in lessons)
    truths = [lesson.reference for lesson in lessons if lesson.reference is not None]
    numbers = set.intersection(*(set(truth.diagnostics) for truth in truths)) if truths else set()
    tables = [{name: np.asarray(column) for name, column in truth.strides._asdict().items() if column is not None}
              for truth in truths if truth.strides is not None]  # fmt: skip
    columns = set.intersection(*map(set, tables)) if tables else set()
    longest = max(tables, key=lambda table: table["valid"].size, default={})
    for lesson in lessons:
        if (truth := lesson.reference) is not None:
            padded: dict[str, PyTree] = {name: np.zeros_like(longest[name]) for name in columns}
            for name in columns if truth.strides is not None else ():
                values = getattr(truth.strides, name)
                padded[name][: len(values)] = values
            empty: dict[str, PyTree] = dict.fromkeys(Strides._fields)
            strides = Strides(**(empty | padded)) if tables else None
            known = {name: truth.diagnostics[name] for name in sorted(numbers)}
            lesson = lesson._replace(reference=truth._replace(strides=strides, diagnostics=known))
        yield lengthened(lesson, samples)


def lessons(
    estimator: Estimator[PyTree, PyTree], walks: Iterable[Walk], *,
    body: Callable[[Walk], dict[str, PyTree]] | None = None,
    windows: Callable[[Walk, Prepared[PyTree]], Windows] | None = None, reference: bool = True,
) -> Lessons:  # fmt: skip
    """Prepare walks for a fit; a walk that cannot be used is a failure and does not stop the others.

    A walk that cannot be stacked with most of the walks (another leg, no accelerometer, a reference without angles, a
    person without a measure that `body` gives of most) is a failure too; such walks need a separate fit.

    Args:
        estimator: from `jgait.estimators`.
        walks: the walks, read one by one.
        body: walk → body measures of the person, which `Estimator.with_body` puts into the parameters in every use,
            whichever parameters are fitted; None for none.
        windows: (walk, prepared) → `Windows`; None: the whole walk, relative to the standing detected.
        reference: whether a reference is needed; if False, none is kept, for losses without a reference.

    Raises:
        ValueError: if no walk can be used; the message gives the reason.
        TypeError: if an item is no walk.
    """
    items: list[_Item] = []
    failures: list[tuple[str, str]] = []
    for walk in walks:
        check_kind(walk, Walk, "walks must be jgait.types.Walk(recording, reference, info)")
        try:
            items.append(_item(estimator, walk, body, windows, reference))
        except ImportError:
            raise
        except Exception as error:  # an error in one walk must not stop the others
            failures.append((walk.recording.name, reason_of(error)))
    if not items:
        reasons = "; ".join(f"{names}: {reason}" for reason, names in [*by_reason(failures).items()][:5])
        raise ValueError(f"no walk to learn from: {reasons or 'there are none'}")
    forms = [_form(item) for item in items]
    kinds = [tuple(sorted(form.items(), key=lambda part: part[0])) for form in forms]
    usual = kinds.index(Counter(kinds).most_common(1)[0][0])
    kept = [item for item, kind in zip(items, kinds, strict=True) if kind == kinds[usual]]
    failures += [
        (item.name, _difference(form, forms[usual]))
        for item, form in zip(items, forms, strict=True) if form != forms[usual]
    ]  # fmt: skip
    padded = list(_alike([item.lesson for item in kept]))
    data = jax.tree.map(lambda *leaves: np.stack([np.asarray(leaf) for leaf in leaves]), *padded)
    subjects, days = (tuple(people(getattr(item, field) for item in kept)) for field in ("subject", "day"))
    return Lessons(data, kept[0].options, subjects, days, tuple(item.name for item in kept), tuple(failures))
