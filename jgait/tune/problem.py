"""What is minimised: a weighted mean of one loss over items, in coordinates where every value is allowed.

Parameters are shared by all items, or belong to the item's subject (`params.per_subject`). Every item is
differentiated with respect to the few numbers that concern it; the sums over items, and over the items of each
subject, come after. So a fit with a leg length for each of a hundred people costs no more than one with a single one.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from jgait.params import Prior, Transform, check_params, constrain, unconstrain
from jgait.tune.gradient import value_and_grad


class Problem(NamedTuple):
    """What stays the same while a fit runs; static.

    Attributes:
        loss: (params, item) → scalar.
        transforms: of the parameters.
        priors: of the parameters, `Prior` or None for each; or None.
        gradient: how to differentiate, see `value_and_grad`.
        mesh: devices over which items are spread, or None.
    """

    loss: Callable[..., Any]
    transforms: Any
    priors: Any
    gradient: str
    mesh: Mesh | None


class Items(NamedTuple):
    """What is fitted to; every leaf has a leading axis (n,).

    Attributes:
        data: pytree of arrays.
        subject: (n,) number of the subject of each, int32.
    """

    data: Any
    subject: Any


class Context(NamedTuple):
    """What a fit reads and never changes.

    Attributes:
        params: natural units, the source of what is fixed; what is each subject's own has a leading axis.
        items: to learn from.
        checked: to be judged by, or None.
        key: PRNG key of the minibatches, or None.
    """

    params: Any
    items: Items
    checked: Items | None
    key: Any


def _is_transform(node: Any) -> bool:
    return isinstance(node, Transform)


def transforms_of(transforms: Any) -> list[Transform]:
    """The transforms in the order of the parameters."""
    return jax.tree.leaves(transforms, is_leaf=_is_transform)


def over_transforms(function: Callable[..., Any], transforms: Any, *trees: Any) -> Any:
    """Map over parameters with the transform of each; a subtree is whatever stands where the transform does."""
    treedef: Any
    flat, treedef = jax.tree.flatten(transforms, is_leaf=_is_transform)
    columns = [treedef.flatten_up_to(tree) for tree in trees]
    return jax.tree.unflatten(treedef, [function(t, *values) for t, *values in zip(flat, *columns, strict=True)])


def of_subject(tree: Any, transforms: Any, subject: Any) -> Any:
    """Parameters, or free coordinates, as they are for one subject."""

    def pick(transform: Transform, value: Any) -> Any:
        return jnp.asarray(value)[subject] if transform.own and value is not None else value

    return over_transforms(pick, transforms, tree)


def check_data(data: Any, batched: bool) -> None:
    """Refuse data that is no pytree of arrays with one leading length.

    Raises:
        TypeError: for anything but numbers.
        ValueError: if it is empty, or the lengths differ.
    """
    flat, _ = jax.tree_util.tree_flatten_with_path(data)
    if not flat:
        raise ValueError("data is empty: fit needs at least one array to compare with")
    lengths: dict[str, int] = {}
    for path, leaf in flat:
        name = "data" + jax.tree_util.keystr(path)
        if isinstance(leaf, str | bytes) or (not hasattr(leaf, "dtype") and not isinstance(leaf, int | float)):
            raise TypeError(f"{name} must be an array or a number; got {type(leaf).__name__}")
        if batched and np.ndim(leaf) == 0:
            raise ValueError(
                f"{name} is a single number; every leaf needs a leading axis of items (batched=False for one item)"
            )
        if batched:
            lengths[name] = np.shape(leaf)[0]
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"{name}: {length}" for name, length in lengths.items())
        raise ValueError(f"every leaf of data needs the same number of items; got {listed}")
    if batched and next(iter(lengths.values())) == 0:
        raise ValueError("data is empty: its leading axis has no items")


def numbered(subjects: Any, n: int) -> tuple[tuple[Any, ...], np.ndarray]:
    """Subjects in the order in which they appear, and the number of each item's (n,); None: one subject.

    Raises:
        ValueError: if there is not one for each item.
    """
    if subjects is None:
        return (), np.zeros(n, np.int32)
    listed = list(np.asarray(subjects).tolist())
    if len(listed) != n:
        raise ValueError(f"subjects needs one label for each of the {n} items; got {len(listed)}")
    order = {label: number for number, label in enumerate(dict.fromkeys(listed))}
    return tuple(order), np.asarray([order[label] for label in listed], np.int32)


def spread_out(params: Any, transforms: Any, subjects: int) -> Any:
    """Give a value for each subject to every parameter that is each subject's own.

    Raises:
        TypeError, ValueError: see `check_params`; or if there are own parameters and no subjects, or the values given
            are not one for each.
    """
    check_params(params, transforms)

    def widen(transform: Transform, value: Any) -> Any:
        if not transform.own:
            return value
        if subjects == 0:
            raise ValueError("parameters per subject need subjects=…, a label for each item")
        have = np.shape(value)
        if have and have[0] != subjects:
            raise ValueError(f"a parameter per subject needs one value, or one for each of {subjects}; got {have[0]}")
        return value if have else np.full(subjects, value)

    return over_transforms(widen, transforms, params)


def check_priors(priors: Any, transforms: Any) -> None:
    """Refuse priors that do not stand beside the parameters.

    Raises:
        TypeError: if the structures differ, or one is no `Prior`.
    """
    if priors is None:
        return

    def check(_: Transform, prior: Any) -> None:
        if prior is not None and not isinstance(prior, Prior):
            raise TypeError(f"priors must hold a jgait.params.Prior or None for every parameter; got {prior!r}")

    try:
        over_transforms(check, transforms, priors)
    except ValueError as error:
        raise TypeError(f"priors and transforms must have the same structure: {error}") from error


def start(params: Any, transforms: Any) -> Any:
    """Free coordinates as arrays of one fixed type each, as a scan's carry must have.

    Raises:
        ValueError: if every parameter is fixed.
    """

    def strong(leaf: Any) -> Any:
        kind = leaf.dtype if jnp.issubdtype(leaf.dtype, jnp.floating) else jnp.result_type(float)
        return jnp.asarray(leaf, kind)

    free = jax.tree.map(strong, unconstrain(params, transforms))
    if not jax.tree.leaves(free):
        raise ValueError("every parameter is fixed: free at least one of them by its transform")
    return free


def check_loss(problem: Problem, params: Any, items: Items) -> Any:
    """The loss's type, for an item of these.

    Raises:
        ValueError: if the loss does not give one floating-point number.
    """
    data, subject = jax.tree.map(lambda leaf: leaf[0], tuple(items))
    out = jax.eval_shape(lambda p, item: problem.loss(of_subject(p, problem.transforms, subject), item), params, data)
    leaves = jax.tree.leaves(out)
    if len(leaves) != 1 or leaves[0].shape != () or not jnp.issubdtype(leaves[0].dtype, jnp.floating):
        got = ", ".join(f"{leaf.dtype}{list(leaf.shape)}" for leaf in leaves) or repr(out)
        raise ValueError(f"loss must return one floating-point scalar for one item; got {got}")
    return leaves[0].dtype


def _one(problem: Problem, free: Any, params: Any, item: Any) -> Any:
    return problem.loss(constrain(free, problem.transforms, params), item)


def _everyone(problem: Problem, function: Callable[..., Any]) -> Callable[..., Any]:
    """Map a function of (free, params, item) over items, each with what is its subject's own; over the mesh if any."""

    def each(free: Any, params: Any, item: Items) -> Any:
        mine, known = (of_subject(tree, problem.transforms, item.subject) for tree in (free, params))
        return function(mine, known, item.data)

    mapped = jax.vmap(each, in_axes=(None, None, 0))
    if problem.mesh is None:
        return mapped
    along, all_of_it = PartitionSpec(problem.mesh.axis_names[0]), PartitionSpec()
    return jax.shard_map(
        mapped, mesh=problem.mesh, in_specs=(all_of_it, all_of_it, along), out_specs=along, check_vma=False
    )


