"""What every estimator offers to those who run it on many recordings: decide, pad, and a pure function to map."""

import math
from collections.abc import Callable, Collection, Hashable
from typing import Any, NamedTuple

import numpy as np

from jgait.estimators.about import About
from jgait.types import Estimate, Recording


class Prepared[I](NamedTuple):
    """A recording made ready for the pure part of an estimator.

    Attributes:
        inputs: pytree of NumPy arrays, one of them `time` (T,); recordings of one T and one structure stack.
        options: what the recording decides at compile time; recordings that share it share a program.
        notes: in words, what was decided or noticed on the way.
        standing: half-open range of samples of quiet standing; None where none was looked for.
    """

    inputs: I
    options: Hashable
    notes: tuple[str, ...]
    standing: tuple[int, int] | None = None


def _nothing(params: Any, recording: Recording) -> Estimate:
    raise NotImplementedError("this estimator has no way to estimate one recording")


class Estimator[P, I](NamedTuple):
    """An estimator as functions, so that cohorts and tuners need not know which one it is.

    Attributes:
        name: as in `jgait.estimators`.
        params: default parameters, natural units.
        transforms: their ranges, in the same type.
        prepare: recording → `Prepared`, on the host; raises `RecordingError` for what cannot be used.
        pad: (inputs, samples) → inputs with invalid samples behind, the estimate before them unchanged.
        run: (params, inputs, options) → `Estimate`; pure, for jit, vmap and grad, `options` static.
        own: (params, body) → parameters with a person's own measures put in; `body` maps a name as of the
            diagnostics of a reference ("thigh_length" [m], …) to a number or to (right, left); pure, arrays welcome.
        about: what the estimator states about itself: measures, options, tables, figures, flags.
        estimate: (params, recording) → `Estimate` of one recording, without padding; on the host.
    """

    name: str
    params: P
    transforms: P
    prepare: Callable[[Recording], Prepared[I]]
    pad: Callable[[I, int], I]
    run: Callable[[P, I, Any], Estimate]
    own: Callable[[P, dict[str, Any]], P]
    about: About = About()
    estimate: Callable[[P, Recording], Estimate] = _nothing


def bucket(samples: int, smallest: int) -> int:
    """The length to pad to: the smallest one times a power of two, so that few programs are compiled."""
    return smallest * 2 ** max(0, math.ceil(math.log2(samples / smallest)))


def lengthened(time: Any, samples: int) -> np.ndarray:
    """Times (T,) that go on in even steps to some number of samples.

    Raises:
        ValueError: if that is less than T.
    """
    time = np.asarray(time)
    if samples < time.size:
        raise ValueError(f"pad only lengthens; got {time.size} samples and {samples} wanted")
    step = float(np.median(np.diff(time)))
    return np.concatenate([time, time[-1] + step * np.arange(1, samples - time.size + 1)])


def grown[R](
    record: R, samples: int, rows: int, *, per_sample: Collection[str], per_row: Collection[str] = (),
    held: Collection[str] = (),
) -> R:  # fmt: skip
    """A record of arrays with more behind some of them: padding of signals, and of tables with room for more rows.

    Args:
        record: NamedTuple of arrays.
        samples: how many more samples.
        rows: how many more rows.
        per_sample: names of the fields (T, …).
        per_row: names of the fields (K, …).
        held: names of the fields whose last entry goes on; others go on with zeros.

    Returns:
        The same record; fields that are not named are unchanged.
    """

    def longer(name: str, values: Any) -> np.ndarray:
        values = np.asarray(values)
        more = samples if name in per_sample else rows if name in per_row else 0
        width = [(0, more)] + [(0, 0)] * (values.ndim - 1)
        return np.pad(values, width, mode="edge" if name in held else "constant") if more else values

    fields = record._asdict()  # type: ignore[attr-defined]
    return record._replace(**{name: longer(name, values) for name, values in fields.items()})  # type: ignore[attr-defined]
