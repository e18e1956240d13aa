"""A laboratory's preset: what a cohort can teach an estimator, judged on people left out and on public sets."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

from jgait import datasets, evaluate, io
from jgait.commands import cohort as cohorts
from jgait.commands.console import Bar, progress, say, show, stop, wrote
from jgait.commands.options import measures_of
from jgait.commands.tune_report import ENOUGH, TuningOutcome
from jgait.commands.tune_run import lessons_of, prepared
from jgait.estimators import Estimator
from jgait.filtering import compiled
from jgait.params import constrain, freed, names, normal, priors, stated, unconstrain
from jgait.report.page import significant
from jgait.tune import LOSSES, Lesson, Lessons, Objective, lacking, objective
from jgait.tune.identifiability import TOGETHER
from jgait.tune.objective import Term
from jgait.tune.problem import kept
from jgait.types import Estimate, Walk

PREFERRED = ("position", "trajectory", "stride_length", "distance", "stride_time")
"""Losses of a reference from which a preset is learned, the most informative first."""

NATS = 0.05
"""Weight of the likelihood beside the logarithm of the error [1 for each nat of a sample]. It determines what
the reference leaves open: .2 nat a sample count as 1 % of the error."""

AGREED = 2.0
"""Least mean gradient of a parameter that is learned, over people [its standard errors]: people agree on the sign."""

MOVES = 0.01
"""Least change of the error with a parameter that is learned, as far as the parameter deviates [share of the error]."""


class Elsewhere(NamedTuple):
    """The median error of the walks of a public set before and after."""

    name: str
    words: str
    unit: str
    n: int
    before: float
    after: float


def loss_of(pipeline: Estimator[PyTree, PyTree], walks: Sequence[Walk]) -> str:
    """The first of `PREFERRED` that the references of at least half of the walks answer; exits with code 2 if none."""
    answers = _answers(pipeline)
    enough = (2 * sum(not lacking(name, walk.reference) for walk in walks) >= max(1, len(walks)) for name in answers)
    answer = next(itertools.compress(answers, enough), None)
    if answer is None:
        stop(f"a preset of {pipeline.name} needs references, for one of {', '.join(answers)}")
    return answer


def _answers(pipeline: Estimator[PyTree, PyTree]) -> list[str]:
    return [name for name in PREFERRED if name in (pipeline.about.losses or PREFERRED)]


@dataclass(frozen=True)
class Logarithm:
    """½ log(1 + loss / scale) of a walk [nat]: halving the error of a good walk counts as much as that of a bad one."""

    name: str  #: of the loss.
    scale: float

    def __call__(self, estimate: Estimate, lesson: Lesson) -> Float[Array, ""]:
        """The term of one walk."""
        return 0.5 * jnp.log1p(LOSSES[self.name].term(estimate, lesson) / self.scale)

    def __str__(self) -> str:
        return self.name


def terms_of(
    pipeline: Estimator[PyTree, PyTree], start: PyTree, made: Lessons, loss: dict[str, float]
) -> dict[str | Term, float]:
    """The logarithms of the losses of the reference, with their median at the start as scale."""
    terms: dict[str | Term, float] = {}
    for name, weight in loss.items():
        losses, _ = _scores(objective(pipeline, made.options, name), start, pipeline.transforms, made.data, False)
        terms[Logarithm(name, max(float(np.nanmedian(losses)), 1e-12))] = weight
    return terms


def with_likelihood(pipeline: Estimator[PyTree, PyTree], made: Lessons, terms: dict[str | Term, float]) -> Objective:
    """The terms, and the likelihood of the measurements beside them."""
    if "likelihood" in (pipeline.about.losses or ()) and "likelihood" not in map(str, terms):
        terms = terms | {"likelihood": NATS / float(np.mean(np.sum(made.data.look, axis=1)))}
    return objective(pipeline, made.options, terms)


class Number(NamedTuple):
    """A number among the parameters that could be learned."""

    name: str
    value: float
    deviation: float  #: stated deviation in natural units; a tenth of the value where none is stated.
    step: float  #: the same in the free coordinate.


def numbers(pipeline: Estimator[PyTree, PyTree], start: PyTree) -> list[Number]:
    """The numbers of the parameters that could be learned; not those of people's bodies."""
    body = (m.parameter or m.name for m in pipeline.about.measures if m.name in measures_of(pipeline))
    without, known, rows = (*pipeline.unused, *body), stated(start), []
    leaves = (jax.tree.leaves(tree, is_leaf=_is_transform) for tree in (pipeline.transforms, start))
    for name, transform, value in zip(names(pipeline.transforms), *leaves, strict=True):
        if transform.to_free is None or np.ndim(value) or any(f"{name}.".startswith(f"{other}.") for other in without):
            continue
        entry = known.get(name) or known.get(name.rpartition(".")[0])
        # without a stated deviation the tenth of the value by which `tune.explain` moves it
        deviation = 0.1 * abs(float(value)) if entry is None or np.isnan(entry.deviation) else entry.deviation
        free = transform.to_free(jnp.asarray(value, float))
        if deviation > 0.0 and np.isfinite(free):
            step = deviation / abs(float(jax.grad(transform.to_natural)(free)))
            rows.append(Number(name, float(value), deviation, step))
    return rows


