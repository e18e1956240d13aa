"""Padding of the inputs of an estimator: the annotation of each field defines its first axis.

gyr: Held       one entry a sample, padding repeats the last entry
begin: Annotated[Any, Axis("zero", capacity)]      one entry a stride, `capacity(samples)` entries with padding
"""

import functools
from collections.abc import Callable
from typing import Annotated, Literal, NamedTuple, get_type_hints

import jax
import numpy as np
from jaxtyping import PyTree

from jgait.types import Values


def one_each(samples: int) -> int:
    """The length of an axis with one entry a sample."""
    return samples


class Axis(NamedTuple):
    """The first axis of a field."""

    #: values of the padding: "zero" (False), "one" (True), "hold" (the last entry repeated), or "onwards" (even steps
    #: from the last entry).
    fill: Literal["zero", "one", "hold", "onwards"] = "zero"
    length: Callable[[int], int] = one_each  #: number of samples → length of the axis.

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
    padded: I = _grown(inputs, have, samples)
    return padded


def _grown(record: PyTree, have: int, samples: int) -> PyTree:
    changed = {}
    for name, axis in axes_of(record.__class__).items():
        value = getattr(record, name)
        if axis is not None:
            more, padded = axis.length(samples) - axis.length(have), axis.padded
            changed[name] = jax.tree.map(lambda v, more=more, padded=padded: padded(np.asarray(v), more), value)
        elif isinstance(value, tuple) and hasattr(value, "_fields"):
            changed[name] = _grown(value, have, samples)
    return record._replace(**changed)


def fields_of(record: type, length: Callable[[int], int]) -> tuple[str, ...]:
    """Names of the fields whose first axis has this length."""
    return tuple(name for name, axis in axes_of(record).items() if axis is not None and axis.length is length)
