"""mobgap's detectors, sides and step lengths on the same walks, judged as those of jgait.

mobgap finds contacts in walking bouts that it is given: here the reference's own, a second longer at both ends, for its
filters find none at the very edges. The height of the sensor was not measured in `ipol_gait`; mobgap's convention, 0.53
of the body height, is kept. Its scale of step lengths is learned on the Mobilise-D cohorts, two of whose people may be
those of `mobgap_lab`, and left as it comes. Contacts outside the reference's bouts are
not counted as errors of mobgap.
"""

from typing import Any

import numpy as np

from experiments.common import peers
from experiments.common.row import Row, show
from experiments.kose2011 import contacts
from experiments.kose2011.contacts import Found
from experiments.kose2011.distances import WAYS, line_of
from experiments.kose2011.walks import Walk, Windows, sets
from jgait.types import as_float

SCRIPT = "mobgap_trunk"
DETECTORS = ("ionescu", "shin", "hklee")
LENGTHS = ("ms_all", "ms_ms")
SIDES = ("ullrich", "mccamley")
MARGIN = 1.0
"""[s] By how much a bout is given longer than it was."""

SHARE = 0.53
"""[1] mobgap's height of the sensor over that of the person."""

HEIGHT = 1.70
"""[m] Height of a person whose height is not known (persons 10 and 14 of `ipol_gait`)."""

AXES = {"mobgap_lab": (1.0, 1.0, 1.0), "ipol_gait": (1.0, -1.0, -1.0)}
"""Signs that take a set's axes to mobgap's: x up, y right, z forwards."""


def job(walk: Walk) -> dict[str, Any]:
    """What mobgap is given of a walk."""
    imu = walk.recording.sensors["lower_back"]
    rate, signs = walk.recording.sampling_rate_hz, np.array(AXES[walk.set])
    bouts = walk.straight.looked + np.array([-MARGIN, MARGIN])
    samples = np.clip(np.rint(bouts * rate).astype(int), 0, len(imu.time))
    height = walk.body.get("sensor_height") or SHARE * walk.body.get("height", HEIGHT)
    return {
        "acc": as_float(imu.acc) * signs, "gyr": as_float(imu.gyr) * signs, "sampling_rate_hz": rate, "bouts": samples,
        "sensor_height": height, "contacts": np.rint(walk.contacts * rate).astype(int),
    }  # fmt: skip


def found_by(answer: dict[str, np.ndarray], walk: Walk, source: str, sides: str) -> Found:
    """Contacts in order of time; where bouts were made to overlap, one that both have counts once."""
    time, first = np.unique(answer[f"{source}_contacts"], return_index=True)
    return Found(time / walk.recording.sampling_rate_hz, answer[f"{source}_sides_{sides}"][first])


def ratio(answer: dict[str, np.ndarray], walk: Walk, source: str, lengths: str, offset: float) -> float:
    """mobgap's over the true length of the straight parts: its way, even between its contacts, from end to end."""
    time = answer[f"{source}_contacts"] / walk.recording.sampling_rate_hz - offset
    step, bout = answer[f"{source}_step_lengths_{lengths}"], answer[f"{source}_bouts"]
    total = 0.0
    for number in np.unique(bout):
        rows = np.flatnonzero(bout == number)
        way = np.concatenate([[0.0], np.cumsum(step[rows][:-1])])
        middle = walk.pieces.ends.mean(axis=1)
        mine = contacts.inside(middle, walk.straight.looked[[number]])
        total += float(np.diff(np.interp(walk.pieces.ends[mine], time[rows], way), axis=1).sum())
    return total / float(walk.pieces.length.sum())


