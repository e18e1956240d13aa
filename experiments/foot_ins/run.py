"""The foot estimator as the experiments run it: prepared once, then with any parameters and parts, and scored."""

from collections.abc import Sequence
from functools import cache, partial
from typing import Any, NamedTuple

import jax
import numpy as np

from experiments.common.recordings import attempt, available
from experiments.common.row import Row
from experiments.foot_ins import feet as real
from experiments.foot_ins.feet import Foot, Matched
from jgait.estimators import foot_ins
from jgait.estimators.foot_ins import DEFAULT, FootOptions, FootParams
from jgait.estimators.interface import pad
from jgait.types import Estimate

QUICK = 4096
"""[samples] All that the quick form looks at, so that it compiles one program."""


class Ready(NamedTuple):
    """One foot with the inputs of the estimator."""

    foot: Foot
    inputs: Any


class Score(NamedTuple):
    """How estimates of several recordings compare with their references.

    Attributes:
        mae: mean absolute error of stride length [cm].
        bias: mean error [cm].
        median: median absolute error [cm].
        worst: largest absolute error [cm].
        within: share of the strides within two stated standard deviations [%].
        rmse: of the position after turning and shifting, over the recordings [m].
        lost: strides of the reference that were not found.
        n: strides.
    """

    mae: float
    bias: float
    median: float
    worst: float
    within: float
    rmse: float
    lost: int
    n: int


def score(found: Sequence[Matched]) -> Score:
    """Strides of all recordings as one; positions of recordings alike."""
    error = 100.0 * np.concatenate([one.error for one in found])
    stddev = 100.0 * np.concatenate([one.stddev for one in found])
    size = np.abs(error)
    rmse = float(np.sqrt(np.mean([one.rmse**2 for one in found])))
    lost = sum(one.lost for one in found)
    if not error.size:
        return Score(*(float("nan"),) * 5, rmse, lost, 0)
    within = 100.0 * float(np.mean(size <= 2.0 * stddev))
    return Score(
        float(size.mean()), float(error.mean()), float(np.median(size)), float(size.max()), within, rmse, lost,
        error.size,
    )  # fmt: skip


def ready(name: str, quick: bool, options: FootOptions = DEFAULT) -> list[Ready]:
    """The feet of a data set, prepared; one that cannot be is named and left out."""
    if not available(name):
        return []
    found = []
    for foot in real.feet(name, 2 if quick else None):
        one = real.cut(foot, QUICK) if quick else foot
        inputs = attempt(f"{name}: {foot.name}", partial(_inputs, one, options))
        if inputs is not None and len(one.strides):
            found.append(Ready(one, inputs))
    return found


@cache
def sets(quick: bool) -> dict[str, list[Ready]]:
    """Set → its feet, of the sets that are here; prepared once for all parts of the experiment."""
    names = real.SETS[2:3] if quick else real.SETS
    return {name: items for name in names if (items := ready(name, quick))}


def _inputs(foot: Foot, options: FootOptions) -> Any:
    return foot_ins.prepared(foot.recording, options).inputs


@partial(jax.jit, static_argnames="options")
def run_one(p: FootParams, inputs: Any, options: FootOptions) -> Estimate:
    """`foot_ins.run`, compiled; the call that is timed too."""
    return foot_ins.run(p, inputs, options)


def bucket(samples: int) -> int:
    """The length that recordings are padded to, so that few programs are compiled."""
    return QUICK * 2 ** max(0, int(np.ceil(np.log2(samples / QUICK))))


def estimated(p: FootParams, inputs: Any, options: FootOptions = DEFAULT) -> Estimate:
    """As `foot_ins.estimate`, from prepared inputs: parameters and stances change without compiling again."""
    samples = inputs.time.size
    result = jax.tree.map(np.asarray, run_one(p, pad(inputs, bucket(samples)), options))
    rows = np.flatnonzero(result.strides.valid)
    rows = rows[np.argsort(result.strides.end[rows], kind="stable")]
    feet = jax.tree.map(lambda leaf: leaf[:samples], result.feet)
    tables = [jax.tree.map(lambda column: column[rows], table) for table in (result.strides, result.strides_stddev)]
    return result._replace(time=result.time[:samples], feet=feet, strides=tables[0], strides_stddev=tables[1])


def solved(p: FootParams, item: Ready, options: FootOptions = DEFAULT) -> Matched | None:
    """One foot estimated and compared; None if it could not be, after saying why."""
    return attempt(
        f"{item.foot.set}: {item.foot.name}", lambda: real.matched(item.foot, estimated(p, item.inputs, options))
    )


def scored(p: FootParams, items: Sequence[Ready], options: FootOptions = DEFAULT) -> Score | None:
    """All feet of a set estimated and compared; None if the set has no foot."""
    found = [one for one in (solved(p, item, options) for item in items) if one is not None]
    return score(found) if found else None


def rows_of(name: str, found: Score, split: str) -> list[Row]:
    """The rows of a set."""
    each = [
        ("stride_mae_cm", found.mae, "cm"), ("stride_bias_cm", found.bias, "cm"),
        ("stride_median_cm", found.median, "cm"), ("stride_worst_cm", found.worst, "cm"),
        ("within_two_sigma_pct", found.within, "%"), ("position_rmse_m", found.rmse, "m"),
        ("strides_lost", float(found.lost), "strides"),
    ]  # fmt: skip
    rows = [Row(f"foot_{metric}_{name}", value, unit, n=found.n, split=split) for metric, value, unit in each]
    shown = {"stride_mae_cm": "MAE", "stride_worst_cm": "worst", "stride_bias_cm": "bias"}
    named = zip(rows, each, strict=True)
    return [row.on(line_of(name), shown[key], "strides") if key in shown else row for row, (key, *_) in named]


def line_of(name: str) -> str:
    """The line of a set in the table of all experiments."""
    way = "pivot learned on other walks" if name.endswith("_calibrated") else "defaults"
    return f"stride length, {way}, `{name.removesuffix('_calibrated')}`: error"
