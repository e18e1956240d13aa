"""From a recording to a leg's own axes: quiet standing, sagittal axis, sign, swapped sensors. NumPy, on the host.

Everything here is a decision: which samples are standing, which axis is mediolateral, which way it points. Nothing
here carries a gradient; what follows (`leg_ekf.run`) is smooth given these decisions.
"""

from typing import NamedTuple

import numpy as np

from jgait.estimators.checks import common_time
from jgait.estimators.leg_ekf.inputs import LegInputs, LegSignals, Preparation, Segment
from jgait.signal.windows import true_runs
from jgait.types import SIDES, AnyArray, Imu, Recording, RecordingError

STILL_RATE = 0.25  # rad/s; every leg gyroscope stays below it while standing
STILL_WINDOW = 0.25  # s either side of a sample that must be quiet too
SHORTEST_STANDING = 0.5  # s
WALKING_RATE = 0.6  # rad/s RMS of a shank that walks
TURNING_RATE = 0.6  # rad/s about the vertical, low-passed: a turn
SMALLEST_VARIANCE = 1e-8  # rad²/s², of a gyroscope at rest
THIGH_LEAD = 0.16  # s by which the thigh's forward swing precedes the shank's


LONG_GAP = 0.3
"""[s] From so many samples missing in a row on, a leg may have turned anywhere."""


def worn_sides(recording: Recording) -> tuple[str, ...]:
    """The sides on which both thigh and shank are measured.

    Raises:
        RecordingError: if neither side has both.
    """
    sides = tuple(s for s in SIDES if f"thigh_{s}" in recording.sensors and f"shank_{s}" in recording.sensors)
    if not sides:
        missing = [p for p in ("thigh_right", "shank_right") if p not in recording.sensors]
        if any(p.endswith("_left") for p in recording.sensors) and len(missing) == 2:
            missing = [p for p in ("thigh_left", "shank_left") if p not in recording.sensors]
        wanted = " and ".join(f"'{p}'" for p in missing)
        feet = any(p.startswith("foot_") for p in recording.sensors)
        other = "; for sensors on the feet take the estimator foot_ins" if feet else ""
        raise RecordingError(f"leg_ekf needs {wanted}; the recording has {sorted(recording.sensors)}{other}")
    return sides


def _common_clock(recording: Recording, sides: tuple[str, ...]) -> tuple[dict[str, Imu], np.ndarray]:
    """The sensors of the worn legs and their shared time, checked."""
    sensors = {f"{part}_{s}": recording.sensors[f"{part}_{s}"] for s in sides for part in ("thigh", "shank")}
    first = next(iter(sensors))
    time = np.asarray(sensors[first].time, np.float64)
    if time.size < 3:
        raise RecordingError(f"leg_ekf needs a walk; '{first}' has {time.size} samples")
    common_time(recording, list(sensors), "leg_ekf", "thigh and shank", acc=False)
    return sensors, time


def resampled(time: np.ndarray, sensors: dict[str, Imu], rate_hz: float | None) -> tuple[np.ndarray, dict[str, Imu]]:
    """Every k-th sample where the rate divides, else linear interpolation; unchanged for None.

    Raises:
        RecordingError: if the recording is slower than the rate asked for.
    """
    rate = 1.0 / float(np.median(np.diff(time)))
    if rate_hz is None or abs(rate / rate_hz - 1.0) < 0.01:
        return time, sensors
    if rate < rate_hz:
        raise RecordingError(f"rate_hz={rate_hz:g} is above the recording's rate of {rate:.1f} Hz")
    factor = round(rate / rate_hz)
    if abs(rate / rate_hz / factor - 1.0) < 0.01:
        return time[::factor], {
            k: Imu(i.time[::factor], i.gyr[::factor], None if i.acc is None else i.acc[::factor], i.mask[::factor])
            for k, i in sensors.items()
        }
    grid = np.arange(time[0], time[-1], 1.0 / rate_hz)

    def on_grid(values: AnyArray) -> np.ndarray:
        return np.stack([np.interp(grid, time, c) for c in np.asarray(values, np.float64).T], 1)

    near = np.clip(np.searchsorted(time, grid), 0, time.size - 1)
    return grid, {
        k: Imu(grid, on_grid(i.gyr), None if i.acc is None else on_grid(i.acc), np.asarray(i.mask)[near])
        for k, i in sensors.items()
    }


