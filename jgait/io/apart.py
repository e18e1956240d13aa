"""Binary files are read in a process of their own, with limits on its memory and time that follow from the file's size.

Libraries for HDF5, MATLAB, Parquet, C3D and gzip files allocate what a file states, unpack all that it holds, and may
crash on a damaged one. Here such a file ends the process at its limits (`setrlimit`), and the reader raises
`RecordingError`. The process stays for the next file. Systems other than Linux limit its time and its result only.
"""

import atexit
import math
import os
import pickle
import resource
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any, cast

from jgait.io.files import library, reading
from jgait.types import RecordingError

MEMORY, MEMORY_A_BYTE = 500_000_000, 8
"""[bytes] Memory for reading any file, and more for each byte of it."""

RESULT, RESULT_A_BYTE = 50_000_000, 8
"""[bytes] Largest content of any file, and more for each byte of it: what is unpacked is at most so large."""

SECONDS, BYTES_A_SECOND = 2, 2_000_000
"""[s], [bytes/s] Processor time for any file, and one second more for so many bytes of it."""

WAITING = 2.5
"""Wall time over processor time: the process is ended after so long, if it neither computes nor ends."""

READY = b"ready"
"""Sent by the process when the library is loaded: the file's time begins."""


def largest(path: Path) -> int:
    """[bytes] Largest content of a file."""
    return RESULT + RESULT_A_BYTE * path.stat().st_size


def apart[T](function: Callable[..., T], path: Path, expected: str, needs: str, **options: Any) -> T:
    """`function(path, **options)` in the process that reads binary files.

    Args:
        function: a function of a module of jgait; its result can be pickled.
        path: the file.
        expected: description of the expected file, for messages.
        needs: the library that the function uses; to load it takes none of the file's time.
        options: further arguments.

    Raises:
        ImportError: if the library is not installed.
        OSError: if the file does not exist, or may not be read.
        RecordingError: if the function raises one or any other error, or exceeds the memory or the time.
    """
    library(needs, expected)
    size = path.stat().st_size
    with _LOCK:
        kind, answer = _process().ask((needs, function, path.absolute(), expected, options, size), _seconds(size))
    if kind == "error":
        raise answer
    if kind == "ended":
        raise RecordingError(f"{path.name} cannot be read: {answer}; expected {expected}")
    return answer


def largest_of_process() -> int:
    """[bytes] Largest memory that the process which reads binary files has held so far, 0 without one."""
    status = Path(f"/proc/{_PROCESSES[0].pid}/status") if _PROCESSES and _PROCESSES[0].alive() else Path("")
    lines = status.read_text().splitlines() if status.is_file() else []
    return next((1024 * int(line.split()[1]) for line in lines if line.startswith("VmHWM")), 0)


def _seconds(size: int) -> int:
    return SECONDS + size // BYTES_A_SECOND


class _Process:
    """A process that answers requests, one at a time."""

    def __init__(self) -> None:
        self.owner = os.getpid()
        places = os.pathsep.join(path for path in sys.path if path)
        # One thread and the system's allocator reserve no memory beyond what they use.
        single = {"ARROW_DEFAULT_MEMORY_POOL": "system", "MALLOC_ARENA_MAX": "1", "OMP_NUM_THREADS": "1"}
        self._process = subprocess.Popen(
            [sys.executable, "-m", "jgait.io.apart"], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL, env={**os.environ, "PYTHONPATH": places, **single},
        )  # fmt: skip

    def ask(self, request: object, seconds: float) -> tuple[str, Any]:
        """The answer: ("result", …), ("error", an exception), or ("ended", the reason in words)."""
        asked, answers = (cast(IO[bytes], pipe) for pipe in (self._process.stdin, self._process.stdout))
        timer = threading.Timer(WAITING * seconds, self._process.kill)
        try:
            pickle.dump(request, asked)
            asked.flush()
            answers.read(len(READY))
            timer.start()
            return pickle.load(answers)
        except (EOFError, OSError, pickle.UnpicklingError):
            if -self._process.wait() in (signal.SIGXCPU, signal.SIGKILL):
                return "ended", f"a file of this size should take at most {seconds} s"
            return "ended", "the library that reads it ended without an error"
        except BaseException:  # an answer that was not awaited would be taken for the next file's
            self._process.kill()
            raise
        finally:
            timer.cancel()

    def alive(self) -> bool:
        """Whether the process runs and is not of a process from which this one was forked."""
        return self.owner == os.getpid() and self._process.poll() is None

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._process.pid

    def close(self) -> None:
        """End the process."""
        if self.owner == os.getpid():
            self._process.kill()
            self._process.communicate()


_LOCK = threading.Lock()
_PROCESSES: list[_Process] = []


def _process() -> _Process:
    """The process that runs, or a new one."""
    if _PROCESSES and not _PROCESSES[0].alive():
        _PROCESSES.pop().close()
    if not _PROCESSES:
        _PROCESSES.append(_Process())
    return _PROCESSES[0]


@atexit.register
def _close() -> None:
    for process in _PROCESSES:
        process.close()


def _limit(size: int) -> None:
    """Set the limits of this process for the next file."""
    spent = resource.getrusage(resource.RUSAGE_SELF)
    _set(resource.RLIMIT_CPU, math.ceil(spent.ru_utime + spent.ru_stime) + _seconds(size))
    status = Path("/proc/self/status")
    if status.exists():
        held = next(int(line.split()[1]) for line in status.read_text().splitlines() if line.startswith("VmData"))
        _set(resource.RLIMIT_DATA, 1024 * held + MEMORY + MEMORY_A_BYTE * size)


def _set(limit: int, value: int) -> None:
    hard = resource.getrlimit(limit)[1]
    resource.setrlimit(limit, (value if hard == resource.RLIM_INFINITY else min(value, hard), hard))


def _answer(function: Callable[..., Any], path: Path, expected: str, options: dict[str, Any], size: int) -> bytes:
    """The pickled answer to a request."""
    try:
        with reading(path, expected):
            answer = pickle.dumps(("result", function(path, **options)), 5)
            if len(answer) > largest(path):
                raise RecordingError(
                    f"{path.name}, {size} bytes, holds {len(answer)} bytes; expected at most {largest(path)}"
                )
            return answer
    except (RecordingError, OSError, ImportError) as error:
        return pickle.dumps(("error", error.with_traceback(None)))


def _main() -> None:
    """Answer requests until the other process ends."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what libraries print is no answer
    while True:
        try:
            request = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        library(request[0], "")
        answers.write(READY)
        answers.flush()
        _limit(request[-1])
        answers.write(_answer(*request[1:]))
        answers.flush()


if __name__ == "__main__":
    _main()
