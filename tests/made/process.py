"""Python processes that tests start, and their environment."""

import os
import socket
import subprocess
import sys
from pathlib import Path

import jax


def environment(devices: int | None = None, **settings: str) -> dict[str, str]:
    """That of this process, with its cache of compiled programs, the makers of tests, and a number of devices."""
    if devices is not None:
        settings["XLA_FLAGS"] = f"{os.environ['XLA_FLAGS']} --xla_force_host_platform_device_count={devices}"
    shared = {
        "JAX_PLATFORMS": "cpu",
        "JAX_COMPILATION_CACHE_DIR": str(jax.config.jax_compilation_cache_dir),
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
        # A program that another process is writing is compiled instead; what a test reads says nothing of it.
        "PYTHONWARNINGS": "ignore:Error reading persistent compilation cache entry",
        "PYTHONPATH": os.pathsep.join([str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")]),
    }
    return {**os.environ, **shared, **settings}


def ran(script: str, *arguments: object, devices: int | None = None, **settings: str) -> str:
    """What a process prints that runs a script to its end."""
    (said,) = _ended([_started(script, *arguments, env=environment(devices, **settings))])
    return said


def two(script: str, *arguments: object, devices: int | None = None, **settings: str) -> list[str]:
    """What two processes print that run a script together: its arguments, then a free port, and the number of each."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    env = environment(devices, **settings)
    return _ended([_started(script, *arguments, port, number, env=env) for number in range(2)])


def _started(script: str, *arguments: object, env: dict[str, str]) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", script, *map(str, arguments)], text=True, env=env, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )  # fmt: skip


def _ended(running: list[subprocess.Popen[str]]) -> list[str]:
    try:
        said = [process.communicate(timeout=120) for process in running]
    finally:
        for process in running:
            process.kill()
    assert not any(process.returncode for process in running), said
    return [out for out, _ in said]
