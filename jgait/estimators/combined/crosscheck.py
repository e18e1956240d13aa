"""Checks of the sensors of a recording against each other: units, mounting, sides, segments, clocks; on the host.

A walking person moves in a known way: both legs swing alike, half a stride apart, and the shank turns faster than the
thigh. A sensor that contradicts the other sensors is named. Every check needs only the norms of the signals and the
direction of gravity, so that it does not depend on how a sensor is mounted.
"""

import itertools
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from jgait.estimators.checks import fast_rate, force_unit
from jgait.estimators.combined.phases import OFFSETS, WRONG_CLOCK, OutOfPhase, kind_of, swing_phases
from jgait.mounting.leg import SWAPPED
from jgait.mounting.shank import LABELS_EXCHANGED
from jgait.notes import WRONG_PLACE, Kind, Note, record
from jgait.quality import SOUND, SensorQuality, above, opposite
from jgait.types import SIDES, AnyArray, Imu, Recording, as_float

WRONG_UNIT = (
    "One sensor is in another unit than the others. Its numbers are not used; state the unit of this sensor, or "
    "convert its columns."
)

GYR_UNIT = Kind(
    "sensor_gyr_unit", "check", "the gyroscope of {placement} seems to be in {unit}: it turns at {rate:.3g} rad/s "
    "where the other sensors let expect about {expected:.2g}; the sensor is left out", WRONG_UNIT,
)  # fmt: skip
ACC_UNIT = Kind(
    "sensor_acc_unit", "check", "the accelerometer of {placement} seems to be in {unit}: it reads {force:.3g} m/s² in "
    "the median, where gravity alone is 9.81; the sensor is left out", WRONG_UNIT,
)  # fmt: skip
TURNED_OVER = Kind(
    "upside_down", "info", "{placement} seems to be upside down: its axis that looks down looks up in {other}",
    "The estimators compute the sensor's axes from the walk, so no result is worse for it, unless the sensor is not "
    "where its label says.",
)  # fmt: skip
FOOT_ON_SHANK = Kind(
    "foot_on_shank", "check", "{foot} and {shank} have changed places: in stances the shank's sensor rests, and the "
    "foot's turns; taken the other way round", WRONG_PLACE,
)  # fmt: skip
TRUNK_CLOCK_OFF = Kind(
    "trunk_clock_off", "check", "the clock of {placement} seems to be about {seconds:.1f} s {direction}: it moves when "
    "the legs rest, and rests when they move", WRONG_CLOCK,
)  # fmt: skip

USUAL_RATE = {"foot": 7.5, "ankle": 5.6, "shank": 5.4, "thigh": 3.2, "wrist": 3.2, "": 1.7}
"""[rad/s] 99th percentile of the norm of the rate in walking; "" for the trunk and the head. From public recordings."""

UNIT_RATIO = 7.5
"""[1] Threshold on the ratio of a sensor's rate to the expected rate: the root of 180 / π, half way to another unit."""

LEAST_WALK = 0.25
"""[1] Least ratio of any sensor's rate to `USUAL_RATE` in walking. Chosen: between those of people who
stand before the walks of `walking5m`, and of simulated people who walk a fifth as fast as usual."""

RESTING, RESTS_S, WALKS, RESTS_MORE = 0.4, 2.0, 0.4, 0.05
"""[rad/s] Rate below which a sensor rests. [s] Window over which the squared rate is averaged, and [1] share of the
largest mean above which a person walks. [1] Least difference of the shares of rest with which a shank or thigh rests
more than the foot; in undamaged public walks the foot of the leg rests more, by at least 0.11."""

RESTS_FLAT = 0.1
"""[1] Least share of rest of a sensor on a foot that lies flat: if its lean varies less while it rests, it is not on
the shank, although the shank of a sound leg can rest more than a stiff leg's foot. Shanks of public walks rest less."""

SEGMENTS = "thigh", "shank", "foot"

OPPOSITE = -0.5
"""[1] Threshold on the scalar product of the up axes of two sensors, below which one is upside down (over 120°)."""

INTENSITY_S = 1.0
"""[s] Duration of the window over which the intensity of movement is averaged; about a stride, so that steps vanish."""

LARGEST_FORCE = 3.0
"""[m/s²] Limit on the difference of a specific force from its median in the intensity."""

LATE_S, LONGEST_DELAY = 0.3, 1.5
"""[s] Threshold on the delay of the trunk's intensity relative to that of the legs, and the longest delay tried; of 43
public walks with synchronous sensors, two have 0.3 s or more, which the next two thresholds leave out."""

LIKE, LEAST_GAIN = 0.9, 0.03
"""[1] Least correlation of the intensities at the best delay, and least gain over the correlation without delay."""

LEAST_SECONDS = 6.0
"""[s] Shortest recording for the comparison of intensities."""


class _Motion(NamedTuple):
    """How a sensor moves in walking."""

    rate: float  #: 99th percentile of the rate [rad/s].
    rests: float  #: share of the time in which it rests [1].
    tilts: float  #: median difference of the directions of gravity while it rests [rad]; NaN where it is not known.


