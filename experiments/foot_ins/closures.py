"""`xio_gait`: how far from its start the foot is at the end of a walk that returns to it."""

from functools import partial

import numpy as np

from experiments.common.recordings import attempt, available, walks
from experiments.common.row import Row, show
from experiments.common.sets import datasets
from jgait.estimators import foot_ins
from jgait.estimators.foot_ins import FootParams


def rows(quick: bool) -> list[Row]:
    """`xio_gait`: how far from its start the foot is found at the end."""
    if quick or not available("xio_gait"):
        return []
    rows, lines = [], []
    for walk in walks("xio_gait"):
        name = walk.recording.name
        if not walk.info["closes"]:
            print(f"xio_gait: {name} left out: it is not known to end where it began")
            continue
        found = attempt(f"xio_gait: {name}", partial(closure, walk))
        if found is None:
            continue
        flat, whole, way = found
        lines.append([name, way, flat, whole, walk.info["publisher_closure"]])
        split = f"xio_gait {name}, {way:.0f} m, untuned"
        rows += [
            Row(f"foot_closure_m_{name}", flat, "m", split=split),
            Row(f"foot_closure_3d_m_{name}", whole, "m", split=split),
        ]
    show("xio_gait: from the end to the start", ["", "way m", "horizontal m", "in 3-D m", "publisher's 3-D m"], lines)
    return rows


def closure(walk: datasets.Walk) -> tuple[float, float, float]:
    """Horizontal and whole distance between both ends, and the way between them [m]."""
    estimate = foot_ins.estimate(FootParams(), walk.recording)
    (foot,) = (one for one in estimate.feet if one is not None)
    where = foot.position[np.asarray(estimate.valid)]
    gap = where[-1] - where[0]
    return float(np.linalg.norm(gap[:2])), float(np.linalg.norm(gap)), float(estimate.distance[-1])
