"""A day of 100 Hz through the filter, in a process of its own: seconds and memory."""

import json
import time

import jax
import jax.numpy as jnp
import numpy as np

from experiments.benchmark.leg import LOG_NOISE, MODEL, Rates, noise_of, recordings
from experiments.common.process import answers, peak_rss, started
from experiments.common.row import Row
from jgait import filtering


def day() -> None:
    """Filter 24 h at 100 Hz in float32, and print seconds (compilation included) and the peak memory [GB]."""
    minute = recordings(1, 6000)[0][0]
    rates = Rates(*(jnp.asarray(np.tile(column, 24 * 60)) for column in minute.T))
    start = time.perf_counter()
    found = filtering.kalman_filter(MODEL, noise_of(jnp.asarray(LOG_NOISE)), rates, dt=0.01, keep=("mean",))
    jax.block_until_ready(found)
    print(json.dumps([time.perf_counter() - start, peak_rss()]))


def rows() -> list[Row]:
    """The day in a process of its own."""
    ((seconds, memory),) = answers(started("experiments.benchmark.day", []))
    split = "24 h at 100 Hz, float32, means only"
    return [
        Row("day_peak_rss_gb", memory, "GB", split=split),
        Row("day_seconds", seconds, "s", split=split),
    ]


if __name__ == "__main__":
    day()
