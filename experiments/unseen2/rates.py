"""What accuracy to expect at 25, 40, 50 and 100 Hz: legs under Vicon, and shoes in a motion laboratory, resampled.

Signals are low-passed at .4 of the new rate, as a sensor does, and interpolated. Rates below those that the estimators
accept are let through here, to see what the limits keep out.
"""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import numpy as np

from experiments.bennett2013.neura_sparse import person
from experiments.common.recordings import attempt, available, names, walks
from experiments.common.row import Row, show
from jgait.estimators import foot_ins, leg_ekf
from jgait.estimators.foot_ins import prepare as foot_prepare
from jgait.estimators.leg_ekf import prepare as leg_prepare
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
    """Estimators without their lowest rates."""
    with ExitStack() as stack:
        for module, name in ((leg_prepare, "LOWEST_RATE_HZ"), (foot_prepare, "SLOWEST_HZ")):
            stack.callback(setattr, module, name, getattr(module, name))
            setattr(module, name, 10.0)
        yield


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


def shoes() -> list[Row]:
    """Stride lengths of `gaitmap_example` against markers: mean absolute error."""
    if not available("gaitmap_example"):
        return []
    (walk,) = walks("gaitmap_example", names("gaitmap_example")[:1])
    truth = walk.reference.strides
    lines, rows = [], []
    for rate in RATES:
        with any_rate():
            estimate = attempt(f"{rate:g} Hz", lambda r=rate: foot_ins.estimate(
                foot_ins.estimator().params, at_rate(walk.recording, r, "foot")))  # fmt: skip
        if estimate is None:
            continue
        made, errors = estimate.strides, []
        for k in np.flatnonzero(np.asarray(truth.valid)):
            same = np.asarray(made.valid) & (np.asarray(made.side) == truth.side[k])
            if same.any():
                nearest = np.flatnonzero(same)[np.argmin(np.abs(as_float(made.end)[same] - truth.end[k]))]
                if abs(float(made.end[nearest] - truth.end[k])) < 0.25:
                    errors.append(100.0 * abs(float(made.length[nearest] - truth.length[k])))
        lines.append([f"{rate:g} Hz", len(errors), float(np.mean(errors)), float(np.max(errors))])
        rows.append(Row(f"shoes_stride_cm_{rate:g}_hz", float(np.mean(errors)), "cm", n=len(errors)).on(
            f"shoes, `gaitmap_example` resampled to {rate:g} Hz: stride length", "", "strides"))  # fmt: skip
    show("Shoes by sampling rate", ["", "strides", "mean |error| cm", "worst cm"], lines)
    return rows


def rows(quick: bool) -> list[Row]:
    """Legs and shoes."""
    del quick
    return [*legs(), *shoes()]