def _median(values: AnyArray, size: int) -> np.ndarray:
    """`windows.median_filter` in NumPy: every recording has a length of its own, and JAX would compile for each.

    Raises:
        RecordingError: if there are not enough samples for a window.
    """
    half = size // 2
    if size < 1 or size % 2 == 0:
        raise ValueError(f"size must be odd and positive, so that the window has a middle; got {size}")
    if len(values) <= half:
        raise RecordingError(f"a median over {size} samples needs more than {half}; the recording has {len(values)}")
    padded = np.pad(np.asarray(values, np.float64), [(half, half), (0, 0)], mode="reflect")
    window = [padded[shift : shift + len(values)] for shift in range(size)]
    # Sorted by exchanging neighbours, whole signals at a time: several times faster than `np.sort` of short windows.
    for turn in range(size):
        for i in range(turn % 2, size - 1, 2):
            window[i], window[i + 1] = np.minimum(window[i], window[i + 1]), np.maximum(window[i], window[i + 1])
    return window[half]


def _maximum(values: np.ndarray, half: int) -> np.ndarray:
    padded = np.pad(values, half, mode="edge")
    return np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1).max(axis=1)


def find_standing(sensors: dict[str, Imu], time: np.ndarray) -> tuple[np.ndarray, tuple[int, int], list[str]]:
    """Which samples are quiet standing, the stretch that calibrates, and what was noticed.

    A sample counts as standing when no leg gyroscope exceeds `STILL_RATE` within `STILL_WINDOW` of it. The first
    stretch of a second or more calibrates; failing that the longest.

    Raises:
        RecordingError: if the person never stands still for `SHORTEST_STANDING`.
    """
    rate = 1.0 / float(np.median(np.diff(time)))
    half = max(1, round(STILL_WINDOW * rate))
    fastest = np.max([np.linalg.norm(np.asarray(i.gyr), axis=1) for i in sensors.values()], axis=0)
    around = _maximum(fastest, half)
    notes: list[str] = []
    for limit in (STILL_RATE, 2.0 * STILL_RATE):
        still = around < limit
        runs = [r for r in true_runs(still) if (r[1] - r[0]) >= SHORTEST_STANDING * rate]
        if runs:
            long = [r for r in runs if (r[1] - r[0]) >= rate]
            if limit > STILL_RATE:
                notes.append(f"the quietest standing still moves at up to {limit:g} rad/s")
            return still, (long[0] if long else max(runs, key=lambda r: r[1] - r[0])), notes
    raise RecordingError(
        f"leg_ekf needs {SHORTEST_STANDING:g} s of quiet standing (all leg gyroscopes below {STILL_RATE:g} rad/s) to "
        f"find the gyroscope bias and the upright pose; the quietest moment of this recording reaches "
        f"{around.min():.2f} rad/s"
    )


