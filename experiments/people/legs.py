"""The legs of recorded walks, with their sensors and where they walk evenly."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from experiments.simulator import real
from experiments.simulator.simulated import Set, together
from jgait.types import SIDES, Walk


class Leg(NamedTuple):
    """One leg in a walk: sensors → gyroscope and accelerometer, where it walks evenly [samples], which samples are
    good, and the side."""

    sensors: dict[str, tuple[Any, Any]]
    windows: list[tuple[int, int]]
    trim: int
    good: np.ndarray | None
    side: str


def legs_of(walk: Walk, given: Set) -> Iterator[Leg]:
    """The legs of a recorded walk that can be used."""
    rate_hz, trim = walk.recording.sampling_rate_hz, 0
    if given.name == "neura_sparse":
        named = [w for name, w in walk.info["windows"].items() if name.startswith("straight")]
        windows = [part for w in named for part in real._brisk(walk.reference.distance, w, rate_hz)]
    elif given.name == "tripod":
        windows = [walk.info["windows"]["steady"]]
    else:
        windows, trim = [walk.info["windows"]["whole"]], 1
    crossed = {one for pair in walk.info.get("misplaced", ()) for one in pair}
    for side in SIDES if windows else ():
        if f"shank_{side}" in walk.recording.sensors and f"shank_{side}" not in crossed:
            sensors, good = real._leg(walk, side)
            yield from (Leg(part, windows, trim, good, side) for part in together(sensors, given))
