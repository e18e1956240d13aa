"""The folder of a command's results: one writer at a time, results of one set of arguments, no other file touched."""

import contextlib
import errno
import fcntl
import filecmp
import json
import os
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from jgait.commands.console import count, note, refused, stop
from jgait.io.atomic import write_text

STAGE = ".jgait.part"
"""Folder within the folder of results in which files lie until all are written."""


def run_of(out: Path, command: str) -> Path:
    """The folder of a command's intermediate results, within that of its results."""
    return out / {"tune": "fits", "estimate": "estimated"}.get(command, "run")


class ResultsFolder:
    """A folder of results that this process alone writes: into `stage`, until `publish` moves the files; `run` holds
    intermediate results, with which a killed command continues.

    Its manifest `.jgait-COMMAND.json` holds the arguments, the files that the command wrote, each with the recording
    that it is of, and whether the command ended.
    """

    def __init__(
        self, path: Path, command: str, arguments: Mapping[str, Any] | None, planned: Mapping[str, str], fresh: bool
    ) -> None:
        """Bind the folder to the arguments; exits with code 2 if it holds results of others, or files of a user."""
        self.path, self.stage, self.run = path, path / STAGE, run_of(path, command)
        self._manifest, self._planned, self._bound = path / f".jgait-{command}.json", planned, arguments is not None
        before: dict[str, Any] = {}
        if self._manifest.exists():
            before = json.loads(self._manifest.read_text(encoding="utf-8"))
        self._arguments: dict[str, Any] = dict(before.get("arguments", {}))
        self._files: dict[str, str] = dict(before.get("files", {}))
        finished = before.get("finished", False)
        if any(name != Path(name).name for name in self._files):
            raise ValueError(f"{self._manifest.name} lists files of other folders")
        now: dict[str, Any] = json.loads(json.dumps(arguments or {}))
        changed = [key for key, value in now.items() if self._arguments.get(key, value) != value]
        if fresh and before and self._bound:
            # The old manifest stays until all that it lists is gone: no old file is ever under new arguments.
            for name in self._files:
                (path / name).unlink(missing_ok=True)
            shutil.rmtree(self.run, ignore_errors=True)
            self._arguments, self._files, finished = {}, {}, False
        elif changed:
            key = changed[0]
            more = f", and {len(changed) - 1} more changed" if len(changed) > 1 else ""
            stop(
                f"{path} holds results of other arguments or inputs: {key} was “{self._arguments[key]}”, now "
                f"“{now[key]}”{more}; give another --out, or --fresh to delete these results"
            )
        self._check(planned)
        if self._bound:
            self._arguments |= now
            self._write(finished)
        self.stage.mkdir()

    def publish(self, files: Sequence[Path]) -> list[Path]:
        """Move files from `stage` into the folder, but for equal ones. Of a bound folder, all that this command wrote
        before goes, of another one, what it wrote before of the same recordings.
        """
        new = {file.name: self._planned.get(file.name, "") for file in files}
        self._check(new)
        again = set(new.values()) - {""}
        gone = sorted(name for name in self._files.keys() - new.keys() if self._bound or self._files[name] in again)
        self._files |= new
        self._write(False)
        for file in files:
            target = self.path / file.name
            if not (target.exists() and filecmp.cmp(file, target, shallow=False)):
                os.replace(file, target)
        for name in gone:
            (self.path / name).unlink(missing_ok=True)
            del self._files[name]
        if gone and not self._bound:
            many = count(len(gone), "file", "files")
            note(f"{self.path}: removed {many} that an earlier command wrote for this recording: {', '.join(gone)}")
        self._write(True)
        return [self.path / file.name for file in files]

    def forget(self) -> None:
        """Delete the intermediate results; without files of an earlier run, any arguments can use the folder next."""
        shutil.rmtree(self.run, ignore_errors=True)
        if not self._files:
            self._manifest.unlink(missing_ok=True)

    def _check(self, planned: Mapping[str, str]) -> None:
        """Exit with code 2 if a file exists that this command did not write, or wrote for another recording."""
        for name, source in planned.items():
            there = (self.path / name).exists()
            if there and name not in self._files:
                stop(f"{self.path / name} is there, and this command did not write it; move it, or give another --out")
            if there and self._files[name] != source:
                stop(f"{self.path / name} is of {self._files[name]}; give another --out for {source}")

    def _write(self, finished: bool) -> None:
        whole = {"arguments": self._arguments, "files": self._files, "finished": finished}
        write_text(self._manifest, json.dumps(whole, indent=1, sort_keys=True) + "\n")


