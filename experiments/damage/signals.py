"""Damaged signals: of each damage and estimator the error, whether a note names the sensor, and what σ says of it."""

import zlib
from collections.abc import Iterator
from typing import Any, NamedTuple

import jax
import numpy as np

from experiments.common import protocols, recordings
from experiments.common.row import Row, show
from experiments.damage.harm import DAMAGES, MISUSE, Damage, Rows, read, rows_of
from jgait import simulate
from jgait.estimators import ankle_stride, duty_cycled_gyro, foot_ins, leg_ekf, stride_width_ekf, waist
from jgait.estimators.combined import analyse
from jgait.simulate.sensors import IDG300, MPU6000, OPAL
from jgait.types import SIDES, Estimate, RangeReadings, Recording, RecordingError, as_float

MODULES = {
    "leg_ekf": leg_ekf, "duty_cycled_gyro": duty_cycled_gyro, "ankle_stride": ankle_stride, "foot_ins": foot_ins,
    "waist": waist, "stride_width_ekf": stride_width_ekf,
}  # fmt: skip
SIMULATED = (
    ("simulated, straight", 8, simulate.straight(15.0), OPAL, 100.0),
    ("simulated, forth and back", 41, simulate.u_turn(8.0), MPU6000, 100.0),
    ("simulated, straight, 50 Hz", 43, simulate.straight(12.0), IDG300, 50.0),
)
"""Simulated walks of usual sensors: name, seed, route, sensors and sampling rate [Hz]."""

HARMED = {"leg_ekf": ("shank_right", "thigh_left"), "duty_cycled_gyro": ("shank_right",),
          "ankle_stride": ("shank_right",), "foot_ins": ("foot_right",), "waist": ("pelvis",),
          "stride_width_ekf": ("foot_left",), "combined": ("shank_right", "foot_right", "pelvis")}  # fmt: skip
"""Estimator → the sensors that are damaged, one at a time."""

LINE, OF = "estimates of damaged walks, wrong by more than 5 % or 5°", "estimates"
LARGE_PCT, LARGE_DEG, LARGE_M = 5.0, 5.0, 0.01
"""Smallest wrong change of a distance [%], of an angle [deg], and of a stride width [m]."""


class Change(NamedTuple):
    """How a damage changes an estimate; NaN where the estimator does not give a number.

    Attributes:
        length_pct: change of the distance or of the sum of the stride lengths [%], whichever is larger.
        angle_deg: largest rms change of a joint angle [deg], where both estimates are valid.
        width_m: change of the mean stride width [m].
        beyond_pct: share of angles that moved by more than three standard deviations [%].
        stated_pct: stated deviation of that length [%].
    """

    length_pct: float
    angle_deg: float
    width_m: float
    beyond_pct: float
    stated_pct: float

    @property
    def wrong(self) -> bool:
        """Whether a user would take a wrong number for a right one."""
        return self.length_pct > LARGE_PCT or self.angle_deg > LARGE_DEG or self.width_m > LARGE_M

    @property
    def within(self) -> bool:
        """Whether only a length is wrong, and by less than three of its stated deviations."""
        return self.length_pct <= 3.0 * self.stated_pct and not (self.angle_deg > LARGE_DEG or self.width_m > LARGE_M)


class Case(NamedTuple):
    """A damaged walk: how the estimate changed (None: refused), and whether a note names the sensor."""

    walk: str
    damage: str
    estimator: str
    placement: str
    change: Change | None
    noted: bool

    @property
    def silent(self) -> bool:
        """Wrong without a note that names the sensor."""
        return self.change is not None and self.change.wrong and not self.noted


