"""Positions under Vicon before and after tuning, every day judged by weights of the other days; and on other sets."""

from functools import cache
from typing import Any, NamedTuple

import jax
import numpy as np

from experiments.autotune import learn, marker
from experiments.autotune.evidence import SHARES, simplest, taken
from experiments.autotune.walks import KINDS, Trials, groups, options_of, trials
from experiments.common.row import Row, show
from experiments.foot_ins.run import Score, scored, sets
from jgait import tune
from jgait.estimators import foot_ins
from jgait.estimators.foot_ins import DEFAULT, TEXTBOOK, FootOptions, FootParams
from jgait.tune import Lesson
from jgait.types import Estimate

NOISES = ("log_linear",)
"""Noise models that are tuned, the simplest first."""

BY_HAND = ("constant", 0.0)
"""The candidate that changes nothing: a noise model, and the share of its tuning that is taken."""

SPLIT = "pyshoe_vicon, days left out"

START = TEXTBOOK._replace(pivot_height=0.02, rate_noise=0.003)
"""The textbook's filter; what it leaves out begins small, for a logarithm of 0 has no gradient."""

LEARNED = ("pivot_height", "velocity_noise", "rate_noise", "acc_noise", "gyr_noise")
"""What is learned from the textbook's filter on; the two noises that it does not have stay as good as 0."""

WAYS = {
    "": "noise tuned on other days as far as they support it, marker too",
    "full": "noise tuned on other days in full, marker too",
    "marker": "hand-chosen noise, marker tuned on other days",
    "before": "hand-chosen noise, path of the sensor",
    "textbook": "textbook's noise, marker tuned on other days",
    "textbook_position": "noise tuned from the textbook's by positions of other days, marker too",
    "textbook_likelihood": "noise tuned from the textbook's by likelihood alone, marker tuned",
}
"""Words of the table of all experiments."""

MANY = 50
"""Fewest strides of a set whose coverage is compared: of 12 strides, 11 are 92 % and all are 100 %."""


class Fold(NamedTuple):
    """A day left out: the fit to the others, and of each share of it the errors of the day's trials [m]."""

    fit: learn.Learned
    errors: dict[float, np.ndarray]


def likelihood(estimate: Estimate, lesson: Lesson) -> Any:
    """Negative log-likelihood of a trial's innovations, per second of it."""
    return tune.LOSSES["likelihood"].term(estimate, lesson) / (lesson.inputs.time[-1] - lesson.inputs.time[0])


@cache
def ready(noise: str, quick: bool) -> tuple[Trials, FootOptions, Any]:
    """The trials, the options of a noise model, and the lessons for them."""
    found, options = trials(quick), options_of(noise)
    assert found is not None
    return found, options, found.groups if options == DEFAULT else groups(found.walks, options)


@cache
def by_hand(quick: bool) -> marker.Paths:
    """The paths of all trials with hand-chosen parameters."""
    _, options, lessons = ready("constant", quick)
    return marker.paths(FootParams(), lessons, options)


def of_day(p: FootParams, day: str, noise: str, quick: bool) -> np.ndarray:
    """Errors of a day's trials [m], the marker solved on the other days."""
    found, options, lessons = ready(noise, quick)
    return marker.held_out(marker.paths(p, lessons, options), found.days == day)


@cache
def fold(day: str, noise: str, quick: bool) -> Fold:
    """The tuning without a day, and what each share of it does on that day."""
    found, options, lessons = ready(noise, quick)
    start, here = foot_ins.estimator(options).params, found.days == day
    fit = learn.fit(lessons, (~here).astype(float), start, options, steps=2 if quick else learn.STEPS)
    errors = {s: of_day(learn.part(fit, s, start, options), day, noise, quick) for s in SHARES}
    errors |= {0.0: marker.held_out(by_hand(quick), here)}
    print(f"{noise}, without {day}: loss {fit.losses[0]:.3f} to {fit.losses[-1]:.3f}; mean log error by share:",
          {s: round(float(np.mean(np.log(e))), 3) for s, e in errors.items()}, flush=True)  # fmt: skip
    return Fold(fit, errors)


@cache
def candidates(quick: bool) -> dict[tuple[str, float], np.ndarray]:
    """(noise model, share) → error of every trial by the tuning without its day [m]; the simplest first."""
    found, _, _ = ready("constant", quick)
    result = {}
    for noise, share in (BY_HAND, *((noise, share) for noise in NOISES for share in SHARES)):
        result[noise, share] = error = np.zeros(found.days.size)
        for day in np.unique(found.days):
            error[found.days == day] = fold(day, noise if share else NOISES[0], quick).errors[share]
    return result


