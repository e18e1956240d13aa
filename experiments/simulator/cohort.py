"""A thousand people for a minute: how long the simulator takes, and how much memory."""

import json
import os
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from experiments.common.process import answers, peak_rss, started
from experiments.common.row import Row
from jgait import filtering, simulate
from jgait.simulate import SEVEN, Person
from jgait.simulate.sensors import MPU6000

# --- many people ---


def cohort(people: int, seconds: float, rate_hz: float, batch: int, recorded: bool) -> None:
    """Simulate people in batches, by rules or as recorded people walk.

    Prints seconds to compile, seconds to run after a warm-up, peak memory [GB], and processor seconds to run.
    """
    samples = round(seconds * rate_hz)
    moving = jnp.asarray(np.arange(samples) / rate_hz)
    drawn = simulate.population(jax.random.key(3), people, recorded)
    quiet = drawn.gait.quiet_before + drawn.gait.quiet_after
    steps = jnp.clip(jnp.floor((seconds - quiet) / (0.5 * drawn.gait.stride_time)) - 1.0, 1.0, CAPACITY)
    drawn = Person(drawn.body, drawn.gait._replace(steps=steps))
    keys = jax.random.split(jax.random.key(4), people)
    along = simulate.straight(100.0)

    def one(key: Any, person: Person, errors: Any) -> Any:
        read, truth = simulate.walk(key, person, along, moving, errors, capacity=CAPACITY, placements=SEVEN)
        return read, truth.estimate, truth.strides

    # One person after another stays in a core's cache; a thread for each core.
    run = filtering.compiled(lambda keys, drawn, errors: lax.map(lambda each: one(*each, errors), (keys, drawn)))
    parts = [
        jax.tree.map(lambda leaf, s=start: leaf[s : s + batch], (keys, drawn)) for start in range(0, people, batch)
    ]
    errors = jax.tree.map(float, MPU6000)
    start = time.perf_counter()
    compiled = run.lower(*parts[0], errors).compile()
    compiling = time.perf_counter() - start
    jax.block_until_ready(compiled(*parts[0], errors))
    start, busy = time.perf_counter(), time.process_time()
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for _ in pool.map(lambda part: jax.block_until_ready(compiled(*part, errors))[1].valid, parts):
            pass
    print(json.dumps([compiling, time.perf_counter() - start, peak_rss(), time.process_time() - busy]))


CAPACITY = 144
"""Steps: room for a minute of the quickest."""


def measured(people: int, batch: int, recorded: bool = False) -> tuple[float, float, float, float]:
    """What `cohort` prints, in a process of its own, in float32 as JAX comes."""
    ((compiling, seconds, memory, busy),) = answers(
        started("experiments.simulator.cohort", [people, batch, int(recorded)])
    )  # fmt: skip
    return compiling, seconds, memory, busy


def rows(quick: bool) -> list[Row]:
    """The cohort by rules."""
    people, batch, suffix = (32, 16, "_quick") if quick else (1000, 10, "")
    compiling, seconds, memory, _ = measured(people, batch)
    split = f"{people} people × 60 s × 7 sensors, 100 Hz, float32, in batches of {batch}"
    name = f"cohort_{people}x60s_seconds{suffix}"
    return [
        Row(name, seconds, "s", None, people, split),
        Row(f"cohort_compile_seconds{suffix}", compiling, "s", None, 1, split),
        Row(f"cohort_peak_rss_gb{suffix}", memory, "GB", None, people, split),
    ]


if __name__ == "__main__":
    cohort(int(sys.argv[1]), 60.0, 100.0, int(sys.argv[2]), sys.argv[3] == "1")