def unfinished(path: Path, command: str) -> bool:
    """Whether a folder holds results of a command that did not end."""
    try:
        return not json.loads((path / f".jgait-{command}.json").read_text(encoding="utf-8"))["finished"]
    except FileNotFoundError:
        return False


@contextlib.contextmanager
def results_folder(
    out: Path, command: str, arguments: Mapping[str, Any] | None, *, planned: Mapping[str, str] | Iterable[str] = (),
    inputs: Iterable[Path | None] = (), json_file: Path | None = None, fresh: bool = False,
) -> Iterator[ResultsFolder]:  # fmt: skip
    """The folder of a command's results, made and locked; exits with code 2 if it cannot be used, or written to.

    It holds results of one set of `arguments`, JSON values on which they depend; a key that is absent counts as
    unchanged; with None, results of different arguments may lie side by side. `planned` are names of the files that
    will be written, if known, perhaps with the recording of each; `fresh` deletes results of other arguments, and
    intermediate results.
    """
    sources = dict(planned) if isinstance(planned, Mapping) else dict.fromkeys(planned, "")
    keep_inputs([*(out / name for name in sources), json_file], inputs)
    if json_file is not None and json_file.resolve() in {(out / name).resolve() for name in sources}:
        stop(f"--json {json_file} is one of the files that this command writes; give another name")
    for part in (out, *out.parents):
        if os.path.exists(part) and not os.path.isdir(part):
            stop(f"--out needs a folder; {part} is a file")
    with contextlib.ExitStack() as stack:
        with refused(f"{out} cannot be used: ", AttributeError, TypeError):
            if not out.exists():
                stack.callback(_remove_empty, out)
            out.mkdir(parents=True, exist_ok=True)
            stack.enter_context(_locked(out))
            shutil.rmtree(out / STAGE, ignore_errors=True)
            folder = ResultsFolder(out, command, arguments, sources, fresh)
            stack.callback(shutil.rmtree, folder.stage, ignore_errors=True)
        try:
            yield folder
        except KeyboardInterrupt:
            if folder.run.exists():
                note("the same command continues where it stopped")
            raise
        except OSError as error:
            stop(f"nothing more could be written to {out}: {error}")


def _remove_empty(folder: Path) -> None:
    with contextlib.suppress(OSError):
        folder.rmdir()


def keep_inputs(outputs: Iterable[Path | None], inputs: Iterable[Path | None]) -> None:
    """Exit with code 2 if an output would overwrite an input."""
    read = [path for path in inputs if path is not None and os.path.isfile(path)]
    for output in outputs:
        if output is not None and os.path.isfile(output) and any(output.samefile(path) for path in read):
            stop(f"{output} is read by this command, which would overwrite it; write to another place")


@contextlib.contextmanager
def _locked(out: Path) -> Iterator[None]:
    """The folder, locked until the block or the process ends, however it ends."""
    descriptor = os.open(out, os.O_RDONLY)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            stop(f"another jgait command is writing to {out}; wait until it ends, or give another --out")
        except OSError as error:
            if error.errno not in (errno.ENOLCK, errno.ENOTSUP, errno.EBADF):  # a file system without locks
                raise
        yield
    finally:
        os.close(descriptor)
