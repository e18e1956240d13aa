"""Modules of this folder in processes of their own, and the memory of such a process. Imports nothing slow."""

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]


def environment(cache: Path | None = None) -> dict[str, str]:
    """The variables of a process that runs on the CPU with JAX's defaults.

    Args:
        cache: folder of compiled programs that processes share; None: each compiles for itself.
    """
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("JAX_", "XLA_"))}
    shared = {} if cache is None else {"JAX_COMPILATION_CACHE_DIR": str(cache),
                                       "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0"}  # fmt: skip
    path = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    return {**kept, "JAX_PLATFORMS": "cpu", "PYTHONPATH": path, **shared}


def started(module: str, arguments: Sequence[Any], cache: Path | None = None) -> "subprocess.Popen[str]":
    """A module ("experiments.cohort.run") in a process of its own."""
    command = [sys.executable, "-m", module, *map(str, arguments)]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT, env=environment(cache)
    )  # fmt: skip


def answers(*running: "subprocess.Popen[str]") -> list[Any]:
    """The JSON that each process prints as its last line.

    Raises:
        RuntimeError: if a process failed.
    """
    try:
        outputs = [process.communicate() for process in running]
    finally:
        for process in running:
            process.kill()
    for process, (_, error) in zip(running, outputs, strict=True):
        if process.returncode:
            raise RuntimeError(f"{process.args} failed: {error[-3000:]}")
    return [json.loads(out.splitlines()[-1]) for out, _ in outputs]


def peak_rss() -> float:
    """Largest memory of this process so far [GB]; by the system's own count, without that of its parent."""
    status = Path("/proc/self/status")
    if status.exists():
        return next(int(line.split()[1]) for line in status.read_text().splitlines() if line.startswith("VmHWM")) / 1e6
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1e9 if sys.platform == "darwin" else 1e6)