def item_losses(problem: Problem, free: Any, params: Any, items: Items) -> Any:
    """(n,) loss of every item."""
    return _everyone(problem, partial(_one, problem))(free, params, items)


def item_gradients(problem: Problem, free: Any, params: Any, items: Items) -> tuple[Any, Any]:
    """(n,) loss of every item, and its gradient with respect to what concerns it, with a leading axis (n,)."""
    both = value_and_grad(partial(_one, problem), problem.gradient)
    return _everyone(problem, both)(free, params, items)


def penalty(problem: Problem, free: Any, params: Any) -> Any:
    """Minus the logarithm of the priors' density [nat], summed over parameters and subjects."""
    natural = constrain(free, problem.transforms, params)
    terms: list[Any] = []

    def add(_: Transform, value: Any, prior: Prior | None, moved: Any) -> None:
        if prior is not None and moved is not None:
            terms.append(jnp.sum(prior.penalty(value)))

    over_transforms(add, problem.transforms, natural, problem.priors, free)
    return sum(terms[1:], terms[0]) if terms else jnp.zeros(())


def value_of(losses: Any, weights: Any) -> Any:
    """Weighted mean of (n,) losses; items without weight may be anything."""
    counted = jnp.where(weights > 0.0, losses, jnp.zeros_like(losses))
    return jnp.sum(weights * counted) / jnp.maximum(jnp.sum(weights), jnp.finfo(losses.dtype).tiny)


