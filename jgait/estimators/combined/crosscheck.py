"""Checks of the sensors of a recording against each other: units, mounting, sides, segments, clocks; on the host.

A walking person moves in a known way: both legs swing alike, half a stride apart, and the shank turns faster than the
thigh. A sensor that contradicts the other sensors is named. No check depends on how a sensor is mounted.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from jgait.estimators.checks import fast_rate, force_unit
from jgait.estimators.combined.phases import OFFSETS, kind_of, late_clock, swing_phases
from jgait.mounting.places import places_in
from jgait.notes import Kind, Note, record
from jgait.quality import SOUND, SensorQuality, above, opposite
from jgait.types import SIDES, AnyArray, Imu, Recording, as_float

SENSOR_UNIT = Kind(
    "sensor_unit", "check", "",
    "One sensor is in another unit than the others. Its numbers are not used; state the unit of this sensor, or "
    "convert its columns.",
)  # fmt: skip

USUAL_RATE = {"foot": 7.5, "ankle": 5.6, "shank": 5.4, "thigh": 3.2, "wrist": 3.2, "": 1.7}
"""[rad/s] 99th percentile of the norm of the rate in walking; "" for the trunk and the head. From public recordings."""

UNIT_RATIO = 7.5
"""[1] Threshold on the ratio of a sensor's rate to the expected rate: the root of 180 / π, half way to another unit."""

LATE_S = 0.3
"""[s] Threshold on the delay of the trunk's intensity relative to that of the legs; of 43 public walks with synchronous
sensors, two have more, whose intensities are too unlike."""


@record
class Findings(NamedTuple):
    """Contradictions between the sensors of a recording.

    Attributes:
        notes: a note for each contradiction.
        unusable: placements whose signals are in a wrong unit.
        doubtful: placements whose side, segment or clock contradicts the other sensors.
        sensors: the sensors; those of two segments of a leg that have changed places are the other way round.
        crossed: placements of sensors that may be exchanged with others.
        replaced: placements of sensors that have changed places within a leg, or across.
        clocks: placements on the legs whose clock seems off.
    """

    notes: tuple[Note, ...]
    unusable: frozenset[str]
    doubtful: frozenset[str]
    sensors: dict[str, Imu]
    crossed: frozenset[str]
    replaced: frozenset[str] = frozenset()
    clocks: frozenset[str] = frozenset()

    def explained(self, quality: Mapping[str, SensorQuality]) -> dict[str, SensorQuality]:
        """The quality of the sensors without contradictions that follow from an exchange of sensors: clocks, and within
        a leg differences of the sides.
        """
        rest = {}
        for placement, facts in quality.items():
            if {placement, above(placement)} & (self.crossed | self.replaced):
                facts = facts._replace(late=SOUND.late)
            if {placement, opposite(placement)} & self.replaced:
                facts = facts._replace(step_share=SOUND.step_share, faster=SOUND.faster)
            rest[placement] = facts
        return rest


def crosscheck(recording: Recording) -> Findings:
    """Contradictions between the sensors of a walking person.

    Args:
        recording: sensors with known placements; each on its own clock.

    Returns:
        The contradictions; none if there are too few sensors or strides. If the person does not walk, only units of
        accelerometers are checked.
    """
    rates = {name: fast_rate(imu) / USUAL_RATE[kind_of(name)] for name, imu in recording.sensors.items()}
    # chosen: people who stand before the walks of `walking5m` have less
    walks = any(rate > 0.25 for name, rate in rates.items() if kind_of(name) != "wrist")
    notes, unusable = _units(recording.sensors, rates if walks else dict.fromkeys(rates, 0.0))
    if not walks:
        return Findings(tuple(notes), frozenset(unusable), frozenset(), dict(recording.sensors), frozenset())
    sensors = {name: imu for name, imu in recording.sensors.items() if name not in unusable}
    every = dict(recording.sensors)
    places = places_in(sensors)
    if places is not None:
        every |= {placement: sensors[label] for placement, label in places.worn.items()}
    sensors = {name: every[name] for name in sensors}
    replaced, crossed, exchanges = frozenset[str](), frozenset[str](), list[Note]()
    late, clocks = swing_phases(sensors)
    if places is not None and not clocks & places.unsure_of:  # a clock that is off explains the doubt
        replaced, crossed, exchanges = frozenset(places.moved), places.doubtful, places.notes()
        late, clocks = ([], frozenset()) if crossed else (late, clocks)
    off, of_trunk = _trunk(sensors)
    return Findings(
        (*notes, *exchanges, *late, *off), frozenset(unusable), clocks | crossed | of_trunk, every, crossed, replaced,
        clocks,
    )  # fmt: skip


def _kept(imu: Imu, values: AnyArray) -> np.ndarray:
    return as_float(values)[np.asarray(imu.mask, bool)]


