"""A file that is there whole or not at all."""

import contextlib
import os
import secrets
from collections.abc import Iterator
from pathlib import Path


@contextlib.contextmanager
def replaced(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A hidden place beside a file, which becomes the file when the block ends well.

    A reader never sees half a file, and a full disk or an exception leaves what was there before and nothing else. The
    new file has the permissions that the user's umask gives any new file.

    Args:
        path: of the file; its folder must exist.

    Yields:
        Where to write: an empty file in the same folder, with the same ending.

    Raises:
        FileNotFoundError: if the folder does not exist.
        OSError: if nothing can be written there.
    """
    target = Path(path)
    if not target.parent.is_dir():
        raise FileNotFoundError(f"the folder {target.parent} does not exist")
    part = target.with_name(f".{target.stem}.{secrets.token_hex(4)}.part{target.suffix}")
    os.close(os.open(part, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
    try:
        yield part
        with part.open("rb+") as written:
            os.fsync(written.fileno())  # else a crash after the renaming may leave an empty file
        os.replace(part, target)
    finally:
        part.unlink(missing_ok=True)


def write_text(path: str | os.PathLike[str], text: str) -> Path:
    """Write a text in UTF-8, whole or not at all; see `replaced`.

    Args:
        path: of the file; its folder must exist.
        text: to write, line ends as they are.

    Returns:
        The path.
    """
    with replaced(path) as part:
        part.write_text(text, encoding="utf-8", newline="")
    return Path(path)
