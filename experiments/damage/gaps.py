"""Gaps: how far interpolated and held readings err over them, and how far the estimates of real walks move.

Signals: parts of real walks are taken out, and the integrals of what a filter would use in their place are compared
with those of what was measured. `LOST_RATE` and `LOST_FORCE` of feet, `LOST` of shanks, and `HELD`, are such errors.
Estimates: one sensor loses its samples at a random moment of a walk. A stride, or a joint angle, that then differs by
more than three of its stated standard deviations from that of the whole recording, and is not flagged, is a silent
error. The constants were chosen on these sets.
"""

import zlib
from collections import defaultdict
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from experiments.common.recordings import attempt, available, names, walks
from experiments.common.row import Row, show
from experiments.damage.harm import Rows, read, rows_of
from experiments.damage.signals import angles
from jgait.estimators import ankle_stride, foot_ins, leg_ekf
from jgait.estimators.checks import HELD
from jgait.types import Estimate, Recording, as_float

SECONDS = (0.2, 0.5, 1.0)
"""[s] Lengths of the gaps of the estimates."""

LOSSES = (0.05, 0.1, 0.2, 0.3, 0.6, 0.9)
"""[s] Lengths of the losses of the signals."""

SETS = {
    "foot": ("neura_sparse", "gaitmap_example", "pyshoe_vicon", "footprints", "xio_gait"),
    "shank": ("neura_sparse", "walking5m", "tripod"),
}
"""Segment → sets with a sensor on it."""

MODULES = {"foot_ins": (foot_ins, "foot"), "ankle_stride": (ankle_stride, "shank"), "leg_ekf": (leg_ekf, "shank")}
"""Estimator → its module, and the segment whose sensor loses samples."""

WALKS, DRAWS, MOVING = 8, 60, 1.0
"""[1] Recordings of a set and moments of a sensor that are used, at most; [rad/s] from this rate on a segment moves."""

AWAY = 2.0
"""[s] No gap is nearer to the first or last movement."""

ALLOWED = 3.0
"""[1] Stated deviations by which an estimate may move."""

LINE = "strides and angles moved by gaps by more than three stated deviations, unflagged"


class Errors(NamedTuple):
    """Integrals of the error of a rate [rad] and of a specific force [m/s] over losses, (n, 3) each."""

    rate: np.ndarray
    force: np.ndarray


def errors(signals: dict[str, np.ndarray], seconds: float, rate_hz: float, draw: np.random.Generator) -> list[Errors]:
    """Integrals of the errors over losses of a moving sensor, interpolated and held."""
    rate, force = np.deg2rad(signals["gyr"]), signals["acc"]
    n = max(round(seconds * rate_hz), 1)
    moving = np.flatnonzero(np.linalg.norm(rate[1 : -n - 1], axis=1) > MOVING) + 1
    share = (np.arange(n) + 1)[:, None] / (n + 1)
    made: list[tuple[list[np.ndarray], ...]] = [([], []), ([], [])]
    for k in draw.choice(moving, min(DRAWS, len(moving)), replace=False):
        window = slice(k - 1, k + n + 1)
        if not (np.isfinite(rate[window]).all() and np.isfinite(force[window]).all()):
            continue
        for number, values in enumerate((rate, force)):
            before, after = values[k - 1], values[k + n]
            for kind, used in enumerate((before + share * (after - before), before)):
                made[kind][number].append((values[k : k + n] - used).sum(axis=0) / rate_hz)
    return [Errors(*(np.reshape(of, (-1, 3)) for of in kind)) for kind in made]


def sizes(segment: str, quick: bool) -> dict[float, tuple[Errors, Errors]]:
    """Length of a loss [s] → errors of all sensors of a segment, interpolated and held."""
    found: dict[float, list[list[Errors]]] = defaultdict(list)
    for name, rows, placement, rate_hz in sensors(segment, quick):
        for seconds in LOSSES:
            draw = np.random.default_rng(zlib.crc32(f"{name} {placement} {seconds}".encode()))
            found[seconds].append(errors(rows.sensors[placement], seconds, rate_hz, draw))
    return {
        seconds: tuple(Errors(*map(np.concatenate, zip(*kind, strict=True))) for kind in zip(*each, strict=True))
        for seconds, each in found.items()
    }  # type: ignore[return-value]


def recordings(segment: str, quick: bool) -> Iterator[tuple[str, Recording]]:
    """Set and recording of the walks that have a sensor on a segment."""
    for name in SETS[segment][:1] if quick else SETS[segment]:
        if available(name):
            for walk in walks(name, names(name)[: 1 if quick else WALKS]):
                if any(placement.startswith(segment) for placement in walk.recording.sensors):
                    yield name, walk.recording


def sensors(segment: str, quick: bool) -> Iterator[tuple[str, Rows, str, float]]:
    """Name of the recording, its rows, placement and rate [Hz] of each sensor of a segment."""
    for name, recording in recordings(segment, quick):
        rows = rows_of(recording, tuple(p for p in recording.sensors if p.startswith(segment)))
        for placement in rows.sensors:
            yield f"{name}, {recording.name}", rows, placement, recording.sampling_rate_hz


class Moved(NamedTuple):
    """Strides or angles of a recording with a gap.

    Attributes:
        error: (n,) change in stated standard deviations.
        flagged: (n,) bool.
        missing: how many have no counterpart in the whole recording, or are left out.
    """

    error: np.ndarray
    flagged: np.ndarray
    missing: int


