"""What every estimator offers: decisions on the host, a pure function to compile and map, and what both come to."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import PyTree

from jgait.estimators.about import About
from jgait.estimators.axes import pad
from jgait.estimators.run import bucket, compiled, trimmed
from jgait.notes import Note
from jgait.params import check_params
from jgait.types import Estimate, Recording, Values


class Prepared[I](NamedTuple):
    """A recording made ready for the pure part of an estimator.

    Attributes:
        inputs: NamedTuple of NumPy arrays whose fields state their axes, see `jgait.estimators.axes`, one of them
            `time` (T,); recordings of one T and one structure stack.
        options: what the recording decides at compile time, hashable; recordings that share it share a program.
        notes: what was decided or noticed on the way.
        standing: half-open range of samples of quiet standing; None where none was looked for.
        extra: what the estimator's own `finish` takes; it stays on the host.
    """

    inputs: I
    options: Any
    notes: tuple[Note, ...]
    standing: tuple[int, int] | None = None
    extra: PyTree = None


class Estimator[P, I](NamedTuple):
    """An estimator as functions, so that cohorts and tuners need not know which one it is.

    Attributes:
        name: as in `jgait.estimators`.
        params: default parameters, natural units.
        transforms: their ranges, in the same type.
        prepare: recording → `Prepared`, on the host; raises `RecordingError` for what cannot be used.
        run: (params, inputs, options) → `Estimate`; pure, for jit, vmap and grad, `options` static.
        own: (params, body) → parameters with a person's own measures put in; `body` maps a name as of the
            diagnostics of a reference ("thigh_length" [m], …) to a number or to (right, left); pure, arrays welcome.
        about: what the estimator states about itself: measures, options, tables, figures, flags.
        per_stride: names of the diagnostics with an entry for each stride.
        finish: (estimate without padding, what was prepared) → the estimate of one recording; on the host.
        in_parts: (params, inputs, options) → the estimate of a recording so long that it is run in parts, or None of
            one that is not; on the host.
        unused: names of the parameters, or of groups of parameters, on which no number of the estimate depends, so
            that its gradient is zero by construction.
    """

    name: str
    params: P
    transforms: P
    prepare: Callable[[Recording], Prepared[I]]
    run: Callable[[P, I, PyTree], Estimate]
    own: Callable[[P, dict[str, PyTree]], P]
    about: About = About()
    per_stride: tuple[str, ...] = ()
    finish: Callable[[Estimate, Prepared[I]], Estimate] | None = None
    in_parts: Callable[[P, I, PyTree], Estimate | None] | None = None
    unused: tuple[str, ...] = ()

    def pad(self, inputs: I, samples: int) -> I:
        """The inputs with invalid samples behind them, the estimate before them unchanged; see `axes.pad`."""
        return pad(inputs, samples)

    def estimate(self, p: P, recording: Recording) -> Estimate:
        """The estimate of one recording: prepared, padded, computed, without padding.

        Args:
            p: parameters.
            recording: as the estimator's package says.

        Returns:
            An `Estimate` of NumPy arrays; `diagnostics["notes"]` says what was decided or noticed, `standing` is the
            half-open range of samples of quiet standing, or None.

        Raises:
            RecordingError: a recording that cannot be used.
            ValueError: a parameter outside its range.
        """
        check_params(p, self.transforms)
        prepared = self.prepare(recording)
        return self.solve(p, prepared._replace(notes=(*recording.notes, *prepared.notes)))

    def solve(self, p: P, prepared: Prepared[I]) -> Estimate:
        """The estimate of what was prepared; as `estimate`."""
        inputs, options = prepared.inputs, prepared.options
        samples = len(inputs.time)  # type: ignore[attr-defined]
        result = None if self.in_parts is None else self.in_parts(p, inputs, options)
        if result is None:
            result = compiled(self.run)(p, pad(inputs, bucket(samples)), options)
        result = trimmed(result, samples, self.per_stride)
        facts = {"notes": prepared.notes, "standing": prepared.standing}
        result = result._replace(diagnostics={**result.diagnostics, **facts})
        return result if self.finish is None else self.finish(result, prepared)


def with_measures[P](estimator: str, measures: tuple[str, ...], p: P, body: dict[str, Any]) -> P:
    """Parameters with a person's own measures put in: those of the same names.

    Args:
        estimator: its name, for the message.
        measures: names that the estimator takes.
        p: parameters; of a measure with a value for each leg the parameter is a pair (right, left).
        body: name → a number or (right, left), as far as known. Where the parameter is one number, the mean counts.

    Raises:
        ValueError: if `body` names anything else, or a measure is not one number or two.
    """
    unknown = [name for name in body if name not in measures]
    if unknown:
        takes = " and ".join(filter(None, [", ".join(measures[:-1]), measures[-1]]))
        raise ValueError(f"{estimator} takes {takes} of a person; got {unknown[0]!r}")

    def number(value: PyTree) -> Values:
        return value if isinstance(value, jax.Array) else float(value)

    def put(name: str, value: PyTree) -> PyTree:
        both = tuple(value) if isinstance(value, tuple | list) or np.ndim(value) else (value, value)
        if len(both) != 2:
            raise ValueError(f"{name} must be one number or (right, left); got {len(both)} numbers")
        own = getattr(p, name)
        if isinstance(own, tuple):
            return type(own)(*map(number, both))
        return number(both[0]) if both[0] is both[1] else 0.5 * (number(both[0]) + number(both[1]))

    return p._replace(**{name: put(name, value) for name, value in body.items()})  # type: ignore[attr-defined]
