"""Delays between gyroscope and accelerometer of a sensor, and between the sensors of a leg, by what shakes them all.

Impacts pass through one leg and hardly reach the other. If the right and left sensors of a segment are exchanged, each
is shaken like the sensors of the other leg: that is no delay.
"""

from collections.abc import Mapping

import numpy as np

from jgait.io.damage.agreement import LONGEST_S, moving_means
from jgait.mounting.leg import SIDES_EXCHANGED
from jgait.notes import Kind, Note
from jgait.types import SIDES, Imu

STEP_S = 0.02
"""[s] Time over which the change of a signal is taken: landings and swings show in it, gravity does not."""

CALM_S = 0.12
"""[s] Length of the moving mean that is taken off a specific force to compare two sensors."""

FARTHEST_S = 0.35
"""[s] Largest delay that is looked for; half a stride is longer."""

SHORTEST_S = 5.0
"""[s] Shortest recording in which delays are looked for."""

LEAST_ALIKE = 0.3
"""[1] Least correlation at the delay that is found."""

CLEARER: dict[str | tuple[str, str], float] = {"foot": 0.05, ("shank", "foot"): 0.1}
"""[1] Least gain of the correlation at a delay over the largest one at usual delays. A foot that shuffles or drags is
shaken twice in a step, and two delays fit equally well. Chosen: recorded signals with delays of 0.08 s gain more."""

COARSE = 0.05
"""[1] The same for all sensors where `STEP_S` is less than one and a half samples: swings then are as sharp as impacts,
and a delay is known to a sample. Chosen, above that of undamaged recordings at 50 and 64 Hz."""

IN_SENSOR = {"foot": (-0.035, 0.032), "ankle": (-0.05, 0.027), "shank": (-0.05, 0.027), "thigh": (-0.06, 0.05)}
"""[s] Range of the delay of the accelerometer behind the gyroscope, by segment. In undamaged public and simulated
recordings it is −0.025 to 0.02 at the foot, −0.039 to 0.02 at the shank, −0.04 to 0.03 at the thigh."""

BETWEEN = {("thigh", "shank"): 0.07, ("shank", "ankle"): 0.06, ("shank", "foot"): 0.13}
"""[s] Largest delay between two sensors of a leg. Impacts pass a leg within 0.05 s in undamaged recordings."""

MORE_ALIKE = 0.08
"""[1] Least gain of both correlations with the sensors of the other leg over both with those of the own leg, if two
sensors are exchanged. In undamaged recordings it is −0.35 or less between thigh and shank, −0.04 between shank and
foot."""

SHARED = "shank"
"""The segment that every pair of `BETWEEN` has."""

DRIFT_S = 0.085
"""[s] Largest change of that delay from the first to the last third of a walk; undamaged ones reach 0.06."""

DRIFTED_S = 12.0
"""[s] Shortest walk in which the delay is compared with itself."""

WALKING = 0.5
"""[1] Share of the mean shaking that its mean over a second exceeds while walking."""

ACCELEROMETER_LATE = Kind(
    "accelerometer_late",
    "check",
    "{placement}: the accelerometer is {milliseconds:.0f} ms {side} the gyroscope",
    "Gyroscope and accelerometer of one sensor have to be measured at the same time; speeds and lengths computed from "
    "both are wrong by many per cent.",
)
SENSOR_LATE = Kind(
    "sensor_late",
    "check",
    "{placement} is {milliseconds:.0f} ms {side} {other}; one of the two clocks is wrong",
    "Angles between two segments, and what is computed from them, need sensors on one clock.",
)
CLOCKS_DRIFT = Kind(
    "clocks_drift",
    "check",
    "{placement} drifts {milliseconds:.0f} ms {side} {other} from the first to the last third of the walk; "
    "one of the two clocks is fast or loses samples",
    "Angles between two segments, and what is computed from them, need sensors on one clock.",
)


