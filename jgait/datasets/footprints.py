"""`footprints`: one shoe, and every footprint measured with a ruler (Çetin and Köroğlu, 2025).

Walks along corridors, 200 Hz (3DM-GX5-25); the tiles of the floor are the ruler. The upstream repository has more
recordings than this version of jgait can fetch; all `SensorConnectData_*_LLIO.mat` in the folder are read. Upstream
m/s² and rad/s. Upstream states neither foot nor person: the sensor is named `foot_right`, and all recordings have one
subject, so that no split mixes a person. The shoe stands at the start, 1.5 to 2.3 s in recordings 36 and 39.

Axes: at rest the sensor's z reads −8 to −9 m/s², so z points down. jgait turns the axes by half a turn about x (y and z
change sign: a proper rotation). The direction of x differs: backwards in 36, forwards in 39. Upstream's positions are
seen from below: its script changes the sign of the ruler's y and turns the positions to upstream's trajectory, because
sensor and trajectory have z down. jgait changes the sign of y back. Then the shoe turns left where the footprints turn
left, and the footprints differ from the ruler's (`own/*.mat`) by a rotation only. A trajectory and the footprints then
differ by a rotation about the vertical and a shift. No walk is a closed loop.

Reference: the distance along the footprints, linear in time between two footprints, and the strides between them, from
the end of one stance to the end of the next; contacts are not known.

Keys of `Walk.info`:
    footprints: {"samples": (n,) int, the last sample of each stance as published (the shoe's angular rate is then up
        to 1.3 rad/s), "time": (n,) [s], "position": (n, 2) [m]}, from above, the first at the origin; None
        where there are none.
    speed: [m/s] from the first footprint to the last; None where there are none.
    no_reference: why there is no reference; None where there is one.
    verified: whether every file's sha256 was known and agreed.
"""

from pathlib import Path
from typing import Any

import numpy as np

from jgait.datasets import reading, registry
from jgait.datasets.reading import FLIP, SIDE_UNKNOWN, Files, foot_imu, footprint_strides, way
from jgait.io.formats.matlab import read_matlab
from jgait.notes import AS_READ
from jgait.types import Estimate, Legs, Recording, RecordingError, Walk

ROOT = "data/LLIO_training_data"
RULER = "data/own"
ENDING = "_LLIO.mat"
COLUMNS = ("strideIndex", "timestamp", "gcpX", "gcpY")


def names() -> list[str]:
    """Recordings on this computer: `SensorConnectData_*` without the ending."""
    files = registry.listing("footprints", ROOT, f"SensorConnectData_*{ENDING}")
    return [Path(file).name.removesuffix(ENDING) for file in files]


def load_one(name: str) -> Walk:
    """One walk with its footprints."""
    files = Files(
        "footprints",
        SIDE_UNKNOWN(),
        AS_READ.note("z down upstream: sensor axes turned about x; positions seen from above (y changed sign)"),
    )
    path = files.need(f"{ROOT}/{name}{ENDING}")
    raw = read_matlab(path, ("timestamps", "imu_data"), squeeze_me=True)
    values = np.asarray(raw["imu_data"], np.float64)
    if values.ndim != 2 or values.shape[1] != 6:
        raise RecordingError(f"{path.name}: imu_data must be (T, 6), acceleration and rate; got {values.shape}")
    time = np.asarray(raw["timestamps"], np.float64)
    imu, rate_hz = foot_imu(path.name, time, values[:, 3:] * FLIP, values[:, :3] * FLIP)
    why = _not_measured(name, files)
    prints = None
    if not why:
        why, prints = _footprints(name, time, files)
    reference, speed = None, None
    if prints is not None:
        position, at = prints["position"], prints["time"]
        distance, valid = way(imu.time, position, at, at), imu.time <= at[-1]
        source, strides = {"source": "path along the footprints"}, footprint_strides("right", position, at, at)
        reference = Estimate(imu.time, Legs(None, None), None, distance, valid, source, strides)
        speed = float(distance[-1] / (at[-1] - at[0]))
    recording = Recording({"foot_right": imu}, rate_hz, name, "footprints", tuple(files.notes))
    return Walk(recording, reference, {
        "footprints": prints, "speed": speed, "no_reference": why, "verified": files.verified,
    })  # fmt: skip


def _not_measured(name: str, files: Files) -> str | None:
    """Why the publisher does not use the footprints; None where nothing is said."""
    path = files.find(f"{RULER}/{name}.mat")
    if path is None or read_matlab(path, ("GCP_exist_and_correct",), squeeze_me=True)["GCP_exist_and_correct"]:
        return None
    return f"{path.name} says that the footprints were not measured, or not correctly"


def _footprints(name: str, time: np.ndarray, files: Files) -> tuple[str | None, dict[str, Any] | None]:
    """Why there are no footprints, None where there are some; and the footprints."""
    try:
        path = files.need(f"{ROOT}/{name}_strideIndex_timestamp_gcpX_gcpY.csv")
    except registry.DatasetUnavailable as error:
        return str(error), None
    table = reading.table(path, COLUMNS)
    samples, clock, x, y = (table[column].to_numpy(np.float64) for column in COLUMNS)
    if len(samples) < 2 or not np.isfinite([samples, clock, x, y]).all():
        raise RecordingError(f"{path.name} must have at least 2 footprints, all of them numbers; it has {len(samples)}")
    samples = samples.astype(np.int64)
    if samples[0] < 0 or samples[-1] >= len(time) or np.any(np.diff(samples) <= 0):
        raise RecordingError(f"{path.name}: strideIndex must rise from 0 or more to less than {len(time)}")
    late = np.abs(time[samples] - clock).max()
    if late > 1e-3:  # [s] the times are written in milliseconds
        raise RecordingError(f"{path.name}: a footprint is {late:.3f} s off the sample that it names")
    position = np.stack([x, -y], axis=1)  # seen from above
    return None, {"samples": samples, "time": time[samples] - time[0], "position": position}
