"""The check of annotations while tests run: beartype; an int passes as a float, a generic record as a tuple."""

import functools
import operator
import types
import typing
from collections.abc import Callable
from typing import Any

import beartype
import numpy as np
import numpy.typing as npt

_PACKAGES = ("params", "types", "geometry", "signal", "tune", "evaluate", "events", "mounting")

MODULES = [f"jgait.{name}" for name in _PACKAGES]
"""Modules whose functions are checked, with all below them."""

_NUMBERS = {int: int | np.integer, float: float | int | np.floating | np.integer, bool: bool | np.bool_}
"""Python's numbers, or those of NumPy; an int passes as a float."""


def check[F: Callable[..., Any]](function: F) -> F:
    """The function, with its arguments and its result checked against the annotations at each call."""
    annotations = getattr(function, "__annotations__", {})
    for name, hint in annotations.items():
        annotations[name] = _checkable(hint)
    return beartype.beartype(function)


def _checkable(hint: Any) -> Any:
    """The hint without what beartype 0.23 does not check: generic NamedTuples, protocols, names in strings."""
    if isinstance(hint, type) and hint in _NUMBERS:
        return _NUMBERS[hint]
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    plain = origin or hint
    if hint is npt.ArrayLike or isinstance(hint, str | typing.ForwardRef) or getattr(plain, "_is_protocol", False):
        return object
    if isinstance(plain, type) and issubclass(plain, tuple) and getattr(plain, "__parameters__", ()):
        return tuple
    if origin in (types.UnionType, typing.Union):
        return functools.reduce(operator.or_, map(_checkable, arguments))
    if origin in (tuple, list, dict):
        return origin[tuple(map(_checkable, arguments))]
    return hint