def gradient_of(problem: Problem, free: Any, slopes: Any, items: Items, weights: Any) -> Any:
    """Gradient of `value_of`, in the type of `free`, from those of the items."""
    total = jnp.maximum(jnp.sum(weights), jnp.finfo(weights.dtype).tiny)

    def gather(transform: Transform, value: Any, slope: Any) -> Any:
        if value is None:
            return None
        share = (weights / total).astype(slope.dtype).reshape((-1,) + (1,) * (slope.ndim - 1))
        part = jnp.where(share > 0.0, share * slope, jnp.zeros_like(slope))
        return jnp.zeros_like(value).at[items.subject].add(part) if transform.own else jnp.sum(part, axis=0)

    return over_transforms(gather, problem.transforms, free, slopes)


def total(problem: Problem, free: Any, params: Any, items: Items, weights: Any, count: Any, forgiving: Any) -> Any:
    """What is minimised, its gradient, and whether each item's part of both is finite.

    Σ wᵢ lossᵢ / Σ wᵢ + penalty / count: with losses in nats, the logarithm of the posterior density per item.

    Args:
        problem: what is minimised.
        free: coordinates.
        params: natural units, the source of what is fixed.
        items: (n,), all or some.
        weights: (n,) of the items.
        count: sum of the weights of all items.
        forgiving: bool; whether to leave out, for once, the items whose part is not finite.

    Returns:
        Value, gradient, (n,) bool.
    """
    losses, slopes = item_gradients(problem, free, params, items)
    axes = [jnp.isfinite(s).reshape((s.shape[0], -1)).all(axis=1) for s in jax.tree.leaves(slopes)]
    sound = jax.tree.reduce(jnp.logical_and, axes, jnp.isfinite(losses))
    used = jnp.where(forgiving & ~sound, jnp.zeros_like(weights), weights)
    found = value_of(losses, used)
    gradient = gradient_of(problem, free, slopes, items, used)
    if problem.priors is not None:
        share = 1.0 / jnp.maximum(count - jnp.sum(weights - used), 1.0)
        more, slope = jax.value_and_grad(lambda f: penalty(problem, f, params))(free)
        found = found + (share * more).astype(found.dtype)
        gradient = jax.tree.map(lambda g, s: g + (share * s).astype(g.dtype), gradient, slope)
    return found, gradient, sound


@partial(jax.custom_vjp, nondiff_argnums=(0,))
def value(problem: Problem, free: Any, params: Any, items: Items, weights: Any, count: Any) -> Any:
    """The value of `total` alone, as line searches ask for it; its derivative is taken as `total` takes it."""
    losses = item_losses(problem, free, params, items)
    found = value_of(losses, weights)
    if problem.priors is not None:
        found = found + (penalty(problem, free, params) / jnp.maximum(count, 1.0)).astype(found.dtype)
    return found


def _value_forward(problem: Problem, free: Any, params: Any, items: Items, weights: Any, count: Any) -> tuple[Any, Any]:
    found, gradient, _ = total(problem, free, params, items, weights, count, jnp.zeros((), bool))
    return found, gradient


def _value_backward(problem: Problem, gradient: Any, cotangent: Any) -> tuple[Any, ...]:
    return jax.tree.map(lambda g: cotangent.astype(g.dtype) * g, gradient), None, None, None, None


value.defvjp(_value_forward, _value_backward)


def place(problem: Problem, items: Items) -> Items:
    """Items as arrays on the devices that work on them; their number must be a multiple of the mesh's."""
    if problem.mesh is None:
        return jax.tree.map(jnp.asarray, items)
    sharding = NamedSharding(problem.mesh, PartitionSpec(problem.mesh.axis_names[0]))

    def put(leaf: Any) -> Any:
        host = np.asarray(leaf)
        host = host.astype(jax.dtypes.canonicalize_dtype(host.dtype))
        return jax.make_array_from_callback(host.shape, sharding, lambda index: host[index])

    return jax.tree.map(put, items)
