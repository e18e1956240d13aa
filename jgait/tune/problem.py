"""The minimised function: a weighted mean of one loss over items, in free coordinates without bounds.

A parameter is shared by all items, or each subject has a value (`params.per_subject`). Each item's loss is
differentiated with respect to the shared numbers and those of the item's subject only; then the gradients are
summed. So a fit with a leg length for each of a hundred subjects costs no more than a fit with a single leg length.
"""

import math
from collections.abc import Callable
from functools import lru_cache, partial, wraps
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray, PyTree

from jgait.params import Prior, Transform, check_params, constrain
from jgait.tune.checks import is_transform, over_transforms, start, transforms_of
from jgait.types import AnyArray, Integer, Maybe, Scalar, Values


class Problem(NamedTuple):
    """The constants of a fit, see `tune.fit`; static."""

    loss: Callable[..., PyTree]
    transforms: PyTree
    priors: PyTree = None
    mesh: Mesh | None = None


class Items(NamedTuple):
    """The items of a fit, and the number of each item's subject, int32; every leaf has a leading axis (n,)."""

    data: PyTree
    subject: Int[AnyArray, "item"]


class Context(NamedTuple):
    """The arrays that a fit reads and never changes: fixed values, training and validation items, key of the
    minibatches.

    A parameter per subject has a leading axis.
    """

    params: PyTree
    items: Items
    checked: Items | None = None
    key: Maybe[PRNGKeyArray] = None