def _contact_rows(
    sets: dict[str, list[Walk]], answers: dict[str, dict[str, np.ndarray]]
) -> tuple[list[Row], dict[tuple[str, str], float]]:
    rows, lines, offsets = [], [], {}
    for name, of_set in sets.items():
        walks = [walk._replace(straight=Windows(walk.straight.looked, walk.straight.looked)) for walk in of_set]
        scores = []
        for source in DETECTORS:
            of = {sides: contacts.score(walks, [found_by(answers[walk.name], walk, source, sides) for walk in walks])
                  for sides in SIDES}  # fmt: skip
            s = of["ullrich"]
            scores.append(s)
            offsets[name, source] = s.offset / 1000.0
            lines.append(
                [*contacts.line(f"{name}: mobgap, {source}", s)[:-1], f"{s.sides:.0f}, {of['mccamley'].sides:.0f}"]
            )
            rows += contacts.rows_of(f"{name}_mobgap_{source}", s)
            rows.append(
                Row(f"ic_side_pct_{name}_mobgap_{source}_mccamley", of["mccamley"].sides, "%", n=s.n - s.missed)
            )
        split, n = "best of mobgap's detectors", scores[0].n
        best = [
            Row(f"ic_f1_{name}_mobgap", max(s.f1 for s in scores), "F1", n=n, split=split),
            Row(f"ic_mae_ms_{name}_mobgap", min(s.mae for s in scores), "ms", n=n, split=split),
            Row(f"ic_side_pct_{name}_mobgap", max(s.sides for s in scores), "%", n=n, split=split),
        ]
        line = contacts.of_set(name)
        rows += [row.on(line[row.metric.removesuffix("_mobgap")], "mobgap's best", "contacts") for row in best]
    show("mobgap's contacts on the same walks, sides by ullrich and mccamley", contacts.COLUMNS, lines)
    return rows, offsets


def _distance_rows(
    sets: dict[str, list[Walk]], answers: dict[str, dict[str, np.ndarray]], offsets: dict[tuple[str, str], float]
) -> list[Row]:
    rows, lines = [], []
    for name, walks in sets.items():
        known = [walk for walk in walks if len(walk.pieces.length)]
        if not known:
            continue
        label = "ipol_straight" if name == "ipol_gait" else name
        for lengths in LENGTHS:
            best = np.inf
            for source in (*DETECTORS, "given"):
                late = offsets.get((name, source), 0.0)
                off = np.array([100.0 * (ratio(answers[w.name], w, source, lengths, late) - 1.0) for w in known])
                size = np.abs(off)
                cell = f"{size.mean():.1f} / {np.median(size):.1f} / {size.max():.0f}  {off.mean():+.1f}"
                lines.append([f"{name}: {source}, {lengths}", cell])
                split = "as mobgap comes" + (", contacts of the reference" if source == "given" else "")
                end = f"{label}_mobgap_{source}_{lengths}"
                rows.append(Row(f"distance_mae_pct_{end}", float(size.mean()), "%", n=off.size, split=split))
                rows.append(Row(f"distance_bias_pct_{end}", float(off.mean()), "%", n=off.size, split=split))
                best = min(best, float(size.mean())) if source != "given" else best
            split = "best of mobgap's detectors"
            row = Row(f"distance_mae_pct_{label}_mobgap_{lengths}", best, "%", n=len(known), split=split)
            rows.append(row.on(line_of(WAYS[0], label), f"mobgap's best, {lengths}", "walks"))
    show("mobgap's distances, |error| [%]: mean / median / worst, and mean error", ["", "straight parts"], lines)
    return rows


def rows(quick: bool) -> list[Row]:
    """On the sets that are here."""
    if quick:
        print("left out of the quick form: ipol_gait, whose feet compile a program of their own, and mobgap")
        return []
    return compared(sets(quick))


def compared(sets: dict[str, list[Walk]]) -> list[Row]:
    """Everything of mobgap's; nothing where it is not installed."""
    if not sets:
        return []
    if not peers.available("mobgap"):
        print(f"left out: {peers.unavailable_reason('mobgap')}")
        return []
    walks = {walk.name: walk for walks in sets.values() for walk in walks}
    try:
        answers = peers.run(SCRIPT, {name: job(walk) for name, walk in walks.items()})
    except RuntimeError as error:
        print(f"mobgap left out: {' '.join(str(error).split())[:300]}")
        return []
    rows, offsets = _contact_rows(sets, answers)
    return rows + _distance_rows(sets, answers, offsets)
