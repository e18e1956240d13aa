"""`pyshoe_vicon`: the right shoe under Vicon, 200 Hz, about 3 × 3 m (Wagstaff, Peretroukhin and Kelly, 2019).

Upstream has 56 trials, of which this version of jgait can fetch five; all trials in the folder are read. People walk,
run and crawl; upstream states neither activity nor person of a trial: compare `speed`; all trials have one subject, so
that no split mixes a person. Upstream m/s², rad/s and m. The shoe stands for 0.9 to 3.3 s at the start.

Axes: at rest the sensor's z reads −9.4 m/s², so z points down (x forwards and 15° down). jgait turns the axes by half a
turn about x (y and z change sign: a proper rotation). Vicon's published z points up, but its x and y are those of a
plan seen from below, so the three axes are left-handed: the shoe turns left where the path turns right, and no
rotation fits the shoe's path to Vicon's (residual 1.3 to 1.7 m, mirrored 0.04 to 0.1 m). So y changes sign.

Time: the published time, which jitters by some milliseconds (steps of 1.6 to 8 ms) although the sensor samples evenly.
Vicon is 3 to 12 ms behind the sensor, differently in each trial: compare positions while the shoe stands.

Reference: position of the foot, z up, on the sensor's time; velocity and orientation are not known. `valid` is False at
both ends of a jump faster than 10 m/s and where Vicon held a value for three samples or more (0.4 s in
2017-11-22-11-22-03). Smaller jumps remain, up to 5 cm. The height of a standing shoe differs by up to 6 cm between
places, also between two long stances, so compare lengths and not heights. The distance is the path from stance to
stance, the strides those between the footprints; contacts are not known.

Keys of `Walk.info`:
    footprints: {"samples": (n,) int, the middle of each stance, "time": (n,) [s], "position": (n, 3) [m], "start",
        "end": (n,) [samples], half-open}: of the intervals in which Vicon's speed is below 0.5 m/s. Where
        Vicon lost the foot between two footprints, one may be missing.
    zero_velocity: {"vicon" | "shoe" | "ared" | "amvd" | "mbgtd": (T,) bool}, the publisher's detectors, each with
        the best threshold for the trial. Their output flickers: with gaps below 0.15 s closed and stances of 0.08 s at
        least, `vicon` gives 25 of the 29 stances of 2017-11-27-11-13-10; `shoe` detects stances in some swings.
    speed: [m/s] path over the time from leaving the first footprint to reaching the last; None below two footprints.
    no_reference: None.
    verified: whether the file's sha256 was known and agreed.
"""

import itertools
from pathlib import Path
from typing import Any

import numpy as np

from jgait.datasets import registry
from jgait.datasets.reading import AXES_TURNED, FLIP, foot_imu, footprint_strides, way
from jgait.io.formats.matlab import read_matlab
from jgait.notes import AS_READ
from jgait.signal.windows import true_runs
from jgait.types import Estimate, Feet, FootTrajectory, Legs, Recording, RecordingError, Walk, as_float

ROOT = "data/vicon/processed"
DETECTORS = ("vicon", "shoe", "ared", "amvd", "mbgtd")
LONGEST_STANDING_S = 0.3
"""[s] A stride begins at most so long before the foot leaves, and ends so long after it arrives; chosen by hand."""


def names() -> list[str]:
    """Recordings on this computer: the trials' dates, which are the files' names."""
    return [Path(file).stem for file in registry.listing("pyshoe_vicon", ROOT, "*.mat")]