def chosen(quick: bool) -> np.ndarray:
    """Error of every trial by the candidate that the other days support [m]."""
    found, _, _ = ready("constant", quick)
    errors = candidates(quick)
    choice = taken({name: np.log(error) for name, error in errors.items()}, found.days)
    print("taken for each day:", choice)
    return np.array([errors[choice[day]][row] for row, day in enumerate(found.days.tolist())])


@cache
def all_days() -> tuple[tuple[str, float], FootParams]:
    """The candidate that all days support, and its parameters tuned on all of them, for other sets and the preset."""
    found, _, _ = ready("constant", False)
    noise, share = simplest({name: np.log(error) for name, error in candidates(False).items()}, found.days)
    return (noise, share), tuned_on_all(noise, share)


@cache
def fit_to_all(noise: str, quick: bool) -> learn.Learned:
    """The tuning on all trials."""
    found, options, lessons = ready(noise, quick)
    start = foot_ins.estimator(options).params
    return learn.fit(lessons, np.ones(found.days.size), start, options, steps=2 if quick else learn.STEPS)


def tuned_on_all(noise: str, share: float) -> FootParams:
    """Parameters at a share of the tuning on all trials."""
    options = options_of(noise)
    start = foot_ins.estimator(options).params
    return learn.part(fit_to_all(noise, False), share, start, options) if share else start


def from_textbook(quick: bool) -> dict[str, np.ndarray]:
    """Errors of the textbook's filter, and tuned from it, without priors, by either loss on the other days [m]."""
    found, options, lessons = ready("constant", quick)
    result = {"textbook": np.zeros(found.days.size)}
    for day in np.unique(found.days):
        here = found.days == day
        result["textbook"][here] = of_day(START, day, "constant", quick)
        for name, loss in (("position", "position_log"), ("likelihood", likelihood)):
            fit = learn.fit(lessons, (~here).astype(float), START, options, loss, names=LEARNED, priors=False,
                            steps=2 if quick else learn.STEPS)  # fmt: skip
            p = learn.part(fit, 1.0, START, options)
            result.setdefault(f"textbook_{name}", np.zeros(found.days.size))[here] = of_day(p, day, "constant", quick)
            print(f"from the textbook, by {name}, without {day}:",
                  {field: round(float(getattr(p, field)), 4) for field in LEARNED}, flush=True)  # fmt: skip
    return result


def gain(before: np.ndarray, after: np.ndarray) -> float:
    """Of the mean logarithm of the error: .1 is 10 %."""
    return float(np.mean(np.log(before / after)))


def rows(quick: bool) -> list[Row]:
    """Before and after by kind of gait; a step's time; stride lengths of other sets with the weights of all days."""
    if trials(quick) is None:
        return []
    found, _, _ = ready("constant", quick)
    plain = marker.errors(by_hand(quick), np.zeros(3))
    every = candidates(quick)
    ways = {"before": plain, "marker": every[BY_HAND], "full": every[NOISES[-1], 1.0], "": chosen(quick)}
    ways |= from_textbook(quick)
    present = [kind for kind in KINDS if (found.kinds == kind).any()]
    lines = [[WAYS[way], *(f(error[found.kinds == kind]) for kind in present for f in (np.median, np.max))]
             for way, error in ways.items()]  # fmt: skip
    lines += [[f"{noise}, share {share}", *(f(e[found.kinds == k]) for k in present for f in (np.median, np.max))]
              for (noise, share), e in every.items()]  # fmt: skip
    columns = [c for kind in present for c in (f"{kind} median", "worst")]
    show("3-D error of positions [m], days left out", ["", *columns], lines)
    result = [row for way, error in ways.items() for row in of_kinds(found, way, error)]
    gains = {way: gain(ways["textbook"], ways[f"textbook_{way}"]) for way in ("position", "likelihood")}
    more = gain(ways["marker"], ways[""])
    print(f"gain in the mean logarithm of the error, from the textbook's filter: {gains}; from the hand-chosen one by "
          f"position: {more:.3f}")  # fmt: skip
    seconds, cpu = np.median(fit_to_all(NOISES[-1], quick).seconds, axis=0)
    compiling = fold(found.days.min(), NOISES[-1], quick).fit.seconds[0][0] - seconds
    cost, size = "tuning of a foot, a step over all trials", f"value and gradient, {plain.size} trials"
    share = gains["likelihood"] / gains["position"] if gains["position"] > 0.0 else 0.0
    line = "gain in the mean logarithm of the position's error, from the textbook's filter on, `pyshoe_vicon`"
    result += [
        Row("likelihood_gain_share", share, "1", n=plain.size, split=f"{SPLIT}, from the textbook's filter on").on(
            line, "likelihood's over the position loss's", "trials"
        ),
        Row("position_gain_from_textbook", gains["position"], "1", n=plain.size, split=SPLIT).on(
            line, "position loss's", "trials"
        ),
        Row("position_gain_from_hand_chosen", more, "1", n=plain.size, split=SPLIT),
        Row("position_m_worst", float(ways[""].max()), "m", n=plain.size, split=SPLIT),
        Row("step_s", float(seconds), "s", n=plain.size, split=size).on(cost, "by the clock", "trials"),
        Row("step_cpu_s", float(cpu), "s", n=plain.size, split=size).on(cost, "of the processors", "trials"),
        Row("compile_s", float(compiling), "s", n=1, split="the first step of the first fit").on(cost, "compiling", ""),
    ]
    return [on_line(row) for row in result + other_sets(quick)]


