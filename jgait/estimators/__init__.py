"""Published estimators, one method a file; `get` finds one by name."""

from typing import Any

from jgait.estimators import leg_ekf
from jgait.estimators.interface import Estimator, Prepared

__all__ = ["Estimator", "Prepared", "get", "names"]

_ESTIMATORS = {"leg_ekf": leg_ekf.estimator}


def names() -> tuple[str, ...]:
    """The estimators there are."""
    return tuple(_ESTIMATORS)


def get(name: str, *args: Any) -> Estimator:
    """An estimator by name.

    Args:
        name: one of `names()`.
        args: its options, for example `leg_ekf.PAPER`.

    Raises:
        ValueError: if there is none of that name.
    """
    if name not in _ESTIMATORS:
        raise ValueError(f"estimator must be one of {', '.join(names())}; got {name!r}")
    return _ESTIMATORS[name](*args)
