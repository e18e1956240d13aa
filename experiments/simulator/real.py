"""Figures of gait in public recordings, with which the simulator is compared.

`figures` takes plain arrays of one leg, simulated or recorded (see `gait`); `real` runs it over a data set,
`spread` gives median and percentiles.

Source of the stance: heel or toe slower than `RESTING` by Vicon (`neura_sparse`, whose own flags are of the flat foot
only, 0.2 of a stride; by the same rule the feet of `gaitmap_example` stand 0.65), the insoles (`walking5m`, by a
threshold of this file, so some hundredths of the stride are uncertain), Zebris' mean of each foot (`tripod`; OptoGait's
stances are 0.05 of a stride longer, for its bars lie above the ground), events from motion capture
(`gaitmap_example`). Stride width: between the heels; on `tripod` Zebris' mean step width. Source of the distance:
Vicon's pelvis, the feet's own sensors (±5 %), the belt, Vicon's heels. Hip, knee and pelvis: `neura_sparse` only.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from experiments.common.recordings import names, walks
from experiments.common.signals import low_pass
from experiments.simulator.gait import NONE, Figures, Truth, figures, pool, summary
from jgait.signal.windows import true_runs
from jgait.types import SIDES, Imu, Walk, leg_of

ENDS = 2.0  # [m] at either end of the walkway that are not straight walking
RESTING = 0.8  # [m/s] a marker of the foot that is slower rests on the ground
WALKING = 0.8  # of the median speed; slower is the start or the end of a walk
INSOLE = 0.15  # part of a sole's range of pressure above which it bears weight


class Spread(NamedTuple):
    """What is usual: over the medians of people, or over the strides of one."""

    median: float
    low: float
    high: float
    n: int
    over: str


def real(name: str, condition: str | None = None) -> list[tuple[str, Figures]]:
    """Figures of every recording of a data set that can be used, both legs together.

    Args:
        name: 'neura_sparse' (straight parts), 'walking5m' (without each leg's first and last stride; the young and the
            elderly), 'tripod' (while the belt is at its speed) or 'gaitmap_example' (the main walk, without the turn).
        condition: only recordings whose name has this as a part between slashes: 'Young', 'PWS+20'.

    Returns:
        (name of the recording, strides).

    Raises:
        DatasetUnavailable: if the set is not there.
    """
    wanted = [one for one in names(name) if condition is None or condition in one.split("/")]
    found = [(walk.recording.name, _READERS[name](walk)) for walk in walks(name, wanted)]
    return [(recording, strides) for recording, strides in found if len(strides.stride_time)]


def spread(name: str, condition: str | None = None) -> dict[str, Spread]:
    """Median, 5th and 95th percentile of each figure: over people's medians, or over strides if there is one person."""
    return spread_of(real(name, condition))


def spread_of(recordings: Sequence[tuple[str, Figures]]) -> dict[str, Spread]:
    """As `spread`, of figures that are there already."""
    if len(recordings) == 1:
        strides = recordings[0][1]._asdict()
        found = {key: (values, "strides") for key, values in strides.items() if len(values)}
        whole = summary(recordings[0][1])
        found |= {key: (np.array([whole[key]]), "strides") for key in whole if key not in found}
    else:
        people = [summary(strides) for _, strides in recordings]
        keys = dict.fromkeys(key for person in people for key in person)
        found = {key: (np.array([person[key] for person in people if key in person]), "people") for key in keys}
    return {
        key: Spread(*(float(np.percentile(values, q)) for q in (50, 5, 95)), len(values), over)
        for key, (values, over) in found.items()
    }


def _leg(walk: Walk, side: str) -> tuple[dict[str, tuple[Any, Any]], np.ndarray]:
    """This leg's sensors and the pelvis', and where all have samples."""
    worn: dict[str, Imu] = {}
    for segment in ("shank", "thigh", "foot", "pelvis"):
        placement = segment if segment == "pelvis" else f"{segment}_{side}"
        if placement in walk.recording.sensors:
            worn[segment] = walk.recording.sensors[placement]
    good = np.logical_and.reduce([imu.mask for imu in worn.values()])
    return {segment: (imu.gyr, imu.acc) for segment, imu in worn.items()}, good


def _neura(walk: Walk) -> Figures:
    rate_hz = walk.recording.sampling_rate_hz
    named = [window for name, window in walk.info["windows"].items() if name.startswith("straight")]
    windows = [part for window in named for part in _brisk(walk.reference.distance, window, rate_hz)]
    centres = walk.info["joint_centres"]
    height = (centres["right"]["hip"][:, 2] + centres["left"]["hip"][:, 2]) / 2
    parts = []
    for side in SIDES if windows else ():
        leg = leg_of(walk.reference.legs, side)
        rests = [
            np.linalg.norm(np.gradient(low_pass(centres[side][marker], 20.0, rate_hz), axis=0), axis=1) * rate_hz
            < RESTING
            for marker in ("heel", "toe")
            if marker in centres[side]
        ]
        contact = np.logical_or(*rests) if len(rests) == 2 else None
        truth = Truth(walk.reference.distance, contact, leg.hip_angle, leg.knee_angle, height)
        sensors, good = _leg(walk, side)
        parts.append(figures(sensors, rate_hz, windows, truth, good=good))
    return pool(parts)._replace(stride_width=_widths(walk, named))


