"""Atomic writing of files: a file is written completely or not at all."""

import contextlib
import fcntl
import glob
import os
import secrets
from collections.abc import Iterator
from pathlib import Path

from jgait.types import check_kind


@contextlib.contextmanager
def replaced(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A hidden temporary file that replaces the target file when the block ends without an exception.

    A reader never reads half a file; after an exception or on a full disk, the old file is unchanged and the temporary
    file is removed. The next writer removes the temporary file of a killed process. The new file has the permissions of
    the user's umask.

    Yields:
        Path of an empty file in the same folder, with the same ending.

    Raises:
        FileNotFoundError: if the folder does not exist.
        OSError: if the folder cannot be written.
    """
    target = Path(path)
    if not target.parent.is_dir():
        raise FileNotFoundError(f"the folder {target.parent} does not exist")
    for left in target.parent.glob(f".{glob.escape(target.stem)}.*.part{glob.escape(target.suffix)}"):
        with contextlib.suppress(OSError), left.open("rb") as file:
            if _lock(file.fileno()):  # else its writer is at work
                left.unlink()
    part = target.with_name(f".{target.stem}.{secrets.token_hex(4)}.part{target.suffix}")
    descriptor = os.open(part, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o666)
    try:
        _lock(descriptor)
        yield part
        with part.open("rb+") as written:
            os.fsync(written.fileno())  # without it, a crash after the renaming may leave an empty file
        os.replace(part, target)
    finally:
        os.close(descriptor)
        part.unlink(missing_ok=True)


def _lock(descriptor: int) -> bool:
    """Lock a file until it is closed or the process ends; False if another process holds it, or there are no locks."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def check_path(path: object) -> None:
    """Raise TypeError if an argument is no path of a file."""
    what = "path must be the path of a file, such as 'walk.csv'"
    if hasattr(path, "columns"):
        what += "; jgait.io.recording_from_dataframe takes tables in memory"
    check_kind(path, (str, os.PathLike), what)


def write_text(path: str | os.PathLike[str], text: str) -> Path:
    """Write a text in UTF-8, whole or not at all, and return the path; line ends stay, bytes of a name that are no text
    become codes.
    """
    with replaced(path) as part:
        part.write_text(text, encoding="utf-8", errors="backslashreplace", newline="")
    return Path(path)
