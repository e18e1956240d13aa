"""Joint angles under Vicon before and after tuning: learned on the walk out (S1), judged on the walk back (S2)."""

import jax
import numpy as np
import optax

from experiments.bennett2013.neura_sparse import person
from experiments.common.recordings import available, walks
from experiments.common.row import Row, show
from experiments.common.sets import datasets
from experiments.common.windows import Judged, judge, named_windows
from jgait import params, tune
from jgait.estimators import leg_ekf
from jgait.types import SIDES

SET = "neura_sparse"
SPLIT = "tuned on S1, judged on S2"
VARIANTS = {
    "soft tissue of the thigh": ("thigh_gain", "thigh_pull"),
    "its gain alone": ("thigh_gain",),
    "noise": ("angle_noise", "gyro_noise", "inclination"),
}
"""What is free; the first is reported in rows."""


def angles(judged: Judged) -> np.ndarray:
    """RMSE of hip and knee, right, then left [°]."""
    return np.array([judged.rmse[side][column] for side in SIDES for column in ("hip_deg", "knee_deg")])


def rows(quick: bool) -> list[Row]:
    """Angles of the walk back with the default parameters and with those that the walk out taught."""
    if not available(SET):
        return []
    walk = walks(SET)[0]
    estimator, start = leg_ekf.estimator(), person(walk)
    learned, unseen = (
        tune.lessons(estimator, [walk], body=datasets.body, windows=named_windows(part)).lesson(0)
        for part in ("straight_1", "straight_2")
    )
    loss = tune.objective(estimator, leg_ekf.DEFAULT, "joint_angles")

    def judged(p: leg_ekf.LegParams) -> np.ndarray:
        inputs = jax.tree.map(jax.numpy.asarray, unseen.inputs)
        return angles(judge(leg_ekf.run(p, inputs, leg_ekf.DEFAULT), unseen.reference, unseen.look, unseen.standing))

    before, ratios = judged(start), []
    lines = [["default", *before, None, None]]
    for name, free in VARIANTS.items() if not quick else [*VARIANTS.items()][:1]:
        fit = tune.fit(
            loss, start, params.freed(leg_ekf.estimator().transforms, *free), learned, optax.adam(0.03),
            steps=2 if quick else 60, batched=False,
        )  # fmt: skip
        after = judged(fit.params)
        ratios.append(after / before)
        lines.append([f"tuned: {name}", *after, ratios[-1].mean(), ratios[-1].max()])
    columns = ["", *(f"{joint} {side}" for side in SIDES for joint in ("hip °", "knee °")), "mean ratio", "worst ratio"]
    show("neura_sparse: tuned on the walk out, judged on the walk back", columns, lines)
    line = "hip and knee, thigh's soft tissue tuned on the walk out, judged on the walk back: error over the default's"
    return [
        Row("leg_heldout_worst_ratio", float(ratios[0].max()), "ratio", n=before.size, split=SPLIT).on(
            line, "worst of four", "joints"
        ),
        Row("leg_heldout_mean_ratio", float(ratios[0].mean()), "ratio", n=before.size, split=SPLIT).on(
            line, "mean of four", "joints"
        ),
    ]
