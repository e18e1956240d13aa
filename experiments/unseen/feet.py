"""Feet and shanks: closure of `xio_gait`, positions of `gaitmap_example`, `tripod` with one speed left out.

Nothing is learned for the feet. The lever of `tripod`'s sensors is learned at the other speed.
"""

import numpy as np

from experiments.common.recordings import attempt, available, names, walks
from experiments.common.row import Row, show
from experiments.common.shanks import legs
from experiments.foot_ins import feet as real
from experiments.foot_ins.closures import closure
from experiments.silva2017.groups import keys
from experiments.silva2017.lever import held_out, prepared, references, run, together, total
from jgait.estimators import foot_ins


def rows(quick: bool) -> list[Row]:
    """On the sets that are here."""
    found = [*closures(), *positions()]
    return found if quick else [*found, *shanks()]


def closures() -> list[Row]:
    """How far from its start the foot of the short walk ends, in 3-D; the publisher's trajectory ends 0.082 m away."""
    if not available("xio_gait"):
        return []
    walk = next((one for one in walks("xio_gait") if one.recording.name == "short_walk"), None)
    ends = None if walk is None else attempt("xio_gait: short_walk", lambda: closure(walk))
    if ends is None:
        return []
    row = Row("xio_short_3d_m", ends[1], "m", split="nothing learned")
    return [row.on("foot_ins, `xio_gait`, short walk: from the end to the start in 3-D", of="walk")]


def positions() -> list[Row]:
    """Horizontal position of both feet of `gaitmap_example` after a turn and a shift, root mean square.

    Both feet estimated together, whose headings then do not drift apart; and each foot by itself.
    """
    if not available("gaitmap_example"):
        return []
    feet = real.feet("gaitmap_example")
    (walk,) = walks("gaitmap_example", names("gaitmap_example"))
    recordings = {"": [walk.recording] * len(feet), "_alone": [foot.recording for foot in feet]}
    rows = []
    for end, chosen in recordings.items():
        each = [
            real.matched(foot, foot_ins.estimate(foot_ins.FootParams(), recording)).rmse
            for foot, recording in zip(feet, chosen, strict=True)
        ]
        value = float(np.sqrt(np.mean(np.square(each))))
        row = Row(f"gaitmap_position_m{end}", value, "m", n=len(each), split="nothing learned")
        part = "each foot alone" if end else "both feet"
        rows.append(row.on("foot_ins, `gaitmap_example`, position: root mean square error", part, "feet"))
    return rows


def shanks() -> list[Row]:
    """Distance of each leg of `tripod` with the lever learned at the other speed."""
    if not available("tripod"):
        return []
    of = legs("tripod")
    inputs = together([prepared(leg, np.zeros(3), np.eye(3)) for leg in of])
    levers = held_out("tripod", of, keys("tripod", of), inputs)
    true, full = references(of, inputs)
    off = 100.0 * np.abs(total(run("tripod", levers, inputs)["length"], full) / total(true, full) - 1.0)
    lines = [[leg.walk, leg.side, lever, error] for leg, lever, error in zip(of, levers, off, strict=True)]
    show("ankle_stride on tripod, speed left out", ["speed", "leg", "lever [m]", "distance error [%]"], lines)
    line, split = "ankle_stride, `tripod`, distance, speed left out: error", "lever learned at the other speed"
    return [
        Row("shank_distance_mean_pct", float(off.mean()), "%", n=len(of), split=split).on(line, "mean", "legs"),
        Row("shank_distance_worst_pct", float(off.max()), "%", n=len(of), split=split).on(line, "worst", "legs"),
    ]
