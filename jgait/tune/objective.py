"""The losses by which walks are tuned and judged, and the loss of one walk as a weighted sum of them."""

import math
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

from jgait.estimators.interface import Estimator
from jgait.notes import record
from jgait.tune import losses
from jgait.tune.lessons import Lesson
from jgait.types import Estimate, Legs, RecordingError, Walk

Term = Callable[..., Float[Array, ""]]
"""(estimate, lesson) → scalar; pure JAX."""


def _percent(estimate: Estimate, lesson: Lesson) -> Float[Array, ""]:
    """Signed error of the distance walked from the lesson's first to its last sample [%]."""
    if estimate.distance is None or lesson.reference is None or lesson.reference.distance is None:
        raise ValueError("a distance error needs a distance of the estimator and of the reference")
    ours, theirs = (jnp.asarray(record.distance) for record in (estimate, lesson.reference))
    walked, true = (jnp.take(way, lesson.last) - jnp.take(way, lesson.first) for way in (ours, theirs))
    return 100.0 * (walked / true - 1.0)


def distance_percent(estimate: Estimate, lesson: Lesson) -> Float[Array, ""]:
    """Absolute error of the distance walked from the lesson's first to its last sample [%], for validation."""
    return jnp.abs(_percent(estimate, lesson))


def _of_legs(terms: int = 1, **without: float) -> Term:
    """The loss of legs in the lesson's `look`, relative to standing, over so many terms; see `losses.trajectory`."""
    weights = losses.TrajectoryWeights(**without)

    def term(estimate: Estimate, lesson: Lesson) -> Float[Array, ""]:
        look, standing = lesson.look, lesson.standing
        return losses.trajectory(estimate, _reference(lesson), weights, window=look, relative_to=standing) / terms

    return term


def _reference(lesson: Lesson) -> Estimate:
    if lesson.reference is None:
        raise ValueError("an error needs a reference; only the likelihood of the measurements needs none")
    reference: Estimate = lesson.reference
    return reference


def position(estimate: Estimate, lesson: Lesson) -> Float[Array, ""]:
    """Mean squared 3-D error of the feet's paths, yaw and shift removed [cm²]; see `losses.position`."""
    return 1e4 * losses.position(estimate, _reference(lesson), lesson.look)


def calibration(estimate: Estimate, lesson: Lesson) -> Float[Array, ""]:
    """Negative log-likelihood of the reference under the stated deviations [nat]; see `losses.calibration`."""
    return losses.calibration(estimate, _reference(lesson), lesson.look, lesson.standing)


def contact_times(estimate: Estimate, lesson: Lesson, empty: float = 0.0) -> Float[Array, ""]:
    """Mean squared error of contacts in units of 10 ms; see `losses.contact_times`."""
    return 1e4 * losses.contact_times(estimate, _reference(lesson), empty)


def _of_strides(field: str, unit: float) -> Term:
    """Mean squared error of strides, in squares of the unit; see `losses.stride`."""

    def term(estimate: Estimate, lesson: Lesson, empty: float = 0.0) -> Float[Array, ""]:
        return losses.stride(estimate, _reference(lesson), field, empty) / unit**2

    return term


def _root(of: Term, **empty: float) -> Term:
    """The root of a mean square, for validation; its gradient at 0 is infinite."""

    def term(estimate: Estimate, lesson: Lesson) -> Float[Array, ""]:
        return jnp.sqrt(of(estimate, lesson, **empty))

    return term


def likelihood(estimate: Estimate, lesson: Lesson) -> Float[Array, ""]:
    """Negative log-likelihood of all measurements, summed over the legs [nat]; needs no reference.

    `Objective` takes the estimator's own `likelihood` instead, where it has one.
    """
    del lesson
    likelihoods = [value for name, value in estimate.diagnostics.items() if name.startswith("log_likelihood")]
    if not likelihoods:
        raise ValueError(f"the estimator tells no log-likelihood; its diagnostics are {sorted(estimate.diagnostics)}")
    return -jax.tree.reduce(jnp.add, [jnp.sum(value) for value in likelihoods])