def _told(delay: float) -> dict[str, float | str]:
    """Values of a note: the size of a delay [ms], and whether it is one."""
    return {"milliseconds": 1e3 * abs(delay), "side": "behind" if delay > 0.0 else "ahead of"}


def _changes(values: np.ndarray, step: int) -> np.ndarray:
    change = values[step:] - values[:-step]
    return np.sqrt(np.sum(change * change, axis=1))


def _mean(values: np.ndarray, samples: int) -> np.ndarray:
    """Centred moving mean of values (T, n); the ends are repeated."""
    before = samples // 2
    held = [np.repeat(values[:1], before, 0), values, np.repeat(values[-1:], samples - before - 1, 0)]
    return moving_means(np.concatenate(held), samples)


def _shaking(values: np.ndarray, samples: int) -> np.ndarray:
    rest = values - _mean(values, samples)
    return np.sqrt(np.sum(rest * rest, axis=1))


def _late(
    first: np.ndarray, second: np.ndarray, rate_hz: float, usual: tuple[float, float] | None = None, gain: float = 0.0
) -> tuple[float, float]:
    """Delay [s] of the second signal behind the first, both (n,), where they are most alike; and their correlation.

    With a range of usual delays [s], one outside of it counts only if its correlation is larger by `gain`.
    """
    farthest = int(FARTHEST_S * rate_hz)
    a, b = first - first.mean(), second - second.mean()
    size = np.sqrt((a @ a) * (b @ b))
    if not size > 0.0:
        return 0.0, 0.0
    samples = 1 << int(len(a) + farthest).bit_length()
    both = np.fft.irfft(np.conj(np.fft.rfft(a, samples)) * np.fft.rfft(b, samples), samples)
    alike = np.concatenate([both[-farthest:], both[: farthest + 1]]) / size
    best = int(np.argmax(alike))
    if usual is not None:
        low, high = (farthest + round(delay * rate_hz) for delay in usual)
        within = max(low, 0) + int(np.argmax(alike[max(low, 0) : high + 1]))
        best = best if alike[best] > alike[within] + gain else within
    return (best - farthest) / rate_hz, float(alike[best])


def delay_notes(sensors: Mapping[str, Imu], rate_hz: float) -> tuple[Note, ...]:
    """Notes about delays within and between the sensors of each leg."""
    notes: list[Note] = []
    long = {name: imu for name, imu in sensors.items() if imu.acc is not None and len(imu.time) > SHORTEST_S * rate_hz}
    step, longest = max(round(STEP_S * rate_hz), 1), int(LONGEST_S * rate_hz)
    coarse = COARSE if step < 2 else 0.0
    for placement, imu in long.items():
        segment = placement.partition("_")[0]
        if segment not in IN_SENSOR:
            continue
        gyr, acc = (np.asarray(part)[:longest] for part in (imu.gyr, imu.acc))
        low, high = IN_SENSOR[segment]
        # below 40 Hz, a delay by one sample is longer than the range
        low, high = min(low, -1.0 / rate_hz), max(high, 1.0 / rate_hz)
        gain = max(CLEARER.get(segment, 0.0), coarse)
        delay, alike = _late(_changes(gyr, step), _changes(acc, step), rate_hz, (low, high), gain)
        # a delay is known to half a sample; one at an end of the range has been found without any gain
        if not low - 0.5 / rate_hz <= delay <= high + 0.5 / rate_hz and alike > LEAST_ALIKE:
            notes.append(ACCELEROMETER_LATE(placement=placement, **_told(delay)))
    return (*notes, *_in_legs(long, rate_hz, coarse))


