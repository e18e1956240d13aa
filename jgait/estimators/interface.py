"""Interface of all estimators: `prepare` on the host, the pure function `run`, and `estimate`, which calls both.

The annotation of each field of the inputs defines its first axis, and how padding fills it:

gyr: Held       one entry a sample, padding repeats the last entry
begin: Annotated[Any, Axis("zero", 10, 2)]      one entry a stride, samples // 10 + 2 entries with padding
"""

import functools
from collections.abc import Callable
from typing import Annotated, Literal, NamedTuple, get_type_hints

import jax
import numpy as np
from jaxtyping import PyTree

from jgait.estimators.about import About
from jgait.estimators.plausible import implausible
from jgait.estimators.programs import bucket
from jgait.estimators.proportions import gives, with_proportions
from jgait.estimators.walking import inside, walking_alone
from jgait.geometry.arrays import on_host
from jgait.notes import Note, record
from jgait.params import check_params, ranges
from jgait.quality import SensorQuality, merged, with_time_spread
from jgait.types import Estimate, Measures, Recording, Values, as_float, check_kind, check_recording


class Axis(NamedTuple):
    """The first axis of a field."""

    #: values of the padding: "zero" (False), "one" (True), "hold" (the last entry repeated), or "onwards" (even steps
    #: from the last entry).
    fill: Literal["zero", "one", "hold", "onwards"] = "zero"
    every: int = 1  #: number of samples for each of which there is an entry.
    ends: int = 0  #: number of entries beside them.

    def length(self, samples: int) -> int:
        """The length of the axis in a recording of this number of samples."""
        return samples // self.every + self.ends

    def padded(self, values: np.ndarray, more: int) -> np.ndarray:
        """The array with `more` entries of padding."""
        if not more:
            return values
        if self.fill == "onwards":
            step = float(np.median(np.diff(values)))
            return np.concatenate([values, values[-1] + step * np.arange(1, more + 1)])
        width = [(0, more)] + [(0, 0)] * (values.ndim - 1)
        if self.fill == "hold":
            return np.pad(values, width, mode="edge")
        return np.pad(values, width, constant_values=int(self.fill == "one"))


type Sampled = Annotated[Values, Axis()]
"""(T, …), one entry a sample; 0 or False in padding."""

type Held = Annotated[Values, Axis("hold")]
"""(T, …), one entry a sample; padding repeats the last entry."""

type Times = Annotated[Values, Axis("onwards")]
"""(T,) [s]; padding continues in even steps."""


@functools.cache
def axes_of(record: PyTree) -> dict[str, Axis | None]:
    """The axis of each field of a NamedTuple; None for a field that is not padded."""

    def axis(hint: object) -> Axis | None:
        hint = getattr(hint, "__value__", hint)
        return next((mark for mark in getattr(hint, "__metadata__", ()) if isinstance(mark, Axis)), None)

    return {name: axis(hint) for name, hint in get_type_hints(record, include_extras=True).items()}


def pad[I](inputs: I, samples: int) -> I:
    """The inputs with invalid samples at the end, so that recordings of different length can be stacked.

    The estimate at the first T samples is unchanged. Axes are annotations of the fields; `time` is (T,).

    Raises:
        ValueError: if `samples` is less than T.
    """
    have = int(np.shape(inputs.time)[0])  # type: ignore[attr-defined]
    if samples < have:
        raise ValueError(f"pad only lengthens; got {have} samples and {samples} wanted")

    def grown(record: PyTree) -> PyTree:
        changed = {}
        for name, axis in axes_of(record.__class__).items():
            value = getattr(record, name)
            if axis is not None:
                more, padded = axis.length(samples) - axis.length(have), axis.padded
                changed[name] = jax.tree.map(lambda v, more=more, padded=padded: padded(np.asarray(v), more), value)
            elif isinstance(value, tuple) and hasattr(value, "_fields"):
                changed[name] = grown(value)
        return record._replace(**changed)

    padded: I = grown(inputs)
    return padded


@record
class Prepared[I](NamedTuple):
    """A recording prepared for the pure function `run` of an estimator."""

    #: NamedTuple of NumPy arrays with annotated axes, see `Axis`, one of them `time` (T,); recordings of the same T and
    #: structure can be stacked.
    inputs: I
    options: PyTree  #: static options of `run`, hashable; recordings with the same options share a compiled program.
    notes: tuple[Note, ...]  #: notes on decisions about the recording and its problems.
    #: half-open range of samples of quiet standing; None if the estimator does not detect it.
    standing: tuple[int, int] | None = None
    extra: PyTree = None  #: further input of `finish`; it stays on the host.
    #: placement → facts about its sensor.
    quality: dict[str, SensorQuality] = {}  # noqa: RUF012
    #: stretches in which the person moves without walking, see `Recording`.
    moves: tuple[tuple[float, float], ...] = ()


