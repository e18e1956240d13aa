"""Sources and folders of the public recordings: address, sha256, local folder.

Every file is named by its upstream address (repository, commit, path) and its sha256. A data set NAME is three things:
its name in `NAMES`, its description and files in `NAME.json`, and its reader `NAME.py`, see `loader`. Another package
makes its own sets known by `register`.
Nothing is downloaded unless `fetch` is called. Files are looked for in `$JGAIT_DATA_DIR/<set>/<upstream path>`
when that folder exists, otherwise in the download cache.
"""

import functools
import hashlib
import importlib
import json
import os
from collections.abc import Callable, Iterable, Mapping
from importlib import resources
from pathlib import Path
from types import ModuleType
from typing import NamedTuple
from urllib.parse import quote, urlsplit

from jgait.notes import record

NAMES = ("neura_sparse", "walking5m", "footprints", "pyshoe_vicon")
"""The data sets of jgait; each has a module and a JSON file of its name in this folder."""

_homes = dict.fromkeys(NAMES, "jgait.datasets")  # data set → the package that has its module and its JSON file

DATA_DIR_VARIABLE = "JGAIT_DATA_DIR"


@record
class DatasetInfo(NamedTuple):
    """Description, source and licence of a data set."""

    name: str  #: short name, as in `load(name)`.
    title: str  #: one line that states what was recorded.
    repository: str  #: upstream repository, host/owner/name.
    commit: str  #: upstream commit the files are taken from.
    licence: str  #: upstream's licence, or the consequence if it has none.
    citation: str  #: the work to cite.
    files: dict[str, str]  #: upstream path → sha256, the files this version of jgait can fetch.
    same_walk: Mapping[str, str] = {}  #: recording → another one of the same walk, which counts for both.

    def address(self, path: str) -> str:
        """The upstream address of one file."""
        host, owner, repository = self.repository.split("/")
        if host != "github.com":
            raise ValueError(f"only github.com repositories can be addressed; {self.name} is at {host}")
        return f"https://raw.githubusercontent.com/{owner}/{repository}/{self.commit}/{quote(path)}"


class DatasetUnavailable(LookupError):
    """A data set, or a file of it, is neither in the data folder nor in the download cache.

    Attributes:
        dataset: name of the set.
        file: path of the file in the set; empty if the whole set is absent.
    """

    def __init__(self, message: str, dataset: str = "", file: str = "") -> None:
        super().__init__(message)
        self.dataset, self.file = dataset, file


class ChecksumError(ValueError):
    """The content of a file does not have the listed sha256."""


def loader(name: str) -> ModuleType:
    """The module of a data set, with `names()`, the recordings on this computer, and `load_one(name)`, a `Walk`. Raises
    ValueError if the data set is not known.
    """
    known = info(name).name
    return importlib.import_module(f"{_homes[known]}.{known}")


@functools.cache
def _registry() -> dict[str, DatasetInfo]:
    files = {name: resources.files(home).joinpath(f"{name}.json") for name, home in _homes.items()}
    return {name: DatasetInfo(name, **json.loads(file.read_text("utf-8"))) for name, file in files.items()}


def register(package: str, *names: str) -> None:
    """Let jgait know data sets of another package: each NAME is `NAME.py` and `NAME.json` in it, see `loader`."""
    _homes.update(dict.fromkeys(names, package))
    _registry.cache_clear()


def list_datasets() -> tuple[str, ...]:
    """Names of the data sets that can be loaded."""
    return tuple(_registry())


def info(name: str) -> DatasetInfo:
    """Title, address, licence, citation and file list of a data set.

    Raises:
        ValueError: if there is no data set of that name; the message lists all data sets.
    """
    known = _registry()
    if name not in known:
        raise ValueError(f"there is no data set {name!r}; known are {', '.join(known)}")
    return known[name]


def path(name: str) -> Path:
    """The folder of a data set, with files at their upstream paths; it may not exist yet.

    `$JGAIT_DATA_DIR/<name>` when that folder exists, otherwise the download cache.
    """
    return _folders(name)[0]


def _folders(name: str) -> tuple[Path, ...]:
    """Folders that are searched for files, in this order: the user's data folder, the download cache."""
    info(name)
    root = os.environ.get(DATA_DIR_VARIABLE)
    users = (Path(root) / name,) if root and (Path(root) / name).is_dir() else ()
    return (*users, _cache(name))


def _locate(name: str, upstream_path: str) -> Path | None:
    return next((folder / upstream_path for folder in _folders(name) if (folder / upstream_path).is_file()), None)


def listing(name: str, under: str, pattern: str) -> list[str]:
    """Sorted upstream paths of the files on this computer under a folder, listed or not; the pattern as for
    `Path.rglob`.
    """
    paths = set()
    for folder in _folders(name):
        paths |= {entry.relative_to(folder).as_posix() for entry in (folder / under).rglob(pattern) if entry.is_file()}
    return sorted(paths)


def missing(name: str) -> tuple[str, ...]:
    """Upstream paths of the listed files that are not on this computer."""
    return tuple(file for file in info(name).files if _locate(name, file) is None)


