"""Libraries that jgait is compared with and that need other versions than it: each has an environment of its own.

`make peers` makes them: NAME.txt of this folder becomes .venv-NAME. A script NAME_*.py of this folder runs in that
environment, imports nothing of jgait, and exchanges arrays through files (`protocol`).
"""

import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from experiments.common.peers import protocol

ROOT = Path(__file__).resolve().parents[3]


class PeerUnavailable(RuntimeError):
    """The environment of a peer has not been made here."""


def python(peer: str) -> Path:
    """The interpreter of a peer's environment."""
    return ROOT / f".venv-{peer}" / "bin" / "python"


def available(peer: str) -> bool:
    """Whether the environment of a peer ("gaitmap") is made; one that is half made is not."""
    return python(peer).exists() and (ROOT / f".venv-{peer}" / "ready").exists()


def unavailable_reason(peer: str) -> str:
    """What to do for a peer that is not there."""
    return f"{peer} is absent: `make peers` installs it in .venv-{peer}"


def run(script: str, jobs: Mapping[str, Mapping[str, ArrayLike]]) -> dict[str, dict[str, np.ndarray]]:
    """Have a peer's script answer jobs, all in one process: starting and compiling take longer than most jobs.

    Args:
        script: name of the file in this folder without its ending; the peer's name is what precedes the first _.
        jobs: name → arrays, as the script's docstring lists them.

    Returns:
        name → arrays that the script gave.

    Raises:
        PeerUnavailable: the environment is not made.
        RuntimeError: the script failed; the message has its error output.
    """
    peer = script.split("_", 1)[0]
    if not available(peer):
        raise PeerUnavailable(unavailable_reason(peer))
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder, "jobs.npz"), Path(folder, "results.npz")
        protocol.save(source, jobs)
        # Nothing of this process' Python and none of the user's own packages.
        command = [python(peer), "-E", "-s", ROOT / "experiments" / "common" / "peers" / f"{script}.py", source, target]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise RuntimeError(f"{script} failed in .venv-{peer}:\n{done.stderr[-2000:]}")
        return protocol.load(target)