def learnable(
    pipeline: Estimator[PyTree, PyTree], start: PyTree, made: Lessons, groups: Sequence[str], terms: Objective
) -> list[str]:
    """The parameters that move the loss as far as they deviate, in the same direction for all people, or days, and that
    are not collinear, the strongest first; exits with code 2 if there is none, or too few people.
    """
    count = len(set(groups))
    if count < ENOUGH:
        stop(f"no preset is written: a verdict needs {ENOUGH} people, or days of one person; here: {count}")
    each = numbers(pipeline, start)
    _, slopes = _scores(terms, start, freed(pipeline.transforms, *(n.name for n in each)), made.data, True)
    of = np.asarray(groups)
    scores = np.stack([np.nan_to_num(slopes)[of == group].sum(axis=0) for group in dict.fromkeys(groups)])
    centred = scores - scores.mean(axis=0)
    size = np.sqrt(np.maximum((centred**2).sum(axis=0), np.finfo(float).tiny))
    clear = np.abs(scores.sum(axis=0)) / (size * np.sqrt(count / (count - 1)))
    moved = np.abs(scores.sum(axis=0)) * np.array([n.step for n in each]) / len(of)
    chosen: list[int] = []
    for k in np.argsort(-moved, kind="stable"):
        apart = all(abs(centred[:, k] @ centred[:, j]) < TOGETHER * size[k] * size[j] for j in chosen)
        if clear[k] >= AGREED and moved[k] >= MOVES and apart:
            chosen.append(int(k))
    if not chosen:
        best = int(np.argmax(np.where(moved >= MOVES, clear, 0.0)))
        stop(
            f"no preset is written: these recordings do not agree on the direction of any of {len(each)} parameters; "
            f"the clearest is {each[best].name}, at {clear[best]:.1f} standard errors of at least {AGREED:g}"
        )
    return [each[k].name for k in chosen]


def priors_of(pipeline: Estimator[PyTree, PyTree], start: PyTree, learned: Sequence[str]) -> PyTree:
    """The declared priors, and for other learned parameters normal ones: the value, within its deviation."""
    structure: PyTree = jax.tree.structure(pipeline.transforms, is_leaf=_is_transform)
    declared = structure.flatten_up_to(priors(start))
    within = {n.name: normal(n.value, n.deviation) for n in numbers(pipeline, start) if n.name in learned}
    every = zip(names(pipeline.transforms), declared, strict=True)
    return jax.tree.unflatten(structure, [within.get(name) if prior is None else prior for name, prior in every])


def _is_transform(node: object) -> bool:
    return hasattr(node, "to_free")


def _scores(
    terms: Objective, start: PyTree, transforms: PyTree, data: PyTree, slopes: bool
) -> tuple[np.ndarray, np.ndarray]:
    """The loss (n,) of every lesson, and its gradient (n, p) in free coordinates; one lesson after another."""
    free = unconstrain(jax.tree.map(jnp.asarray, start), transforms)
    losses, gradients = _program(terms, transforms, slopes)(free, start, data)
    parts = [np.asarray(leaf)[:, None] for leaf in jax.tree.leaves(gradients)]
    return np.asarray(losses, float), np.concatenate(parts, axis=1) if parts else np.zeros((len(losses), 0))


