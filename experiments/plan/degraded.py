"""Errors of set-ups that a recording predicts by its own estimate at full quality, beside those of its reference.

Public recordings with measured stride lengths are degraded to other rates and ranges, and to one side. The prediction
knows no reference: change against the estimate at full quality, and the deviation that this estimate states. A case is
a set-up on all walks of a set.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.stats import spearmanr

from experiments.common.recordings import available, names, walks
from experiments.common.row import Row, show
from jgait.evaluate import study
from jgait.geometry.vectors import GRAVITY

SETS = {
    "footprints": (("foot_right",),), "pyshoe_vicon": (("foot_right",),),
    "gaitmap_example": (("foot_right", "foot_left"), ("foot_right",), ("foot_left",)), "mobgap_lab": (("lower_back",),),
}  # fmt: skip
"""Set with measured stride lengths → sets of sensors."""

EVERY = {"pyshoe_vicon": 8, "footprints": 2, "mobgap_lab": 2}
"""Set → one walk of so many is taken."""

RATES = {"lower_back": (100.0, 50.0, 25.0)}
RANGES = (math.inf, 8.0 * GRAVITY, 4.0 * GRAVITY)
WITHIN = 1.5


class Case(NamedTuple):
    """A set-up on a set."""

    group: str  #: set and sensors.
    setup: str  #: rate and range.
    predicted: float  #: root mean square error of a stride [m].
    real: float  #: the same, against the reference [m].
    strides: int


def cases(quick: bool) -> list[Case]:
    """All cases of the sets that are here."""
    made = []
    for name, places in SETS.items():
        if not available(name):
            continue
        listed = names(name)[:: EVERY.get(name, 1)]
        known = list(walks(name, listed[:2] if quick else listed))
        for placements in places[:1] if quick else places:
            rates = RATES.get(placements[0], (200.0, 100.0, 50.0))
            choices = study.setups(placements=[placements], rate_hz=rates, acc_range=RANGES)
            mine = [walk._replace(info={}) for walk in known]
            full = [study.own_truth(walk.recording, choices[0]) for walk in known]
            real, predicted = (study.plan(of, choices[:2] if quick else choices) for of in (mine, full))
            for setup, true, ours in zip(choices, real.to_dict("records"), predicted.to_dict("records"), strict=False):
                if true["walks"] and ours["walks"]:
                    words = f"{setup.rate_hz:g} Hz, ±{setup.acc_range / GRAVITY:g} g"
                    where = f"{name}, {'+'.join(placements)}"
                    made.append(Case(where, words, ours["stride_rmse"], true["stride_rmse"], true["strides"]))
    return made


def rows(quick: bool) -> list[Row]:
    """The share of cases within the factor, and the ranking."""
    every = cases(quick)
    if not every:
        return []
    show(
        "predicted and real error of a stride [cm]", ["set", "set-up", "predicted", "real", "ratio", "strides"],
        [[c.group, c.setup, 100.0 * c.predicted, 100.0 * c.real, c.predicted / c.real, c.strides] for c in every],
    )  # fmt: skip
    ratio = np.array([c.predicted / c.real for c in every])
    within = (ratio < WITHIN) & (ratio > 1.0 / WITHIN)
    rank = float(spearmanr([c.predicted for c in every], [c.real for c in every]).statistic)
    line = "Planned set-ups: predicted error of a stride over the real one"
    return [
        Row("predicted_within_pct", 100.0 * float(np.mean(within)), "%", n=len(every)).on(line, "within 1.5", "cases"),
        Row("predicted_over_real_median", float(np.median(ratio)), "1", n=len(every)).on(line, "", "cases"),
        Row("ranking_spearman", rank, "1", n=len(every)).on(line, "ranking", "cases"),
    ]
