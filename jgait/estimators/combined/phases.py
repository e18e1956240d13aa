"""The phase of a stride at which each leg sensor swings, and sensors that contradict the others; on the host."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from jgait.estimators.stride_flags import FEWEST_STRIDES
from jgait.notes import Kind, Note
from jgait.signal.butterworth import low_pass_both_ways
from jgait.signal.windows import peaks
from jgait.types import SIDES, Imu, as_float

CLOCK_OFF = Kind(
    "clock_off", "check", "",
    "Contacts and joint angles that need both this sensor and another, steps, and what differs between right and left "
    "in time are wrong by this. The sensor's own strides and lengths hold. Synchronise the sensors and compute the "
    "result again.",
)  # fmt: skip

OFFSETS = {"foot": -0.10, "shank": 0.0, "ankle": 0.02, "thigh": -0.08}
"""[strides] Phase of the stride frequency in the squared rate, after that of the shank of the same leg. Medians of
`walking5m` and `neura_sparse`; feet and ankles vary by 0.03, thighs by 0.1 between people."""

SHARES = (np.arange(64) + 0.5) / 64.0
"""[strides] Moments of a stride at which movements are compared."""

STRIDE_S = (0.7, 2.2)
"""[s] Shortest and longest stride."""


class _Phase(NamedTuple):
    """Phase of a sensor's movement in the stride [strides], without its segment's offset; coherence and share."""

    phase: float
    coherence: float
    share: float


def kind_of(placement: str) -> str:
    """The segment of a placement without its side ("shank"); "" for the trunk and the head."""
    kind, _, side = placement.partition("_")
    return kind if side in SIDES else ""


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


def _phase(imu: Imu, begins: np.ndarray, ends: np.ndarray, offset: float) -> _Phase:
    """The phase of the stride frequency in a sensor's squared rate, over strides of another sensor [s]."""
    values = _strides_of(imu, begins, ends)
    if len(values) < FEWEST_STRIDES:
        return _Phase(0.0, 0.0, 0.0)
    size = np.maximum(np.abs(values).sum(axis=1), 1e-12)
    waves = (values * np.exp(-2j * np.pi * SHARES)).sum(axis=1) / size
    mean = waves.mean()
    phase = -float(np.angle(mean)) / (2.0 * np.pi) - offset
    return _Phase(phase % 1.0, float(abs(mean) / max(np.abs(waves).mean(), 1e-12)), float(abs(mean)))


