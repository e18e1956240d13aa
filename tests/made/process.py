"""The environment of Python processes that tests start."""

import os
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
