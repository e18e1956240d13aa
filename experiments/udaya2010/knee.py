"""The knee's angle of `leg_ekf` on `neura_sparse`, both shin gyroscopes off part of the time.

`FURTHEST` of the filler was chosen in view of this walk; nothing else was.
"""

from typing import Any, NamedTuple

import numpy as np

from experiments.common.recordings import available, walks
from experiments.common.row import Row, show
from experiments.common.sets import datasets
from experiments.udaya2010.behind import _rms_deg
from experiments.udaya2010.fillers import fillers
from experiments.udaya2010.walked import Walked, neura
from jgait.duty_cycle.recording import fill_recording
from jgait.estimators import leg_ekf
from jgait.types import SIDES, Estimate, as_float, leg_of


class _Knee(NamedTuple):
    """Root mean square of the knee's angle [°]: to motion capture and to the estimate always on; right, left."""

    truth: np.ndarray
    always: np.ndarray


def _knees(one: Walked, found: Estimate, always: Estimate) -> _Knee:
    def relative(estimate: Estimate, side: str) -> np.ndarray:
        time, knee = as_float(one.truth.time), as_float(leg_of(estimate.legs, side).knee_angle)
        told = np.interp(time, as_float(estimate.time), knee)
        return (told - told[slice(*one.standing)].mean())[one.begin[side] : one.end]

    pairs = [[relative(found, side) - relative(other, side) for side in SIDES] for other in (one.truth, always)]
    return _Knee(*(np.array([_rms_deg(off) for off in pair]) for pair in pairs))


def rows(quick: bool) -> list[Row]:
    """`leg_ekf`'s knee angle on `neura_sparse` with both shin gyroscopes off part of the time."""
    if not available("neura_sparse"):
        return []
    one = neura()[0]
    walk = walks("neura_sparse")[0]
    p = leg_ekf.with_body(leg_ekf.LegParams(), datasets.body(walk))
    always = leg_ekf.estimate(p, one.recording)
    late = one._replace(begin=dict.fromkeys(SIDES, walk.info["windows"]["straight_2"][0]))
    starts = {"": (one, "from two strides on, U-turn included"), "_straight": (late, "from the U-turn's end on")}
    if quick:
        del starts["_straight"]
    rows: list[Row] = []
    lines: list[list[Any]] = []
    phases = (0.0,) if quick else (0.0, 0.5)
    cases = [(duty, "blend") for duty in ((50,) if quick else (50, 20))]
    for end, (part, words) in starts.items():
        before = _knees(part, always, always)
        lines.append([f"always on, {words}", *map(float, np.concatenate(before))])
        split = f"neura_sparse, {words}, FURTHEST chosen on it; mean of legs and of places where the schedule begins"
        usual = float(before.truth.mean())
        rows.append(Row(f"joint_knee_deg_always_on{end}", usual, "°", None, 2, f"neura_sparse, {words}, untuned"))
        for duty, filler in cases:
            found = []
            for phase in phases:
                asleep = fill_recording(one.recording, gyro_on=part.on(duty, phase), filler=fillers()[filler])
                found.append(_knees(part, leg_ekf.estimate(p, asleep), always))
            mean = _Knee(*(np.mean(values, axis=0) for values in zip(*found, strict=True)))
            lines.append([f"  duty {duty} %, {filler}", *map(float, np.concatenate(mean))])
            lost, what = mean.truth - before.truth, f"{split}; {filler} with the thigh, causal"
            name = f"{end}{'' if filler == 'blend' else '_' + filler}_duty{duty}"
            count = len(phases)
            row = Row(f"joint_knee_deg_lost{name}", float(lost.mean()), "°", None, count, what)
            rows.append(
                row.on(
                    f"knee of `leg_ekf`, `neura_sparse`, {words}: added error", f"gyroscope on for {duty} %", "starts"
                )
            )
            rows += [
                Row(f"joint_knee_deg_lost{name}_{side}", float(value), "°", None, count, what)
                for side, value in zip(SIDES, lost, strict=True)
            ]
            apart = float(mean.always.mean())
            rows.append(Row(f"joint_knee_deg_to_always_on{name}", apart, "°", None, count, what))
    columns = ["", *(f"to {other}, {side} [°]" for other in ("motion capture", "always on") for side in SIDES)]
    show("leg_ekf's knee on neura_sparse, both shin gyroscopes off part of the time", columns, lines)
    return rows