def walks(quick: bool) -> Iterator[tuple[str, Recording, tuple[str, ...]]]:
    """Name, recording and estimators of each walk."""
    key = jax.random.key(3)
    with_range = protocols.potter(
        key, 1, errors=MPU6000, rate=100.0, placements=simulate.SEVEN, straight=8.0, after=5.0
    )[0]
    yield "simulated, with a corner", with_range.recording, (*MODULES, "combined")
    if quick:
        return
    without = (*(name for name in MODULES if name != "stride_width_ekf"), "combined")
    for name, key, way, errors, rate in SIMULATED:
        yield name, simulate.cohort(jax.random.key(key), 1, way, errors, rate, recorded=False)[0][0], without
    if recordings.available("neura_sparse"):
        yield "neura_sparse", next(iter(recordings.walks("neura_sparse"))).recording, without
    if recordings.available("walking5m"):
        for name in ("Young/20180621_10", "Elderly/20180605_2"):
            walk = next(iter(recordings.walks("walking5m", [name])))
            yield (
                f"walking5m, {name}",
                walk.recording,
                tuple(name for name in without if name not in ("waist", "combined")),
            )
    if recordings.available("gaitmap_example"):
        walk = next(iter(recordings.walks("gaitmap_example", ["imu_sample"])))
        feet = (walk.reference.feet.right.position, walk.reference.feet.left.position)
        time = as_float(next(iter(walk.recording.sensors.values())).time)
        place = [np.stack([np.interp(time, walk.reference.time, p[:, i]) for i in (0, 1)], axis=1) for p in feet]
        distance = np.linalg.norm(place[0] - place[1], axis=1)
        read_at = (distance < 0.25) & (np.arange(time.size) % 7 == 0)
        apart = RangeReadings(time, np.where(read_at, distance, 0.0), read_at)
        yield "gaitmap_example", walk.recording._replace(feet_range=apart), ("foot_ins", "stride_width_ekf")


def estimate(name: str, recording: Recording) -> Estimate:
    """The estimate with default parameters; "combined": from all sensors together, of a person of usual height."""
    if name == "combined":
        return analyse(recording, {"height": 1.75}).estimate
    module = MODULES[name]
    return module.estimator().estimate(module.estimator().params, recording)


def total(result: Estimate) -> list[tuple[float, float]]:
    """Distance, and sum of the stride lengths, as far as given, each with its standard deviation [m]."""
    valid = np.asarray(result.valid, bool)
    found = []
    if result.distance is not None and valid.any():
        spread = as_float(result.diagnostics.get("distance_stddev", np.nan)).ravel()
        found.append((float(as_float(result.distance)[valid][-1]), float(spread[-1])))
    if result.strides is not None:
        spread = np.nan if result.strides_stddev is None else as_float(result.strides_stddev.length)
        columns = (as_float(result.strides.length), np.broadcast_to(spread, np.shape(result.strides.side)))
        for side in range(2):
            own = np.asarray(result.strides.side) == side
            found.append(tuple(float(np.nansum(column[own])) for column in columns))
    return found