@kept
def _program(terms: Objective, transforms: PyTree, slopes: bool) -> Any:
    def loss(free: PyTree, start: PyTree, item: PyTree) -> Float[Array, ""]:
        return terms(constrain(free, transforms, start), item)

    def of_item(free: PyTree, start: PyTree, item: PyTree) -> PyTree:
        return jax.value_and_grad(loss)(free, start, item) if slopes else (loss(free, start, item), ())

    return compiled(lambda free, start, data: jax.lax.map(partial(of_item, free, start), data))


def elsewhere(
    pipeline: Estimator[PyTree, PyTree], start: PyTree, params: PyTree, judged: str, without: str | None
) -> list[Elsewhere]:
    """The errors on every public set on this computer that the estimator can use, but for the one learned from."""
    rows, answers = [], _answers(pipeline)
    for name in datasets.list_datasets():
        if name == without or not datasets.available(name):
            continue
        source = cohorts.source(None, name, None, 0, None, None, measures_of(pipeline))
        # some walks of each set, for the time
        picked = np.unique(np.linspace(0, len(source.items) - 1, 8).round().astype(int))
        walks, ready = prepared(source._replace(items=[source.items[k] for k in picked]), pipeline, [])
        for loss in dict.fromkeys((judged, *answers)):
            try:
                made = lessons_of(ready, walks, start, [], [], [loss])
            except ValueError:  # the set has no such sensors, or no such reference
                continue
            both = [evaluate.judged(pipeline, p, made, [loss])[loss] for p in (start, params)]
            finite = np.isfinite(both).all(axis=0)
            if finite.any():
                medians = (float(np.median(errors[finite])) for errors in both)
                rows.append(Elsewhere(name, LOSSES[loss].words, LOSSES[loss].unit, int(finite.sum()), *medians))
            break
    return rows


def refusal(outcome: TuningOutcome, many: str, others: Sequence[Elsewhere]) -> str:
    """Why no preset is written, in words; "" if it is better on people, or days, left out, and spoils no other set."""
    change, held = outcome.change, outcome.made["held_out"]
    if change is None or change.n < ENOUGH:
        return f"a verdict needs {ENOUGH} {many}, each left out once; there are {0 if change is None else change.n}"
    if not change.high < 0.0 or not held["after"] < held["before"]:
        return (
            f"it does not gain on {many} left out: median {held['error']} {significant(held['before'])} {held['unit']} "
            f"before, {significant(held['after'])} after; {change.better} better, {change.worse} worse; the median "
            f"change is {significant(change.low)} to {significant(change.high)} with 95 %"
        )
    spoilt = [row for row in others if not row.after <= 1.01 * row.before]
    each = (f"{row.name}: {row.words} {significant(row.before)} {row.unit} before, {significant(row.after)} after"
            for row in spoilt)  # fmt: skip
    return f"it is worse on other recordings, {'; '.join(each)}" if spoilt else ""


def write(
    name: str, pipeline: Estimator[PyTree, PyTree], start: PyTree, params: PyTree, outcome: TuningOutcome, many: str,
    judged: str, dataset: str | None,
) -> None:  # fmt: skip
    """Write the preset with the table of its proof; exits with code 2 and the reason if it does not gain."""
    reason, others = refusal(outcome, many, []), []
    if not reason:
        with progress() as bars:
            Bar(bars).begin("judging on the public sets on this computer")
            others = elsewhere(pipeline, start, params, judged, dataset)
        reason = refusal(outcome, many, others)
    if others:
        rows = [(row.name, f"{row.words} [{row.unit}]", row.n, significant(row.before), significant(row.after))
                for row in others]  # fmt: skip
        show("public set", "error, median of walks", "walks", "before", "after", rows=rows, left=2)
    if reason:
        stop(f"no preset is written: {reason}")
    made = outcome.made | {"elsewhere": [row._asdict() for row in others]}
    file = io.write_preset(name, params, estimator=pipeline.name, stderr=outcome.spreads, made=made)
    wrote([file])
    say(f"commands take it by --estimator {pipeline.name} --params preset:{name}")
