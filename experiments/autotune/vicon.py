"""Positions under Vicon before and after tuning, every day judged by weights of the other days; and on other sets."""

from functools import cache

import jax
import numpy as np

from experiments.autotune import learn, marker
from experiments.autotune.walks import KINDS, Trials, trials
from experiments.common.row import Row, show
from experiments.foot_ins.run import Score, scored, sets
from jgait.estimators.foot_ins import FootParams

SPLIT = "pyshoe_vicon, days left out"

WAYS = {
    "": "noise tuned from the textbook's by positions and likelihood of other days, marker too",
    "marker": "hand-chosen noise, marker tuned on other days",
    "before": "hand-chosen noise, path of the sensor",
    "textbook": "textbook's noise, marker tuned on other days",
    "likelihood": "noise tuned from the textbook's by likelihood alone, marker tuned",
}
"""Words of the table of all experiments."""

MANY = 50
"""Fewest strides of a set whose coverage is compared: of 12 strides, 11 are 92 % and all are 100 %."""


@cache
def found(quick: bool) -> Trials:
    """The trials."""
    some = trials(quick)
    assert some is not None
    return some


@cache
def fit(day: str, loss: learn.Terms, quick: bool) -> learn.Learned:
    """The tuning on all days but one; "" leaves none out."""
    here = found(quick)
    told = learn.fit(here.groups, (here.days != day).astype(float), loss, 2 if quick else learn.STEPS)
    print(f"without {day or 'none'}: loss {told.losses[0]:.3f} to {told.losses[-1]:.3f};",
          {name: float(f"{float(getattr(told.params, name)):.3g}") for name in learn.FREE}, flush=True)  # fmt: skip
    return told


def of_days(params: dict[str, FootParams], quick: bool) -> np.ndarray:
    """Error of every trial [m] by the parameters for its day, with the marker that the other days taught."""
    here = found(quick)
    error, same = np.zeros(here.days.size), {}
    for day, p in params.items():
        away = here.days == day
        if id(p) not in same:
            same = {id(p): marker.paths(p, here.groups)}
        error[away] = marker.held_out(same[id(p)], away)
    return error


def gain(before: np.ndarray, after: np.ndarray) -> float:
    """Of the mean logarithm of the error: .1 is 10 %."""
    return float(np.mean(np.log(before / after)))


@cache
def ways(quick: bool) -> dict[str, np.ndarray]:
    """Error of every trial [m] by each of `WAYS`."""
    here = found(quick)
    days, default = sorted(set(here.days.tolist())), FootParams()
    plain = marker.errors(marker.paths(default, here.groups), np.zeros(3))
    return {
        "before": plain,
        "marker": of_days(dict.fromkeys(days, default), quick),
        "textbook": of_days(dict.fromkeys(days, learn.START), quick),
        "": of_days({day: fit(day, learn.POSITION, quick).params for day in days}, quick),
        "likelihood": of_days({day: fit(day, learn.LIKELIHOOD, quick).params for day in days}, quick),
    }


def rows(quick: bool) -> list[Row]:
    """Before and after by kind of gait; a step's time; stride lengths of other sets with the weights of all days."""
    if trials(quick) is None:
        return []
    here, each = found(quick), ways(quick)
    present = [kind for kind in KINDS if (here.kinds == kind).any()]
    lines = [[WAYS[way], *(f(error[here.kinds == kind]) for kind in present for f in (np.median, np.max)),
              float(np.mean(np.log(error)))] for way, error in each.items()]  # fmt: skip
    columns = [*(c for kind in present for c in (f"{kind} median", "worst")), "mean log"]
    show("3-D error of positions [m], days left out", ["", *columns], lines)
    gains = {way: gain(each["textbook"], each[way]) for way in ("marker", "", "likelihood")}
    print("gain in the mean logarithm of the error from the textbook's filter on:", gains)
    print("trials whose error is smaller by tuning than by hand:", int(np.sum(each[""] < each["marker"])))
    seconds, cpu = np.median(fit("", learn.POSITION, quick).seconds, axis=0)
    compiling = fit(min(here.days.tolist()), learn.POSITION, quick).seconds[0][0] - seconds
    line = "gain in the mean logarithm of the position's error, from the textbook's filter on, `pyshoe_vicon`"
    cost, size, n = (
        "tuning of a foot, a step over all trials",
        f"value and gradient, {here.days.size} trials",
        here.days.size,
    )
    result = [row for way, error in each.items() for row in of_kinds(here, way, error)] + [
        Row("position_gain_tuned", gains[""], "1", n=n, split=SPLIT).on(line, "tuned by position", "trials"),
        Row("position_gain_by_hand", gains["marker"], "1", n=n, split=SPLIT).on(line, "hand-chosen", "trials"),
        Row("position_gain_likelihood", gains["likelihood"], "1", n=n, split=SPLIT).on(
            line, "tuned by likelihood", "trials"
        ),
        Row("likelihood_gain_share", gains["likelihood"] / gains[""], "1", n=n, split=SPLIT).on(
            line, "likelihood's share of the position loss's", "trials"
        ),
        Row("position_m_worst", float(each[""].max()), "m", n=n, split=SPLIT),
        Row("step_s", float(seconds), "s", n=n, split=size).on(cost, "by the clock", "trials"),
        Row("step_cpu_s", float(cpu), "s", n=n, split=size).on(cost, "of the processors", "trials"),
        Row("compile_s", float(compiling), "s", n=n, split="first step, first fit").on(cost, "compiling", "trials"),
    ]  # fmt: skip
    return [on_line(row) for row in result + other_sets(quick)]


