"""Which parameters the data determine, from the curvature of the loss at the best parameters.

Unless natural units are stated, results are in free coordinates (see `jgait.params`): a standard error of 1 is a
factor e for a positive parameter, one unit of the logit for an interval, one unit of the value for a real parameter.
"""

import math
from collections.abc import Callable, Hashable, Sequence
from functools import partial
from statistics import NormalDist
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, PyTree

from jgait.notes import record, resolved
from jgait.params import Transform, constrain, positive
from jgait.tune.checks import check_data, check_priors, is_transform, numbered
from jgait.tune.problem import Coordinates, Items, Problem, coordinates, natural_numbers, penalty
from jgait.tune.remainder import reduced

TOGETHER = 0.95
"""Least absolute correlation at which two parameters are reported as correlated."""

LARGE = 0.3
"""Least absolute component of a unit vector at which a direction's name includes the parameter [1]."""

OFF = 0.25
"""Least gᵀ B⁻¹ g at which a point is reported as not an optimum: half a standard error away [1]."""


class Direction(NamedTuple):
    """A combination of parameters in free coordinates."""

    names: tuple[str, ...]  #: names of the parameters with large components.
    weights: tuple[float, ...]  #: those components of the unit vector, the largest positive.
    stddev: float  #: standard deviation along the direction; infinite without information.
    words: str  #: the combination as text, for example "0.71 a1 − 0.71 rollover_radius".


@record
class Identifiability(NamedTuple):
    """How well the data determine p free numbers; `sentences` reports it in words."""

    names: tuple[str, ...]  #: names of the numbers, such as "thigh_length.right" or "level[0]".
    transforms: tuple[str, ...]  #: name of each number's transform.
    values: np.ndarray  #: (p,) the numbers in natural units.
    free: np.ndarray  #: (p,) the numbers in free coordinates.
    loss: float  #: sum of the items' losses and the prior's penalty [nat].
    gradient: np.ndarray  #: (p,) gradient of that sum in free coordinates.
    #: gᵀ B⁻¹ g over the determined directions, B the covariance of the gradient: squared length of the step to the
    #: optimum in standard errors. Well below 1 at an optimum.
    decrement: float
    information: np.ndarray  #: (p, p) in free coordinates: second derivatives of the loss.
    #: (p, p) in free coordinates; directions without information have a huge but finite variance.
    covariance: np.ndarray
    correlation: np.ndarray  #: (p, p); ±1 for exactly singular pairs.
    stderr_free: np.ndarray  #: (p,) standard errors in free coordinates; infinite without information.
    stderr: np.ndarray  #: (p,) standard errors in natural units, by the slope of the transform.
    low: np.ndarray  #: (p,) lower ends of the confidence intervals in natural units, inside the bounds.
    high: np.ndarray  #: (p,) upper ends of the confidence intervals.
    determined: np.ndarray  #: (p,) bool, whether the standard error is within the limit.
    directions: tuple[Direction, ...]  #: the directions that are not determined, the largest standard deviation first.
    minimum: bool  #: False where the loss curves downwards or its curvature is not finite.
    undetermined: list[str]  #: names of the numbers that are not determined.
    sentences: list[str]  #: the results in words.
    level: float  #: confidence level of the intervals.


def _spread(
    information: np.ndarray, noise: np.ndarray, gradient: np.ndarray, rounding: float, limit: float
) -> tuple[np.ndarray, np.ndarray, float, np.ndarray]:
    """Invert the information (p, p) in the directions whose eigenvalue is positive; `noise` is the gradient's
    covariance.

    The matrix is scaled to a unit diagonal first, so that the threshold `rounding`, relative to its largest eigenvalue,
    does not depend on parameter units.

    Returns:
        The covariance (p, p) of the directions with information, that, huge, of those without, the decrement (see
        `Identifiability`), and (k, p) the directions along which the loss curves downwards.
    """
    scale = np.sqrt(np.abs(np.diag(information)))
    scale = 1.0 / np.where(scale > 0.0, scale, 1.0)
    values, vectors = np.linalg.eigh(information * np.outer(scale, scale))
    has = values > rounding * np.abs(values).max()
    good = vectors[:, has] / values[has]
    bread = np.outer(scale, scale) * (good @ vectors[:, has].T)
    known = bread @ noise @ bread
    # The variance is huge relative to all known ones, so that directions without information give correlations of ±1.
    # Components at rounding level are set to zero: such a parameter is not part of the direction.
    empty = np.where(np.abs(vectors[:, ~has]) < 1e-5, 0.0, vectors[:, ~has])
    huge = 1e12 * max(1.0, float(np.max(np.diag(known) / scale**2)))
    unknown = huge * np.outer(scale, scale) * (empty @ empty.T)
    steps = vectors[:, has].T @ (scale * gradient)
    meat = vectors[:, has].T @ (np.outer(scale, scale) * noise) @ vectors[:, has]
    decrement = float(steps @ np.linalg.pinv(meat, hermitian=True) @ steps) if has.any() else 0.0
    along = (scale[:, None] * vectors[:, values < -rounding * np.abs(values).max()]).T
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    # Negative curvature below a millionth of that of a determined direction is rounding, and not reported.
    falls = np.einsum("ki,ij,kj->k", along, information, along) < -1e-6 / limit**2
    return known, unknown, decrement, along[falls]


