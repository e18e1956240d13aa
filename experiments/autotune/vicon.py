"""Positions under Vicon before and after tuning, every day judged by weights of the other days; and on other sets."""

from functools import cache

import jax
import numpy as np

from experiments.autotune import learn
from experiments.autotune.walks import KINDS, Trials, options_of, trials
from experiments.common.row import Row, show
from experiments.foot_ins.run import Score, scored, sets
from jgait.estimators.foot_ins import DEFAULT, FootParams

NOISE = "log_linear"
SPLIT = "pyshoe_vicon, days left out"


@cache
def held_out(noise: str, quick: bool) -> tuple[np.ndarray, np.ndarray, list[learn.Learned]]:
    """3-D error of every trial before and after [m], with the parameters of the other days; and the fits."""
    found = trials(noise, quick)
    assert found is not None
    before = 0.01 * learn.errors(FootParams(), found.groups, DEFAULT)
    after, fits = np.full(before.size, np.nan), []
    for day in np.unique(found.days):
        fits.append(
            learn.fit(found.groups, (found.days != day).astype(float), options_of(noise), steps=2 if quick else 30)
        )
        here = found.days == day
        after[here] = 0.01 * learn.errors(fits[-1].params, found.groups, options_of(noise))[here]
        print(f"without {day}: loss {fits[-1].losses[0]:.3f} to {fits[-1].losses[-1]:.3f}; left out, before and after:")
        print("  ", list(zip(found.kinds[here].tolist(), before[here].round(3), after[here].round(3), strict=True)))
    return before, after, fits


def rows(quick: bool) -> list[Row]:
    """Before and after by kind of gait; a step's time; stride lengths of other sets with the weights of all days."""
    found = trials(NOISE, quick)
    if found is None:
        return []
    before, after, fits = held_out(NOISE, quick)
    result = of_kinds(found, "before", before) + of_kinds(found, "", after)
    lines = [[kind, *(f(e[found.kinds == kind]) for e in (before, after) for f in (np.median, np.max))]
             for kind in KINDS if (found.kinds == kind).any()]  # fmt: skip
    show("3-D error of positions [m], days left out", ["", "before", "worst", "after", "worst"], lines)
    seconds = np.concatenate([fit.seconds[1:] for fit in fits])
    result += [
        Row("position_m_worst", float(after.max()), "m", n=after.size, split=SPLIT),
        Row("step_s", float(np.median(seconds)), "s", n=found.days.size, split="value and gradient, all trials"),
        Row("compile_s", fits[0].seconds[0] - float(np.median(seconds)), "s", n=len(found.groups), split="programs"),
    ]
    return [on_line(row) for row in result + other_sets(found, quick)]


def on_line(row: Row) -> Row:
    """The row in its line of the table of all experiments, if it has one."""
    kind = row.metric.removeprefix("position_m_")
    if kind in (*KINDS, "worst"):
        return row.on(
            "position of a foot, noise model tuned on other days, `pyshoe_vicon`: median error", kind, "trials"
        )
    name, end = row.metric.partition("_stride_mae_cm_elsewhere")[::2]
    if name != row.metric:
        part = "hand-chosen" if end else "tuned"
        return row.on(f"stride length, noise model tuned on `pyshoe_vicon`, `{name}`: mean error", part, "strides")
    return row


@cache
def all_days(noise: str) -> FootParams:
    """Parameters tuned on all trials, for other sets and for the preset."""
    found = trials(noise, False)
    assert found is not None
    return learn.fit(found.groups, np.ones(found.days.size), options_of(noise)).params


def of_kinds(found: Trials, label: str, errors: np.ndarray) -> list[Row]:
    """The median of each kind of gait."""
    end = f"_{label}" if label else ""
    split = "pyshoe_vicon, hand-chosen" if label else SPLIT
    return [
        Row(f"position_m_{kind}{end}", float(np.median(errors[found.kinds == kind])), "m",
            n=int(np.sum(found.kinds == kind)), split=split)
        for kind in KINDS if (found.kinds == kind).any()
    ]  # fmt: skip


def other_sets(found: Trials, quick: bool) -> list[Row]:
    """Stride length of the other sets before and after, with parameters tuned on Vicon alone: other people."""
    if quick:
        return []
    options = options_of(NOISE)
    p = all_days(NOISE)
    print("parameters of all days:", jax.tree.map(float, p))
    lines, result, ratios = [], [], []
    for name, items in sets(quick).items():
        if name == "pyshoe_vicon":
            continue
        scores = [scored(*pair) for pair in ((FootParams(), items), (p, items, options))]
        one, other = (score for score in scores if isinstance(score, Score))
        ratios.append(other.mae / one.mae)
        lines.append([name, one.mae, other.mae, one.median, other.median, one.worst, other.worst, other.within])
        split = f"{name}, tuned on pyshoe_vicon"
        result += [
            Row(f"{name}_stride_mae_cm_elsewhere", other.mae, "cm", n=other.n, split=split),
            Row(f"{name}_stride_mae_cm_elsewhere_before", one.mae, "cm", n=one.n, split=f"{name}, hand-chosen"),
            Row(f"{name}_within_two_sigma_pct", other.within, "%", n=other.n, split=split),
        ]
    columns = ["", "MAE cm", "after", "median", "after", "worst", "after", "within 2σ %, after"]
    show("stride length of sets that the tuning did not use", columns, lines)
    within = [row.value for row in result if row.unit == "%"]
    return [
        *result,
        Row("other_sets_worst_ratio", max(ratios), "ratio", n=len(ratios), split="tuned on pyshoe_vicon"),
        Row("within_two_sigma_pct_lowest", min(within), "%", n=len(within), split="tuned on pyshoe_vicon"),
        Row("within_two_sigma_pct_highest", max(within), "%", n=len(within), split="tuned on pyshoe_vicon"),
    ]