@record
class Estimator[P, I](NamedTuple):
    """An estimator as a record of functions, the same for all estimators, for cohorts and tuners."""

    name: str  #: name in `jgait.estimators`.
    params: P  #: default parameters, natural units, with declared ranges.
    #: recording → `Prepared`, on the host; raises `RecordingError` for an unusable recording.
    prepare: Callable[[Recording], Prepared[I]]
    #: (params, inputs, options) → `Estimate`; pure, for jit, vmap and grad, `options` static. For one recording it gets
    #: NumPy's arrays and runs on the host: it writes functions of arrays as `geometry.arrays.xp.sqrt`, and calls
    #: filters and scans through `programs.compiled`.
    run: Callable[[P, I, PyTree], Estimate]
    #: (params, body) → parameters with the measures of a person; `body` maps a name, as in the diagnostics of a
    #: reference ("thigh_length" [m], …), to a number or to (right, left); pure, also for JAX arrays.
    with_body: Callable[[P, Measures], P]
    about: About = About()  #: description of the estimator: measures, options, tables, figures, flags.
    per_stride: tuple[str, ...] = ()  #: names of the diagnostics with an entry for each stride.
    #: (estimate without padding, `Prepared`) → the estimate of one recording; on the host.
    finish: Callable[[Estimate, Prepared[I]], Estimate] | None = None
    #: (params, inputs, options) → the estimate of a long recording, computed in parts, or None for a recording that is
    #: not long; on the host.
    in_parts: Callable[[P, I, PyTree], Estimate | None] | None = None
    #: names of the parameters, or of groups of parameters, on which no number of the estimate depends, so that its
    #: gradient is zero by construction.
    unused: tuple[str, ...] = ()
    #: (params, inputs, options) → log-likelihood of the measurements [nat] for tuning; pure, `options` static. None:
    #: the sum of the diagnostics `log_likelihood…`.
    likelihood: Callable[[P, I, PyTree], Values] | None = None
    #: whether a path goes on through movements that are no walking: `prepare` gets the sensors as they are, and leaves
    #: out the strides in `Recording.moves`. Otherwise it gets standing in their place.
    through: bool = False

    @property
    def transforms(self) -> P:
        """The declared ranges of the parameters, in the same type."""
        return ranges(self.params)

    def pad(self, inputs: I, samples: int) -> I:
        """The inputs with invalid samples at the end, which do not change the estimate; see `pad`."""
        return pad(inputs, samples)

    def estimate(self, p: P, recording: Recording) -> Estimate:
        """The estimate of one recording: prepared, padded, computed, without padding.

        Args:
            p: parameters.
            recording: with the sensors that the estimator's package lists.

        Returns:
            An `Estimate` of NumPy arrays; `diagnostics["notes"]` lists decisions and problems, `standing` is the
            half-open range of samples of quiet standing, or None; `sensors` maps placements to the `SensorQuality`.

        Raises:
            RecordingError: an unusable recording.
            ValueError: a parameter outside its range.
            TypeError: an argument of another kind.
        """
        kind = type(self.params)
        check_kind(p, kind, f"the first argument must be parameters, {kind.__name__}")
        check_recording(recording)
        check_params(p, self.transforms, self.params)
        prepared = self.prepared(recording)
        with np.errstate(all="ignore"):  # padding, and samples that are not valid
            result = self.parts(p, prepared) or self.run(*self.arguments(p, prepared))
        return self.finished(result, prepared)

    def prepared(self, recording: Recording) -> Prepared[I]:
        """The result of `prepare` for the walking of a recording alone, with the notes and facts of the reader."""
        walking = walking_alone(recording)
        sensors = recording.sensors if self.through else walking.recording.sensors
        made = self.prepare(walking.recording._replace(sensors=sensors))
        read = {name: facts for name, facts in recording.quality.items() if name in made.quality}
        notes = (*recording.notes, *walking.notes, *made.notes)
        moves = () if self.through else walking.spans
        return made._replace(notes=notes, quality=merged(read, made.quality), moves=moves)

    def solve(self, p: P, prepared: Prepared[I]) -> Estimate:
        """The estimate of a prepared recording; as `estimate`."""
        return self.finished(self.computed(p, prepared), prepared)

    def computed(self, p: P, prepared: Prepared[I]) -> Estimate:
        """The estimate before `finished`."""
        with np.errstate(all="ignore"):
            return self.parts(p, prepared) or self.run(*self.arguments(p, prepared))

    def parts(self, p: P, prepared: Prepared[I]) -> Estimate | None:
        """The result of `in_parts`, None without one."""
        return self.in_parts and self.in_parts(on_host(p), on_host(prepared.inputs), prepared.options)

    def arguments(self, p: P, prepared: Prepared[I]) -> tuple[P, I, PyTree]:
        """The arguments of `run` for a prepared recording: padded, so that few programs are compiled, on the host."""
        inputs = on_host(prepared.inputs)
        return on_host(p), pad(inputs, bucket(len(inputs.time))), prepared.options

    def finished(self, result: Estimate, prepared: Prepared[I]) -> Estimate:
        """The result of `estimate`, from that of `computed`."""
        result = trimmed(result, len(prepared.inputs.time), self.per_stride)  # type: ignore[attr-defined]
        facts = {"notes": prepared.notes, "standing": prepared.standing, "sensors": prepared.quality}
        result = result._replace(diagnostics={**result.diagnostics, **facts})
        result = result if self.finish is None else self.finish(result, prepared)
        result = result._replace(valid=result.valid & ~inside(as_float(result.time), prepared.moves))
        result = with_time_spread(result, prepared.quality)
        notes = (*result.diagnostics["notes"], *implausible(result))
        return result._replace(diagnostics={**result.diagnostics, "notes": notes})