def angles(result: Estimate) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Name of a joint angle → angle and standard deviation (T,) [deg]; NaN where it is not valid."""
    valid = np.asarray(result.valid, bool)
    found = {}
    for side in SIDES:
        leg = getattr(result.legs, side, None)
        if leg is None:
            continue
        for joint in ("hip_angle", "knee_angle"):
            spread = np.full(valid.size, np.inf)
            if result.stddev is not None:
                spread = np.rad2deg(as_float(getattr(getattr(result.stddev, side), joint)))
            found[f"{side} {joint}"] = (np.where(valid, np.rad2deg(as_float(getattr(leg, joint))), np.nan), spread)
    return found


def changed(clean: Estimate, now: Estimate, when: np.ndarray) -> Change:
    """How the estimate of a damaged walk, at true times (T,) [s], differs from that of the undamaged one."""
    pairs = list(zip(total(clean), total(now), strict=False))
    shares = [(100.0 * abs(b / a - 1.0), 100.0 * sd / abs(b) if b else 0.0) for (a, _), (b, sd) in pairs if a]
    length, stated = max(shares, default=(np.nan, np.nan))
    if any(not np.isfinite(b) for _, (b, _) in pairs):
        length = np.inf
    before, after = angles(clean), angles(now)
    rms, beyond, count = [], 0, 0
    for name in before.keys() & after.keys():
        own = np.stack([np.interp(when, clean.time - clean.time[0], column) for column in before[name]])
        apart = np.abs(after[name][0] - own[0])
        known = np.isfinite(apart)
        if known.any():
            rms.append(float(np.sqrt(np.mean(apart[known] ** 2))))
            beyond += int(np.sum(apart[known] > 3.0 * after[name][1][known]))
            count += int(known.sum())
    return Change(
        length, max(rms, default=np.nan), abs(_width(now) - _width(clean)),
        100.0 * beyond / count if count else np.nan, stated,
    )  # fmt: skip


def _width(result: Estimate) -> float:
    if result.strides is None or "width_valid" not in result.diagnostics:
        return float("nan")
    width = as_float(result.strides.width)[np.asarray(result.diagnostics["width_valid"], bool)]
    return float(np.nanmean(width)) if np.isfinite(width).any() else float("nan")


def warnings_of(result: Estimate) -> dict[str, set[str]]:
    """Code → texts of the notes that say that something is wrong, or was corrected."""
    found: dict[str, set[str]] = {}
    for note in result.diagnostics["notes"]:
        if note.severity != "info":
            found.setdefault(note.code, set()).add(note.text)
    return found


def noted(clean: Estimate, now: Estimate, placement: str, everywhere: bool) -> bool:
    """Whether a note that the undamaged walk does not have names the sensor.

    Where all sensors are damaged, any note of another kind than those of the undamaged walk does.
    """
    before, after = warnings_of(clean), warnings_of(now)
    if everywhere:
        return bool(after.keys() - before.keys())
    more = {text for code, texts in after.items() for text in texts - before.get(code, set())}
    return any(placement in text for text in more)


def case(walk: str, label: str, damage: Damage, name: str, placement: str, rows: Rows, clean: Estimate) -> Case:
    """Damage a walk, estimate, and compare."""
    draw = np.random.default_rng(zlib.crc32(f"{walk} {label} {placement}".encode()))
    damaged = damage.change(rows, placement, draw)
    try:
        result = estimate(name, read(damaged, walk))
    except RecordingError:
        return Case(walk, label, name, placement, None, True)
    change = changed(clean, result, damaged.true_time(as_float(result.time)))
    return Case(walk, label, name, placement, change, noted(clean, result, placement, damage.everywhere))


def cases(quick: bool) -> list[Case]:
    """Every damage of every walk, by every estimator that can use it."""
    found = []
    for walk, recording, estimators in walks(quick):
        rows = rows_of(recording, tuple(recording.sensors))
        for name in estimators:
            clean = estimate(name, read(rows, walk))
            for placement in HARMED[name][:1] if quick else HARMED[name]:
                found += [
                    case(walk, label, damage, name, placement, rows, clean)
                    for label, damage in MISUSE.items()
                    if name == "combined" or not damage.together
                ]
    return found


def cell(case: Case) -> str:
    """A case in a few characters: size of the change, then who noticed."""
    if case.change is None:
        return "refused"
    parts = [
        (case.change.length_pct, "%"), (case.change.angle_deg, "°"), (100.0 * case.change.width_m, "cm"),
    ]  # fmt: skip
    size = " ".join(f"{value:.3g}{unit}" for value, unit in parts if np.isfinite(value))
    return f"{size}{' noted' if case.noted else ' SILENT' if case.change.wrong else ''}"


def rows(quick: bool) -> list[Row]:
    """Damage walks, and count what is wrong without a word."""
    found = cases(quick)
    for walk in dict.fromkeys(one.walk for one in found):
        lines: list[list[Any]] = []
        columns = list(dict.fromkeys((one.estimator, one.placement) for one in found if one.walk == walk))
        for label in MISUSE:
            by = {(one.estimator, one.placement): one for one in found if one.walk == walk and one.damage == label}
            lines.append([label, *(cell(by[column]) if column in by else "" for column in columns)])
        show(walk, ["damage", *(f"{name}, {placement}" for name, placement in columns)], lines)
    misused, found = found, [one for one in found if one.damage in DAMAGES]
    wrong = sum(one.change is not None and one.change.wrong for one in found)
    silent = sum(one.silent for one in found)
    one_of_many = [c for c in found if c.estimator == "combined" and not DAMAGES[c.damage].everywhere]
    pulled = sum(c.change is not None and c.change.length_pct > LARGE_PCT for c in one_of_many)
    beyond = sum(
        one.change is not None and not one.noted and one.change.beyond_pct > LARGE_PCT and one.change.angle_deg > 1.0
        for one in found
    )
    split = f"{len(DAMAGES)} damages, {len({one.walk for one in found})} walks; against the undamaged walk"
    every = f"{len(MISUSE)} kinds, {len({one.walk for one in misused})} walks; against the walk as it was"
    return [
        Row(
            "misuse_silent_pct",
            100.0 * sum(one.silent and not one.change.within for one in misused) / len(misused),
            "%",
            n=len(misused),
            split=f"{every}; beyond three stated deviations",
        ),
        Row("silent_wrong_pct", 100.0 * silent / len(found), "%", n=len(found), split=split).on(LINE, "unnoticed", OF),
        Row(
            "combined_pulled_pct",
            100.0 * pulled / len(one_of_many),
            "%",
            n=len(one_of_many),
            split=f"{split}; damages of one sensor, length or distance from all sensors together",
        ),
        Row("wrong_pct", 100.0 * wrong / len(found), "%", n=len(found), split=split).on(LINE, "noticed or not", OF),
        Row("silent_beyond_pct", 100.0 * beyond / len(found), "%", n=len(found), split=f"{split}; beyond three σ"),
    ]
