"""Public recordings with a reference, by name: `load("neura_sparse")`, `load("walking5m")`.

Nothing is bundled and nothing is downloaded unasked: `fetch(name)` downloads, or `JGAIT_DATA_DIR` names a folder that
holds the sets. A set may hold more recordings than this version of jgait lists; they are used, and marked unverified.
"""

from collections.abc import Collection

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
    unavailable_reason,
)
from jgait.datasets.walks import Failure, Walks, body, load_each
from jgait.types import Walk

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
    "unavailable_reason",
]


def names(name: str) -> tuple[str, ...]:
    """Names of the recordings of a data set that are there, those not known to this version of jgait included.

    Raises:
        DatasetUnavailable: if none is there; the message states how to get the set.
    """
    there = tuple(loader(name).names())
    if not there:
        raise DatasetUnavailable(unavailable_reason(name), name)
    return there


def available(name: str) -> bool:
    """Whether any recording of a data set is there.

    Raises:
        ValueError: if the data set is not known.
    """
    return bool(loader(name).names())


def load(name: str, only: Collection[str] | None = None) -> Walks:
    """Every recording of a data set that is there, with its reference.

    Args:
        name: data set, see `list_datasets`.
        only: names of recordings (see `names`); None: all.

    Returns:
        The walks, a list; its attribute `failures` names each recording that could not be read and why.

    Raises:
        ValueError: if the data set, or a recording in `only`, is not known.
        DatasetUnavailable: if nothing of the set is there; the message states how to get it.
    """
    there = names(name)
    if only is not None:
        lacking = [wanted for wanted in only if wanted not in there]
        if lacking:
            raise ValueError(f"{name} has no recording {lacking[0]!r}; there are {', '.join(there)}")
        there = tuple(wanted for wanted in there if wanted in only)
    return load_each(there, loader(name).load_one)