def trimmed(result: Estimate, samples: int, per_stride: tuple[str, ...]) -> Estimate:
    """An estimate without padding, as NumPy arrays; strides, and diagnostics `per_stride`, in order of their ends."""
    result = jax.tree.map(np.asarray, result)
    padded = np.size(result.time)
    by_stride = {name: result.diagnostics[name] for name in per_stride if name in result.diagnostics}
    rest = {name: value for name, value in result.diagnostics.items() if name not in by_stride}
    strides, stddev = result.strides, result.strides_stddev
    if strides is not None:
        rows = np.flatnonzero(strides.valid)
        rows = rows[np.argsort(strides.end[rows], kind="stable")]
        strides, stddev, by_stride = jax.tree.map(lambda column: column[rows], (strides, stddev, by_stride))
    short = jax.tree.map(
        lambda leaf: leaf[:samples] if leaf.ndim and len(leaf) == padded else leaf,
        result._replace(strides=None, strides_stddev=None, diagnostics=rest),
    )
    return short._replace(strides=strides, strides_stddev=stddev, diagnostics=short.diagnostics | by_stride)


def with_measures[P](estimator: str, measures: tuple[str, ...], p: P, body: Measures) -> P:
    """The parameters with the measures of a person: each measure replaces the parameter of the same name.

    Args:
        estimator: name of the estimator in error messages.
        measures: names of the measures that the estimator accepts.
        p: parameters; a parameter with a value for each leg is a pair (right, left).
        body: name → a number or (right, left), as far as known. A parameter of one number gets the mean of both.
            "height" [m] gives the measures that are not in `body`, see `jgait.estimators.proportions`.

    Raises:
        ValueError: if `body` contains another name, or a measure is not one number or two.
    """
    body = with_proportions(body, measures)
    if unknown := [name for name in body if name not in measures]:
        named = (*measures, "height") if gives(measures) else measures
        takes = " and ".join(filter(None, [", ".join(named[:-1]), named[-1]]))
        raise ValueError(f"{estimator} takes {takes} of a person; got {unknown[0]!r}")

    def number(value: PyTree) -> Values:
        return value if isinstance(value, jax.Array) else float(value)

    def put(name: str, value: PyTree) -> PyTree:
        both = tuple(value) if isinstance(value, tuple | list) or np.ndim(value) else (value, value)
        if len(both) != 2:
            raise ValueError(f"{name} must be one number or (right, left); got {len(both)} numbers")
        pair, current = tuple(map(number, both)), getattr(p, name)
        return type(current)(*pair) if isinstance(current, tuple) else 0.5 * sum(pair)

    return p._replace(**{name: put(name, value) for name, value in body.items()})  # type: ignore[attr-defined]