@record
class Loss(NamedTuple):
    """A loss by which walks are tuned and judged."""

    term: Term  #: the loss of an estimate; smooth, in squared units or in nats.
    error: Term  #: the error that is reported for a walk.
    unit: str  #: unit of the error.
    words: str  #: name of the error.
    #: fields of the reference, one of which is enough, such as "strides.length"; empty: no reference.
    needs: tuple[str, ...]


def _squared(term: Term, unit: str, words: str, *needs: str) -> Loss:
    """A mean square; the error of a walk without any stride that is compared is NaN, its loss 0."""
    empty = {"empty": math.nan} if needs[0].startswith("strides") else {}
    return Loss(term, _root(term, **empty), unit, words, needs)


LOSSES: dict[str, Loss] = {
    "distance": Loss(
        lambda e, lesson: _percent(e, lesson) ** 2, distance_percent, "%", "|error of the distance|", ("distance",)
    ),
    # the loss is the sum of two angles and two axes, the error the root of their mean
    "trajectory": Loss(
        _of_legs(), _root(_of_legs(4)), "° and cm", "RMS error of angles and foot path, 1° counted as 1 cm", ("legs",)
    ),
    "joint_angles": _squared(_of_legs(2, x=0.0, y=0.0), "°", "RMS error of hip and knee angles", "legs"),
    "foot_path": _squared(
        _of_legs(hip_angle=0.0, knee_angle=0.0), "cm", "RMS error of the foot's path in the leg's plane", "legs"
    ),
    "position": _squared(position, "cm", "RMS 3-D error of the feet's paths", "feet"),
    # halving the error of a good walk counts as much as halving that of a bad one
    "position_log": Loss(
        lambda e, lesson: 0.5 * jnp.log1p(position(e, lesson)), _root(position), "cm",
        "RMS 3-D error of the feet's paths", ("feet",),
    ),
    "stride_length": _squared(_of_strides("length", 0.01), "cm", "RMS error of stride length", "strides.length"),
    "stride_width": _squared(_of_strides("width", 0.01), "cm", "RMS error of stride width", "strides.width"),
    "stride_height": _squared(_of_strides("height", 0.01), "cm", "RMS error of stride height", "strides.height"),
    "stride_time": _squared(
        _of_strides("duration", 0.01), "10 ms", "RMS error of stride time", "strides.start", "strides.standing"
    ),
    "contact_times": _squared(contact_times, "10 ms", "RMS error of contact times", "strides.end"),
    "likelihood": Loss(likelihood, likelihood, "nat", "negative log-likelihood", ()),
    "calibration": Loss(
        calibration, calibration, "nat", "negative log-likelihood of the reference, before doubts widen deviations",
        ("strides.length", "legs"),
    ),
}  # fmt: skip
"""Losses by name; `About.losses` lists those that an estimator answers."""

TERMS: dict[str, Term] = {
    **{name: loss.term for name, loss in LOSSES.items()},
    **{f"{name}_error": loss.error for name, loss in LOSSES.items() if loss.error is not loss.term},
    "distance_percent": distance_percent,
    "trajectory_rms": LOSSES["trajectory"].error,
}
"""Terms by name: the losses, and their errors for validation."""


def parsed(text: str) -> dict[str, float]:
    """Losses with their weights from "position=1,stride_length=0.2"; a name alone has the weight 1. Raises ValueError
    if a name is unknown or given twice, or a weight is not a positive number.
    """
    weights: dict[str, float] = {}
    for part in text.split(","):
        name, _, number = (piece.strip() for piece in part.partition("="))
        if name not in LOSSES or name in weights:
            raise ValueError(f"a loss is one of {', '.join(LOSSES)}, each given once; got {name!r}")
        weights[name] = _weight(name, number or 1.0)
    return weights


def _weight(name: str | Term, number: str | float) -> float:
    """The weight of a loss. Raises ValueError if it is not a positive number."""
    try:
        weight = float(number)
    except ValueError:
        weight = math.nan
    if not 0.0 < weight < math.inf:
        raise ValueError(f"the weight of {name!r} must be a positive number; got {number!r}")
    return weight


def lacking(name: str, reference: Estimate | None) -> str:
    """Why a reference cannot judge a loss, in words; "" if it can. References may be stacked."""
    needs = LOSSES[name].needs
    if not needs or (reference is not None and any(_has(reference, path) for path in needs)):
        return ""
    return f"{name} needs a reference with {' or '.join(path.replace('.', ' with ') for path in needs)}"