def unavailable_reason(name: str) -> str:
    """The message for an absent data set: the searched folders, and how to get the set."""
    root = os.environ.get(DATA_DIR_VARIABLE)
    looked = f"{DATA_DIR_VARIABLE}={root} has no folder {name}" if root else f"{DATA_DIR_VARIABLE} is not set"
    return (
        f"data set '{name}' is not there: {looked}, and {_cache(name)} holds none of it. "
        f"Download it with `python -c \"import jgait.datasets as d; d.fetch('{name}')\"` "
        f"(licence: {info(name).licence}), or set {DATA_DIR_VARIABLE} to a folder that has {name}/ "
        "with the files at their upstream paths."
    )


class _Meter:
    """What pooch calls while a file arrives; it reports the bytes that are here, and all of them."""

    total = 0

    def __init__(self, file: str, report: Callable[[str, int, int | None], None]) -> None:
        self.file, self.report, self.done = file, report, 0

    def update(self, more: int) -> None:
        self.done += more
        self.report(self.file, self.done, self.total or None)

    def reset(self) -> None:
        self.done = 0

    def close(self) -> None:
        pass


def fetch(
    name: str, files: Iterable[str] | None = None, *, progress: Callable[[str, int, int | None], None] | None = None
) -> Path:
    """Download a data set into the user's cache, each file checked against its sha256.

    Only this call downloads; `load` never does. A set without a stated licence (`walking5m`) is fetched for the
    caller's own use and must not be redistributed. Files that are already on this computer are not fetched again.

    Args:
        name: data set.
        files: upstream paths; None: every listed file that is missing.
        progress: called while a file arrives, with its path, the bytes that are here, and all of them if known.

    Raises:
        ValueError: if the data set, or a file of it, is not known.
        ChecksumError: if a downloaded file does not have the listed sha256.
        OSError: if there is no network, the server does not have the file, or the file cannot be written.
        ImportError: without the extra `io`.
    """
    known = info(name)
    wanted = missing(name) if files is None else tuple(files)
    unknown = [file for file in wanted if file not in known.files]
    if unknown:
        raise ValueError(f"{name} has no known file {unknown[0]!r}; info({name!r}).files lists them")
    if not wanted:
        return _cache(name)
    pooch = _pooch()
    import requests

    hashes = {file: f"sha256:{known.files[file]}" for file in wanted}
    urls = {file: known.address(file) for file in wanted}
    getter = pooch.create(path=_cache(name), base_url="", registry=hashes, urls=urls)
    for file in wanted:
        meter = False if progress is None else _Meter(file, progress)
        try:
            getter.fetch(file, downloader=pooch.HTTPDownloader(progressbar=meter, chunk_size=1 << 16))
        except requests.HTTPError as error:
            answer = " ".join(str(getattr(error.response, part)) for part in ("status_code", "reason"))
            raise OSError(f"{urls[file]} could not be downloaded: the server answers {answer}") from None
        except requests.RequestException as error:
            host = urlsplit(urls[file]).netloc
            reason = f"no connection to {host} ({type(error).__name__}); check the network"
            raise OSError(f"{urls[file]} could not be downloaded: {reason}") from None
        except ValueError:  # pooch has removed the file
            raise ChecksumError(
                f"{urls[file]} is not the file that was expected: its sha256 is not {known.files[file][:12]}…"
            ) from None
    return _cache(name)


def file(name: str, upstream_path: str, *, strict: bool = True) -> tuple[Path, bool]:
    """One file of a data set, and whether its sha256 was verified.

    Args:
        name: data set.
        upstream_path: path inside the upstream repository.
        strict: whether a listed file must have its sha256; False for an index that a fuller set extends.

    Returns:
        The local path, and True if the file is listed and its sha256 agrees, False if it is not listed
        (upstream has more files than this version of jgait lists).

    Raises:
        DatasetUnavailable: if the file is not on this computer.
        ChecksumError: if the file is listed and its sha256 differs.
    """
    local = _locate(name, upstream_path)
    if local is None:
        raise DatasetUnavailable(
            f"{name} lacks {upstream_path} in {path(name)}; jgait.datasets.fetch({name!r}) gets it", name, upstream_path
        )
    expected = info(name).files.get(upstream_path)
    if expected is None:
        return local, False
    stat = local.stat()
    digest = _sha256(local, stat.st_size, stat.st_mtime_ns)
    if digest != expected and not strict:
        return local, False
    if digest != expected:
        raise ChecksumError(
            f"{local} is not upstream's file: sha256 {digest[:12]}… found, {expected[:12]}… expected "
            f"(commit {info(name).commit[:7]} of {info(name).repository}); delete it and fetch it again"
        )
    return local, True


def _pooch() -> ModuleType:
    try:
        import pooch
    except ImportError as missing:
        raise ImportError(f"public recordings need the extra io: pip install 'jgait[io]' ({missing})") from missing
    return pooch


def _cache(name: str) -> Path:
    return Path(_pooch().os_cache("jgait")) / name


@functools.lru_cache(maxsize=4096)
def _sha256(local: Path, size: int, modified: int) -> str:
    """sha256 of a file; size and time of change are part of the key, so that a changed file is read again."""
    del size, modified
    with local.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