def on_line(row: Row) -> Row:
    """The row in its line of the table of all experiments, if it has one."""
    kind, _, way = row.metric.removeprefix("position_m_").partition("_")
    if kind in (*KINDS, "worst"):
        return row.on(f"position of a foot, {WAYS[way]}, `pyshoe_vicon`: median error", kind, "trials")
    return row


def of_kinds(found: Trials, label: str, errors: np.ndarray) -> list[Row]:
    """The median of each kind of gait."""
    end = f"_{label}" if label else ""
    split = "pyshoe_vicon, hand-chosen" if label == "before" else SPLIT
    return [
        Row(f"position_m_{kind}{end}", float(np.median(errors[found.kinds == kind])), "m",
            n=int(np.sum(found.kinds == kind)), split=split)
        for kind in KINDS if (found.kinds == kind).any()
    ]  # fmt: skip


def other_sets(quick: bool) -> list[Row]:
    """Stride length of the other sets, with hand-chosen parameters, and with those tuned on Vicon alone: other people.

    In full is the larger model at a share of 1; as far as supported is the candidate that the days left out support.
    """
    if quick:
        return []
    best, p = all_days()
    print("supported by all days:", best)
    print("parameters, log-linear, in full:", jax.tree.map(float, tuned_on_all(NOISES[-1], 1.0)))
    ways = {"hand-chosen": (FootParams(), DEFAULT), "supported": (p, options_of(best[0])),
            "full": (tuned_on_all(NOISES[-1], 1.0), options_of(NOISES[-1]))}  # fmt: skip
    lines, result, ratios, within = [], [], {"supported": [], "full": []}, []
    for name, items in sets(quick).items():
        if name == "pyshoe_vicon":
            continue
        scores = {}
        for way, (q, options) in ways.items():
            score = scored(q, items, options)
            assert isinstance(score, Score)
            scores[way] = score
        before, after, full = scores.values()
        for way, some in ratios.items():
            some.append(scores[way].mae / before.mae)
        if after.n >= MANY:
            within.append(after.within)
        lines += [[f"{name}, {way}", one.mae, one.median, one.worst, one.within] for way, one in scores.items()]
        split, line = f"{name}, tuned on pyshoe_vicon", f"stride length, noise tuned on `pyshoe_vicon`, `{name}`"
        result += [
            Row(f"{name}_stride_mae_cm_elsewhere{end}", one.mae, "cm", n=one.n, split=split).on(
                f"{line}: mean error", part, "strides"
            )
            for end, part, one in (("", "as far as supported", after), ("_full", "in full", full),
                                   ("_before", "hand-chosen", before))
        ]  # fmt: skip
        result.append(Row(f"{name}_within_two_sigma_pct", after.within, "%", n=after.n, split=split).on(
            f"{line}: within two stated deviations", "as far as supported", "strides"
        ))  # fmt: skip
    show("stride length of sets that the tuning did not use", ["", "MAE cm", "median", "worst", "within 2σ %"], lines)
    split, line = "tuned on pyshoe_vicon", "stride length of other sets, error after tuning over before, worst set"
    return [
        *result,
        Row("other_sets_worst_ratio", max(ratios["supported"]), "ratio", n=len(lines) // 3, split=split).on(
            line, "as far as supported", "sets"
        ),
        Row("other_sets_worst_ratio_full", max(ratios["full"]), "ratio", n=len(lines) // 3, split=split).on(
            line, "in full", "sets"
        ),
        Row("within_two_sigma_pct_lowest", min(within), "%", n=len(within), split=split),
        Row("within_two_sigma_pct_highest", max(within), "%", n=len(within), split=split),
    ]