@partial(jax.jit, static_argnums=(0, 1, 2, 3))
def _derivatives(
    loss: Callable[..., PyTree], priors: tuple[PyTree, ...] | None, leaves: tuple[Transform, ...], structure: PyTree,
    free: PyTree, params: PyTree, data: PyTree,
) -> tuple[Array, Array, Array, tuple[Array, Array, Array]]:  # fmt: skip
    """Each item's loss (items,) and its gradient (items, p), the second derivatives (p, p) of their sum; and the value,
    gradient and second derivatives of the prior's penalty, all in free coordinates. `leaves` are the transforms.
    """
    transforms = jax.tree.unflatten(structure, leaves)
    problem = Problem(loss, transforms, None if priors is None else jax.tree.unflatten(structure, priors))
    flat, unflatten = ravel_pytree(free)

    def item_loss(vector: Float[Array, "free"], item: PyTree) -> Float[Array, ""]:
        return loss(constrain(unflatten(vector), transforms, params), item)

    def both(vector: Float[Array, "free"]) -> tuple[Array, Array]:
        return jax.vmap(jax.value_and_grad(item_loss), in_axes=(None, 0))(vector, data)

    def along(direction: Float[Array, "free"]) -> tuple[Array, ...]:
        (losses, scores), (_, bends) = jax.jvp(both, (flat,), (direction,))
        return losses, scores, jnp.sum(bends, axis=0)

    def prior(vector: Float[Array, "free"]) -> Float[Array, ""]:
        given = jnp.zeros(()) if priors is None else penalty(problem, unflatten(vector), params)
        return given.astype(vector.dtype)

    losses, scores, bends = jax.lax.map(along, jnp.eye(flat.size, dtype=flat.dtype))  # one evaluation is compiled
    slope = jax.jacfwd(prior)
    return losses[0], scores[0], (bends + bends.T) / 2.0, (prior(flat), slope(flat), jax.jacfwd(slope)(flat))


