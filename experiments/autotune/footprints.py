"""Stride lengths against a ruler (`footprints`) before and after tuning, every walk judged by what others taught."""

import jax
import jax.numpy as jnp
import numpy as np

from experiments.autotune import learn
from experiments.autotune.walks import groups
from experiments.common.recordings import available, names, walks
from experiments.common.row import Row, show
from experiments.foot_ins.run import ready, score, solved
from jgait import tune
from jgait.estimators.foot_ins import FootParams
from jgait.tune import Lesson
from jgait.types import Estimate

SET = "footprints"
SPLIT = "footprints, walks left out"
LINE = "stride length of a foot, noise tuned on other walks, `footprints`: mean error"


def length_log(estimate: Estimate, lesson: Lesson) -> jnp.ndarray:
    """½ log(1 + mean squared error of stride length [cm²]): a walk with one wrong footprint does not rule the fit."""
    return 0.5 * jnp.log1p(tune.LOSSES["stride_length"].term(estimate, lesson))


LENGTH: learn.Terms = ((length_log, 1.0),)
"""Without the likelihood, whose gradient of the running walk is a thousand times that of all others."""


def rows(quick: bool) -> list[Row]:
    """Stride lengths of every walk with parameters that the other walks taught."""
    if not available(SET):
        return []
    found = list(walks(SET, names(SET)[:2] if quick else None))
    lessons = groups(found)
    feet = {item.foot.name.split()[0]: item for item in ready(SET, False)}
    lines, before, after = [], [], []
    for row, name in enumerate(walk.recording.name for walk in found):
        others = (np.arange(len(found)) != row).astype(float)
        fit = learn.fit(lessons, others, LENGTH, 2 if quick else learn.STEPS)
        tuned = jax.tree.map(float, fit.params)
        pair = solved(FootParams(), feet[name]), solved(tuned, feet[name])
        if pair[0] is None or pair[1] is None:
            continue
        before.append(pair[0])
        after.append(pair[1])
        lines.append([name, *(v for one in pair for v in (score([one]).mae, score([one]).worst, score([one]).within))])
        print(lines[-1], {name: float(f"{getattr(tuned, name):.3g}") for name in learn.FREE}, flush=True)
    show("stride length [cm], walks left out", ["", "before", "worst", "in 2σ %", "after", "worst", "in 2σ %"], lines)
    first, last = score(before), score(after)
    return [
        Row("footprints_stride_mae_cm", last.mae, "cm", n=last.n, split=SPLIT).on(LINE, "tuned", "strides"),
        Row("footprints_stride_mae_cm_before", first.mae, "cm", n=first.n, split=SPLIT).on(
            LINE, "hand-chosen", "strides"
        ),
        Row("footprints_stride_median_cm", last.median, "cm", n=last.n, split=SPLIT).on(
            LINE, "tuned, median", "strides"
        ),
        Row("footprints_two_sigma_pct", last.within, "%", n=last.n, split=SPLIT),
    ]