def _smooth(values: np.ndarray, seconds: float, rate: float) -> np.ndarray:
    """Moving average applied forward and back (a triangle), same length."""
    width = max(1, round(seconds * rate / 2))
    kernel = np.convolve(np.ones(width), np.ones(width)) / width**2
    padded = np.pad(values, (kernel.size // 2, kernel.size - 1 - kernel.size // 2), mode="edge")
    return np.convolve(padded, kernel, mode="valid")


def sagittal_axis(
    gyr: np.ndarray, up: np.ndarray | None, still: np.ndarray, rate: float, *, perpendicular: bool
) -> np.ndarray:
    """The axis about which the segment turns while walking straight, in sensor axes, up to its sign.

    The first principal axis of the angular rate over the walking samples that are not part of a turn; with
    `perpendicular`, made perpendicular to gravity as felt while standing.

    Args:
        gyr: (T, 3) angular rate without bias [rad/s].
        up: (3,) unit vector up while standing, or None without an accelerometer.
        still: (T,) bool.
        rate: samples a second [Hz].
        perpendicular: project onto the horizontal plane.

    Returns:
        (3,) unit vector.
    """
    walking = ~still
    if up is not None:
        turning = np.abs(_smooth(gyr @ up, 1.0, rate)) > TURNING_RATE
        if np.count_nonzero(walking & ~turning) > rate:
            walking = walking & ~turning
    samples = gyr[walking]
    _, vectors = np.linalg.eigh(samples.T @ samples)
    axis = vectors[:, -1]
    if perpendicular and up is not None:
        axis = axis - (axis @ up) * up
    return axis / np.linalg.norm(axis)


def _segment_axes(axis: np.ndarray, up: np.ndarray | None) -> np.ndarray:
    """Rows forward, up, right in sensor axes; right is the sagittal axis itself."""
    if up is None:
        up = np.eye(3)[np.argmin(np.abs(axis))]
    forward = np.cross(up, axis)
    forward = forward / np.linalg.norm(forward)
    return np.stack([forward, np.cross(axis, forward), axis])


class _Sensor(NamedTuple):
    gyr: np.ndarray
    bias: np.ndarray
    up: np.ndarray | None
    axis: np.ndarray
    swing: np.ndarray


def _analyse(imu: Imu, standing: slice, still: np.ndarray, rate: float, *, perpendicular: bool) -> _Sensor:
    gyr = np.asarray(imu.gyr, np.float64)
    bias = gyr[standing].mean(axis=0)
    up = None
    if imu.acc is not None:
        mean = np.asarray(imu.acc, np.float64)[standing].mean(axis=0)
        up = mean / np.linalg.norm(mean)
    free = gyr - bias
    axis = sagittal_axis(free, up, still, rate, perpendicular=perpendicular)
    swing = _smooth(free @ axis, 0.1, rate)
    return _Sensor(gyr, bias, up, axis, swing)


def orient(
    sensors: dict[str, Imu], side: str, standing: slice, still: np.ndarray, rate: float, *, perpendicular: bool
) -> tuple[LegSignals, list[str]]:
    """One leg's signals in segment axes, with swapped sensors put right and both signs found.

    The shank turns faster than the thigh; where the sensor called thigh turns a quarter faster, the two are taken as
    swapped. A shank swings forward faster than it goes back, which gives its sign; the thigh swings forward
    `THIGH_LEAD` before the shank does, which gives the thigh's (correlation .7 to .9 on every leg of `walking5m`, near
    0 without the lead).

    Raises:
        RecordingError: if the shank never moves like walking.
    """
    notes: list[str] = []
    names = {"thigh": f"thigh_{side}", "shank": f"shank_{side}"}
    found = {
        part: _analyse(sensors[name], standing, still, rate, perpendicular=perpendicular)
        for part, name in names.items()
    }
    moving = {
        part: float(np.sqrt(np.mean(f.swing[~still] ** 2))) if (~still).any() else 0.0 for part, f in found.items()
    }
    if max(moving.values()) < WALKING_RATE:
        raise RecordingError(
            f"leg_ekf found no walking: the {side} shank turns at {moving['shank']:.2f} rad/s RMS outside standing "
            f"(a walking shank exceeds {WALKING_RATE:g}); is the gyroscope in rad/s?"
        )
    if moving["thigh"] > 1.25 * moving["shank"]:
        names = {"thigh": names["shank"], "shank": names["thigh"]}
        found = {"thigh": found["shank"], "shank": found["thigh"]}
        notes.append(
            f"{side} thigh and shank sensors look swapped (the 'thigh' turns faster); taken the other way round"
        )
    shank, thigh = found["shank"], found["thigh"]
    signs = {"shank": float(np.sign(np.sum(shank.swing**3)) or 1.0)}
    lead = round(THIGH_LEAD * rate)
    together = float(np.sum(thigh.swing[: len(still) - lead] * shank.swing[lead:])) * signs["shank"]
    signs["thigh"] = float(np.sign(together) or 1.0)
    segments = {}
    for part, sensor in found.items():
        imu = sensors[names[part]]
        axes = _segment_axes(signs[part] * sensor.axis, sensor.up)
        gyr = sensor.gyr @ axes.T
        acc = np.zeros_like(gyr)
        if imu.acc is not None:
            raw = np.asarray(imu.acc, np.float64)
            acc = raw @ axes.T / np.linalg.norm(raw[standing].mean(axis=0))
        measured = np.asarray(imu.mask, bool)
        # A coarsely quantised gyroscope reads the same all the time at rest; its noise is not 0 for that.
        variance = np.maximum(np.var(gyr[standing, 2]), SMALLEST_VARIANCE)
        segments[part] = Segment(gyr, acc, measured, axes @ sensor.bias, variance)
    return LegSignals(segments["thigh"], segments["shank"]), notes


def _told(legs: dict[str, LegSignals], time: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """Where the sensors say enough for an estimate (T,) bool, and what is not said of the rest."""
    lost = ~np.all([segment.measured for leg in legs.values() for segment in leg], axis=0)
    heard, step = np.ones(time.size, bool), float(np.median(np.diff(time)))
    notes = []
    for start, stop in true_runs(lost):
        if (stop - start) * step >= LONG_GAP:
            heard[start:stop] = False
            notes.append(
                f"nothing is stated for {(stop - start) * step:.2f} s from {time[start] - time[0]:.2f} s, where "
                "samples are missing; angles and distance after it are less certain than stated"
            )
    return heard, notes


def prepare(
    recording: Recording, *, rate_hz: float | None = None, median: int = 1, perpendicular: bool = True
) -> Preparation:
    """Check a recording and turn it into the inputs of `leg_ekf.run`.

    Args:
        recording: with thigh and shank sensors of at least one leg, standing still at some time.
        rate_hz: resample to this rate [Hz]; None keeps the recording's.
        median: width in samples of a median filter on the gyroscopes; 1 is none.
        perpendicular: make the sagittal axis perpendicular to gravity.

    Returns:
        Inputs in segment axes, notes in words, and the half-open range of samples that calibrated.

    Raises:
        RecordingError: missing placement, clocks that differ, no standing, no walking.
    """
    sides = worn_sides(recording)
    sensors, time = _common_clock(recording, sides)
    time, sensors = resampled(time, sensors, rate_hz)
    if median > 1:
        sensors = {k: i._replace(gyr=_median(i.gyr, median)) for k, i in sensors.items()}
    rate = 1.0 / float(np.median(np.diff(time)))
    still, (start, stop), notes = find_standing(sensors, time)
    legs = {}
    for side in sides:
        legs[side], more = orient(sensors, side, slice(start, stop), still, rate, perpendicular=perpendicular)
        notes += more
    if any(sensors[k].acc is None for k in sensors):
        notes.append("no accelerometer: angles come from the gyroscopes alone and drift")
    if not still[0]:
        notes.append("the recording does not start standing still; its first angles are uncertain")
    notes += [
        f"{segment}_{side} is worn without the {other} of that leg, which is left out"
        for side in SIDES for segment, other in (("thigh", "shank"), ("shank", "thigh"))
        if side not in sides and f"{segment}_{side}" in recording.sensors
    ]  # fmt: skip
    if len(sides) == 1:
        notes.append(
            f"only the {sides[0]} leg is worn: distances come out some 10 % short in simulation, unless distance_scale "
            "was learned with one leg too"
        )
    heard, more = _told(legs, time)
    dt = np.concatenate([[0.0], np.diff(time)])
    variance = np.asarray(1e-4 if still[0] else 0.1)
    inputs = LegInputs(legs.get("right"), legs.get("left"), time, dt, still, heard, variance)
    notes += more
    return Preparation(inputs, tuple(notes), (start, stop))
