"""How still a shoe is in stance, how much landings shake it, and how closing steps end: recorded and simulated shoes.

A stance is the quietest moment of a stride. Simulated people move as recorded ones do; their sensors are perfect, or
as `sensors.ON_SHOE`, whose sway and jolts have the sizes that these sets show. That sensors on shoes sway and vibrate
at all was tried on `pyshoe_vicon` too, on which `transfer` is judged: the sizes are of other people, the idea is not.

A closing step is a last step that does not land on the heel. It ends on the ball of the foot: how far the heel is up
where the last `LEFT` of the way are left.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.signal import welch

from experiments.common.recordings import available
from experiments.common.row import Row, show
from experiments.common.sets import datasets
from experiments.people.transfer import FOOT_HZ, walkers
from jgait.estimators import foot_ins
from jgait.estimators.foot_ins import FootParams
from jgait.simulate.sensors import IDEAL, ON_SHOE
from jgait.types import Imu, Recording, as_float

SETS = ("walking5m", "gaitmap_example", "footprints", "neura_sparse")
QUIET_S, STRIDE_S, SWINGS = 0.15, 1.0, 2.0
"""[s] Length of the quietest moment of a stride; least time between two. [rad/s] RMS rate that a swing has at least."""
BAND = (20.0, 45.0)
"""[Hz] Vibrations: people move more slowly, and all sets are sampled fast enough."""
PIECE_S = 1.28
"""[s] Length of the pieces whose spectra are averaged."""
LEFT, LATE_S, FLAT = 0.05, 0.6, np.radians(4.0)
"""[m] Way that is left where a closing step is looked at; [s] its last part, and [rad] how far toes are up in it at
most."""


class Shoe(NamedTuple):
    """RMS rate of a shoe in stance over that of walking [1], density of its vibrations [(m/s²)²/Hz], and how far the
    heel is up before the end of a closing step [rad], NaN without such a step."""

    rest: float
    shakes: float
    heel_up: float


def closing(sensor: Imu) -> float:
    """How far the heel is up before the end of the last step [rad]; NaN where it lands on the heel, or has no rest."""
    rate_hz = 1.0 / float(np.median(np.diff(sensor.time)))
    found = foot_ins.estimate(FootParams(), Recording({"foot_right": sensor}, rate_hz))
    strides, foot = found.strides, found.feet.right if found.feet else None
    if foot is None or strides is None or strides.standing_end is None or not np.any(strides.valid):
        return np.nan
    time, pitch = np.asarray(found.time), as_float(found.diagnostics["pitch_right"])
    end = int(np.searchsorted(time, np.max(as_float(strides.standing_end)[np.asarray(strides.valid)])))
    part = slice(int(np.searchsorted(time, time[end] - LATE_S)), end + 1)
    way = np.linalg.norm(foot.position[part, :2] - foot.position[end, :2], axis=1)
    turn = pitch[part] - pitch[end]
    far = np.flatnonzero(way > LEFT)
    return float(-turn[far[-1]]) if len(far) and turn.max() < FLAT else np.nan


def shoe_of(sensor: Imu) -> Shoe | None:
    """Of one sensor; None where there is no walk."""
    gyr, acc, dt = np.nan_to_num(as_float(sensor.gyr)), np.nan_to_num(as_float(sensor.acc)), np.diff(sensor.time)
    step = float(np.median(dt))
    square = np.sum(gyr**2, axis=1)
    long, half = max(round(QUIET_S / step), 3), round(0.5 * STRIDE_S / step)
    mean = np.convolve(square, np.ones(long) / long, "same")
    around = np.lib.stride_tricks.sliding_window_view(mean, 2 * half + 1)
    middle = mean[half : half + len(around)]
    quiet = middle[(middle <= around.min(axis=1)) & (around.max(axis=1) > SWINGS**2)]
    walks = np.convolve(square > SWINGS**2, np.ones(round(STRIDE_S / step)), "same") > 0.0
    if len(quiet) < 2 or walks.sum() < PIECE_S / step:
        return None
    frequency, density = welch(acc[walks], 1.0 / step, nperseg=round(PIECE_S / step), axis=0)
    band = (frequency >= BAND[0]) & (frequency < BAND[1])
    rest = float(np.median(np.sqrt(quiet)) / np.sqrt(square[walks].mean()))
    return Shoe(rest, float(density.sum(axis=1)[band].mean()), closing(sensor))


def recorded(name: str, most: int | None) -> Iterator[list[Imu]]:
    """Shoes of each person of a set, or of each walk where people have no names."""
    people: dict[str, list[Imu]] = {}
    for walk in datasets.load(name, None):
        who = walk.recording.subject or walk.recording.name
        own = [imu for place, imu in walk.recording.sensors.items() if place.startswith("foot")]
        people.setdefault(who, []).extend(own)
        if most is not None and len(people) >= most:
            break
    yield from people.values()


def joined(shoes: Sequence[Shoe], mean: Callable[..., Any]) -> Shoe:
    """A mean of shoes; of closing steps, of those that have one."""
    finite = ([value for value in values if np.isfinite(value)] for values in zip(*shoes, strict=True))
    return Shoe(*(float(mean(values)) if values else np.nan for values in finite))


def medians(people: Iterable[list[Imu]]) -> tuple[Shoe, int] | None:
    """Medians over people, each of whom is the mean of the own shoes; and how many people."""
    each = []
    for own in people:
        found = [shoe for sensor in own if (shoe := shoe_of(sensor)) is not None]
        if found:
            each.append(joined(found, np.mean))
    return (joined(each, np.median), len(each)) if each else None


def rows(quick: bool) -> list[Row]:
    """Shares of stance, vibrations and ends of closing steps of all sets and of simulated people."""
    lines, result = [], []
    groups = {name: recorded(name, 2 if quick else None) for name in SETS if available(name)}
    for way, errors in (("perfect", IDEAL), ("on_shoe", ON_SHOE)):
        walks = walkers(2 if quick else 12, errors)
        groups[f"simulated_{way}"] = (list(walk.recording.sensors.values()) for walk in walks)
    lines_of = {
        "rest_pct": ("%", "shoe in stance, RMS rate over that of walking"),
        "shakes_db": ("dB", f"vibrations of a shoe, {BAND[0]:g} to {BAND[1]:g} Hz, over 1 m²/s⁴/Hz"),
        "closing_deg": ("deg", f"heel up {100.0 * LEFT:g} cm before the end of a closing step"),
    }
    for name, people in groups.items():
        found = medians(people)
        if found is None:
            continue
        shoe, count = found
        values = 100.0 * shoe.rest, float(10.0 * np.log10(shoe.shakes)), float(np.degrees(shoe.heel_up))
        lines.append([name, count, *(value if np.isfinite(value) else "–" for value in values)])
        made = name.startswith("simulated")
        part = name.removeprefix("simulated_") if made else name
        for (metric, (unit, line)), value in zip(lines_of.items(), values, strict=True):
            if np.isnan(value):
                continue
            row = Row(f"shoe_{metric}_{name}", value, unit, None, count, f"{name}, median of people")
            result.append(row._replace(line=line, part=part, data="simulation" if made else "recordings", of="people"))
    heads = ["", "people", "rate %", "vibrations dB", "heel up °"]
    show(f"Shoes in stance, at landing and in closing steps, {FOOT_HZ:g} Hz simulated", heads, lines)
    return result
