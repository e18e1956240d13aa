"""Where people of the sets wear their sensors on thigh, shank and foot: where sensors and joints lie to each other.

Two segments agree on the acceleration of the joint between them, whatever it is: of the points that are fixed to both
sensors, the joint is the one at which the size of the acceleration differs least (Seel, Raisch and Schauer, Sensors 14,
2014, 6891). Components along the joint's axis have no effect and are not known. Where one sensor has another clock
(`tripod`), the ankle is the point about which the shank turns while the foot stands: in mid stance the accelerometer
reads gravity, turned by the integrated rate, and the height of the sensor times the angular acceleration.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy import optimize, signal

from experiments.common.recordings import available
from experiments.common.row import Row, show
from experiments.common.sets import datasets
from experiments.people.legs import Leg, legs_of
from experiments.people.waves import axes
from experiments.simulator.gait import find_strides, sagittal_rates
from experiments.simulator.simulated import SETS, names_of
from jgait.geometry.vectors import GRAVITY

JOINTS = (("knee", "thigh", "shank"), ("ankle", "shank", "foot"))
LOW_PASS_HZ, TURNS = 6.0, 1.0
"""[Hz] Of rates and forces; [rad/s] least sum of both rates at an instant that counts."""
STANDS = (0.38, 0.62)
"""[1] Mid stance, as a share of the time from one swing to the next."""
STARTS, SEED = 3, 0


class Mount(NamedTuple):
    """From a joint to a sensor [m]: forward and up, along the axes of `waves.axes`."""

    ahead: float
    up: float


def smooth(values: np.ndarray, rate_hz: float) -> np.ndarray:
    """Low-passed forth and back."""
    return signal.filtfilt(*signal.butter(2, LOW_PASS_HZ / (0.5 * rate_hz)), values, axis=0)


def joint(gyr: list[np.ndarray], acc: list[np.ndarray], rate_hz: float) -> list[np.ndarray]:
    """(3,) from the joint of two segments to each sensor [m], from rates and forces (T, 3)."""
    gyr, acc = ([smooth(one, rate_hz) for one in each] for each in (gyr, acc))
    counts = sum(np.linalg.norm(one, axis=1) for one in gyr) > TURNS
    turns = [(one[counts], np.gradient(one, 1.0 / rate_hz, axis=0)[counts]) for one in gyr]

    def apart(x: np.ndarray) -> np.ndarray:
        sizes = [
            np.linalg.norm(force[counts] - np.cross(rate, np.cross(rate, r)) - np.cross(faster, r), axis=1)
            for force, (rate, faster), r in zip(acc, turns, np.split(x, 2), strict=True)
        ]
        return sizes[0] - sizes[1]

    random = np.random.default_rng(SEED)
    tries = [
        optimize.least_squares(apart, 0.1 * random.standard_normal(6), loss="soft_l1", f_scale=1.0)
        for _ in range(STARTS)
    ]
    return np.split(min(tries, key=lambda one: one.cost).x, 2)


def by_joints(leg: Leg, rate_hz: float) -> Iterator[tuple[str, Mount]]:
    """Joint and segment → mount."""
    _, rates = sagittal_rates(leg.sensors, rate_hz, leg.windows)
    for name, upper, lower in JOINTS:
        if not {upper, lower} <= set(leg.sensors):
            continue
        for start, end in leg.windows:
            both = [[np.asarray(leg.sensors[one][kind])[start:end] for one in (upper, lower)] for kind in (0, 1)]
            if leg.good is None or leg.good[start:end].all():
                for segment, r in zip((upper, lower), joint(*both, rate_hz), strict=True):
                    turned = axes(*map(np.asarray, leg.sensors[segment]), rates[segment], leg.windows)
                    yield f"{segment} from {name}", Mount(float(r @ turned[:, 0]), float(r @ turned[:, 2]))


def by_stance(leg: Leg, rate_hz: float) -> Iterator[tuple[str, Mount]]:
    """The height of a shank's sensor over the point about which the shank turns in mid stance."""
    _, rates = sagittal_rates(leg.sensors, rate_hz, leg.windows)
    strides = find_strides(rates["shank"], rate_hz, leg.windows, leg.trim, leg.good)
    turned = axes(*map(np.asarray, leg.sensors["shank"]), rates["shank"], leg.windows)
    force = smooth(np.asarray(leg.sensors["shank"][1]) @ turned[:, 0], rate_hz)
    rate = -smooth(rates["shank"], rate_hz)  # upper end forward
    found = []
    for first, last in zip(strides.start, strides.end, strict=True):
        a, b = (round(first + share * (last - first)) for share in STANDS)
        angle, faster = np.cumsum(rate[a:b]) / rate_hz, np.gradient(rate[a:b], 1.0 / rate_hz)
        rows = np.column_stack([np.ones(b - a), faster])
        found.append(np.linalg.lstsq(rows, force[a:b] + GRAVITY * angle, rcond=None)[0][1])
    if found:
        yield "shank from ankle, stance", Mount(np.nan, float(np.median(found)))


def rows(quick: bool) -> list[Row]:
    """Medians over the legs of every set."""
    found, lines = [], []
    for given in SETS[2:3] if quick else SETS:
        if given.name == "gaitmap_example" or not available(given.name):
            continue
        pooled: dict[str, list[Mount]] = {}
        for walk in datasets.load(given.name, names_of(given)):
            for leg in legs_of(walk, given) if walk.reference is not None else ():
                if "shank" in leg.sensors:
                    apart = by_stance if given.name == "tripod" else by_joints
                    for name, one in apart(leg, given.rate_hz):
                        pooled.setdefault(name, []).append(one)
        for name, each in pooled.items():
            ahead, up = np.median(each, axis=0)
            lines.append([given.label, name, len(each), float(ahead), float(up), float(np.std(each, axis=0)[1])])
            row = Row(
                f"mount_m_{given.label}_{name.replace(', ', '_').replace(' ', '_')}",
                float(up),
                "m",
                None,
                len(each),
                "median",
            )
            found.append(row.on(f"sensor's height over the joint: {name}", given.label, "legs and pieces"))
    show("From joints to sensors, m", ["set", "", "n", "ahead", "up", "deviation of up"], lines)
    return found