def _in_legs(sensors: Mapping[str, Imu], rate_hz: float, coarse: float) -> list[Note]:
    """Notes about exchanged sensors, and about delays between the others of each leg; `coarse` is 0 or `COARSE`."""
    samples, longest = max(round(CALM_S * rate_hz), 3), int(LONGEST_S * rate_hz)
    segments = dict.fromkeys(segment for pair in BETWEEN for segment in pair)
    shaken = {
        name: _shaking(np.asarray(sensors[name].acc)[:longest], samples)
        for segment in segments for side in SIDES if (name := f"{segment}_{side}") in sensors
    }  # fmt: skip
    if len({len(signal) for signal in shaken.values()}) > 1:
        return []
    # a coarse delay is known to a sample
    usual = {pair: (int(far * rate_hz) + 1) / rate_hz if coarse else far for pair, far in BETWEEN.items()}
    crossed = {pair: _crossed(shaken, pair, farthest, rate_hz) for pair, farthest in usual.items()}
    notes = _exchanged(crossed)
    for (upper, lower), farthest in usual.items():
        if notes and crossed[upper, lower] is not False:
            continue
        gain = max(CLEARER.get((upper, lower), 0.0), coarse)
        for side in SIDES:
            names = f"{upper}_{side}", f"{lower}_{side}"
            if all(name in shaken for name in names):
                notes += _between(*names, shaken[names[0]], shaken[names[1]], farthest, gain, rate_hz)
    return notes


def _crossed(shaken: Mapping[str, np.ndarray], pair: tuple[str, str], farthest: float, rate_hz: float) -> bool | None:
    """Whether the sensors of a segment are shaken like those of another segment on the other leg; None if unclear."""
    if not all(f"{segment}_{side}" in shaken for segment in pair for side in SIDES):
        return None
    here, other = (
        [_late(shaken[f"{pair[0]}_{a}"], shaken[f"{pair[1]}_{b}"], rate_hz) for a, b in zip(SIDES, sides, strict=True)]
        for sides in (SIDES, SIDES[::-1])
    )
    for answer, like, unlike in ((True, other, here), (False, here, other)):
        least = max(LEAST_ALIKE, *(alike + MORE_ALIKE for _, alike in unlike))
        if all(abs(delay) <= farthest and alike > least for delay, alike in like):
            return answer
    return None


def _exchanged(crossed: Mapping[tuple[str, str], bool | None]) -> list[Note]:
    """Notes about exchanged sensors: of the segments that contradict each other, the fewer ones."""
    away, here = (
        {segment for pair, answers in crossed.items() if answers is answer for segment in pair if segment != SHARED}
        for answer in (True, False)
    )
    if not away:
        return []
    few, many = sorted((away, here | {SHARED}), key=len)
    if len(few) == len(many):
        return [SIDES_EXCHANGED(kind=" or ".join(sorted(few | many)), others="the other sensors")]
    others = ", ".join(f"{segment}_{side}" for segment in sorted(many) for side in SIDES)
    return [SIDES_EXCHANGED(kind=segment, others=others) for segment in sorted(few)]


def _between(
    upper: str, lower: str, first: np.ndarray, second: np.ndarray, farthest: float, gain: float, rate_hz: float
) -> list[Note]:
    """Notes about two sensors of a leg."""
    notes = []
    delay, alike = _late(first, second, rate_hz, (-farthest, farthest), gain)
    if abs(delay) > farthest and alike > LEAST_ALIKE:
        notes.append(SENSOR_LATE(placement=lower, other=upper, **_told(delay)))
    walks = np.flatnonzero(_mean(first[:, None], round(rate_hz))[:, 0] > WALKING * first.mean())
    first, second = (signal[walks[0] : walks[-1] + 1] for signal in (first, second))
    third = len(first) // 3
    if 3 * third > DRIFTED_S * rate_hz:
        parts = [(first[cut], second[cut]) for cut in (slice(third), slice(-third, None))]
        begin = _late(*parts[0], rate_hz)
        end = _late(*parts[1], rate_hz, (begin[0] - DRIFT_S, begin[0] + DRIFT_S), gain)
        begin = _late(*parts[0], rate_hz, (end[0] - DRIFT_S, end[0] + DRIFT_S), gain)
        drift = end[0] - begin[0]
        if abs(drift) > DRIFT_S and min(begin[1], end[1]) > LEAST_ALIKE:
            notes.append(CLOCKS_DRIFT(placement=lower, other=upper, **_told(drift)))
    return notes