def identifiability(
    loss: Callable[[PyTree, PyTree], PyTree], params: PyTree, transforms: PyTree, data: PyTree, *,
    batched: bool = True, subjects: Sequence[Hashable] | None = None, information: str = "hessian",
    level: float = 0.95, limit: float = 1.0, priors: PyTree = None,
) -> Identifiability:  # fmt: skip
    """Standard errors of the best parameters, and the directions that the data do not determine.

        hessian    observed information Σ ∂²ℓᵢ; its inverse is the covariance. For negative log-likelihoods.
        sandwich   H⁻¹ (Σ ∂ℓᵢ ∂ℓᵢᵀ) H⁻¹, H = Σ ∂²ℓᵢ; for any loss of independent items, such as trajectory errors. With
                   few items, or subjects, n the standard errors are too small, by a factor of about √(1 − p/n).

    A direction (an eigenvector of the information) is not determined when its standard deviation exceeds `limit` in
    free coordinates or its eigenvalue is not positive beyond rounding; a parameter when its standard error does so.

    Args:
        loss: (params, item) → the item's total negative log-likelihood [nat], not a mean over its samples: a loss
            divided by n makes every standard error √n too large, except for "sandwich".
            Pure JAX; a function kept between calls is compiled once.
        params: NamedTuple of the best parameters in natural units (`Fit.params`).
        transforms: the same type, holding a `Transform` for each.
        data: pytree of arrays with a leading axis of items; one item without that axis if not `batched`.
        batched: whether `data` has an axis of items.
        subjects: (n,) subject of each item; items of one subject are not independent, and count as one in "sandwich".
            None: every item is independent.
        information: "hessian" or "sandwich".
        level: confidence level of the intervals, which are symmetric in free coordinates and so inside the bounds.
        limit: largest standard error in free coordinates that counts as determined.
        priors: the type of `params`, holding a `jgait.params.Prior` or None for each, as in `fit`, each added once.

    Returns:
        The standard errors, intervals, directions and sentences.

    Raises:
        TypeError: if `params`, `transforms` and `priors` do not match, or `data` holds anything but numbers.
        ValueError: if nothing is free, a value is outside its range, the loss is not one finite scalar, an
            option is unknown, or there are too few items to compare scores.

    Source: White (1982), Econometrica 50, for the sandwich. Tests: tests/tune/test_identifiability.py.
    """
    if information not in ("hessian", "sandwich"):
        raise ValueError(f"information must be one of hessian, sandwich; got {information!r}")
    if not (0.0 < level < 1.0 and 0.0 < limit < math.inf):
        raise ValueError(f"level must lie in (0, 1) and limit be positive; got level={level}, limit={limit}")
    check_priors(priors, transforms)
    at = coordinates(params, transforms)
    data, count = check_data(data, batched)
    whose = np.arange(count) if subjects is None else numbered(subjects, count)[1]
    problem = Problem(loss, transforms, priors)
    problem, items, _ = reduced(problem, params, at.tree, Items(data, np.zeros(count, np.int32)))
    structure: PyTree
    leaves, structure = jax.tree.flatten(transforms, is_leaf=is_transform)
    prior_leaves = None if priors is None else tuple(structure.flatten_up_to(priors))
    parts = _derivatives(problem.loss, prior_leaves, tuple(leaves), structure, at.tree, params, items.data)
    losses, scores, bends, prior = jax.tree.map(lambda part: np.asarray(part, float), parts)
    total, slope, whole = losses.sum() + prior[0], scores.sum(axis=0) + prior[1], bends + prior[2]
    if not math.isfinite(total):
        raise ValueError(f"the loss is not finite at these parameters (total {total})")
    scores = np.stack([scores[whose == subject].sum(axis=0) for subject in range(whose.max() + 1)])
    if information == "sandwich" and len(scores) <= slope.size:
        raise ValueError(
            "information='sandwich' needs more items, or subjects, than free numbers, whose scores it compares; got "
            f"{len(scores)} for {slope.size} numbers"
        )
    noise = whole if information == "hessian" else scores.T @ scores
    # assumed largest rounding error of second derivatives
    rounding = 1000.0 * len(slope) * float(np.finfo(at.vector.dtype).eps)
    return _statement(at, float(total), slope, whole, noise, rounding, level, limit)


def _statement(
    at: Coordinates, total: float, slope: np.ndarray, information: np.ndarray, noise: np.ndarray,
    rounding: float, level: float, limit: float,
) -> Identifiability:  # fmt: skip
    finite = bool(np.isfinite(slope).all() and np.isfinite(information).all() and np.isfinite(noise).all())
    usable, gradient = (information, slope) if finite else (np.zeros_like(information), np.zeros_like(slope))
    informed, blind, decrement, downwards = _spread(usable, noise if finite else usable, gradient, rounding, limit)
    covariance = informed + blind
    deviation = np.sqrt(np.diag(covariance))
    deviation = np.where(deviation > 0.0, deviation, 1.0)
    correlation = np.clip(covariance / np.outer(deviation, deviation), -1.0, 1.0)
    np.fill_diagonal(correlation, 1.0)
    free = np.asarray(at.vector, float)
    stderr_free = np.where(np.diag(blind) > 0.0, np.inf, np.sqrt(np.diag(covariance)))
    values, slopes = natural_numbers(at, free)
    infinite = np.isinf(stderr_free)
    stderr = np.where(infinite, np.inf, np.abs(slopes) * np.where(infinite, 0.0, stderr_free))
    reach = NormalDist().inv_cdf(0.5 + level / 2.0) * stderr_free
    # where the reach is infinite, the bound
    ends = [np.where(np.isnan(at_end), [getattr(t, name) for t in at.transforms], at_end) for name, at_end in (
        ("low", natural_numbers(at, free - reach)[0]), ("high", natural_numbers(at, free + reach)[0])
    )]  # fmt: skip
    low, high = np.minimum(*ends), np.maximum(*ends)
    _, eigenvectors = np.linalg.eigh(usable)
    known, unknown = (np.einsum("ik,ij,jk->k", eigenvectors, part, eigenvectors) for part in (informed, blind))
    deviations = np.where(unknown > known, np.inf, np.sqrt(np.maximum(known, 0.0)))
    loose = tuple(
        _direction(at.names, eigenvectors[:, k], float(deviations[k]))
        for k in np.argsort(-deviations, kind="stable")
        if deviations[k] > limit
    )
    determined = stderr_free <= limit
    result = Identifiability(
        at.names, tuple(t.name for t in at.transforms), values, free, total, slope, decrement,
        information, covariance, correlation, stderr_free, stderr, low, high,
        determined, loose, finite and not len(downwards),
        [name for name, known in zip(at.names, determined, strict=True) if not known], [], level,
    )  # fmt: skip
    # Where neither is determined, `directions` has their combination.
    pairs = np.argwhere(np.triu(np.abs(correlation) >= TOGETHER, 1))
    together = [(int(i), int(j)) for i, j in pairs if determined[i] or determined[j]]
    falling = [_direction(at.names, vector, math.inf) for vector in downwards]
    return result._replace(sentences=_sentences(result, at.transforms, together, falling, finite, limit))


