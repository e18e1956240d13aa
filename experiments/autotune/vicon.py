"""Positions under Vicon before and after tuning, every day judged by weights of the other days; and on other sets."""

from functools import cache
from typing import Any, NamedTuple

import jax
import numpy as np

from experiments.autotune import learn
from experiments.autotune.walks import KINDS, Trials, groups, options_of, trials
from experiments.common.row import Row, show
from experiments.foot_ins.run import Score, scored, sets
from jgait import tune
from jgait.estimators.foot_ins import DEFAULT, FootOptions, FootParams
from jgait.tune import Lesson
from jgait.types import Estimate

NOISE = "log_linear"
SPLIT = "pyshoe_vicon, days left out"


def before(noise: str, quick: bool) -> np.ndarray:
    """3-D error of every trial with hand-chosen parameters [m]; the path is the sensor's."""
    found = trials(noise, quick)
    assert found is not None
    return 0.01 * learn.errors(FootParams(), found.groups, DEFAULT)


WAYS = {
    "": "noise model and marker tuned on other days",
    "marker": "hand-chosen noise, marker tuned on other days",
    "before": "hand-chosen noise, path of the sensor",
    "likelihood": "noise tuned by likelihood alone on other days",
}
"""Words of the table of all experiments."""


MANY = 50
"""Fewest strides of a set whose coverage is compared: of 12 strides, 11 are 92 % and all are 100 %."""


class HeldOut(NamedTuple):
    """Every trial with parameters of the other days: 3-D error [m], and the fit of each day left out."""

    error: np.ndarray
    fits: list[learn.Learned]


def by_days(found: Trials, options: FootOptions, groups: Any, **how: Any) -> HeldOut:
    """Errors with what the other days taught; `start` may be one set of parameters for each day."""
    error, fits, starts = np.full(found.days.size, np.nan), [], how.pop("start", None)
    for number, day in enumerate(np.unique(found.days)):
        start = None if starts is None else starts[number]
        weights = (found.days != day).astype(float)
        fits.append(learn.fit(groups, weights, options, start=start, **how))
        here = found.days == day
        error[here] = 0.01 * learn.errors(fits[-1].params, groups, options)[here]
        print(f"without {day}: loss {fits[-1].losses[0]:.3f} to {fits[-1].losses[-1]:.3f}; left out:")
        print("  ", list(zip(found.kinds[here].tolist(), error[here].round(3), strict=True)))
    return HeldOut(error, fits)


def likelihood(estimate: Estimate, lesson: Lesson) -> Any:
    """Negative log-likelihood of a trial's innovations, per second of it."""
    return tune.LOSSES["likelihood"].term(estimate, lesson) / (lesson.inputs.time[-1] - lesson.inputs.time[0])


@cache
def tuned(noise: str, quick: bool) -> HeldOut:
    """Noise model and marker tuned by the position loss."""
    found = trials(noise, quick)
    assert found is not None
    return by_days(found, options_of(noise), found.groups, steps=2 if quick else learn.STEPS)


@cache
def marked(noise: str, quick: bool) -> HeldOut:
    """Hand-chosen parameters; only the place of the reference's marker on the foot is tuned."""
    found = trials(noise, quick)
    assert found is not None
    hard = groups(found.walks, DEFAULT)
    return by_days(found, DEFAULT, hard, free=learn.MARKER, steps=2 if quick else learn.FEW)


@cache
def likely(noise: str, quick: bool) -> HeldOut:
    """Constant noise tuned by the likelihood of the innovations in hard stances; the marker's place as in `marked`."""
    found = trials(noise, quick)
    assert found is not None
    start = [fit.params for fit in marked(noise, quick).fits]
    steps, hard = 2 if quick else learn.FEW, groups(found.walks, DEFAULT)
    return by_days(found, DEFAULT, hard, loss=likelihood, free=learn.NOISES, start=start, steps=steps)


def rows(quick: bool) -> list[Row]:
    """Before and after by kind of gait; a step's time; stride lengths of other sets with the weights of all days."""
    found = trials(NOISE, quick)
    if found is None:
        return []
    plain = 0.01 * learn.errors(FootParams(), found.groups, DEFAULT)
    after, fits = tuned(NOISE, quick)
    ways = {"hand-chosen, path of the sensor": plain, "hand-chosen, path of the marker": marked(NOISE, quick).error,
            "tuned by likelihood alone": likely(NOISE, quick).error, "tuned by position": after}  # fmt: skip
    lines = [[way, *(f(error[found.kinds == kind]) for kind in KINDS if (found.kinds == kind).any()
                     for f in (np.median, np.max))] for way, error in ways.items()]  # fmt: skip
    columns = [c for kind in KINDS if (found.kinds == kind).any() for c in (f"{kind} median", "worst")]
    show("3-D error of positions [m], days left out", ["", *columns], lines)
    _, by_marker, by_likelihood, _ = ways.values()
    result = of_kinds(found, "before", plain) + of_kinds(found, "marker", by_marker)
    result += of_kinds(found, "likelihood", by_likelihood) + of_kinds(found, "", after)
    gains = [float(np.mean(np.log(by_marker / error))) for error in (by_likelihood, after)]
    print(f"gain in the mean logarithm of the error: likelihood alone {gains[0]:.3f}, position {gains[1]:.3f}")
    seconds = np.concatenate([fit.seconds[1:] for fit in fits])
    result += [
        # without a gain there is nothing to share
        Row("likelihood_gain_share", gains[0] / gains[1] if gains[1] > 0.0 else 0.0, "1", n=after.size, split=SPLIT),
        Row("position_m_worst", float(after.max()), "m", n=after.size, split=SPLIT),
        Row("step_s", float(np.median(seconds)), "s", n=found.days.size, split="value and gradient, all trials"),
        Row("compile_s", fits[0].seconds[0] - float(np.median(seconds)), "s", n=len(found.groups), split="programs"),
    ]
    return [on_line(row) for row in result + other_sets(found, quick)]


def on_line(row: Row) -> Row:
    """The row in its line of the table of all experiments, if it has one."""
    kind, _, way = row.metric.removeprefix("position_m_").partition("_")
    if kind in (*KINDS, "worst"):
        return row.on(f"position of a foot, {WAYS[way]}, `pyshoe_vicon`: median error", kind, "trials")
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
    split = "pyshoe_vicon, hand-chosen" if label == "before" else SPLIT
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
    within = [row.value for row in result if row.unit == "%" and (row.n or 0) >= MANY]
    return [
        *result,
        Row("other_sets_worst_ratio", max(ratios), "ratio", n=len(ratios), split="tuned on pyshoe_vicon"),
        Row("within_two_sigma_pct_lowest", min(within), "%", n=len(within), split="tuned on pyshoe_vicon"),
        Row("within_two_sigma_pct_highest", max(within), "%", n=len(within), split="tuned on pyshoe_vicon"),
    ]
