"""Estimators sample by sample: the time of a sample from Python, in blocks of ten.

Both sides have sensors. The median is over blocks, after a walk to warm up; a block's time includes the checks of the
samples and the tables of what is new.
"""

import time
from typing import Any

import jax
import numpy as np

import jgait
from experiments.common.row import Row, show
from jgait import simulate
from jgait.simulate.sensors import OPAL
from jgait.types import Recording

PEOPLE_KEY = 2304
BLOCK = 10
PLACEMENTS = {
    "leg_ekf": simulate.FOUR,
    "foot_ins": ("foot_right", "foot_left"),
    "ankle_stride": ("ankle_right", "ankle_left"),
    "duty_cycled_gyro": simulate.FOUR,
}


def microseconds(name: str, recording: Recording, rounds: int) -> np.ndarray:
    """Times of a sample in each block [us]."""
    live = jgait.online(recording, {"height": 1.75}, name)
    stamps = np.asarray(recording.sensors[live.placements[0]].time)
    signals = {one: tuple(map(np.asarray, recording.sensors[one][1:3])) for one in live.placements}
    blocks: list[tuple[np.ndarray, dict[str, Any]]] = []
    for start in range(0, len(stamps) - BLOCK + 1, BLOCK):
        at = slice(start, start + BLOCK)
        blocks.append((stamps[at], {one: (gyr[at], acc[at]) for one, (gyr, acc) in signals.items()}))
    took = []
    for number in range(rounds + 1):
        for at, block in blocks:
            begin = time.perf_counter()
            live.push(at + number * (stamps[-1] + 1.0), block)
            took.append((time.perf_counter() - begin) * 1e6 / BLOCK)
    return np.array(took[len(blocks) :])


def rows(quick: bool) -> list[Row]:
    """Microseconds a sample of each estimator, and of the slowest."""
    placements = tuple(dict.fromkeys(name for names in PLACEMENTS.values() for name in names))
    key = jax.random.key(PEOPLE_KEY)
    ((recording, _),) = simulate.cohort(key, 1, simulate.straight(10.0), OPAL, 100.0, placements, recorded=False)
    lines, found = [], {}
    for name, worn in PLACEMENTS.items():
        own = recording._replace(sensors={one: recording.sensors[one] for one in worn})
        times = microseconds(name, own, 1 if quick else 10)
        found[name] = float(np.median(times))
        lines.append([name, found[name], float(np.percentile(times, 10)), float(np.percentile(times, 90))])
    show("A sample from Python, in blocks of ten [us]", ["estimator", "median", "10 %", "90 %"], lines)
    worst = max(found, key=lambda name: found[name])
    line = "a sample from Python, blocks of ten, both sides, slowest estimator"
    return [
        Row("online_us_per_sample", found[worst], "us", n=1, split=f"{worst}, 100 Hz, simulated").on(
            line, "median", "walks", simulated=True
        )
    ]