def of_strides(whole: Estimate, now: Estimate) -> Moved:
    """Change of the lengths of the strides that end at the same time."""
    before, after, stated = whole.strides, now.strides, now.strides_stddev
    assert before is not None
    assert after is not None
    assert stated is not None
    apart = np.abs(as_float(before.end)[:, None] - as_float(after.end)) + 1e3 * (
        np.asarray(before.side)[:, None] != np.asarray(after.side)
    )
    if not apart.size:
        return Moved(np.zeros(0), np.zeros(0, bool), len(as_float(before.end)))
    nearest = apart.argmin(axis=0)
    same = apart.min(axis=0) < 0.15
    change = np.abs(as_float(after.length) - as_float(before.length)[nearest]) / as_float(stated.length)
    flagged = np.asarray(now.diagnostics["doubtful"], bool)
    return Moved(change[same], flagged[same], len(as_float(before.end)) - int(same.sum()))


def of_angles(whole: Estimate, now: Estimate) -> Moved:
    """Change of the joint angles, sample by sample, where both are valid."""
    before, after = angles(whole), angles(now)
    change, missing = [], 0
    for name in before.keys() & after.keys():
        apart = np.abs(after[name][0] - before[name][0]) / after[name][1]
        missing += int(np.isnan(after[name][0]).sum() - np.isnan(before[name][0]).sum())
        change.append(apart[np.isfinite(apart)])
    all_of_them = np.concatenate(change)
    return Moved(all_of_them, np.zeros(all_of_them.size, bool), missing)


def moved(estimator: str, quick: bool) -> Iterator[tuple[float, Moved]]:
    """Length of the gap, and what it did, for each sensor."""
    module, segment = MODULES[estimator]
    compare = of_angles if estimator == "leg_ekf" else of_strides

    def estimate(rows: Rows, name: str) -> Estimate:
        return module.estimator().estimate(module.estimator().params, read(rows, name))

    def one(rows: Rows, placement: str, name: str) -> list[tuple[float, Moved]]:
        found: list[tuple[float, Moved]] = []
        draw = np.random.default_rng(zlib.crc32(f"{name} {placement}".encode()))
        whole = estimate(rows, name)
        moving = np.linalg.norm(np.nan_to_num(rows.sensors[placement]["gyr"]), axis=1) > np.rad2deg(MOVING)
        moments = rows.time[moving]
        moments = moments[(moments > moments[0] + AWAY) & (moments < moments[-1] - AWAY)]
        for seconds in SECONDS if moments.size else ():
            begin = float(draw.choice(moments)) - 0.5 * seconds
            gone = (rows.time >= begin) & (rows.time < begin + seconds)
            signals = {kind: np.where(gone[:, None], np.nan, v) for kind, v in rows.sensors[placement].items()}
            cut = rows._replace(sensors={**rows.sensors, placement: signals})
            found.append((seconds, compare(whole, estimate(cut, name))))
        return found

    for name, recording in recordings(segment, quick):
        used = [p for p in recording.sensors if p.startswith(("thigh", "shank") if estimator == "leg_ekf" else segment)]
        if estimator == "leg_ekf" and len(used) < 4:
            continue
        rows = rows_of(recording, tuple(used))
        for placement in (p for p in used if p.startswith(segment)):
            own = rows if estimator == "leg_ekf" else rows._replace(sensors={placement: rows.sensors[placement]})
            yield from attempt(f"{name}, {recording.name}", lambda own=own, p=placement, n=name: one(own, p, n)) or []


def rows(quick: bool) -> list[Row]:
    """Errors of signals, then what estimates make of gaps."""
    made: list[Row] = []
    lines: list[list[Any]] = []
    ratios: list[float] = []
    split = "public walks of the sets on which the constants were chosen"
    for segment in SETS:
        for seconds, (between, held) in sizes(segment, quick).items():
            rms = [float(np.sqrt(np.mean(of**2))) for kind in (between, held) for of in kind]
            ratios += [rms[2] / rms[0], rms[3] / rms[1]] if seconds >= 0.1 else []
            lines.append([segment, seconds, len(between.rate), *(value / seconds for value in rms)])
            if seconds == 0.2:
                for kind, value, unit in (("rate", rms[0], "rad/s"), ("force", rms[1], "m/s²")):
                    made.append(Row(f"lost_{kind}_{segment}", value / seconds, unit, n=len(between.rate), split=split))
    columns = ["segment", "lost [s]", "n", *(f"{kind} {signal}" for kind in ("interpolated:", "held:") for signal in
               ("rate [rad/s]", "force [m/s²]"))]  # fmt: skip
    show("errors of integrals over losses, over their lengths", columns, lines)
    made.append(Row("held_over_interpolated", float(np.median(ratios)), "1", n=len(ratios), split=f"used: {HELD}"))
    lines = []
    for estimator in MODULES:
        found: dict[float, list[Moved]] = defaultdict(list)
        for seconds, one in moved(estimator, quick):
            found[seconds].append(one)
        for seconds, each in found.items():
            far = np.concatenate([one.error for one in each]) > ALLOWED
            flagged = np.concatenate([one.flagged for one in each])
            silent = far & ~flagged
            lines.append([estimator, seconds, len(each), far.size, int(far.sum()), int(silent.sum()),
                          sum(one.missing for one in each)])  # fmt: skip
            made.append(
                Row(f"gap_{estimator}_{round(1e3 * seconds)}_ms_pct", 100.0 * float(silent.mean()), "%", n=len(each),
                    split=f"{far.size} strides or angles; {split}").on(LINE, f"{estimator}, {seconds:g} s", "sensors")
            )  # fmt: skip
    show("estimates of walks with a gap", ["estimator", "gap [s]", "sensors", "strides or angles", "> 3 deviations",
         "of them unflagged", "left out"], lines)  # fmt: skip
    return made
