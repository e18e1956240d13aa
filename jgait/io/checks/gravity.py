"""Gravity and units of one sensor: whether its gyroscope and its accelerometer agree.

Turned by the gyroscope to the axes at the start of a window of two strides, the accelerometer's mean is gravity: what
the body accelerates has no mean over whole strides. If the gyroscope turns the wrong way, about the wrong axis, or by
the wrong amount, the mean has another size, or another direction than in the standing before or after the strides. It
needs no calibration.
"""

import numpy as np

from jgait.geometry.rotation import Quaternion, conjugate, product
from jgait.geometry.vectors import GRAVITY
from jgait.io.checks import limits as at
from jgait.io.units import Unit
from jgait.notes import Note
from jgait.quality.notes import CONTRADICTS
from jgait.signal.windows import held_spread, true_runs, window_size
from jgait.types import Imu, as_float

TRIALS = {
    "the gyroscope may be 2 times too small": (2.0, 2.0, 2.0),
    "the gyroscope may be 2 times too large": (0.5, 0.5, 0.5),
    "its x axis may be turned round": (-1.0, 1.0, 1.0),
    "its y axis may be turned round": (1.0, -1.0, 1.0),
    "its z axis may be turned round": (1.0, 1.0, -1.0),
    "its sign or the handedness of its axes may be wrong": (-1.0, -1.0, -1.0),
}
"""Likely causes, and what the gyroscope is multiplied by to undo them."""


type _Means = tuple[np.ndarray, np.ndarray, np.ndarray, float]
"""Means of a few samples each: gyr and acc (n, 3), whether in a gap (n,), and the time between them [s]."""


def slow_gyroscope(placement: str, imu: Imu, rate_hz: float, unit: Unit | None) -> Note | None:
    """The note about a gyroscope of a leg that hardly turns while its accelerometer is shaken as in walking."""
    segment, mask = placement.partition("_")[0], np.asarray(imu.mask)
    legs = segment in at.TILTED_DEG and segment not in at.TRUNK and imu.acc is not None
    if not legs or len(imu.time) < 2.0 * at.WINDOW_S * rate_hz or not mask.any():
        return None
    rate = float(np.percentile(np.linalg.norm(as_float(imu.gyr)[mask], axis=1), 99.0))
    if rate >= at.SLOW_GYR or float(np.linalg.norm(as_float(imu.acc)[mask], axis=1).std()) <= at.SHAKEN:
        return None
    return CONTRADICTS.note(
        "{placement}: the gyroscope reaches only {rate:.3g} rad/s (99th percentile{stated}) while the accelerometer is "
        "shaken as in walking; its unit differs from that of the other sensors (rad/s in place of deg/s?), or it did "
        "not record",
        placement=placement, rate=rate, stated=f", {unit}" if unit is not None and unit.origin == "header" else "",
    )  # fmt: skip


def gravity_notes(placement: str, imu: Imu, lost: np.ndarray, rate_hz: float) -> list[Note]:
    """Notes about a sensor of legs or trunk whose gyroscope and accelerometer contradict each other; `lost` (T,) are
    samples in long gaps.
    """
    segment, length = placement.partition("_")[0], min(len(imu.time), int(at.LONGEST_S * rate_hz))
    if segment not in at.TILTED_DEG or imu.acc is None or length < at.WINDOW_S * rate_hz:
        return []
    trunk, count = segment in at.TRUNK, max(int(rate_hz / at.TURNED_HZ), 1)
    length = length // count
    gyr, acc = (as_float(part)[: length * count].reshape(length, count, 3).mean(axis=1) for part in (imu.gyr, imu.acc))
    means = gyr, acc, lost[: length * count].reshape(length, count).any(axis=1), count / rate_hz
    notes = []
    if segment in at.AGREEING and length * count >= 2.0 * at.WINDOW_S * rate_hz:
        notes += _size(placement, means, *at.AGREEING[segment], 0.0 if trunk else at.FASTEST_WINDOW)
    if rate_hz >= at.TILT_HZ:
        angle = smallest_tilt(means, at.MOVING_TRUNK if trunk else at.FASTEST_WINDOW)
        if angle is not None and angle > at.TILTED_DEG[segment]:
            tilts = (
                "{placement}: between standing and walking its gyroscope and its accelerometer tilt by up to "
                "{degrees:.0f}° more or less than each other; the sign, order or handedness of the axes of one of them "
                "is wrong"
            )
            notes.append(CONTRADICTS.note(tilts, placement=placement, degrees=angle))
    return notes


