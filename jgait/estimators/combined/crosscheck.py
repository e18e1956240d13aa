"""Checks of the sensors of a recording against each other: units, mounting, sides, segments, clocks; on the host.

A walking person moves in a known way: both legs swing alike, half a stride apart, and the shank turns faster than the
thigh. A sensor that contradicts the other sensors is named. No check depends on how a sensor is mounted.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from jgait.estimators.checks import fast_rate, force_unit
from jgait.estimators.stride_flags import FEWEST_STRIDES
from jgait.mounting.places import places_in
from jgait.notes import Kind, Note, record
from jgait.quality import SOUND, SensorQuality, above, opposite
from jgait.signal.butterworth import low_pass_both_ways
from jgait.signal.windows import peaks
from jgait.types import SIDES, Imu, Recording, as_float

SENSOR_UNIT = Kind(
    "sensor_unit", "check", "",
    "One sensor is in another unit than the others. Its numbers are not used; state the unit of this sensor, or "
    "convert its columns.",
)  # fmt: skip

CLOCK_OFF = Kind(
    "clock_off", "check", "",
    "Contacts and joint angles that need both this sensor and another, steps, and what differs between right and left "
    "in time are wrong by this. The sensor's own strides and lengths hold. Synchronise the sensors and compute the "
    "result again.",
)  # fmt: skip

USUAL_RATE = {"foot": 7.5, "ankle": 5.6, "shank": 5.4, "thigh": 3.2, "wrist": 3.2, "": 1.7}
"""[rad/s] 99th percentile of the norm of the rate in walking, of public recordings; "" for the trunk and the head."""

OFFSETS = {"foot": -0.10, "shank": 0.0, "ankle": 0.02, "thigh": -0.08}
"""[strides] Phase of the stride frequency in the squared rate, after that of the shank of the same leg. Medians of
`walking5m` and `neura_sparse`; feet and ankles vary by 0.03, thighs by 0.1 between people."""

SHARES = (np.arange(64) + 0.5) / 64.0
"""[strides] Moments of a stride at which movements are compared; chosen by hand."""

STRIDE_S = (0.7, 2.2)
"""[s] Shortest and longest stride of walking; chosen by hand."""


@record
class Findings(NamedTuple):
    """Contradictions between the sensors of a recording; sets are of placements."""

    notes: tuple[Note, ...]  #: a note for each contradiction.
    unusable: frozenset[str]  #: signals are in a wrong unit.
    doubtful: frozenset[str]  #: side, segment or clock contradicts the other sensors.
    sensors: dict[str, Imu]  #: the sensors; those that have changed places are the other way round.
    crossed: frozenset[str]  #: may be exchanged with others.
    replaced: frozenset[str] = frozenset()  #: have changed places within a leg, or across.
    clocks: frozenset[str] = frozenset()  #: on the legs, the clock seems off.

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


def kind_of(placement: str) -> str:
    """The segment of a placement without its side ("shank"); "" for the trunk and the head."""
    kind, _, side = placement.partition("_")
    return kind if side in SIDES else ""


def crosscheck(recording: Recording) -> Findings:
    """Contradictions between the sensors of a walking person, each on its own clock; none if there are too few sensors
    or strides. If the person does not walk, only units of accelerometers are checked.
    """
    rates = {name: fast_rate(imu) / USUAL_RATE[kind_of(name)] for name, imu in recording.sensors.items()}
    # chosen: people who stand before the walks of `walking5m` have less
    walks = any(rate > 0.25 for name, rate in rates.items() if kind_of(name) != "wrist")
    notes, unusable = _units(recording.sensors, rates if walks else dict.fromkeys(rates, 0.0))
    every = dict(recording.sensors)
    if not walks:
        return Findings(tuple(notes), frozenset(unusable), frozenset(), every, frozenset())
    sensors = {name: imu for name, imu in every.items() if name not in unusable}
    places = places_in(sensors)
    if places is not None:
        every |= {placement: sensors[label] for placement, label in places.worn.items()}
    sensors = {name: every[name] for name in sensors}
    replaced, crossed, exchanges = frozenset[str](), frozenset[str](), list[Note]()
    late, clocks = _swing_phases(sensors)
    if places is not None and not clocks & places.unsure_of:  # a clock that is off explains the doubt
        replaced, crossed, exchanges = frozenset(places.moved), places.doubtful, places.notes()
        late, clocks = ([], frozenset()) if crossed else (late, clocks)
    off, of_trunk = _trunk(sensors)
    return Findings(
        (*notes, *exchanges, *late, *off), frozenset(unusable), clocks | crossed | of_trunk, every, crossed, replaced,
        clocks,
    )  # fmt: skip


def _units(sensors: Mapping[str, Imu], rates: Mapping[str, float]) -> tuple[list[Note], set[str]]:
    """Notes about sensors in other units than the other sensors, and their placements; `rates` are ratios to
    `USUAL_RATE`, and a sensor with 0 is not judged by its gyroscope.
    """
    notes: list[Note] = []
    wrong: set[str] = set()
    known = np.sort(np.log([rate for rate in rates.values() if rate > 0.0]))
    # if half of the sensors contradict the other half, those nearer to the usual rate are right
    middle_two = known[(known.size - 1) // 2 : known.size // 2 + 1]
    pace = float(np.exp(min(middle_two, key=abs, default=0.0)))
    for name, imu in sensors.items():
        ratio = rates[name] / pace
        if rates[name] > 0.0 and abs(np.log(ratio)) > 0.5 * np.log(180.0 / np.pi):  # half way to another unit
            wrong.add(name)
            text = (
                "the gyroscope of {placement} seems to be in {unit}: it turns at {rate:.3g} rad/s where the other "
                "sensors let expect about {expected:.2g}; the sensor is left out"
            )
            unit = "deg/s" if ratio > 1.0 else "rad/s, and was converted as if in deg/s"
            expected = pace * USUAL_RATE[kind_of(name)]
            notes.append(SENSOR_UNIT.note(text, placement=name, unit=unit, rate=fast_rate(imu), expected=expected))
        force, unit = force_unit(imu)
        if unit:
            wrong.add(name)
            text = (
                "the accelerometer of {placement} seems to be in {unit}: it reads {force:.3g} m/s² in the median, "
                "where gravity alone is 9.81; the sensor is left out"
            )
            notes.append(SENSOR_UNIT.note(text, placement=name, unit=unit, force=force))
    return notes, wrong


type _Late = tuple[list[Note], frozenset[str]]
"""Notes on sensors that move at another time than the others, and placements whose clock seems off."""


def _late_clock(placement: str, seconds: float, direction: str) -> Note:
    text = "the clock of {placement} seems to be about {seconds:.1f} s {direction}: it moves when the others rest"
    return CLOCK_OFF.note(text, placement=placement, seconds=seconds, direction=direction)


def _wrapped(strides: float) -> float:
    """A phase between −0.5 and 0.5 strides."""
    return (strides + 0.5) % 1.0 - 0.5


def _swings(imu: Imu) -> np.ndarray:
    """Times [s] of the largest rate in each stride of a sensor on a shank, at an ankle or on a foot."""
    time = as_float(imu.time)
    rate_hz = 1.0 / float(np.median(np.diff(time)))
    speed = np.linalg.norm(as_float(imu.gyr), axis=1)
    if len(speed) < 5.0 * rate_hz:
        return np.zeros(0)
    slow = low_pass_both_ways(speed, 4.0, rate_hz)
    least = 0.6 * float(np.percentile(slow, 98.0))
    return np.asarray(time[peaks(slow, height=least, distance=max(1, round(STRIDE_S[0] * rate_hz)))])


def _strides_of(imu: Imu, begins: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """(n, 64) squared rate at `SHARES` of each stride about its mean, of strides with at most a tenth of losses."""
    time, power = as_float(imu.time), np.sum(as_float(imu.gyr) ** 2, axis=1)
    at = begins[:, None] + (ends - begins)[:, None] * SHARES
    at = at[np.interp(at, time, ~np.asarray(imu.mask, bool)).mean(axis=1) <= 0.1]
    values = np.interp(at, time, power)
    return np.asarray(values - values.mean(axis=1, keepdims=True))


def _phase(values: np.ndarray) -> tuple[float, float, float]:
    """Phase of the stride frequency in a sensor's squared rate over strides (n, 64) [strides]; its coherence, and its
    share of the signal.
    """
    if len(values) < FEWEST_STRIDES:
        return 0.0, 0.0, 0.0
    waves = (values * np.exp(-2j * np.pi * SHARES)).sum(axis=1) / np.maximum(np.abs(values).sum(axis=1), 1e-12)
    share = float(abs(waves.mean()))
    return -float(np.angle(waves.mean())) / (2.0 * np.pi), share / max(float(np.abs(waves).mean()), 1e-12), share


def _thighs_shifted(strides: list[np.ndarray]) -> float:
    """Delay of the right thigh in its stride relative to the left thigh in its own [strides]; 0 unless both move alike
    after that shift, and only then.
    """
    if min(map(len, strides)) < FEWEST_STRIDES:
        return 0.0
    right, left = (wave.mean(axis=0) / max(float(np.linalg.norm(wave.mean(axis=0))), 1e-12) for wave in strides)
    left = np.roll(left, len(SHARES) // 2)
    alike = [float(np.roll(right, -shift) @ left) for shift in range(len(SHARES))]
    shift = _wrapped(float(SHARES[int(np.argmax(alike))] - SHARES[0]))
    # chosen: people who limp or run do not reach it
    return shift if max(alike) > 0.85 and alike[0] < 0.5 and abs(shift) > 0.3 else 0.0


def _swing_phases(sensors: Mapping[str, Imu]) -> _Late:
    """The leg sensors that swing at another phase of the stride than the other sensors."""
    legs = [f"{kind}_{side}" for kind in ("shank", "foot", "ankle", "thigh") for side in SIDES]
    legs = [name for name in legs if name in sensors]
    if len(legs) < 2 or kind_of(legs[0]) == "thigh":
        return [], frozenset()
    swings = _swings(sensors[legs[0]])
    lasts = np.diff(swings)
    whole = (lasts > STRIDE_S[0]) & (lasts < STRIDE_S[1])
    stride = float(np.median(lasts[whole])) if whole.any() else np.inf
    whole &= np.abs(lasts / stride - 1.0) < 0.3
    if whole.sum() < FEWEST_STRIDES:
        return [], frozenset()
    # strides that end in standing: their last swing only moves the foot beside the other, so that thighs move otherwise
    if np.mean(np.append(lasts[1:] > 1.5 * lasts[:-1], True)[whole]) > 0.5:
        legs = [name for name in legs if kind_of(name) != "thigh"]
    moves = {name: _strides_of(sensors[name], swings[:-1][whole], swings[1:][whole]) for name in legs}
    every, phases = dict[str, float](), dict[str, float]()
    for name, values in moves.items():
        phase, coherence, share = _phase(values)
        every[name] = (phase - OFFSETS[kind_of(name)] - 0.5 * SIDES.index(name.rpartition("_")[2])) % 1.0
        # others do not take part; the phase of a thigh may be of the backward swing
        if coherence > 0.6 and share > (0.3 if kind_of(name) == "thigh" else 0.08):
            phases[name] = every[name]
    right, left = (f"thigh_{side}" for side in SIDES)
    if {right, left} <= moves.keys() and (later := _thighs_shifted([moves[right], moves[left]])):
        off, other = sorted((right, left), key=lambda name: abs(_wrapped(every[name])), reverse=True)
        phases[off] = (phases.get(other, 0.0) + (later if off == right else -later)) % 1.0
    return _contradicting(phases, stride)


def _contradicting(phases: dict[str, float], stride: float) -> _Late:
    """The phases that contradict the others, in words."""
    names = list(phases)

    def away(common: float) -> list[str]:
        # [strides] half way from a correct to an exchanged sensor
        return [name for name in names if abs(_wrapped(phases[name] - common)) > 0.25]

    common = min(
        phases.values(),
        key=lambda value: (len(away(value)), sum(abs(_wrapped(p - value)) for p in phases.values())),
        default=0.0,
    )
    near = set(names).difference(away(common))
    common += float(np.median([_wrapped(phases[name] - common) for name in near])) if near else 0.0
    wrong = away(common)
    if len(names) == 2 and wrong:
        apart = abs(_wrapped(phases[names[0]] - phases[names[1]] + 0.5)) * stride
        text = (
            "{placement} and {other} swing {seconds:.2f} s apart, where half a stride is {half:.2f} s: one of the two "
            "clocks seems to be off, or both are on one leg"
        )
        note = CLOCK_OFF.note(text, placement=names[0], other=names[1], seconds=apart, half=0.5 * stride)
        return [note], frozenset(names)
    for kind in OFFSETS:  # in running both feet swing earlier beside the shanks than in walking
        pair = {f"{kind}_{side}" for side in SIDES}
        if pair.issubset(wrong) and all(abs(_wrapped(phases[name] - common)) < 0.36 for name in pair):
            wrong = [name for name in wrong if name not in pair]
    notes = []
    for name in wrong:
        strides = _wrapped(phases[name] - common)
        direction = "late" if strides > 0.0 else "early"  # strides repeat
        notes.append(_late_clock(name, abs(strides) * stride, "late or early" if abs(strides) > 0.4 else direction))
    return notes, frozenset(wrong)


def _intensity(imu: Imu, grid: np.ndarray, step: float) -> np.ndarray:
    """Intensity of a sensor's movement on a time grid: the specific force's difference from its median, limited so that
    all parts of walking have the same weight, averaged over about a stride, of mean 1.
    """
    force = np.linalg.norm(as_float(imu.acc), axis=1)
    moved = np.minimum(np.abs(force - np.median(force)), 3.0)  # [m/s²]
    window = np.hanning(max(1, round(1.0 / step)) + 2)[1:-1]  # [s] about a stride, so that steps vanish
    level = np.convolve(np.interp(grid, as_float(imu.time), moved), window / window.sum(), mode="same")
    return np.asarray(level / max(float(level.mean()), 1e-9))


def _trunk(sensors: Mapping[str, Imu]) -> _Late:
    """The trunk sensors that move and rest at other times than the legs."""
    measured = {name: imu for name, imu in sensors.items() if imu.acc is not None}
    legs = [[n for n in measured if kind_of(n) in OFFSETS and n.endswith(side)] for side in SIDES]
    trunk = [name for name in measured if kind_of(name) == "" and name != "head"]
    if not all(legs) or not trunk:
        return [], frozenset()
    step, every = 0.02, [measured[name] for name in (*legs[0], *legs[1], *trunk)]
    grid = np.arange(max(float(i.time[0]) for i in every), min(float(i.time[-1]) for i in every), step)
    if grid.size * step < 6.0:  # [s]
        return [], frozenset()
    of_legs = np.mean(
        [np.median([_intensity(measured[name], grid, step) for name in side], axis=0) for side in legs], axis=0
    )
    delays = {
        name: _delay(_intensity(measured[name], grid, step), of_legs, round(1.5 / step)) for name in trunk  # [s]
    }  # fmt: skip
    off = {
        name: delay * step for name, (delay, likeness, gain) in delays.items()
        if abs(delay * step) > 0.3 and likeness > 0.9 and gain > 0.03  # [s] of 43 public walks two have more
    }  # fmt: skip
    return [_late_clock(n, abs(s), "late" if s > 0.0 else "early") for n, s in off.items()], frozenset(off)


def _delay(level: np.ndarray, other: np.ndarray, most: int) -> tuple[int, float, float]:
    """The delay [samples] at which two signals correlate most, the correlation, and its gain over that without delay.
    Samples without a counterpart count with the first or last value.
    """
    if np.ptp(level) == 0.0 or np.ptp(other) == 0.0:
        return 0, 0.0, 0.0
    padded = np.pad(level, most, mode="edge")
    alike = [float(np.corrcoef(padded[most + d : most + d + len(level)], other)[0, 1]) for d in range(-most, most + 1)]
    best = int(np.argmax(alike))
    return best - most, alike[best], alike[best] - alike[most]
