"""The loss of one walk: a weighted sum of terms of its estimate."""

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

from jgait.estimators.interface import Estimator
from jgait.tune import losses
from jgait.tune.lessons import Lesson
from jgait.types import Estimate

Term = Callable[[Estimate, Lesson], Float[Array, ""]]
"""(estimate, lesson) → scalar; pure JAX."""


def _percent(estimate: Estimate, lesson: Lesson) -> Float[Array, ""]:
    """Signed error of the distance walked from the lesson's first to its last sample [%]."""
    if estimate.distance is None or lesson.reference is None or lesson.reference.distance is None:
        raise ValueError("a distance error needs a distance of the estimator and of the reference")
    ours, theirs = (jnp.asarray(one.distance) for one in (estimate, lesson.reference))
    walked, true = (way[lesson.last] - way[lesson.first] for way in (ours, theirs))
    return 100.0 * (walked / true - 1.0)


def distance(estimate: Estimate, lesson: Lesson) -> Float[Array, ""]:
    """Squared error of the distance walked from the lesson's first to its last sample [%²]."""
    return _percent(estimate, lesson) ** 2


def distance_percent(estimate: Estimate, lesson: Lesson) -> Float[Array, ""]:
    """Absolute error of the distance walked [%], for validation."""
    return jnp.abs(_percent(estimate, lesson))


def trajectory(estimate: Estimate, lesson: Lesson) -> Float[Array, ""]:
    """Squared error of angles and foot path in the lesson's `look`, relative to standing; see `losses.trajectory`."""
    if lesson.reference is None:
        raise ValueError("a trajectory error needs a reference")
    return losses.trajectory(estimate, lesson.reference, window=lesson.look, relative_to=lesson.standing)


def trajectory_rms(estimate: Estimate, lesson: Lesson) -> Float[Array, ""]:
    """Root mean square error over hip and knee [°] and foot path [cm], 1° weighted as 1 cm, for validation."""
    return jnp.sqrt(trajectory(estimate, lesson) / len(losses.TrajectoryWeights._fields))


def likelihood(estimate: Estimate, lesson: Lesson) -> Float[Array, ""]:
    """Negative log-likelihood of all measurements, summed over the legs [nat]; needs no reference."""
    del lesson
    found = [value for name, value in estimate.diagnostics.items() if name.startswith("log_likelihood")]
    if not found:
        raise ValueError(f"the estimator tells no log-likelihood; its diagnostics are {sorted(estimate.diagnostics)}")
    return -jax.tree.reduce(jnp.add, [jnp.sum(value) for value in found])


TERMS: dict[str, Term] = {
    "distance": distance,
    "distance_percent": distance_percent,
    "likelihood": likelihood,
    "trajectory": trajectory,
    "trajectory_rms": trajectory_rms,
}
"""Terms by name."""


@dataclass(frozen=True)
class Objective:
    """(params, lesson) → scalar, for `tune.fit`, `tune.cross_validate` and `tune.identifiability`.

    Two objectives with equal fields are equal and share compiled programs.

    Attributes:
        run: `run` of the estimator.
        own: `own` of the estimator.
        options: options of the estimator.
        terms: (name or function, weight) of each term.
    """

    run: Callable[..., Estimate]
    own: Callable[..., PyTree]
    options: Hashable
    terms: tuple[tuple[str | Term, float], ...]

    def __call__(self, params: PyTree, lesson: Lesson) -> Float[Array, ""]:
        """The weighted sum of the terms, with the person's body measures in the parameters."""
        estimate = self.run(self.own(params, lesson.own), lesson.inputs, self.options)
        parts = [
            weight * (TERMS[term] if isinstance(term, str) else term)(estimate, lesson) for term, weight in self.terms
        ]
        return jax.tree.reduce(jnp.add, parts)


def objective(
    estimator: Estimator[PyTree, PyTree], options: PyTree, terms: str | Mapping[str | Term, float]
) -> Objective:
    """A loss over lessons; `terms` is the name of one term (see `TERMS`), or maps names or `Term` to weights.

    Raises:
        ValueError: if a name is unknown, or there is no term.
    """
    weights: dict[str | Term, float] = {terms: 1.0} if isinstance(terms, str) else dict(terms)
    unknown = [name for name in weights if isinstance(name, str) and name not in TERMS]
    if unknown or not weights:
        raise ValueError(f"terms must be among {', '.join(TERMS)}, or functions; got {unknown or 'none'}")
    return Objective(estimator.run, estimator.own, options, tuple((n, float(w)) for n, w in weights.items()))


@dataclass(frozen=True)
class _OfSubject:
    """(params, (items, counts)) → sum of a loss over the items of one subject; `counts` is False for padding."""

    loss: Callable[[PyTree, PyTree], PyTree]

    def __call__(self, params: PyTree, own: tuple[PyTree, PyTree]) -> PyTree:
        items, counts = own
        each: PyTree = jax.vmap(lambda item: self.loss(params, item))(items)
        return jnp.sum(jnp.where(counts, each, jnp.zeros_like(each)))


def by_subject(
    loss: Callable[[PyTree, PyTree], PyTree], data: PyTree, subjects: Sequence[Hashable]
) -> tuple[Callable[[PyTree, PyTree], PyTree], PyTree]:
    """The sum of a loss over each subject's items, for `tune.identifiability`: walks of a person are not independent.

    Returns:
        (params, items of a subject) → scalar, and the data with a leading axis of subjects, in order of appearance.

    Raises:
        ValueError: if there is not one subject for each item.
    """
    n = np.shape(jax.tree.leaves(data)[0])[0]
    if len(subjects) != n:
        raise ValueError(f"subjects needs one label for each of the {n} items; got {len(subjects)}")
    rows: dict[Hashable, list[int]] = {}
    for item, subject in enumerate(subjects):
        rows.setdefault(subject, []).append(item)
    most = max(map(len, rows.values()))
    index = np.asarray([own + own[:1] * (most - len(own)) for own in rows.values()])
    counts = np.asarray([[i < len(own) for i in range(most)] for own in rows.values()])
    whole: PyTree = _OfSubject(loss)
    return whole, (jax.tree.map(lambda leaf: np.asarray(leaf)[index], data), counts)
