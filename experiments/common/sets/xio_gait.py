"""`xio_gait`: one foot that ends where it began, about 398 Hz (x-io Technologies, Gait-Tracking).

`short_walk` is about 25 m long, `long_walk` (upstream only) about 60 m, each a loop; the trajectory of the publisher's
algorithm ends 82 mm and 421 mm from its start, height included. Upstream g and deg/s, sensor's axes with z up and x
forwards (29° down). The foot stands for 15 s at the start of the short walk. Upstream does not state which foot it is:
the sensor is named `foot_right`.

Time: the file's. 205 rows of `short_walk` repeat the row before, time included, and are dropped; other samples are
missing (165 gaps, up to 12.6 ms instead of 2.5), so time steps must be taken from `time` and not from the rate.

The only reference is the closed loop.

Keys of `Walk.info`:
    closes: whether the foot is known to end where it began.
    publisher_closure: [m] distance from start to end of the publisher's trajectory; None where it is not given.
    no_reference: why there is no reference.
    verified: whether the file's sha256 was known and agreed.
"""

from pathlib import Path

import numpy as np

from jgait.datasets import registry
from jgait.datasets.reading import SIDE_UNKNOWN, foot_imu
from jgait.geometry.vectors import GRAVITY
from jgait.io.formats import devices
from jgait.notes import AS_READ, Kind
from jgait.types import Recording, RecordingError, Walk

CLOSED = {"short_walk": 0.082, "long_walk": 0.421}  # publisher's closure [m]

UNITS_CONVERTED = Kind("units_converted", "info", "g and deg/s upstream", AS_READ.meaning)

TIME_STEPS = Kind("time_steps", "info", "time steps {least_ms:.1f} to {most_ms:.1f} ms", AS_READ.meaning)


def names() -> list[str]:
    """Recordings on this computer: files `*_walk.csv`, without the extension."""
    return [Path(file).stem for file in registry.listing("xio_gait", "", "*_walk.csv") if "/" not in file]


def load_one(name: str) -> Walk:
    """One walk."""
    path, known = registry.file("xio_gait", f"{name}.csv")
    content = devices.FORMATS["xio"].measured(path)
    (part,), repeated = content.parts, content.notes
    if part.time is None or part.acc is None:
        raise RecordingError(f"{path.name} has no time; expected a column Time (s)")
    imu, rate_hz = foot_imu(path.name, part.time, np.deg2rad(part.gyr), part.acc * GRAVITY)
    notes = [SIDE_UNKNOWN(), UNITS_CONVERTED(), *repeated]
    steps = 1e3 * np.diff(imu.time)
    notes.append(TIME_STEPS(least_ms=steps.min(), most_ms=steps.max()))
    recording = Recording({"foot_right": imu}, rate_hz, name, "xio_gait", tuple(notes))
    details = {
        "closes": name in CLOSED,
        "publisher_closure": CLOSED.get(name),
        "no_reference": "known is only that the foot ends where it began" if name in CLOSED else "nothing is known",
        "verified": known,
    }
    return Walk(recording, None, details)
