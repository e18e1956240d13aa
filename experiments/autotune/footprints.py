"""Stride lengths against a ruler (`footprints`) before and after tuning, every walk judged by what others taught."""

import jax.numpy as jnp
import numpy as np

from experiments.autotune import learn
from experiments.autotune.evidence import SHARES, taken
from experiments.autotune.walks import groups, options_of
from experiments.common.recordings import available, names, walks
from experiments.common.row import Row, show
from experiments.foot_ins.feet import Matched
from experiments.foot_ins.run import ready, score, solved
from jgait import tune
from jgait.estimators import foot_ins
from jgait.estimators.foot_ins import DEFAULT, FootParams
from jgait.tune import Lesson
from jgait.types import Estimate

SET, NOISE = "footprints", "log_linear"
SPLIT = "footprints, walks left out"
LINE = "stride length of a foot, noise model tuned on other walks, `footprints`: mean error"


def length_log(estimate: Estimate, lesson: Lesson) -> jnp.ndarray:
    """½ log(1 + mean squared error of stride length [cm²]): a walk with one wrong footprint does not rule the fit."""
    return 0.5 * jnp.log1p(tune.LOSSES["stride_length"].term(estimate, lesson))


def rows(quick: bool) -> list[Row]:
    """Stride lengths by what the other walks taught, in full and as far as those left out support it."""
    if not available(SET):
        return []
    options = options_of(NOISE)
    start = foot_ins.estimator(options).params
    found = list(walks(SET, names(SET)[:2] if quick else None))
    lessons = groups(found, options)
    feet = {item.foot.name.split()[0]: item for item in ready(SET, False)}
    labels = np.array([walk.recording.name for walk in found])
    every: dict[float, list[Matched]] = {share: [] for share in (0.0, *SHARES)}
    for name in labels:
        fit = learn.fit(lessons, (labels != name).astype(float), start, options, length_log,
                        steps=2 if quick else learn.STEPS)  # fmt: skip
        for share, some in every.items():
            tuned = FootParams() if share == 0.0 else learn.part(fit, share, start, options)
            one = solved(tuned, feet[name], options if share else DEFAULT)
            if one is None:
                raise RuntimeError(f"{name} could not be estimated")
            some.append(one)
        print(name, {share: round(score(some[-1:]).mae, 2) for share, some in every.items()}, flush=True)
    losses = {share: np.array([np.log(score([one]).mae) for one in some]) for share, some in every.items()}
    choice = taken(losses, labels)
    print("taken for each walk:", choice)
    scores = {f"share {share}": score(some) for share, some in every.items()}
    last = score([every[choice[name]][row] for row, name in enumerate(labels.tolist())])
    first, full = scores["share 0.0"], scores["share 1.0"]
    lines = [[name, s.mae, s.median, s.worst, s.within] for name, s in {**scores, "as supported": last}.items()]
    show("stride length [cm], walks left out", ["", "MAE", "median", "worst", "in 2σ %"], lines)
    return [
        Row(f"footprints_stride_mae_cm{end}", one.mae, "cm", n=one.n, split=SPLIT).on(LINE, part, "strides")
        for end, part, one in (("", "as far as supported", last), ("_full", "in full", full),
                               ("_before", "hand-chosen", first))
    ] + [
        Row("footprints_stride_median_cm", last.median, "cm", n=last.n, split=SPLIT),
        Row("footprints_two_sigma_pct", last.within, "%", n=last.n, split=SPLIT),
    ]  # fmt: skip
