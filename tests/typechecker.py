"""How annotations are checked while tests run: beartype, an int where a float is asked, generic records as tuples."""

import functools
import operator
import types
import typing
from collections.abc import Callable
from typing import Any

import beartype

_CONFIGURATION = beartype.BeartypeConf(is_pep484_tower=True)


def check[F: Callable[..., Any]](function: F) -> F:
    """The function, its arguments and its result checked against their annotations at each call."""
    annotations = getattr(function, "__annotations__", {})
    for name, hint in annotations.items():
        annotations[name] = _without_generic_records(hint)
    return beartype.beartype(conf=_CONFIGURATION)(function)


def _without_generic_records(hint: Any) -> Any:
    """A hint with `tuple` for each generic NamedTuple, which beartype 0.23 does not check."""
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    record = origin or hint
    if isinstance(record, type) and issubclass(record, tuple) and getattr(record, "__parameters__", ()):
        return tuple
    if origin in (types.UnionType, typing.Union):
        return functools.reduce(operator.or_, map(_without_generic_records, arguments))
    if origin in (tuple, list, dict):
        return origin[tuple(map(_without_generic_records, arguments))]
    return hint
