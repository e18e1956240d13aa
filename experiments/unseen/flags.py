"""Doubt: of all strides and trials, how many are off by more than three stated deviations without a flag, or flagged
though they are good.

Strides are those of the feet on four sets and of ankles and shanks on three. Where the reference has an error of its
own, as a three-cornered hat gives it, it is added to the stated deviation. A trial of `pyshoe_vicon` is off if its
position errs by more than 0.5 m, or by more than three times what the deviations of its strides, and the largest within
one, add up to. The limits (`jgait.estimators.trust`) were chosen on these sets; every other recording stands apart, to
see how much they depend on the choice.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from experiments.common.matching import nearest, overlapping
from experiments.common.recordings import attempt, available, names, walks
from experiments.common.row import Row, show
from experiments.common.shanks import Leg, legs
from experiments.foot_ins import feet as real
from experiments.foot_ins.feet import Foot
from experiments.silva2017.lever import AT_ANKLE, REFERENCE_SD
from jgait.estimators import ankle_stride, foot_ins
from jgait.estimators.trust import trust
from jgait.evaluate import yaw_aligned
from jgait.types import Estimate, Recording, Strides, Walk, as_float

ALLOWED, FAR = 3.0, 0.5
"""[1] Stated deviations by which a good stride may be off; [m] error of a position from which on a trial is off."""

BANDS = (0.5, 1.0, 2.0, 3.0)
"""[1] Stated deviations of the reliability table."""

NORMAL = (38.3, 68.3, 95.4, 99.7)
"""[%] Share of a normal distribution within `BANDS`."""


class Judged(NamedTuple):
    """Strides of one sensor: their errors in stated deviations, and whether they are flagged, both (n,)."""

    group: str
    recording: str
    error: np.ndarray
    flagged: np.ndarray


class Trial(NamedTuple):
    """A trial of `pyshoe_vicon`: its largest error [m], the deviation that its strides state [m], and its trust."""

    name: str
    error: float
    stated: float
    trusted: bool

    @property
    def off(self) -> bool:
        """Whether the trial is wrong by more than it says."""
        return self.error > FAR or self.error > ALLOWED * self.stated


def compared(group: str, name: str, estimate: Estimate, pairs: np.ndarray, true: np.ndarray, sd: float) -> Judged:
    """Strides `pairs[:, 1]` of an estimate beside lengths (n,) [m] of a reference with a deviation of its own [m]."""
    strides, stated = estimate.strides, estimate.strides_stddev
    assert isinstance(strides, Strides)
    assert isinstance(stated, Strides)
    rows = pairs[:, 1]
    error = np.abs(as_float(strides.length)[rows] - true) / np.hypot(as_float(stated.length)[rows], sd)
    return Judged(group, name, error, np.asarray(estimate.diagnostics["doubtful"], bool)[rows])


def of_foot(foot: Foot) -> Judged:
    """The strides of a foot."""
    estimate = foot_ins.estimate(foot_ins.FootParams(), foot.recording)
    strides = estimate.strides
    assert strides is not None
    pairs = overlapping(foot.strides, np.stack([strides.standing, strides.standing_end], axis=1))
    return compared(f"foot_ins, {foot.set}", foot.name, estimate, pairs, foot.length[pairs[:, 0]], 0.0)


def of_leg(leg: Leg) -> Judged:
    """The strides of a shank or ankle."""
    placement = f"{'ankle' if leg.group in AT_ANKLE else 'shank'}_{leg.side}"
    recording = Recording({placement: leg.imu}, leg.rate_hz, leg.walk, leg.subject)
    estimate = ankle_stride.estimate(ankle_stride.AnkleParams(), recording)
    assert estimate.strides is not None
    pairs = np.array(nearest(as_float(estimate.strides.end), leg.reference.contact, 0.3), int).reshape(-1, 2)[:, ::-1]
    true = leg.reference.length[pairs[:, 0]]
    if leg.reference.positions is not None:
        ends = estimate.diagnostics[f"instants_{leg.side}"][pairs[:, 1]]
        true = np.linalg.norm(leg.reference.positions[ends[:, 1]] - leg.reference.positions[ends[:, 0]], axis=1)
    known = np.isfinite(true)
    group = leg.group.split("_")[0]
    sd = REFERENCE_SD.get(group, 0.0)
    return compared(f"ankle_stride, {group}", f"{leg.walk} {leg.side}", estimate, pairs[known], true[known], sd)


def of_trial(walk: Walk) -> Trial:
    """The position of a trial, after a turn about the vertical and a shift."""
    estimate, reference = foot_ins.estimate(foot_ins.FootParams(), walk.recording), walk.reference
    assert reference is not None
    good = np.asarray(reference.valid, bool) & np.asarray(estimate.valid, bool)
    assert estimate.feet is not None
    assert reference.feet is not None
    ours, theirs = (np.asarray(feet.right.position)[good] for feet in (estimate.feet, reference.feet))
    apart = np.linalg.norm(yaw_aligned(ours, theirs) - theirs, axis=1)
    stated = estimate.strides_stddev
    assert stated is not None
    assert estimate.feet_stddev is not None
    within = np.asarray(estimate.feet_stddev.right.position)[good].max()
    total = float(np.sqrt(np.sum(as_float(stated.length) ** 2) + within**2))
    return Trial(walk.recording.name, float(apart.max()), total, trust(estimate).recording)


def judged(quick: bool) -> Iterator[Judged]:
    """All strides of the sets that are here."""
    for name in real.SETS[1:2] if quick else real.SETS:
        for foot in real.feet(name) if available(name) else []:
            yield from filter(None, [attempt(f"{name}: {foot.name}", lambda foot=foot: of_foot(foot))])
    for name in () if quick else ("tripod", "neura_sparse", "walking5m"):
        for leg in legs(name) if available(name) else []:
            yield from filter(None, [attempt(f"{name}: {leg.walk}", lambda leg=leg: of_leg(leg))])


def rows(quick: bool) -> list[Row]:
    """Missed and false flags of strides and of trials, and a reliability table."""
    found = [one for one in judged(quick) if one.error.size]
    trials = [
        attempt(walk.recording.name, lambda walk=walk: of_trial(walk))
        for walk in (walks("pyshoe_vicon", names("pyshoe_vicon")) if not quick and available("pyshoe_vicon") else [])
    ]
    return [*of_strides(found), *of_trials([one for one in trials if one is not None])]


def shares(found: list[Judged]) -> tuple[float, float, int]:
    """Missed among all and falsely flagged among the good strides [%], and the number of strides."""
    error, flagged = (np.concatenate([getattr(one, field) for one in found]) for field in ("error", "flagged"))
    off = error > ALLOWED
    missed, false = off & ~flagged, flagged[~off]
    return 100.0 * float(missed.mean()), 100.0 * float(false.mean()) if false.size else 0.0, error.size


def of_strides(found: list[Judged]) -> list[Row]:
    """Rows of the strides."""
    if not found:
        return []
    recordings = sorted({one.recording for one in found})
    halves = [[one for one in found if recordings.index(one.recording) % 2 == part] for part in (0, 1)]
    groups = sorted({one.group for one in found})
    sets = {group: [one for one in found if one.group == group] for group in groups}
    lines = []
    parts = zip(("every other recording", "the others"), halves, strict=True)
    for name, some in [*sets.items(), *(part for part in parts if part[1]), ("all", found)]:
        missed, false, n = shares(some)
        error = np.concatenate([one.error for one in some])
        inside = [f"{100.0 * float(np.mean(error <= band)):.1f}" for band in BANDS]
        lines.append([name, n, missed, false, *inside])
    columns = ["", "strides", "missed [%]", "false [%]", *(f"within {band:g} sd [%]" for band in BANDS)]
    show(
        "Flags of strides, and reliability of the stated deviations", columns, [*lines, ["normal", "", "", "", *NORMAL]]
    )
    missed, false, n = shares(found)
    line = "doubt, strides of feet and shanks, all sets"
    return [
        Row("flags_missed_pct", missed, "%", n=n, split="limits chosen on these sets").on(
            f"{line}: off by more than three stated deviations and not flagged", "", "strides"
        ),
        Row("flags_false_pct", false, "%", n=n, split="limits chosen on these sets").on(
            f"{line}: flagged though good", "", "strides"
        ),
        *(
            Row(f"flags_{name}_pct_{part}", shares(some)[k], "%", n=shares(some)[2], split="half of the recordings")
            for part, some in zip(("even", "odd"), halves, strict=True)
            if some
            for k, name in enumerate(("missed", "false"))
        ),
        *(covered(name, some) for name, some in sets.items()),
    ]


def covered(group: str, some: list[Judged]) -> Row:
    """The share of a set's strides within two stated deviations."""
    error = np.concatenate([one.error for one in some])
    value = 100.0 * float(np.mean(error <= 2.0))
    row = Row(f"within_two_sigma_pct_{group.replace(', ', '_')}", value, "%", n=error.size, split="defaults")
    return row.on("stride length, within two stated standard deviations", group, "strides")


def of_trials(trials: list[Trial]) -> list[Row]:
    """Rows of the trials of `pyshoe_vicon`."""
    if not trials:
        return []
    lines = [
        [one.name, one.error, one.stated, "off" if one.off else "", "" if one.trusted else "doubt"]
        for one in trials if one.off or not one.trusted
    ]  # fmt: skip
    show("Trials of pyshoe_vicon that are off or in doubt", ["", "largest error [m]", "stated [m]", "", ""], lines)
    missed = sum(one.off and one.trusted for one in trials)
    false = sum(not one.off and not one.trusted for one in trials)
    line, n = "doubt, positions, `pyshoe_vicon`", len(trials)
    return [
        Row("trials_missed", float(missed), "trials", n=n, split="limits chosen on these trials").on(
            f"{line}: beyond 0.5 m or three stated deviations without a flag", "", "trials"
        ),
        Row("trials_false", float(false), "trials", n=n, split="limits chosen on these trials").on(
            f"{line}: flagged though good", "", "trials"
        ),
    ]
