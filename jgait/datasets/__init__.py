"""Public recordings with a reference, by name: `load("neura_sparse")`, `load("walking5m")`.

The package contains no data: `fetch(name)` downloads a set, or `JGAIT_DATA_DIR` names a folder that contains the sets.
A set may contain more recordings than this version of jgait lists; these are loaded and marked as unverified.
"""

from collections.abc import Callable, Collection, Iterable
from typing import NamedTuple

from jgait.datasets.registry import (
    ChecksumError,
    DatasetInfo,
    DatasetUnavailable,
    fetch,
    file,
    info,
    list_datasets,
    loader,
    missing,
    path,
    register,
    unavailable_reason,
)
from jgait.types import SIDES, Measures, Walk, reason_of

__all__ = [
    "ChecksumError",
    "DatasetInfo",
    "DatasetUnavailable",
    "Failure",
    "Walk",
    "Walks",
    "available",
    "body",
    "fetch",
    "file",
    "info",
    "list_datasets",
    "load",
    "missing",
    "names",
    "path",
    "register",
    "repeated",
    "unavailable_reason",
]


class Failure(NamedTuple):
    """A recording that could not be read, and why."""

    name: str
    reason: str


class Walks(list[Walk]):
    """Walks in a list; `failures` are (name, reason) of every recording that could not be read."""

    def __init__(self, walks: Iterable[Walk] = (), failures: Iterable[Failure] = ()) -> None:
        super().__init__(walks)
        self.failures: tuple[Failure, ...] = tuple(failures)


def names(name: str) -> tuple[str, ...]:
    """Names of the recordings of a data set on this computer, including those that jgait does not list. Raises
    DatasetUnavailable, with how to get the set, if there is none.
    """
    there = tuple(loader(name).names())
    if not there:
        raise DatasetUnavailable(unavailable_reason(name), name)
    return there


def available(name: str) -> bool:
    """Whether any recording of a data set is on this computer. Raises ValueError if the data set is not known."""
    return bool(loader(name).names())


def repeated(name: str) -> dict[str, str]:
    """Recordings of a data set that are of the same walk as another one on this computer: name → that one's name.
    Raises DatasetUnavailable if there is no recording of the set.
    """
    there = names(name)
    return {again: once for again, once in info(name).same_walk.items() if again in there and once in there}


def load(name: str, only: Collection[str] | None = None) -> Walks:
    """Every walk of a data set on this computer, with its reference.

    Args:
        name: data set, see `list_datasets`.
        only: names of recordings (see `names`); None: all, but of a walk that several recordings hold only the first,
            see `repeated`.

    Returns:
        The walks, a list; its attribute `failures` has the name of each recording that could not be read, and why.

    Raises:
        ValueError: if the data set, or a recording in `only`, is not known.
        TypeError: if `only` is a text: one recording is `only=["…"]`.
        DatasetUnavailable: if no file of the set is on this computer; the message states how to get the set.
    """
    there = names(name)
    if isinstance(only, str):
        raise TypeError(f"only must be a list of names of recordings, such as [{only!r}]; got a text")
    if only is None:
        only = set(there) - set(repeated(name))
    else:
        lacking = [wanted for wanted in only if wanted not in there]
        if lacking:
            raise ValueError(f"{name} has no recording {lacking[0]!r}; there are {', '.join(there)}")
    return load_each([wanted for wanted in there if wanted in only], loader(name).load_one)


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
