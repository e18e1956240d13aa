"""Feet: positions of `pyshoe_vicon` with the marker of other days, stride lengths of `footprints` beside the ruler.

Nothing else is learned. Stances between rests were judged by velocities of `pyshoe_vicon` and `footprints`, see
`jgait.events.foot`. The ruler of `footprints` has errors of its own: per stride, gaitmap's method errs there alike.
"""

from collections.abc import Sequence

import numpy as np

from experiments.autotune import marker
from experiments.autotune.walks import KINDS, SET, kind
from experiments.common.matching import overlapping
from experiments.common.recordings import available, names, walks
from experiments.common.row import Row, show
from experiments.foot_ins import feet as real
from jgait.estimators import foot_ins
from jgait.estimators.foot_ins import FootParams
from jgait.types import Estimate, Walk

GOOD_CM = 10.0
"""[cm] Largest error of a stride that is good."""


def rows(quick: bool) -> list[Row]:
    """On the sets that are here."""
    return [*positions(quick), *outdoors(quick)]


def positions(quick: bool) -> list[Row]:
    """3-D error of the path after yaw and shift, by kind of gait, with the marker that other days taught."""
    if not available(SET):
        return []
    tracked = walks(SET, names(SET)[::9] if quick else None)
    paths = _paths([(walk, foot_ins.estimate(FootParams(), walk.recording)) for walk in tracked])
    kinds = np.array([kind(walk.info["speed"]) for walk in tracked])
    days = np.array([walk.recording.name[:10] for walk in tracked])
    error = np.zeros(days.size)
    for day in sorted(set(days.tolist())):
        error[days == day] = marker.held_out(paths, days == day)
    split, rows = "pyshoe_vicon, marker of other days", []
    for name in (one for one in KINDS if (kinds == one).any()):
        some = error[kinds == name]
        line = "foot_ins, `pyshoe_vicon`, position, marker of other days: median error"
        row = Row(f"position_m_{name}", float(np.median(some)), "m", n=len(some), split=split)
        rows += [row.on(line, name, "trials"), row._replace(metric=f"position_m_{name}_worst", value=float(some.max()))]
    return [*rows, Row("position_m_worst_trusted", float(error.max()), "m", n=len(error), split=split)]


def _paths(estimated: Sequence[tuple[Walk, Estimate]]) -> marker.Paths:
    """The right foot's path beside the marker's at the times of the sensor, padded to the longest trial."""
    longest, rows = max(len(estimate.time) for _, estimate in estimated), []
    for walk, estimate in estimated:
        reference, foot = walk.reference, estimate.feet.right
        there = np.stack(
            [np.interp(estimate.time, reference.time, part) for part in reference.feet.right.position.T], 1
        )
        known = np.interp(estimate.time, reference.time, np.asarray(reference.valid, float)) == 1.0
        row = (foot.position, foot.orientation, there, known & np.asarray(estimate.valid, bool))
        rows.append([np.concatenate([part, np.repeat(part[-1:], longest - len(part), axis=0)]) for part in row])
        rows[-1][3][len(estimate.time) :] = False
    return marker.Paths(*(np.stack(parts) for parts in zip(*rows, strict=True)))


def outdoors(quick: bool) -> list[Row]:
    """Stride lengths of `footprints` with defaults, those in doubt apart; the guess is the median of other walks."""
    if not available("footprints"):
        return []
    lines, error, doubtful, guess = [], [], [], []
    walked = real.feet("footprints", 2 if quick else None)
    for foot in walked:
        estimate = foot_ins.estimate(FootParams(), foot.recording)
        strides = estimate.strides
        pairs = overlapping(foot.strides, np.stack([strides.standing, strides.standing_end], axis=1))
        error.append(100.0 * np.abs(strides.length[pairs[:, 1]] - foot.length[pairs[:, 0]]))
        doubtful.append(np.asarray(estimate.diagnostics["doubtful"])[pairs[:, 1]])
        others = np.concatenate([other.length for other in walked if other is not foot])
        guess.append(100.0 * np.abs(np.median(others) - foot.length[pairs[:, 0]]))
        sure = error[-1][~doubtful[-1]]
        lines.append([foot.name, len(error[-1]), float(sure.mean()), float(sure.max()), int(doubtful[-1].sum()),
                      float(guess[-1].mean())])  # fmt: skip
    show("footprints: stride length [cm]", ["", "n", "MAE", "worst", "in doubt", "guess MAE"], lines)
    off, doubt = np.concatenate(error), np.concatenate(doubtful)
    sure, split = off[~doubt], "footprints, defaults, not in doubt"
    good = 100.0 * float(np.mean(doubt[off < GOOD_CM]))
    line = "foot_ins, `footprints`, stride length of strides not in doubt: error"
    return [
        Row("outdoor_stride_mae_cm", float(sure.mean()), "cm", n=len(sure), split=split).on(line, "MAE", "strides"),
        Row("outdoor_stride_median_cm", float(np.median(sure)), "cm", n=len(sure), split=split),
        Row("outdoor_stride_worst_cm", float(sure.max()), "cm", n=len(sure), split=split).on(line, "worst", "strides"),
        Row("outdoor_stride_over_guess", float(sure.mean() / np.concatenate(guess)[~doubt].mean()), "ratio",
            n=len(sure), split=split),
        Row("outdoor_stride_mae_cm_all", float(off.mean()), "cm", n=len(off), split="footprints, defaults"),
        Row("outdoor_good_doubted_pct", good, "%", n=int(np.sum(off < GOOD_CM)), split="footprints, error below 10 cm"),
    ]  # fmt: skip
