"""Feet of public recordings with reference strides, and the errors of an estimate against them.

Where the length comes from: markers on the foot from standing to standing (`gaitmap_example`: mean of heel, toe and
fifth metatarsal at the set's own events; `neura_sparse`: between ankle and toe, where the sensor sits; `pyshoe_vicon`:
the tracked foot), a ruler between footprints (`footprints`). Every stride of the reference is searched in the
estimate; a stride that is missing there is lost. Of `xio_gait` it is only known that the foot ends where it began.
"""

import itertools
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from experiments.common.matching import aligned_rmse, overlapping
from experiments.common.recordings import attempt, foot_centres, names, walks
from jgait.types import SIDES, Estimate, Recording

SETS = ("gaitmap_example", "neura_sparse", "footprints", "pyshoe_vicon")
SHORT = 0.25
"""[m] Shorter strides of a reference are steps on the spot."""


class Foot(NamedTuple):
    """One foot of one recording.

    Attributes:
        set: name of the data set.
        name: of the recording and the side.
        side: 'right' or 'left'.
        recording: with this foot's sensor only.
        strides: (n, 2) from standing to standing [s].
        length: (n,) [m].
        time: (m,) of the positions [s].
        position: (m, 2) [m], in a frame of their own.
    """

    set: str
    name: str
    side: str
    recording: Recording
    strides: np.ndarray
    length: np.ndarray
    time: np.ndarray
    position: np.ndarray


def feet(name: str, most: int | None = None) -> list[Foot]:
    """Every foot of a data set that has a reference, of its first `most` recordings; prints which could not be read."""
    reader = {"gaitmap_example": _gaitmap, "neura_sparse": _neura, "footprints": _footprints, "pyshoe_vicon": _vicon}
    found = []
    for walk in walks(name, names(name)[:most]):
        found += attempt(f"{name}: {walk.recording.name}", partial(reader[name], walk)) or []
    return [foot for foot in found if len(foot.strides)]


def cut(foot: Foot, samples: int) -> Foot:
    """The first samples of a recording, and the strides in them."""
    ((placement, imu),) = foot.recording.sensors.items()
    short = imu._replace(**{name: values[:samples] for name, values in imu._asdict().items() if values is not None})
    end = short.time[-1]
    kept, there = foot.strides[:, 1] < end, foot.time < end
    return foot._replace(
        recording=foot.recording._replace(sensors={placement: short}), strides=foot.strides[kept],
        length=foot.length[kept], time=foot.time[there], position=foot.position[there],
    )  # fmt: skip


def _alone(recording: Recording, side: str) -> Recording:
    placement = f"foot_{side}"
    return recording._replace(
        sensors={placement: recording.sensors[placement]}, name=f"{recording.name} {side}", notes=()
    )


def _foot(name: str, walk: Any, side: str, strides: Any, length: Any, time: Any, position: Any) -> Foot:
    strides, length = np.asarray(strides, np.float64).reshape(-1, 2), np.asarray(length, np.float64)
    good = np.isfinite(length) & (length > SHORT)
    own = _alone(walk.recording, side)
    return Foot(name, own.name, side, own, strides[good], length[good], np.asarray(time), np.asarray(position)[:, :2])


def _gaitmap(walk: Any) -> list[Foot]:
    found = []
    for side in SIDES:
        centre = foot_centres(walk)[side]
        time, hz = walk.info["mocap_time"], walk.recording.sampling_rate_hz
        events = walk.info["events"][side]
        ends = np.stack([events["start"], events["end"]], axis=1) / hz
        at = np.stack([np.interp(ends, time, centre[:, axis]) for axis in (0, 1)], axis=-1)
        length = np.linalg.norm(at[:, 1] - at[:, 0], axis=1)
        found.append(_foot("gaitmap_example", walk, side, ends, length, time, centre))
    return found


def _neura(walk: Any) -> list[Foot]:
    found = []
    time = walk.recording.sensors["foot_right"].time
    start, end = walk.info["windows"]["whole"]
    for side in SIDES:
        joints = walk.info["joint_centres"][side]
        centre = 0.5 * (joints["ankle"] + joints["toe"])
        samples = walk.info["ankle_strides"][side][:, :2].astype(int)
        length = np.linalg.norm(centre[samples[:, 1], :2] - centre[samples[:, 0], :2], axis=1)
        walking = slice(start, min(end, len(time)))
        found.append(_foot("neura_sparse", walk, side, time[samples], length, time[walking], centre[walking]))
    return found


def _footprints(walk: Any) -> list[Foot]:
    marks = walk.info["footprints"]
    if marks is None:
        return []
    ends = np.stack([marks["time"][:-1], marks["time"][1:]], axis=1)
    length = np.linalg.norm(np.diff(marks["position"], axis=0), axis=1)
    return [_foot("footprints", walk, "right", ends, length, marks["time"], marks["position"])]


def _vicon(walk: Any) -> list[Foot]:
    marks, reference = walk.info["footprints"], walk.reference
    # a stride is timed from at most 0.3 s before the foot leaves: it may have stood for long
    leaves = np.maximum(marks["time"], reference.time[marks["end"] - 1] - 0.3)
    arrives = np.minimum(marks["time"], reference.time[marks["start"]] + 0.3)
    ends = np.stack([leaves[:-1], arrives[1:]], axis=1)
    length = np.linalg.norm(np.diff(marks["position"][:, :2], axis=0), axis=1)
    good = np.asarray(reference.valid, bool)
    position = reference.feet.right.position
    # a glitch between two footprints may hide a third
    samples = marks["samples"]
    whole = np.array([good[a:b].mean() > 0.8 for a, b in itertools.pairwise(samples)], bool)
    length = np.where(whole, length, np.nan)
    return [_foot("pyshoe_vicon", walk, "right", ends, length, reference.time[good], position[good])]


class Matched(NamedTuple):
    """How an estimate compares with a reference.

    Attributes:
        error: (n,) of the length of each stride that was found [m].
        length: (n,) the reference's [m].
        stddev: (n,) that the estimate states [m]; NaN where it states none.
        lost: strides of the reference that were not found.
        rmse: of the position after turning and shifting [m].
        rows: (n,) which of the reference's strides they are.
    """

    error: np.ndarray
    length: np.ndarray
    stddev: np.ndarray
    lost: int
    rmse: float
    rows: np.ndarray


def matched(foot: Foot, estimate: Estimate) -> Matched:
    """An estimate beside the reference of a foot."""
    assert estimate.feet is not None
    assert estimate.strides is not None
    s = estimate.strides
    found = np.stack([s.standing, s.standing_end], axis=1)
    pairs = overlapping(foot.strides, found)
    error = s.length[pairs[:, 1]] - foot.length[pairs[:, 0]]
    stated = estimate.strides_stddev
    stddev = np.full(len(pairs), np.nan) if stated is None else stated.length[pairs[:, 1]]
    trajectory = getattr(estimate.feet, foot.side).position
    return Matched(
        error, foot.length[pairs[:, 0]], stddev, len(foot.strides) - len(pairs),
        position_rmse(foot, estimate.time, trajectory), pairs[:, 0],
    )  # fmt: skip


def position_rmse(foot: Foot, time: np.ndarray, position: np.ndarray) -> float:
    """Root mean square of the distance between two ways, one of them turned about the vertical and shifted [m]."""
    here = np.stack([np.interp(foot.time, time, position[:, axis]) for axis in (0, 1)], axis=1)
    return aligned_rmse(here, foot.position)
