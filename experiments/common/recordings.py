"""Public recordings as all experiments load them: what is absent or cannot be read is printed, and left out."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from experiments.common.sets import datasets
from jgait.types import SIDES, Walk

MAIN_WALK = {"gaitmap_example": "imu_sample"}
"""The one recording of a set that has a reference of its own: the others are the same walk again, or have none."""


def available(name: str) -> bool:
    """Whether a data set is here; prints the reason if it is not."""
    if datasets.available(name):
        return True
    print(f"left out: {datasets.unavailable_reason(name)}")
    return False


def names(name: str) -> list[str]:
    """The recordings of a data set that have a reference."""
    return [one for one in datasets.names(name) if MAIN_WALK.get(name, one) == one]


def walks(name: str, only: Sequence[str] | None = None) -> datasets.Walks:
    """The recordings of a data set, and the reasons of those that cannot be read (printed too).

    Args:
        name: of the set.
        only: names of recordings; None: all that have a reference.

    Raises:
        DatasetUnavailable: if the set is not there.
    """
    loaded = datasets.load(name, list(names(name) if only is None else only))
    for failure in loaded.failures:
        print(f"{name}: {failure.name} left out: {failure.reason}")
    return loaded


def attempt(what: str, call: Callable[[], Any]) -> Any:
    """The result of a call, or None after the error was printed: one bad recording must not cost the others.

    An error that a recording cannot cause, such as an attribute that is gone, is raised.
    """
    try:
        return call()
    except (ValueError, OSError, RuntimeError, LookupError, ArithmeticError) as error:
        print(f"{what} left out: {type(error).__name__}: {' '.join(str(error).split())[:200]}")
        return None


def foot_centres(walk: Walk) -> dict[str, np.ndarray]:
    """Side → (m, 3) mean of the markers on a foot of `gaitmap_example`: heel, toe and fifth metatarsal [m]."""
    return {side: sum(walk.info["mocap"][side].values()) / len(walk.info["mocap"][side]) for side in SIDES}