def on_line(row: Row) -> Row:
    """The row in its line of the table of all experiments, if it has one."""
    kind, _, way = row.metric.removeprefix("position_m_").partition("_")
    if kind in (*KINDS, "worst"):
        return row.on(f"position of a foot, {WAYS[way]}, `pyshoe_vicon`: median error", kind, "trials")
    return row


def of_kinds(here: Trials, label: str, errors: np.ndarray) -> list[Row]:
    """The median of each kind of gait."""
    end = f"_{label}" if label else ""
    split = "pyshoe_vicon, hand-chosen" if label == "before" else SPLIT
    return [
        Row(f"position_m_{kind}{end}", float(np.median(errors[here.kinds == kind])), "m",
            n=int(np.sum(here.kinds == kind)), split=split)
        for kind in KINDS if (here.kinds == kind).any()
    ]  # fmt: skip


def other_sets(quick: bool) -> list[Row]:
    """Stride length of the other sets before and after, with parameters tuned on Vicon alone: other people."""
    if quick:
        return []
    p = fit("", learn.POSITION, quick).params
    lines, result, ratios, within = [], [], [], []
    for name, items in sets(quick).items():
        if name == "pyshoe_vicon":
            continue
        before, after = (scored(q, items) for q in (FootParams(), jax.tree.map(float, p)))
        assert isinstance(before, Score)
        assert isinstance(after, Score)
        ratios.append(after.mae / before.mae)
        if after.n >= MANY:
            within.append(after.within)
        lines += [[f"{name}, {way}", one.mae, one.bias, one.median, one.worst, one.within]
                  for way, one in (("hand-chosen", before), ("tuned", after))]  # fmt: skip
        split, line = f"{name}, tuned on pyshoe_vicon", f"stride length, noise tuned on `pyshoe_vicon`, `{name}`"
        result += [
            Row(f"{name}_stride_mae_cm_elsewhere", after.mae, "cm", n=after.n, split=split).on(
                f"{line}: mean error", "tuned", "strides"
            ),
            Row(f"{name}_stride_mae_cm_elsewhere_before", before.mae, "cm", n=before.n, split=split).on(
                f"{line}: mean error", "hand-chosen", "strides"
            ),
            Row(f"{name}_within_two_sigma_pct", after.within, "%", n=after.n, split=split).on(
                f"{line}: within two stated deviations", "tuned", "strides"
            ),
            Row(f"{name}_within_two_sigma_pct_before", before.within, "%", n=before.n, split=split).on(
                f"{line}: within two stated deviations", "hand-chosen", "strides"
            ),
        ]  # fmt: skip
    columns = ["", "MAE cm", "bias cm", "median", "worst", "within 2σ %"]
    show("stride length of sets that the tuning did not use", columns, lines)
    split, line = "tuned on pyshoe_vicon", "stride length of other sets, error after tuning over before, worst set"
    many = f"strides within two stated deviations after tuning, other sets of {MANY} strides or more"
    return [
        *result,
        Row("other_sets_worst_ratio", max(ratios), "ratio", n=len(ratios), split=split).on(line, "", "sets"),
        Row("within_two_sigma_pct_lowest", min(within), "%", n=len(within), split=split).on(many, "lowest", "sets"),
        Row("within_two_sigma_pct_highest", max(within), "%", n=len(within), split=split).on(many, "highest", "sets"),
    ]
