"""`neura_sparse`: IMUs on pelvis and both legs, with Vicon joint centres (Sy et al. 2020, gait-tech/gaittoolbox).

Sensors: Xsens, 100 Hz, m/s² and rad/s, on pelvis, thighs, shanks (upstream `LowLeg2`, mid shank), ankles (upstream
`LowLeg`, lower shank, turned by 90° about the shank's axis) and feet. Reference: Vicon joint centres and markers,
100 Hz, mm, z up.

The reference's distance is the length of the pelvis' horizontal path, smoothed so that sway does not count; on the
straight parts it lies within 1.2 % of the net displacement.

The IMU lags Vicon by two samples, so the first two IMU samples and the last two Vicon frames are dropped; all indices
in `info` count samples of the aligned recording from 0, half-open.

Keys of `Walk.info`:
    windows: name → (start, end): `whole` (the walk), `standing`, `end_standing`, `straight_1`, `straight_2` …
    lengths: {"right": (thigh, shank), "left": …} [m] from the joint centres while standing.
    joint_centres: {"right": {"hip" | "knee" | "ankle" | "heel" | "toe": (T, 3) [m]}, "left": …}, z up.
    heading: (T,) [rad] of the pelvis, low-passed, counter-clockwise from the laboratory's x axis.
    contact: {"right": (T,) bool, "left": …}, foot on the ground, upstream's flags; {} where there are none.
    ankle_strides: {"right": (n, 3) (stance sample, next stance sample, horizontal ankle displacement [m]), "left": …}.
    verified: whether every file's sha256 was known and agreed.
"""

from pathlib import Path

import numpy as np
from jaxtyping import PyTree

from jgait.datasets import reading, registry
from jgait.datasets.reading import Files
from jgait.geometry.sagittal import leg_in_plane, low_pass_heading, path_walked
from jgait.io.formats.matlab import read_matlab
from jgait.notes import LEFT_OUT, Kind
from jgait.signal.windows import true_runs
from jgait.types import SIDES, Estimate, Imu, Legs, Recording, RecordingError, Walk

IMU_LATE = Kind(
    "imu_late",
    "corrected",
    "the IMU lags Vicon by {samples} samples: first {samples} IMU samples, last {samples} Vicon frames dropped",
    "Two measuring systems began at different moments; they were put on one clock.",
)

RATE_HZ = 100.0
"""[Hz] Sampling rate of the IMUs and of Vicon, by upstream."""

LAG = 2
"""[samples] Delay of the IMU against Vicon, at which their rates of turn correlate best; a test computes it."""

ROOT = "data/sample"
LIST = f"{ROOT}/data-list.csv"

SERIALS = {
    "pelvis": "00B40B91",
    "thigh_right": "00B40C3C",
    "thigh_left": "00B40C45",
    "shank_right": "00B40C35",
    "shank_left": "00B40BA5",
    "ankle_right": "00B40C47",
    "ankle_left": "00B40C44",
    "foot_right": "00B40C48",
    "foot_left": "00B40C55",
}

WINDOWS = {
    "S02-Trial-Walk-1": {
        "standing": (200, 1000), "straight_1": (1120, 1440), "straight_2": (1640, 2074), "end_standing": (2200, 2450),
    }
}  # fmt: skip
"""[samples] The parts of the published trial for which results are reported, chosen by eye on the pelvis' path."""


def names() -> list[str]:
    """Trials in upstream's list whose raw IMU files are on this computer, for example 'S02-Trial-Walk-1'."""
    if not registry.listing("neura_sparse", ROOT, Path(LIST).name):
        return []
    return [name for name in _trials()[0] if _sensor_paths(name)]


def load_one(name: str) -> Walk:
    """One trial: nine sensors, and Vicon as an `Estimate`."""
    trials, list_known = _trials()
    files = Files("neura_sparse", IMU_LATE(samples=LAG))
    tables = {placement: reading.xsens(files.need(path))[0] for placement, path in _sensor_paths(name).items()}
    if not tables:
        raise RecordingError(f"{name} has none of the sensors {', '.join(SERIALS.values())}")
    needed = ["LASI", "RASI", "LPSI", "RPSI", *(side + joint for side in "RL" for joint in ("HJC", "KJC", "AJC"))]
    perhaps = [side + marker for side in "RL" for marker in ("HEE", "TOE")]
    vicon = read_matlab(files.need(f"{ROOT}/vicon/{name}.mat"), needed, perhaps, squeeze_me=True)
    vicon = {key: np.asarray(values, np.float64) / 1000.0 for key, values in vicon.items()}
    contact = _read_contact(name, files)

    first = int(min(table[0, 0] for table in tables.values())) + LAG
    length = int(max(table[-1, 0] for table in tables.values())) + 1 - first
    sensors = reading.on_counter(tables, first, min(length, len(vicon["RHJC"]) - LAG), RATE_HZ, files.notes)
    samples = len(next(iter(sensors.values())).time)
    vicon = {key: values[:samples] for key, values in vicon.items()}
    contact = {side: flags[:samples] for side, flags in contact.items()}
    lacking = [placement for placement in SERIALS if placement not in sensors]
    if lacking:
        files.notes.append(LEFT_OUT.note(f"no file for {', '.join(lacking)}"))
    recording = Recording(sensors, RATE_HZ, name, name.split("-")[0], tuple(files.notes))
    reference, details = _reference(name, trials[name], sensors, vicon, contact)
    return Walk(recording, reference, {**details, "verified": list_known and files.verified})


