"""Reading a data set walk by walk: a recording that cannot be read is listed with its reason."""

from collections.abc import Callable, Iterable
from typing import NamedTuple

from jgait.types import SIDES, Measures, Walk, reason_of


class Failure(NamedTuple):
    """A recording that could not be read, and why."""

    name: str
    reason: str


class Walks(list[Walk]):
    """Walks in a list; `failures` are (name, reason) of every recording that could not be read."""

    def __init__(self, walks: Iterable[Walk] = (), failures: Iterable[Failure] = ()) -> None:
        super().__init__(walks)
        self.failures: tuple[Failure, ...] = tuple(failures)


def load_each(names: Iterable[str], load_one: Callable[[str], Walk]) -> Walks:
    """Load recordings one by one; a recording that cannot be read is listed in `failures`.

    ImportError is raised: a missing package is an error of the installation and not of the recording.
    """
    walks, failures = [], []
    for name in names:
        try:
            walks.append(load_one(name))
        except ImportError:
            raise
        except Exception as error:  # any error of one file is listed, and the other files are read
            failures.append(Failure(name, reason_of(error)))
    return Walks(walks, failures)


def body(walk: Walk) -> Measures:
    """Body measures of the person, as far as known, for `evaluate.cohort` and `tune.lessons`.

    Lengths are in `info["lengths"]` (public sets), or among the diagnostics of the reference (simulated walks).

    Returns:
        "thigh_length" and "shank_length" [m], each (right, left); unknown lengths are left out.
    """
    lengths = walk.info.get("lengths")
    if lengths is not None:
        names = ("thigh_length", "shank_length")
        return {name: tuple(float(lengths[side][i]) for side in SIDES) for i, name in enumerate(names)}
    known = {} if walk.reference is None else walk.reference.diagnostics
    return {name: (float(known[name]),) * 2 for name in ("thigh_length", "shank_length") if name in known}