def kept[**P, R](build: Callable[P, R]) -> Callable[P, R]:
    """Keep what is built, as a compiled program, for the next call with equal arguments, if these can be compared."""
    cached = lru_cache(maxsize=16)(build)

    @wraps(build)
    def get(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return cached(*args, **kwargs)  # type: ignore[arg-type]
        except TypeError:
            return build(*args, **kwargs)

    return get


def of_subject(tree: PyTree, transforms: PyTree, subject: Integer) -> PyTree:
    """The parameters, or free coordinates, of one subject."""

    def pick(transform: Transform, value: AnyArray | float | None) -> AnyArray | float | None:
        return jnp.asarray(value)[subject] if transform.per_subject and value is not None else value

    return over_transforms(pick, transforms, tree)


def _one(problem: Problem, free: PyTree, params: PyTree, item: PyTree) -> PyTree:
    """The loss of an item; NaN for an item whose real numbers are all NaN or infinite, and for parameters that have run
    to an infinite end of their range, or to 0: of both a loss may make a 0, which would be the least.
    """
    natural = constrain(free, problem.transforms, params)
    loss = problem.loss(natural, item)
    reals = [leaf for leaf in jax.tree.leaves(item) if jnp.issubdtype(leaf.dtype, jnp.floating) and leaf.size]
    sound = [jnp.any(jnp.stack([jnp.isfinite(leaf).any() for leaf in reals]))] if reals else []

    def inside(transform: Transform, value: Values, moved: PyTree) -> None:
        if moved is not None and not (math.isfinite(transform.low) and math.isfinite(transform.high)):
            sound.append(jnp.all(jnp.isfinite(value) & (value != transform.low)))

    over_transforms(inside, problem.transforms, natural, free)
    return jnp.where(jnp.all(jnp.stack(sound)), loss, jnp.nan) if sound else loss


def _everyone(problem: Problem, function: Callable[..., PyTree]) -> Callable[..., PyTree]:
    """Map a function of (free, params, item) over items, with the values of each item's subject; on the mesh if any."""

    def each(free: PyTree, params: PyTree, item: Items) -> PyTree:
        free_of_subject, known = (of_subject(tree, problem.transforms, item.subject) for tree in (free, params))
        return function(free_of_subject, known, item.data)

    mapped = jax.vmap(each, in_axes=(None, None, 0))
    if problem.mesh is None:
        return mapped
    along, all_of_it = PartitionSpec(problem.mesh.axis_names[0]), PartitionSpec()
    return jax.shard_map(
        mapped, mesh=problem.mesh, in_specs=(all_of_it, all_of_it, along), out_specs=along, check_vma=False
    )


def item_losses(problem: Problem, free: PyTree, params: PyTree, items: Items) -> Float[Array, "item"]:
    """(n,) loss of every item."""
    return _everyone(problem, partial(_one, problem))(free, params, items)


def penalty(problem: Problem, free: PyTree, params: PyTree) -> Float[Array, ""]:
    """Minus the logarithm of the priors' density [nat], summed over parameters and subjects."""
    natural = constrain(free, problem.transforms, params)
    terms: list[Array] = []

    def add(_: Transform, value: Values | None, prior: Prior | None, moved: PyTree) -> None:
        if prior is not None and moved is not None:
            terms.append(jnp.sum(prior.penalty(value)))

    over_transforms(add, problem.transforms, natural, problem.priors, free)
    return sum(terms[1:], terms[0]) if terms else jnp.zeros(())


def value_of(losses: Float[Array, "item"], weights: Float[Array, "item"]) -> Float[Array, ""]:
    """Weighted mean of (n,) losses; the loss of an item with weight 0 may be any value, also NaN."""
    counted = jnp.where(weights > 0.0, losses, jnp.zeros_like(losses))
    return jnp.sum(weights * counted) / jnp.maximum(jnp.sum(weights), jnp.finfo(losses.dtype).tiny)


def value(
    problem: Problem, free: PyTree, params: PyTree, items: Items, weights: Float[Array, "item"], count: Scalar
) -> Float[Array, ""]:
    """The minimised value of `total`, without a gradient."""
    loss = value_of(item_losses(problem, free, params, items), weights)
    if problem.priors is not None:
        loss = loss + (penalty(problem, free, params) / jnp.maximum(count, 1.0)).astype(loss.dtype)
    return loss


def _summed(problem: Problem, free: PyTree, slopes: PyTree, items: Items, shares: Float[Array, "item"]) -> PyTree:
    """Σ shareᵢ slopeᵢ over the items, in the type of `free`; of a parameter per subject over the subject's items."""

    def gather(transform: Transform, value: PyTree, slope: PyTree) -> PyTree:
        if value is None:
            return None
        share = shares.astype(slope.dtype).reshape((-1,) + (1,) * (slope.ndim - 1))
        part = jnp.where(share > 0.0, share * slope, jnp.zeros_like(slope))
        return jnp.zeros_like(value).at[items.subject].add(part) if transform.per_subject else jnp.sum(part, axis=0)

    return over_transforms(gather, problem.transforms, free, slopes)


def total(
    problem: Problem, free: PyTree, params: PyTree, items: Items, weights: Float[Array, "item"], count: Scalar,
    forgiving: Bool[Array, ""],
) -> tuple[Float[Array, ""], PyTree, PyTree, Bool[Array, "item"]]:  # fmt: skip
    """The minimised value, its gradient, the gradient's squared standard error over the items, and whether each item's
    loss and gradient are finite, (n,) bool.

    Σ wᵢ lossᵢ / Σ wᵢ + penalty / count: with losses in nats, the logarithm of the posterior density per item. `count`
    is the sum of the weights of all items; if `forgiving`, items that are not finite are left out.
    """
    both = jax.value_and_grad(partial(_one, problem))
    losses, slopes = _everyone(problem, both)(free, params, items)
    axes = [jnp.isfinite(s).reshape((s.shape[0], -1)).all(axis=1) for s in jax.tree.leaves(slopes)]
    sound = jax.tree.reduce(jnp.logical_and, axes, jnp.isfinite(losses))
    used = jnp.where(forgiving & ~sound, jnp.zeros_like(weights), weights)
    loss = value_of(losses, used)
    shares = used / jnp.maximum(jnp.sum(used), jnp.finfo(used.dtype).tiny)
    gradient = _summed(problem, free, slopes, items, shares)
    # Near an optimum the mean of the items' gradients is 0, so that their mean square is their variance.
    variance = _summed(problem, free, jax.tree.map(jnp.square, slopes), items, shares**2)
    if problem.priors is not None:
        share = 1.0 / jnp.maximum(count - jnp.sum(weights - used), 1.0)
        more, slope = jax.value_and_grad(lambda f: penalty(problem, f, params))(free)
        loss = loss + (share * more).astype(loss.dtype)
        gradient = jax.tree.map(lambda g, s: g + (share * s).astype(g.dtype), gradient, slope)
    return loss, gradient, variance, sound


def place(problem: Problem, items: Items) -> Items:
    """Items as arrays on their devices; the number of items must be a multiple of the number of devices."""
    if problem.mesh is None:
        return jax.tree.map(jnp.asarray, items)
    sharding = NamedSharding(problem.mesh, PartitionSpec(problem.mesh.axis_names[0]))

    def put(leaf: AnyArray) -> Array:
        host = np.asarray(leaf)
        host = host.astype(jax.dtypes.canonicalize_dtype(host.dtype))
        return jax.make_array_from_callback(host.shape, sharding, lambda index: host[index])

    return jax.tree.map(put, items)


class Coordinates(NamedTuple):
    """The free numbers of a parameter set, in the order of the leaves."""

    names: tuple[str, ...]  #: name of each number: "thigh_length.right", "angle_noise", or "level[0]" in an array.
    transforms: tuple[Transform, ...]  #: transform of each number.
    tree: PyTree  #: free values as `jgait.params.unconstrain` returns them; `vector`: the same as one vector (p,).
    vector: Float[AnyArray, "free"]


def coordinates(params: PyTree, transforms: PyTree) -> Coordinates:
    """The names and the vector of all free numbers of parameters in natural units.

    Raises:
        TypeError: if `params` and `transforms` do not match.
        ValueError: if a value is outside its range, everything is fixed, or a parameter is declared `per_subject`.
    """
    check_params(params, transforms)
    if any(t.per_subject for t in transforms_of(transforms)):
        raise ValueError("parameters per subject: give the parameters and the items of one subject, and fix the shared")
    tree = start(params, transforms)
    leaves, _ = jax.tree_util.tree_flatten_with_path(tree)
    by_path = dict(jax.tree_util.tree_flatten_with_path(transforms, is_leaf=is_transform)[0])
    names: list[str] = []
    each: list[Transform] = []
    for path, leaf in leaves:
        for index in np.ndindex(leaf.shape):
            place = f"[{', '.join(map(str, index))}]" if index else ""
            names.append(jax.tree_util.keystr(path).lstrip(".") + place)
            each.append(by_path[path])
    return Coordinates(tuple(names), tuple(each), tree, ravel_pytree(tree)[0])


def natural(at: Coordinates, vectors: Float[AnyArray, "*point free"], transforms: PyTree, params: PyTree) -> PyTree:
    """Parameters in natural units from free vectors (…, p); a leading axis goes in front of every free leaf."""
    unflatten: Callable[[PyTree], PyTree] = ravel_pytree(at.tree)[1]
    for _ in range(jnp.ndim(vectors) - 1):
        unflatten = jax.vmap(unflatten)
    return constrain(unflatten(jnp.asarray(vectors, at.vector.dtype)), transforms, params)


def natural_numbers(at: Coordinates, vector: Float[AnyArray, "free"]) -> tuple[np.ndarray, np.ndarray]:
    """Natural values (p,) of free numbers (p,), which may be infinite, and the slopes (p,) of the transforms there."""
    values, slopes = np.empty((2, len(at.names)))
    for k, (transform, value) in enumerate(zip(at.transforms, jnp.asarray(vector, at.vector.dtype), strict=True)):
        assert transform.to_natural is not None
        values[k], slopes[k] = jax.jvp(transform.to_natural, (value,), (jnp.ones_like(value),))
    return values, slopes
