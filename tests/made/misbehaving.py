"""Functions that read a file badly; to import them takes none of the time that a file is given."""

import os
import signal


def crash(path):
    os.kill(os.getpid(), signal.SIGSEGV)


def sleep(path):
    while True:
        pass


def swallow(path):
    return bytearray(b"1") * 3_000_000_000


def content(path):
    return path.read_bytes()


def fail(path):
    raise KeyError(path.name)


def gone(path):
    return (path / "no").read_bytes()