def asked(walk: Walk, names: Sequence[str]) -> Walk:
    """A walk with only those parts of its reference that the losses `names` need, so that walks can be stacked whose
    references have other parts too. Raises RecordingError if the reference cannot judge one of them.
    """
    reasons = [reason for name in names if (reason := lacking(name, walk.reference))]
    if reasons:
        raise RecordingError("; ".join(reasons))
    needs = {path.partition(".")[0] for name in names for path in LOSSES[name].needs}
    reference = walk.reference
    if reference is None or not needs:
        return walk._replace(reference=None)
    way = None
    if needs & {"strides", "distance"}:  # a distance shows in which strides a body advances as far as a foot
        way = np.full(np.shape(reference.time), np.nan) if reference.distance is None else reference.distance
    kept = reference._replace(
        distance=way, legs=reference.legs if "legs" in needs else Legs(None, None),
        feet=reference.feet if "feet" in needs else None, strides=reference.strides if "strides" in needs else None,
    )  # fmt: skip
    return walk._replace(reference=kept)


def _has(reference: Estimate, path: str) -> bool:
    value: PyTree = reference
    for part in path.split("."):
        value = None if value is None else getattr(value, part)
    leaves = jax.tree.leaves(value)
    return any(leaf.size and np.isfinite(leaf).any() for leaf in map(np.asarray, leaves))


@dataclass(frozen=True)
class Objective:
    """(params, lesson) → scalar, for `tune.fit`, `tune.cross_validate` and `tune.identifiability`.

    Two objectives with equal fields are equal and share compiled programs.
    """

    run: Callable[..., Estimate]  #: `run` of the estimator.
    with_body: Callable[..., PyTree]  #: `with_body` of the estimator.
    options: Hashable  #: options of the estimator.
    terms: tuple[tuple[str | Term, float], ...]  #: (name or function, weight) of each term.
    likelihood: Callable[..., Float[Array, ""]] | None = None  #: `likelihood` of the estimator.

    def __call__(self, params: PyTree, lesson: Lesson) -> Float[Array, ""]:
        """The weighted sum of the terms, with the person's body measures in the parameters."""
        subject_params = self.with_body(params, lesson.body)
        estimate = self.run(subject_params, lesson.inputs, self.options)

        def value(term: str | Term) -> PyTree:
            if term == "likelihood" and self.likelihood is not None:
                return -self.likelihood(subject_params, lesson.inputs, self.options)
            return (TERMS[term] if isinstance(term, str) else term)(estimate, lesson)

        parts = [weight * value(term) for term, weight in self.terms]
        return jax.tree.reduce(jnp.add, parts)


def objective(
    estimator: Estimator[PyTree, PyTree], options: PyTree, terms: str | Mapping[str, float] | Mapping[str | Term, float]
) -> Objective:
    """A loss over lessons; `terms` is the name of one term, or maps names or functions (estimate, lesson) → scalar to
    weights.

    A name of `LOSSES` is a smooth loss, of most in the square of the unit that `LOSSES` states: "stride_length" in cm².
    With "_error" it is the error in that unit, "stride_length_error" in cm, as `cross_validate(error=…)` wants it;
    "distance_percent" and "trajectory_rms" are other names of "distance_error" and "trajectory_error".

    Raises:
        ValueError: if a name is unknown, there is no term, a weight is not a positive number, or the estimator cannot
            answer one of the terms.
    """
    weights: dict[str | Term, float] = {terms: 1.0} if isinstance(terms, str) else {**terms}  # type: ignore[dict-item]
    unknown = [name for name in weights if isinstance(name, str) and name not in TERMS]
    if unknown or not weights:
        raise ValueError(f"terms must be among {', '.join(TERMS)}, or functions; got {unknown or 'none'}")
    answers = estimator.about.losses
    for name in weights:
        loss = str(name).removesuffix("_error")
        if answers is not None and loss in LOSSES and loss not in answers:
            raise ValueError(f"{estimator.name} cannot answer {loss!r}; it answers {', '.join(answers)}")
    parts = tuple((n, _weight(n, w)) for n, w in weights.items())
    return Objective(estimator.run, estimator.with_body, options, parts, estimator.likelihood)
