"""Reading a data set walk by walk: a failure is kept with its reason, and the others are not lost."""

from collections.abc import Callable, Iterable
from typing import NamedTuple

from jgait.types import Walk


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