def _turned(rates: np.ndarray, forces: np.ndarray, step: float) -> np.ndarray:
    """Forces (…, n, 3), each turned by the rates before it to the axes at the beginning; (3, …, n)."""
    half = 0.5 * step * rates
    angle = np.sqrt(np.sum(half * half, axis=-1))
    q = np.concatenate([np.cos(angle)[None], np.moveaxis(half, -1, 0) * np.sinc(angle / np.pi)])
    q[..., 1:] = q[..., :-1].copy()
    q[..., 0] = np.array([1.0, 0.0, 0.0, 0.0]).reshape(4, *[1] * (angle.ndim - 1))
    width = 1
    while width < q.shape[-1]:  # products of neighbours, of pairs, of fours …
        q[..., width:] = product(Quaternion(*q[..., :-width]), Quaternion(*q[..., width:]))
        width *= 2
    whole, zero = Quaternion(*q), np.zeros(angle.shape)
    still = Quaternion(zero, *np.broadcast_to(np.moveaxis(forces, -1, 0), (3, *angle.shape)))
    return np.stack(product(product(whole, still), conjugate(whole))[1:])


def _windows(length: int, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Rows (windows, samples) of windows half a window apart, and the weights of their samples, a raised cosine, which
    leaves out what repeats every stride.
    """
    samples = round(at.WINDOW_S / step)
    weight = np.hanning(samples + 2)[1:-1]
    begins = np.arange(0, length - samples + 1, max(samples // 2, 1))
    return begins[:, None] + np.arange(samples), weight / weight.sum()


def _size(placement: str, means: _Means, low: float, high: float, fastest: float) -> list[Note]:
    """The note about a turned mean that has not the size of gravity; `fastest` [rad/s] is the least rms rate."""
    gyr, acc, lost, step = means
    rows, weight = _windows(len(gyr), step)
    square = np.where(lost[rows].any(axis=1), 0.0, np.sum(gyr[rows] ** 2, axis=2).mean(axis=1))
    rows = rows[(square > at.ACTIVE * square.max(initial=0.0)) & (square > fastest**2)]
    if not len(rows):
        return []
    factors = np.array([(1.0, 1.0, 1.0), *TRIALS.values()])

    def ratios(trials: np.ndarray) -> np.ndarray:
        rates = gyr[rows] * trials[:, None, None, :]
        mean = _turned(rates, acc[rows][None], step) @ weight
        return np.asarray(np.median(np.linalg.norm(mean, axis=0), axis=1) / GRAVITY)

    ratio, more = float(ratios(factors[:1])[0]), at.FEW_WINDOWS / float(np.sqrt(len(rows)))
    if low - more <= ratio <= high + more:
        return []
    undone = ratios(factors[1:])
    fits = [cause for cause, value in zip(TRIALS, undone, strict=True) if abs(value - 1.0) < at.UNDONE]
    causes = ", or ".join(fits[:3]) or "its axes, unit or scale, or the sampling rate, may be wrong"
    disagree = (
        "{placement}: gyroscope and accelerometer do not agree: turned by the gyroscope, the mean acceleration over "
        "two strides is {ratio:.2f} of gravity; {causes}"
    )
    return [CONTRADICTS.note(disagree, placement=placement, ratio=ratio, causes=causes)]


def smallest_tilt(means: _Means, moving: float) -> float | None:
    """Smallest angle between the mean forces of a standing, of which the longest has the bias, and of the walking
    beside it, of a rms rate of `moving` [rad/s] or more [deg]; None without both.
    """
    gyr, acc, lost, step = means
    size = window_size(at.STANDING_S, 1.0 / step)
    still = (held_spread(gyr, size) < at.STILL[0]) & (held_spread(acc, size) < at.STILL[1]) & ~lost
    standings = sorted(true_runs(still), key=lambda run: run[0] - run[1])[: at.STANDINGS]
    if not standings or (standings[0][1] - standings[0][0]) * step < at.BIAS_S - at.STANDING_S:
        return None
    bias, half, beside = gyr[slice(*standings[0])].mean(axis=0), size // 2, round(at.BESIDE_S / step)
    angles = []
    for start, end in standings:
        for way, middle in ((1, end - 1), (-1, start)):
            down = acc[max(middle - half, 0) : middle + half + 1].mean(axis=0)
            first = middle + way * (half + 1)
            rows = np.arange(first, np.clip(first + way * beside, -1, len(gyr)), way)
            rows = rows[: int(np.argmax(lost[rows]))] if lost[rows].any() else rows
            windows, weight = _windows(len(rows), step)
            if not len(windows):
                continue
            square = np.sum(gyr[rows[windows]] ** 2, axis=2).mean(axis=1)
            walks = windows[square > max(at.ACTIVE * square.max(), moving**2)][:2]
            if len(walks):
                back = _turned(way * (gyr[rows] - bias), acc[rows], step).T
                mean = np.einsum("w,kwi->ki", weight, back[walks])
                cosine = mean @ down / (np.linalg.norm(mean, axis=1) * np.linalg.norm(down))
                angles.append(float(np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0))).mean()))
    return min(angles, default=None)
