"""Strides of every estimator beside a reference: their errors in stated standard deviations, and their flags.

Strides are those of the feet on four sets, of ankles and shanks on three, and of the waist on three. The reference of
the waist is motion capture or, on `ipol_gait`, the feet; all its strides count, those of turns and stops too. Where the
reference has an error of its own, as a three-cornered hat or its own deviation gives it, it is added to the stated
deviation.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from experiments.common.matching import nearest, overlapping
from experiments.common.recordings import attempt, available, names, walks
from experiments.common.shanks import Leg, legs
from experiments.foot_ins import feet as real
from experiments.foot_ins.feet import Foot
from experiments.kose2011.walks import body
from experiments.silva2017.lever import AT_ANKLE, REFERENCE_SD
from jgait.estimators import ankle_stride, foot_ins, waist
from jgait.quality import trust
from jgait.types import SIDES, Estimate, Recording, Strides, Walk, as_float

TRUNKS = ("lower_back", "pelvis")
"""Placements of a waist's sensor in the sets."""


class Judged(NamedTuple):
    """Strides of one sensor (n,): their errors in stated deviations, whether they are flagged, and lengths [m].

    `noise` is the standard deviation of the reference in one stride, where a three-cornered hat gives it [m];
    `reference` that of each stride; `rows` are its strides in the estimate; `person` is who walked.
    """

    group: str
    recording: str
    error: np.ndarray
    flagged: np.ndarray
    length: np.ndarray
    true: np.ndarray
    noise: float = 0.0
    estimate: Estimate | None = None
    rows: np.ndarray | None = None
    reference: np.ndarray | None = None
    person: str = ""


def compared(
    group: str, name: str, who: str, estimate: Estimate, pairs: np.ndarray, true: np.ndarray, sd: np.ndarray | float
) -> Judged:
    """Strides `pairs[:, 1]` of an estimate beside lengths (n,) [m] of a reference with a deviation of its own [m].

    Where an estimator does not judge its strides, none is flagged.
    """
    strides, stated = estimate.strides, estimate.strides_stddev
    assert isinstance(strides, Strides)
    assert isinstance(stated, Strides)
    rows = pairs[:, 1]
    length = as_float(strides.length)[rows]
    error = np.abs(length - true) / np.hypot(as_float(stated.length)[rows], sd)
    flagged = np.asarray(estimate.diagnostics.get("doubtful", np.zeros(strides.side.size, bool)), bool)
    reference = np.broadcast_to(sd, true.shape)
    noise = 0.0 if np.ndim(sd) else float(sd)
    return Judged(group, name, error, flagged[rows], length, true, noise, estimate, rows, reference, who)


def of_foot(foot: Foot) -> Judged:
    """The strides of a foot."""
    estimate = foot_ins.estimate(foot_ins.FootParams(), foot.recording)
    strides = estimate.strides
    assert strides is not None
    pairs = overlapping(foot.strides, np.stack([strides.standing, strides.standing_end], axis=1))
    return compared(
        f"foot_ins, {foot.set}",
        foot.name,
        foot.recording.subject or foot.name,
        estimate,
        pairs,
        foot.length[pairs[:, 0]],
        0.0,
    )


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
    return compared(
        f"ankle_stride, {group}", f"{leg.walk} {leg.side}", leg.subject, estimate, pairs[known], true[known], sd
    )


def of_waist(name: str, walk: Walk) -> Judged:
    """The strides of a lower back or pelvis, beside those of motion capture or of the feet that are not in doubt."""
    sensors = walk.recording.sensors
    alone = {place: sensors[place] for place in TRUNKS if place in sensors}
    p = waist.with_body(waist.WaistParams(), body(walk.info))
    estimate = waist.estimate(p, walk.recording._replace(sensors=alone))
    strides = estimate.strides
    reference, sd = None if walk.reference is None else walk.reference.strides, 0.0
    if reference is None or not np.isfinite(as_float(reference.length)).any():  # contacts alone
        feet = {place: imu for place, imu in sensors.items() if place.startswith("foot")}
        measured = foot_ins.estimate(foot_ins.FootParams(), walk.recording._replace(sensors=feet))
        assert measured.strides is not None
        assert measured.strides_stddev is not None
        good = np.asarray(measured.strides.valid, bool) & trust(measured).strides
        reference, sd = measured.strides._replace(valid=good), as_float(measured.strides_stddev.length)
    assert strides is not None
    known = np.flatnonzero(np.asarray(reference.valid, bool) & np.isfinite(as_float(reference.length)))
    ours = np.flatnonzero(np.asarray(strides.valid, bool))
    found = []
    for side in range(len(SIDES)):
        rows, of = (some[np.asarray(table.side)[some] == side] for some, table in ((known, reference), (ours, strides)))
        times = [np.stack([as_float(table.start), as_float(table.end)], axis=1)[some]
                 for table, some in ((reference, rows), (strides, of))]  # fmt: skip
        pairs = overlapping(*times)
        found.append(np.stack([rows[pairs[:, 0]], of[pairs[:, 1]]], axis=1))
    pairs = np.concatenate(found)
    true = as_float(reference.length)[pairs[:, 0]]
    own = np.broadcast_to(sd, reference.length.shape)[pairs[:, 0]]
    return compared(
        f"waist, {name}", walk.recording.name, walk.recording.subject or walk.recording.name, estimate, pairs, true, own
    )


def judged(quick: bool) -> Iterator[Judged]:
    """All strides of the sets that are here."""
    for name in real.SETS[1:2] if quick else real.SETS:
        for foot in real.feet(name) if available(name) else []:
            yield from filter(None, [attempt(f"{name}: {foot.name}", lambda foot=foot: of_foot(foot))])
    for name in () if quick else ("tripod", "neura_sparse", "walking5m"):
        for leg in legs(name) if available(name) else []:
            yield from filter(None, [attempt(f"{name}: {leg.walk}", lambda leg=leg: of_leg(leg))])
    for name in () if quick else ("ipol_gait", "mobgap_lab", "neura_sparse"):
        for walk in walks(name, names(name)) if available(name) else []:
            if walk.reference is not None:
                one = attempt(f"{name}: {walk.recording.name}", lambda walk=walk, name=name: of_waist(name, walk))
                yield from filter(None, [one])