def _direction(names: tuple[str, ...], vector: np.ndarray, stddev: float) -> Direction:
    """Describe a unit vector by its large components, or by the largest ones if all are small."""
    vector = vector * (1.0 if vector[np.argmax(np.abs(vector))] > 0.0 else -1.0)
    order = np.argsort(-np.abs(vector), kind="stable")
    large = [int(i) for i in order if abs(vector[i]) >= LARGE] or [int(i) for i in order[:3]]
    words = names[large[0]] if len(large) == 1 else f"{vector[large[0]]:.2f} {names[large[0]]}"
    for i in large[1:]:
        words += f" {'−' if vector[i] < 0.0 else '+'} {abs(vector[i]):.2f} {names[i]}"
    return Direction(tuple(names[i] for i in large), tuple(float(vector[i]) for i in large), stddev, words)


def _is_positive(transform: Transform) -> bool:
    """Whether the free value is the logarithm."""
    return transform.to_free is positive.to_free


def _unknown(name: str, transform: Transform, stderr: float, low: float, high: float, level: float) -> str:
    """That a parameter is not determined, with its standard error or interval."""
    sentence = f"{name} is not determined by these data: "
    if math.isinf(stderr):
        return sentence + "its standard error is infinite"
    if math.isfinite(transform.low) and math.isfinite(transform.high):
        ends = " to ".join(resolved(end, high - low) for end in (low, high))
        return sentence + f"its {100 * level:g} % interval is {ends} of {transform.name}"
    if _is_positive(transform):
        factor = f"a factor of {math.exp(stderr):.3g}" if stderr < 14.0 else "more than a factor of a million"
        return sentence + f"its standard error is {factor}"
    return sentence + f"its standard error is {stderr:.3g}"


def _known(name: str, transform: Transform, value: float, stderr_free: float, stderr: float) -> str:
    """A sentence stating the value of a parameter and one standard error."""
    if _is_positive(transform) and stderr_free >= LARGE:
        return f"{name} {value:.4g} within a factor of {math.exp(stderr_free):.2g}"
    if _is_positive(transform):
        return f"{name} {resolved(value, value * stderr_free, 4)} ± {100.0 * stderr_free:.2g} %"
    return f"{name} {resolved(value, stderr, 4)} ± {stderr:.2g}"


def _sentences(
    result: Identifiability, transforms: tuple[Transform, ...], together: list[tuple[int, int]],
    falling: list[Direction], finite: bool, limit: float,
) -> list[str]:  # fmt: skip
    """An `Identifiability` in sentences: problems, undetermined parameters, the pairs `together` whose correlation is
    stated, determined parameters. Along `falling` directions the loss curves downwards; `finite`: all derivatives are.
    """
    lines: list[str] = []
    if not finite:
        lines.append("nothing can be said: the derivatives of the loss are not finite at these parameters")
    for fall in falling:
        lines.append(f"the point is no minimum: the loss curves downwards along {fall.words}")
    if not result.decrement <= OFF:
        lines.append(
            "the point is no optimum: the gradient asks for a step of "
            f"{math.sqrt(result.decrement):.2g} standard errors"
        )
    rows = list(zip(result.names, transforms, result.determined, strict=True))
    for i, (name, transform, good) in enumerate(rows):
        if not good:
            lines.append(_unknown(name, transform, result.stderr_free[i], result.low[i], result.high[i], result.level))
    for loose in result.directions:
        if len(loose.names) > 1 and finite:
            spread = "infinite" if math.isinf(loose.stddev) else f"{loose.stddev:.3g}, above {limit:g}"
            lines.append(f"the combination {loose.words} is not determined: its standard deviation is {spread}")
    for i, j in together:
        value = result.correlation[i, j]
        verb = "move together" if value > 0.0 else "move against each other"
        number = f"{value:.2f}".replace("-", "−")
        lines.append(f"{result.names[i]} and {result.names[j]} {verb}, correlation {number}")
    for i, (name, transform, good) in enumerate(rows):
        if good:
            lines.append(_known(name, transform, result.values[i], result.stderr_free[i], result.stderr[i]))
    return lines