def _brisk(distance: np.ndarray, window: tuple[int, int], rate_hz: float) -> list[tuple[int, int]]:
    """The parts of a window without the steps that start and end a walk."""
    speed = low_pass(np.gradient(distance), 1.0, rate_hz)[slice(*window)]
    return [(window[0] + start, window[0] + end) for start, end in true_runs(speed > WALKING * np.median(speed))]


def _widths(walk: Walk, windows: Sequence[tuple[int, int]]) -> np.ndarray:
    """How far each heel, standing, is from the line between two stances of the other heel [m]."""
    strides, centres, widths = walk.info["ankle_strides"], walk.info["joint_centres"], []
    if len(strides) < 2 or any("heel" not in centres[side] for side in SIDES):
        return np.zeros(0)
    for side, other in (SIDES, SIDES[::-1]):
        heel = centres[side]["heel"]
        stands = np.unique(strides[other][:, :2]).astype(int)
        for first, last in strides[side][:, :2].astype(int):
            between = stands[(stands > first) & (stands < last)]
            if len(between) and any(start <= first and last < end for start, end in windows):
                way, there = heel[last] - heel[first], centres[other]["heel"][between[0]] - heel[first]
                widths.append(abs(way[0] * there[1] - way[1] * there[0]) / np.hypot(way[0], way[1]))
    return np.array(widths)


def _walking5m(walk: Walk) -> Figures:
    parts = []
    crossed = {one for pair in walk.info["misplaced"] for one in pair}
    for side in SIDES:
        usable = walk.reference is not None and walk.info["group"] in ("young", "elderly")
        if not usable or f"shank_{side}" in crossed or f"shank_{side}" not in walk.recording.sensors:
            continue
        sensors, good = _leg(walk, side)
        window = walk.info["windows"]["whole"]
        contact = None
        if side in walk.info["insoles"]:
            contact = np.logical_or(*(_bears(sole, window) for sole in walk.info["insoles"][side]))
        truth = Truth(walk.reference.distance, contact)
        parts.append(figures(sensors, walk.recording.sampling_rate_hz, [window], truth, trim=1, good=good))
    return pool(parts)


def _bears(sole: np.ndarray, window: tuple[int, int]) -> np.ndarray:
    """(T,) bool, whether a part of the sole bears weight."""
    low, high = np.percentile(sole[slice(*window)], [5, 95])
    return sole > low + INSOLE * (high - low)


def _tripod(walk: Walk) -> Figures:
    if walk.reference is None:
        return NONE
    window, parts = walk.info["windows"]["steady"], []
    for side in SIDES:
        sensors, good = _leg(walk, side)
        if {"shank", "foot"} & set(sensors):
            rate_hz = walk.recording.sampling_rate_hz
            parts.append(figures(sensors, rate_hz, [window], Truth(walk.reference.distance), good=good))
    zebris = walk.info["zebris"]
    stance = [zebris[key] for key in (f"stance_fraction_{side}" for side in SIDES) if key in zebris]
    width = [zebris[key] for key in ("step_width",) if key in zebris]
    return pool(parts)._replace(stance=np.array(stance), stride_width=np.array(width))


def _gaitmap(walk: Walk) -> Figures:
    if walk.reference is None:
        return NONE
    time, rate_hz = walk.reference.time, walk.recording.sampling_rate_hz
    heels = np.concatenate([walk.info["mocap"][side]["heel"][:, :2] for side in SIDES])
    walkway = np.linalg.svd(heels - heels.mean(axis=0), full_matrices=False)[2][0]
    middle = sum(walk.info["mocap"][side]["heel"][:, :2] @ walkway for side in SIDES) / 2
    along = np.interp(time, walk.info["mocap_time"], middle)
    windows = true_runs((along > along.min() + ENDS) & (along < along.max() - ENDS))
    parts, width = [], [np.zeros(0)]
    for side in SIDES:
        sensors, good = _leg(walk, side)
        events, strides = walk.info["events"].get(side), walk.info["strides"].get(side)
        contact = None
        if events is not None and strides is not None:
            contact = np.zeros(len(time), bool)
            for first, last in zip(events["pre_ic"], events["tc"], strict=True):
                contact[int(first) : int(last)] = True
            width.append(strides["width"][strides["straight"] & np.isfinite(strides["width"])])
        if sensors:
            parts.append(figures(sensors, rate_hz, windows, Truth(walk.reference.distance, contact), good=good))
    return pool(parts)._replace(stride_width=np.concatenate(width))


_READERS: dict[str, Callable[[Walk], Figures]] = {
    "neura_sparse": _neura,
    "walking5m": _walking5m,
    "tripod": _tripod,
    "gaitmap_example": _gaitmap,
}
