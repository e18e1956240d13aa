"""What accuracy to expect at 25, 40, 50 and 100 Hz: legs under Vicon, resampled.

Signals are low-passed at .4 of the new rate, as a sensor does, and interpolated. A rate below those that the estimator
accepts is let through here, to see what the limit keeps out.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from experiments.bennett2013.neura_sparse import person
from experiments.common.recordings import available, walks
from experiments.common.row import Row, show
from jgait.estimators import leg_ekf
from jgait.estimators.leg_ekf import prepare
from jgait.signal.butterworth import low_pass_both_ways
from jgait.types import SIDES, Imu, Recording, as_float

RATES = (25.0, 40.0, 50.0, 100.0)


def at_rate(recording: Recording, rate_hz: float, prefix: str = "") -> Recording:
    """The sensors whose names begin with a prefix, at another rate [Hz]."""
    sensors = {}
    for name, imu in recording.sensors.items():
        if not name.startswith(prefix):
            continue
        time = as_float(imu.time)
        grid = np.arange(time[0], time[-1], 1.0 / rate_hz)

        def moved(part: Any, time: np.ndarray = time, grid: np.ndarray = grid) -> np.ndarray:
            slow = part
            if rate_hz < 0.99 * recording.sampling_rate_hz:
                slow = low_pass_both_ways(as_float(part), 0.4 * rate_hz, recording.sampling_rate_hz)
            return np.stack([np.interp(grid, time, column) for column in as_float(slow).T], axis=1)

        kept = np.asarray(imu.mask, bool)[np.clip(np.searchsorted(time, grid), 0, len(time) - 1)]
        sensors[name] = Imu(grid, moved(imu.gyr), None if imu.acc is None else moved(imu.acc), kept)
    return recording._replace(sensors=sensors, sampling_rate_hz=rate_hz)


@contextmanager
def any_rate() -> Iterator[None]:
    """The estimator without its lowest rate."""
    before = prepare.LOWEST_RATE_HZ
    try:
        prepare.LOWEST_RATE_HZ = 10.0
        yield
    finally:
        prepare.LOWEST_RATE_HZ = before


def legs() -> list[Row]:
    """Root mean square errors of hip and knee relative to standing, straight walk of `neura_sparse`."""
    if not available("neura_sparse"):
        return []
    (walk,) = walks("neura_sparse")
    time = as_float(next(iter(walk.recording.sensors.values())).time)
    lines, rows = [], []
    for rate in RATES:
        with any_rate():
            estimate = leg_ekf.estimate(person(walk), at_rate(walk.recording, rate))
        errors = {}
        for joint in ("hip_angle", "knee_angle"):
            squares = []
            for side in SIDES:
                angle = np.interp(time, as_float(estimate.time), as_float(getattr(getattr(estimate.legs, side), joint)))
                off = angle - as_float(getattr(getattr(walk.reference.legs, side), joint))
                off = off - np.nanmean(off[slice(*walk.info["windows"]["standing"])])
                squares.append(np.nanmean(off[slice(*walk.info["windows"]["straight_1"])] ** 2))
            errors[joint] = float(np.rad2deg(np.sqrt(np.mean(squares))))
        lines.append([f"{rate:g} Hz", *errors.values()])
        rows += [
            Row(f"legs_{joint.partition('_')[0]}_deg_{rate:g}_hz", error, "deg", n=2).on(
                f"legs, `neura_sparse` resampled to {rate:g} Hz: {joint.partition('_')[0]}", "", "legs"
            )
            for joint, error in errors.items()
        ]
    show("Legs by sampling rate, root mean square error", ["", "hip °", "knee °"], lines)
    return rows


def rows(quick: bool) -> list[Row]:
    """Legs at every rate."""
    del quick
    return legs()