def _strides_of(imu: Imu, begins: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """(n, 64) squared rate at `SHARES` of each stride about its mean, of strides with at most a tenth of losses."""
    time, power = as_float(imu.time), np.sum(as_float(imu.gyr) ** 2, axis=1)
    at = begins[:, None] + (ends - begins)[:, None] * SHARES
    at = at[np.interp(at, time, ~np.asarray(imu.mask, bool)).mean(axis=1) <= 0.1]
    values = np.interp(at, time, power)
    return np.asarray(values - values.mean(axis=1, keepdims=True))


def _thighs_shifted(sensors: Mapping[str, Imu], begins: np.ndarray, ends: np.ndarray) -> float:
    """Delay of the right thigh in its stride relative to the left thigh in its own [strides]; 0 unless both move alike
    after that shift, and only then.
    """
    strides = [_strides_of(sensors[f"thigh_{side}"], begins, ends) for side in SIDES]
    if min(map(len, strides)) < FEWEST_STRIDES:
        return 0.0
    right, left = (wave.mean(axis=0) / max(float(np.linalg.norm(wave.mean(axis=0))), 1e-12) for wave in strides)
    left = np.roll(left, len(SHARES) // 2)
    alike = [float(np.roll(right, -shift) @ left) for shift in range(len(SHARES))]
    shift = _wrapped(float(SHARES[int(np.argmax(alike))] - SHARES[0]))
    # chosen: people who limp or run do not reach it
    return shift if max(alike) > 0.85 and alike[0] < 0.5 and abs(shift) > 0.3 else 0.0


def _wrapped(strides: float) -> float:
    """A phase between −0.5 and 0.5 strides."""
    return (strides + 0.5) % 1.0 - 0.5


type Late = tuple[list[Note], frozenset[str]]
"""Notes on leg sensors that swing at another time than the other sensors, and placements whose clock seems off."""

NONE_LATE: Late = [], frozenset()


def swing_phases(sensors: Mapping[str, Imu]) -> Late:
    """The leg sensors that swing at another time than the other sensors."""
    legs = [f"{kind}_{side}" for kind in ("shank", "foot", "ankle", "thigh") for side in SIDES]
    legs = [name for name in legs if name in sensors]
    if len(legs) < 2 or kind_of(legs[0]) == "thigh":
        return NONE_LATE
    swings = _swings(sensors[legs[0]])
    lasts = np.diff(swings)
    whole = (lasts > STRIDE_S[0]) & (lasts < STRIDE_S[1])
    if not whole.any():
        return NONE_LATE
    stride = float(np.median(lasts[whole]))
    whole &= np.abs(lasts / stride - 1.0) < 0.3
    if whole.sum() < FEWEST_STRIDES:
        return NONE_LATE
    begins, ends = swings[:-1][whole], swings[1:][whole]
    # a stride that ends in standing: its last swing only moves the foot beside the other, so that thighs move otherwise
    closing = np.mean(np.append(lasts[1:] > 1.5 * lasts[:-1], True)[whole]) > 0.5
    phases: dict[str, float] = {}
    all_phases: dict[str, float] = {}
    unsure: set[str] = set()
    for name in legs:
        side = 0.5 * SIDES.index(name.rpartition("_")[2])
        phase = _phase(sensors[name], begins, ends, OFFSETS[kind_of(name)] + side)
        all_phases[name] = phase.phase
        if phase.coherence > 0.6 and phase.share > 0.08:  # others do not take part
            phases[name] = phase.phase
            # the phase may be of the backward swing
            if phase.coherence < 0.8 or (kind_of(name) == "thigh" and (closing or phase.share < 0.3)):
                unsure.add(name)
    thighs = [f"thigh_{side}" for side in SIDES]
    later = _thighs_shifted(sensors, begins, ends) if set(thighs) <= set(all_phases) else 0.0
    if later:
        off = max(thighs, key=lambda name: abs(_wrapped(all_phases[name])))
        other = thighs[1 - thighs.index(off)]
        phases[off] = (phases.get(other, 0.0) + (later if off == thighs[0] else -later)) % 1.0
        unsure.discard(off)
    return _named(phases, stride, unsure)


def late_clock(placement: str, seconds: float, direction: str) -> Note:
    """A note on a sensor that moves late or early beside the others."""
    text = "the clock of {placement} seems to be about {seconds:.1f} s {direction}: it moves when the others rest"
    return CLOCK_OFF.note(text, placement=placement, seconds=seconds, direction=direction)


def _named(phases: dict[str, float], stride: float, unsure: set[str]) -> Late:
    """The phases that contradict the others, in words; `unsure` ones give no note on a clock."""
    if len(phases) < 2:
        return NONE_LATE
    names = list(phases)

    def away(common: float) -> list[str]:
        # [strides] half way from a correct to an exchanged sensor
        return [name for name in names if abs(_wrapped(phases[name] - common)) > 0.25]

    sure = [name for name in names if name not in unsure] or names
    common = min(
        (phases[name] for name in sure),
        key=lambda value: (len(away(value)), sum(abs(_wrapped(p - value)) for p in phases.values())),
    )
    near = [phases[name] for name in sure if name not in away(common)]
    common += float(np.median([_wrapped(value - common) for value in near]))
    wrong = away(common)
    if not wrong:
        return NONE_LATE
    if len(names) == 2:
        if unsure:
            return NONE_LATE
        apart = abs(_wrapped(phases[names[0]] - phases[names[1]] + 0.5)) * stride
        text = (
            "{placement} and {other} swing {seconds:.2f} s apart, where half a stride is {half:.2f} s: one of the two "
            "clocks seems to be off, or both are on one leg"
        )
        note = CLOCK_OFF.note(text, placement=names[0], other=names[1], seconds=apart, half=0.5 * stride)
        return [note], frozenset(names)
    notes: list[Note] = []
    clocks = set[str]()
    # in running both feet swing earlier beside the shanks than in walking
    for kind in OFFSETS:
        pair = {f"{kind}_{side}" for side in SIDES}
        if pair.issubset(wrong) and all(abs(_wrapped(phases[name] - common)) < 0.36 for name in pair):
            wrong = [name for name in wrong if name not in pair]
    for name in sorted(set(wrong) - unsure, key=names.index):
        strides = _wrapped(phases[name] - common)
        direction = "late" if strides > 0.0 else "early"
        if abs(strides) > 0.4:  # [strides] strides repeat
            direction = "late or early"
        notes.append(late_clock(name, abs(strides) * stride, direction))
        clocks.add(name)
    return notes, frozenset(clocks)