@record
class Findings(NamedTuple):
    """Contradictions between the sensors of a recording.

    Attributes:
        notes: a note for each contradiction.
        unusable: placements whose signals are in a wrong unit.
        doubtful: placements whose side, segment or clock contradicts the other sensors.
        sensors: the sensors; those of two segments of a leg that have changed places are the other way round.
        crossed: placements of sensors that are exchanged with those of the other leg, also by the reader.
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


type _Pair = tuple[str, str]
"""Placements of two sensors of a leg that have changed places: a thigh's and another's, or a foot's and a shank's."""


def crosscheck(recording: Recording) -> Findings:
    """Contradictions between the sensors of a walking person.

    Args:
        recording: sensors with known placements; each on its own clock.

    Returns:
        The contradictions; none if there are too few sensors or strides. If the person does not walk, only units of
        accelerometers and sensors upside down are checked.
    """
    rates = {name: fast_rate(imu) / USUAL_RATE[kind_of(name)] for name, imu in recording.sensors.items()}
    walks = any(rate > LEAST_WALK for name, rate in rates.items() if kind_of(name) != "wrist")
    crossed = frozenset(placement for placement, facts in recording.quality.items() if facts.other_side)
    notes, unusable = _units(recording.sensors, rates if walks else dict.fromkeys(rates, 0.0))
    if not walks:
        over, every = _upside_down(recording.sensors), dict(recording.sensors)
        return Findings((*notes, *over), frozenset(unusable), frozenset(), every, crossed)
    sensors = {name: imu for name, imu in recording.sensors.items() if name not in unusable}
    every = dict(recording.sensors)
    pairs = _exchanges(sensors)
    for placement, other in pairs:
        every[placement], every[other] = every[other], every[placement]
    exchanges = [_note(*pair) for pair in pairs]
    sensors = {name: every[name] for name in sensors}
    swings = swing_phases(sensors)
    if crossed:  # the reader, which compares all sensors, explains when they swing
        swings = OutOfPhase((), crossed.intersection(sensors), crossed)
    off, of_trunk = _trunk(sensors)
    return Findings(
        (*notes, *exchanges, *_upside_down(sensors), *swings.notes, *off), frozenset(unusable),
        swings.doubtful | of_trunk, every, swings.crossed, frozenset(itertools.chain(*pairs)), swings.clocks,
    )  # fmt: skip


def _note(placement: str, other: str) -> Note:
    """The note on two sensors of a leg that have changed places."""
    if kind_of(placement) == "foot":
        return FOOT_ON_SHANK(foot=placement, shank=other)
    return LABELS_EXCHANGED(thigh=placement, other=other)


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
            notes.append(GYR_UNIT(placement=name, unit=unit, rate=fast_rate(imu), expected=expected))
        force, unit = force_unit(imu)
        if unit:
            wrong.add(name)
            notes.append(ACC_UNIT(placement=name, unit=unit, force=force))
    return notes, wrong


def _up(imu: Imu) -> np.ndarray | None:
    """(3,) direction of the median specific force in the sensor's axes; None without an accelerometer."""
    if imu.acc is None or not np.any(imu.mask):
        return None
    up = np.median(_kept(imu, imu.acc), axis=0)
    return np.asarray(up / max(float(np.linalg.norm(up)), 1e-9))


def _upside_down(sensors: Mapping[str, Imu]) -> list[Note]:
    """Notes about sensors whose upward axis points down in their counterpart."""
    ups = {name: up for name, imu in sensors.items() if (up := _up(imu)) is not None}
    segments = {name: up for name, up in ups.items() if kind_of(name) in ("thigh", "shank", "ankle")}
    notes: list[Note] = []
    for kind in OFFSETS:
        pair = [f"{kind}_{side}" for side in SIDES if f"{kind}_{side}" in ups]
        if len(pair) < 2 or ups[pair[0]] @ ups[pair[1]] > OPPOSITE:
            continue
        others = [up for name, up in segments.items() if name not in pair]
        votes = [sum(float(np.sign(ups[name] @ up)) for up in others) for name in pair]
        if kind != "foot" and votes[0] * votes[1] < 0.0:
            wrong = pair[int(np.argmin(votes))]
            notes.append(TURNED_OVER(placement=wrong, other=pair[1 - pair.index(wrong)]))
        else:
            notes.append(TURNED_OVER(placement=" or ".join(pair), other="the other"))
    trunk = [name for name in ups if kind_of(name) == "" and len(segments) >= 3]
    turned = [name for name in trunk if max(float(ups[name] @ up) for up in segments.values()) < OPPOSITE]
    return notes + [TURNED_OVER(placement=name, other="thighs and shanks") for name in turned]