def _trials() -> tuple[dict[str, tuple[int, int]], bool]:
    """Trial name → (first, last + 1) frame of its walk, which upstream counts from 1, and whether the list is the known
    one; a fuller set has a longer list.
    """
    import pandas as pd

    path, known = registry.file("neura_sparse", LIST, strict=False)
    table = pd.read_csv(path)
    return {f"{row.subj}-{row.act}": (int(row.startFrame) - 1, int(row.endFrame)) for row in table.itertuples()}, known


def _sensor_paths(name: str) -> dict[str, str]:
    folder = f"{ROOT}/rawimu"
    listed = {
        placement: registry.listing("neura_sparse", folder, f"{name}-*_{serial}.txt")
        for placement, serial in SERIALS.items()
    }
    return {placement: paths[0] for placement, paths in listed.items() if paths}


def _read_contact(name: str, files: Files) -> dict[str, np.ndarray]:
    path = f"{ROOT}/rawstep-detect/{name}-revStepDetect.csv"
    if path not in registry.listing("neura_sparse", f"{ROOT}/rawstep-detect", Path(path).name):
        return {}
    table = reading.table(files.need(path), ("stepR", "stepL"))
    return {side: table[f"step{side[0].upper()}"].to_numpy() == 1 for side in SIDES}


def pelvis_heading(vicon: dict[str, np.ndarray]) -> np.ndarray:
    """Heading of the pelvis (T,) [rad], unwrapped, counter-clockwise from x, low-passed: at a right angle to the axis
    that joins the iliac spines, front and back averaged.
    """
    to_right = vicon["RASI"] - vicon["LASI"] + vicon["RPSI"] - vicon["LPSI"]
    return low_pass_heading(np.unwrap(np.arctan2(to_right[:, 0], -to_right[:, 1])), RATE_HZ)


def stance_strides(contact: np.ndarray, ankle: np.ndarray) -> np.ndarray:
    """(n, 3): stance sample, next stance sample, displacement [m] of the ankle (T, 3) between their middles."""
    starts, ends = np.array(true_runs(contact)).reshape(-1, 2).T
    if len(starts) < 2:
        return np.zeros((0, 3))
    # The first and the last stance are long: take the instant at which the foot leaves or comes to rest.
    middles = (starts + ends) // 2
    middles[0], middles[-1] = max(middles[0], ends[0] - 30), min(middles[-1], starts[-1] + 30)
    displacement = np.linalg.norm(np.diff(ankle[middles, :2], axis=0), axis=1)
    return np.stack([middles[:-1], middles[1:], displacement], axis=1)


def _reference(
    name: str,
    frames: tuple[int, int],
    sensors: dict[str, Imu],
    vicon: dict[str, np.ndarray],
    contact: dict[str, np.ndarray],
) -> tuple[Estimate, dict[str, PyTree]]:
    heading = pelvis_heading(vicon)
    pelvis = (vicon["LASI"] + vicon["RASI"] + vicon["LPSI"] + vicon["RPSI"])[:, :2] / 4
    windows = _windows(name, frames, sensors, heading)
    legs, lengths, centres = {}, {}, {}
    stand = slice(*windows["standing"])
    for side in SIDES:
        hip, knee, ankle = (vicon[side[0].upper() + joint] for joint in ("HJC", "KJC", "AJC"))
        legs[side] = leg_in_plane(hip, knee, ankle, heading)
        bones = (knee - hip, ankle - knee)
        lengths[side] = tuple(float(np.linalg.norm(bone, axis=1)[stand].mean()) for bone in bones)
        centres[side] = {"hip": hip, "knee": knee, "ankle": ankle}
        for key, marker in (("heel", "HEE"), ("toe", "TOE")):
            if side[0].upper() + marker in vicon:
                centres[side][key] = vicon[side[0].upper() + marker]
    time, source = np.arange(len(heading)) / RATE_HZ, {"source": "Vicon joint centres in the pelvis' sagittal plane"}
    valid = np.ones(len(heading), bool)
    estimate = Estimate(time, Legs(**legs), None, path_walked(pelvis, RATE_HZ), valid, source)
    return estimate, {
        "windows": windows,
        "lengths": lengths,
        "joint_centres": centres,
        "heading": heading,
        "contact": contact,
        "ankle_strides": {side: stance_strides(contact[side], centres[side]["ankle"]) for side in contact},
    }


def _windows(
    name: str, frames: tuple[int, int], sensors: dict[str, Imu], heading: np.ndarray
) -> dict[str, tuple[int, int]]:
    """Standing, walking and straight parts; computed for trials that are not in `WINDOWS`."""
    if name in WINDOWS:
        return {"whole": frames, **WINDOWS[name]}
    from jgait.events.rest import longest_still

    start, end = frames
    pelvis = sensors.get("pelvis", next(iter(sensors.values())))
    windows = {"whole": frames}
    for key, low, high in (("standing", 0, start), ("end_standing", end, len(heading))):
        still = longest_still(pelvis.gyr[low:high], RATE_HZ) if high - low > RATE_HZ else None
        if still is not None:
            windows[key] = (low + still[0], low + still[1])
    windows.setdefault("standing", (start, start + 1))
    turning = np.abs(np.gradient(heading[start:end]) * RATE_HZ) > np.deg2rad(20.0)
    straight = [(start + a, start + b) for a, b in true_runs(~turning) if b - a >= 1.5 * RATE_HZ]
    windows.update({f"straight_{number}": run for number, run in enumerate(straight, 1)})
    return windows
