"""The records in which data sets come: a walk with its reference, or a failure with its reason."""

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from jgait.types import Estimate, Recording


class Walk(NamedTuple):
    """One recorded walk.

    Attributes:
        recording: what the sensors gave.
        reference: what an independent measurement says, in the type of an estimate; None where there is none.
        info: what else is known; each data set's module says which keys there are.
    """

    recording: Recording
    reference: Estimate | None
    info: dict[str, Any]


class Failure(NamedTuple):
    """A recording that could not be read, and why."""

    name: str
    reason: str


class Walks(list[Walk]):
    """Walks in a list; `failures` names the recordings that could not be read.

    Attributes:
        failures: (name, reason) of every recording that gave no walk.
    """

    def __init__(self, walks: Iterable[Walk] = (), failures: Iterable[Failure] = ()) -> None:
        super().__init__(walks)
        self.failures: tuple[Failure, ...] = tuple(failures)


def load_each(names: Iterable[str], load_one: Callable[[str], Walk]) -> Walks:
    """Load recordings one by one; what fails is named, and the others are not lost.

    A missing package is the installation's fault and not the recording's, so ImportError passes through.
    """
    walks, failures = [], []
    for name in names:
        try:
            walks.append(load_one(name))
        except ImportError:
            raise
        except Exception as error:  # whatever is wrong with one file, the others are still wanted
            failures.append(Failure(name, f"{type(error).__name__}: {error}"))
    return Walks(walks, failures)