def _exchanges(sensors: Mapping[str, Imu]) -> list[_Pair]:
    """Two sensors of different segments and legs if they have changed places; else those of single legs.

    Such a pair is named only if, after the exchange, all sensors swing at consistent times. Where sides are exchanged,
    the rests of a foot and a shank of two legs prove nothing, because they differ in limping.
    """
    pairs, swings = _segments(sensors), swing_phases(sensors)
    if pairs and not swings.doubtful:
        return pairs
    measured = {name: _motion(imu) for name, imu in sensors.items()}
    for side, mate in (SIDES, SIDES[::-1]):
        for segment, other in (("thigh", "shank"), ("thigh", "foot"), ("foot", "shank")):
            pair = f"{segment}_{side}", f"{other}_{mate}"
            if not set(pair) <= sensors.keys():
                continue
            names = {segment: pair[0], other: pair[1]}
            changed = _out_of_place({name: measured[name] for name in pair}, *(names.get(k, k) for k in SEGMENTS))
            if changed and not swing_phases({**sensors, pair[0]: sensors[pair[1]], pair[1]: sensors[pair[0]]}).doubtful:
                return [changed]
    return [pair for pair in pairs if kind_of(pair[0]) != "foot" or not swings.crossed.intersection(pair)]


def _segments(sensors: Mapping[str, Imu]) -> list[_Pair]:
    """Pairs of sensors of a leg that have changed places, each exchanged back before the next is looked for."""
    pairs = []
    for side in SIDES:
        names = [f"{kind}_{side}" for kind in SEGMENTS]
        leg = {name: _motion(sensors[name]) for name in names if name in sensors}
        for _ in names[1:]:  # two exchanges make every order of three
            if pair := _out_of_place(leg, *names):
                placement, other = pair
                leg[placement], leg[other] = leg[other], leg[placement]
                pairs.append(pair)
    return pairs


def _out_of_place(leg: Mapping[str, _Motion], thigh: str, shank: str, foot: str) -> _Pair | None:
    """Two sensors of a leg if they contradict that thighs turn least, and that feet rest most and lie flat then.

    The foot of a stiff leg turns less than the thigh: only a thigh's sensor that rests more than the foot's is on it.
    """
    if thigh in leg:
        there = [name for name in leg if name != foot or leg[thigh].rests > leg[foot].rests + RESTS_MORE]
        slowest = min(there, key=lambda name: leg[name].rate)
        if leg[thigh].rate > SWAPPED * leg[slowest].rate:
            return thigh, slowest
    if not {foot, shank} <= leg.keys() or leg[shank].rests <= leg[foot].rests + RESTS_MORE:
        return None
    flat = leg[foot].rests > RESTS_FLAT and leg[foot].tilts < leg[shank].tilts
    return None if flat else (foot, shank)


def _motion(imu: Imu) -> _Motion:
    """How a sensor moves in walking; it rests below `RESTING`, but not if it never moves."""
    square = np.sum(_kept(imu, imu.gyr) ** 2, axis=1)
    width = max(1, round(RESTS_S / max(float(np.median(np.diff(as_float(imu.time)))), 1e-6)))
    level = np.convolve(square, np.ones(width) / width, mode="same") if len(square) >= width else np.zeros(len(square))
    walks = level > WALKS * level.max(initial=0.0)
    rests = walks & (square < RESTING**2)
    tilts = np.nan
    if imu.acc is not None and rests.any():
        ups = _kept(imu, imu.acc)[rests]
        ups = ups / np.maximum(np.linalg.norm(ups, axis=1, keepdims=True), 1e-9)
        usual = np.median(ups, axis=0)
        tilts = float(np.median(np.linalg.norm(ups - usual, axis=1)))
    return _Motion(fast_rate(imu), float(np.mean(rests[walks])) if walks.any() else 0.0, tilts)


def _intensity(imu: Imu, grid: np.ndarray, step: float) -> np.ndarray:
    """Intensity of a sensor's movement on a time grid: the specific force's difference from its median, of mean 1.

    The difference is limited to `LARGEST_FORCE`, so that all parts of walking have the same weight, and averaged over
    `INTENSITY_S`.
    """
    force = np.linalg.norm(as_float(imu.acc), axis=1)
    moved = np.minimum(np.abs(force - np.median(force)), LARGEST_FORCE)
    width = max(1, round(INTENSITY_S / step))
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
    if grid.size * step < LEAST_SECONDS:
        return [], set()
    of_legs = np.mean([np.median([_intensity(imu, grid, step) for imu in side], axis=0) for side in legs], axis=0)
    notes: list[Note] = []
    doubtful: set[str] = set()
    for name in trunk:
        delay, likeness, gain = _delay(
            _intensity(accelerometers[name], grid, step), of_legs, round(LONGEST_DELAY / step)
        )
        seconds = delay * step
        if abs(seconds) > LATE_S and likeness > LIKE and gain > LEAST_GAIN:
            words = "late" if seconds > 0.0 else "early"
            notes.append(TRUNK_CLOCK_OFF(placement=name, seconds=abs(seconds), direction=words))
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