def _units(sensors: Mapping[str, Imu], rates: Mapping[str, float]) -> tuple[list[Note], set[str]]:
    """Notes about sensors in other units than the other sensors, and their placements.

    `rates` are ratios to `USUAL_RATE`; a sensor with 0 is not judged by its gyroscope.
    """
    notes: list[Note] = []
    wrong: set[str] = set()
    known = np.sort(np.log([rate for rate in rates.values() if rate > 0.0]))
    # if half of the sensors contradict the other half, those nearer to the usual rate are right
    middle_two = known[(known.size - 1) // 2 : known.size // 2 + 1]
    pace = float(np.exp(min(middle_two, key=abs, default=0.0)))
    for name, imu in sensors.items():
        ratio = rates[name] / pace
        expected = pace * USUAL_RATE[kind_of(name)]
        if rates[name] > 0.0 and not 1.0 / UNIT_RATIO < ratio < UNIT_RATIO:
            wrong.add(name)
            unit = "deg/s" if ratio > 1.0 else "rad/s, and was converted as if in deg/s"
            text = (
                "the gyroscope of {placement} seems to be in {unit}: it turns at {rate:.3g} rad/s where the other "
                "sensors let expect about {expected:.2g}; the sensor is left out"
            )
            values = {"unit": unit, "rate": fast_rate(imu), "expected": expected}
            notes.append(SENSOR_UNIT.note(text, placement=name, **values))
        force, unit = force_unit(imu)
        if unit:
            wrong.add(name)
            text = (
                "the accelerometer of {placement} seems to be in {unit}: it reads {force:.3g} m/s² in the median, "
                "where gravity alone is 9.81; the sensor is left out"
            )
            notes.append(SENSOR_UNIT.note(text, placement=name, unit=unit, force=force))
    return notes, wrong


def _intensity(imu: Imu, grid: np.ndarray, step: float) -> np.ndarray:
    """Intensity of a sensor's movement on a time grid: the specific force's difference from its median, of mean 1.

    The difference is limited to 3 m/s², so that all parts of walking have the same weight, and averaged over
    a second, about a stride.
    """
    force = np.linalg.norm(as_float(imu.acc), axis=1)
    moved = np.minimum(np.abs(force - np.median(force)), 3.0)  # [m/s²]
    width = max(1, round(1.0 / step))  # [s] about a stride, so that steps vanish
    window = np.hanning(width + 2)[1:-1]
    level = np.convolve(np.interp(grid, as_float(imu.time), moved), window / window.sum(), mode="same")
    return np.asarray(level / max(float(level.mean()), 1e-9))


def _trunk(sensors: Mapping[str, Imu]) -> tuple[list[Note], set[str]]:
    """Notes about trunk sensors that move and rest at other times than the legs, and their placements."""
    accelerometers = {name: imu for name, imu in sensors.items() if imu.acc is not None}
    legs = [
        [imu for name, imu in accelerometers.items() if kind_of(name) in OFFSETS and name.endswith(side)]
        for side in SIDES
    ]
    trunk = [name for name in accelerometers if kind_of(name) == "" and name != "head"]
    if not all(legs) or not trunk:
        return [], set()
    step = 0.02
    every = [*legs[0], *legs[1], *(accelerometers[name] for name in trunk)]
    grid = np.arange(max(float(i.time[0]) for i in every), min(float(i.time[-1]) for i in every), step)
    if grid.size * step < 6.0:  # [s]
        return [], set()
    of_legs = np.mean([np.median([_intensity(imu, grid, step) for imu in side], axis=0) for side in legs], axis=0)
    notes: list[Note] = []
    doubtful: set[str] = set()
    for name in trunk:
        delay, likeness, gain = _delay(
            _intensity(accelerometers[name], grid, step),
            of_legs,
            round(1.5 / step),  # [s]
        )
        seconds = delay * step
        if abs(seconds) > LATE_S and likeness > 0.9 and gain > 0.03:
            words = "late" if seconds > 0.0 else "early"
            notes.append(late_clock(name, abs(seconds), words))
            doubtful.add(name)
    return notes, doubtful


def _delay(level: np.ndarray, other: np.ndarray, most: int) -> tuple[int, float, float]:
    """The delay [samples] at which two signals correlate most, the correlation, and its gain over that without delay.

    Samples without a counterpart count with the first or last value, so that every delay has the same samples.
    """
    if np.ptp(level) == 0.0 or np.ptp(other) == 0.0:
        return 0, 0.0, 0.0
    padded = np.pad(level, most, mode="edge")
    correlations = [
        float(np.corrcoef(padded[most + d : most + d + len(level)], other)[0, 1]) for d in range(-most, most + 1)
    ]
    best = int(np.argmax(correlations))
    return best - most, correlations[best], correlations[best] - correlations[most]
