"""The paper's routes walked by simulated people: Tables I and II.

One ankle sensor with the paper's errors; three routes at two paces. Strides counted by five detectors, distance as the
sum of all strides, half-steps included. The sensor's height over the ankle is known (4 cm, a tape's); nothing is tuned.
"""

from typing import Any

import jax
import numpy as np
from _ankle_detect import DETECTORS, found
from _ankle_legs import Leg, Reference, rested
from _ankle_lengths import CUTOFF_HZ, lengths, signals, stacked, with_lever
from common import Row, show

from jgait import protocols, shank_axes
from jgait.kinematics import GRAVITY
from jgait.sensors import MPU6000
from jgait.types import as_float

ROUTES, PACES = ("A", "B", "C"), ("normal", "fast")
HEIGHT = 0.04  # [m] of the simulator's ankle sensor over the ankle
OURS_HZ = 8.0
"""With the true lever, the paper's 4 Hz make a stride 1.7 (normal) to 3.5 cm (fast) too long, 8 Hz 0.1 to 0.5 cm."""

SENSOR = MPU6000._replace(acc_range=16.0 * GRAVITY)
"""The paper saw no saturation at ±4 g; a simulated heel strike at the fast pace passes that, and a stride whose strike
is clipped comes out 13 cm short. So the range is the sensor's widest."""

COUNTS = {"swings": None, "machine": None, "paper's machine": 0.45, "Jiménez": 2.75, "Feliz": 6.05}
"""Paper's error of the count of both subjects [%]."""
DISTANCES = {"SL2": 7.2, "Li 2-D": 8.4, "3-D as printed": 2.45, "3-D level": None}
"""Paper's error of the distance, mean of both subjects [%]."""


def leg_of(walked: protocols.Walked) -> Leg:
    """The right ankle of a simulated walk, the truth as its reference."""
    recording, strides = walked.recording, walked.truth.strides
    mine = np.asarray(strides.valid) & (np.asarray(strides.side) == 0)
    start, end, length = (as_float(v)[mine] for v in (strides.start, strides.end, strides.length))
    imu = rested(recording.sensors["ankle_right"], recording.sampling_rate_hz)
    axes = shank_axes.functional_axes(imu)
    if axes is None:
        raise ValueError(f"{recording.name} does not walk")
    body = walked.extra["person"].body
    tall = float(body.thigh_length) + float(body.shank_length)
    truth = Reference(end, length, start, None, (0.0, float(as_float(imu.time)[-1])))
    return Leg("simulated", recording.name, recording.subject, "right", imu, axes, recording.sampling_rate_hz, tall,
               truth, ())  # fmt: skip


def distances(legs: list[Leg], method: str) -> np.ndarray:
    """Sum of all strides of each leg [m]."""
    s = stacked([signals(leg) for leg in legs])
    lever = with_lever(0.0 if method != "3-D level" else HEIGHT)
    cutoff = OURS_HZ if method == "3-D level" else CUTOFF_HZ
    told = np.asarray(lengths(method, lever._replace(leg_length=1.0), cutoff, s))
    there = np.arange(told.shape[1])[None, :] < np.array([len(found(leg).end) for leg in legs])[:, None]
    scale = np.array([leg.leg_length if method.startswith("SL") else 1.0 for leg in legs])
    return scale * np.where(there, told, 0.0).sum(axis=1)


def simulated(quick: bool, people: int = 8) -> list[Row]:
    """Errors of counts and distances over all routes and paces."""
    counts: dict[str, list[list[float]]] = {name: [] for name in COUNTS}
    ways: dict[str, list[list[float]]] = {name: [] for name in DISTANCES}
    lines, number = [], 1 if quick else people
    for route in ROUTES[1:2] if quick else ROUTES:
        for pace in PACES[:1] if quick else PACES:
            walks = protocols.silva(jax.random.key(7), number, route, pace, errors=SENSOR)
            legs = [leg_of(walked) for walked in walks]
            true = np.array([len(leg.reference.contact) for leg in legs], float)
            far = np.array([walked.extra["distance"] for walked in walks])
            line: list[Any] = [f"route {route}, {pace}"]
            for name in DETECTORS:
                ours = np.array([len(found(leg, name).end) for leg in legs])
                counts[name].append((100.0 * np.abs(ours / true - 1.0)).tolist())
                line.append(float(np.mean(counts[name][-1])))
            for name in DISTANCES:
                ways[name].append((100.0 * np.abs(distances(legs, name) / far - 1.0)).tolist())
                line.append(float(np.mean(ways[name][-1])))
            lines.append(line)
    columns = ["mean error %", *(f"count: {name}" for name in DETECTORS), *DISTANCES]
    show(f"The paper's routes, {number} simulated people", columns, lines)
    split, n = f"{number} simulated people, untuned", len(lines) * number
    keys = {"swings": "", "machine": "_machine", "paper's machine": "_paper", "Jiménez": "_jimenez", "Feliz": "_feliz"}
    rows = [
        Row(f"sim_count{keys[name]}_error_pct", float(np.mean(counts[name])), "%", COUNTS[name], n, split)
        for name in DETECTORS
    ]
    names = {"SL2": "_sl2", "Li 2-D": "_li", "3-D as printed": "_printed", "3-D level": ""}
    rows += [
        Row(f"sim_distance{key}_error_pct", float(np.mean(ways[name])), "%", DISTANCES[name] or 2.45, n, split)
        for name, key in names.items()
    ]
    return rows