def load_one(name: str) -> Walk:
    """One trial with the trajectory of the foot."""
    path, known = registry.file("pyshoe_vicon", f"{ROOT}/{name}.mat")
    flags = {detector: f"zv_{detector}_opt" for detector in DETECTORS}
    raw = read_matlab(path, ("ts", "imu", "gt", *flags.values()), squeeze_me=True)
    time, values = np.asarray(raw["ts"], np.float64), np.asarray(raw["imu"], np.float64)
    position = np.asarray(raw["gt"], np.float64)
    zero_velocity = {detector: np.asarray(raw[flag]).astype(bool) for detector, flag in flags.items()}
    for what, got, wanted in (
        ("imu", values.shape, (len(time), 6)),
        ("gt", position.shape, (len(time), 3)),
        *((flags[detector], of.shape, (len(time),)) for detector, of in zero_velocity.items()),
    ):
        if got != wanted:
            raise RecordingError(f"{path.name}: {what} must be {wanted}; got {got}")
    imu, rate_hz = foot_imu(path.name, time, values[:, 3:] * FLIP, values[:, :3] * FLIP)
    time = as_float(imu.time)
    valid = usable(position, rate_hz)
    position = np.where(np.isfinite(position), position, 0.0) * [1.0, -1.0, 1.0]
    prints = stances(position, valid, time, rate_hz)
    arrived, left = time[prints["start"]], time[prints["end"] - 1]
    distance = way(imu.time, prints["position"], arrived, left)
    source = {"source": "Vicon; distance from stance to stance"}
    feet = Feet(FootTrajectory(position, None, None), None)
    # not valid where Vicon lost the foot for long, because a footprint may be missing
    whole = np.array([valid[a:b].mean() > 0.8 for a, b in itertools.pairwise(prints["samples"])], bool)
    last = np.maximum(prints["time"], left - LONGEST_STANDING_S)
    first = np.minimum(prints["time"], arrived + LONGEST_STANDING_S)
    strides = footprint_strides("right", prints["position"], first, last, whole)
    reference = Estimate(imu.time, Legs(None, None), None, distance, valid, source, strides, feet)
    lost = () if valid.all() else (AS_READ.note(f"samples of Vicon masked: {(~valid).sum()}"),)
    notes = (AXES_TURNED, AS_READ.note("Vicon's axes are left-handed upstream: y changed sign"), *lost)
    recording = Recording({"foot_right": imu}, rate_hz, name, "pyshoe_vicon", notes)
    details: dict[str, Any] = {
        "day": "-".join(name.split("-")[:3]),
        "footprints": prints,
        "zero_velocity": zero_velocity,
        "speed": float(distance[-1] / (arrived[-1] - left[0])) if len(left) > 1 else None,
        "no_reference": None,
        "verified": known,
    }
    return Walk(recording, reference, details)


def usable(position: np.ndarray, rate_hz: float) -> np.ndarray:
    """(T,) bool: False at both ends of a jump, and where the position (T, 3) [m] was held or is missing."""
    known = np.isfinite(position).all(axis=1)
    step = np.linalg.norm(np.diff(np.where(known[:, None], position, 0.0), axis=0), axis=1)
    step = np.where(known[1:] & known[:-1], step, np.nan)
    # The published times jitter more than the sensor's sampling, so the speed is computed with the nominal rate.
    jump = np.flatnonzero(step * rate_hz > 10.0)  # [m/s] no foot is as fast
    known[jump] = False
    known[jump + 1] = False
    for start, end in true_runs(step == 0):
        if end - start >= 3:
            known[start : end + 1] = False
    return known


def stances(position: np.ndarray, valid: np.ndarray, time: np.ndarray, rate_hz: float) -> dict[str, np.ndarray]:
    """Footprints of the stances by motion capture alone; the keys are those of `info["footprints"]`."""
    from scipy.ndimage import median_filter

    speed = np.linalg.norm(np.gradient(position, axis=0), axis=1) * rate_hz
    # single positions have errors of some centimetres; a standing foot rolls a little
    still = (median_filter(speed, 9) < 0.5) & valid
    joined = still.copy()
    for start, end in true_runs(~still):
        joined[start:end] = start > 0 and end < len(still) and end - start < 0.1 * rate_hz
    kept = [(start, end) for start, end in true_runs(joined) if end - start >= 0.05 * rate_hz]
    inside = [start + np.flatnonzero(still[start:end]) for start, end in kept]
    middle = np.array([samples[len(samples) // 2] for samples in inside], np.int64)
    edges = np.array(kept, np.int64).reshape(-1, 2)
    where = {"samples": middle, "time": time[middle], "position": position[middle]}
    return {**where, "start": edges[:, 0], "end": edges[:, 1]}
