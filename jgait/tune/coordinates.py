"""Free coordinates as one vector whose every number has a name."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree

from jgait.params import Transform, check_params, constrain, unconstrain


class Coordinates(NamedTuple):
    """The free numbers of a parameter set, in the order of its leaves.

    Attributes:
        names: of each number: "thigh_length.right", "angle_noise", or "level[0]" in an array.
        transforms: of each number.
        tree: free values as `jgait.params.unconstrain` gives them, floats of one fixed type each.
        vector: (p,) the same as one vector.
    """

    names: tuple[str, ...]
    transforms: tuple[Transform, ...]
    tree: Any
    vector: Any


def _is_transform(node: Any) -> bool:
    return isinstance(node, Transform)


def _strong(leaf: Any) -> Any:
    return jnp.asarray(leaf, leaf.dtype if jnp.issubdtype(leaf.dtype, jnp.floating) else jnp.result_type(float))


def coordinates(params: Any, transforms: Any) -> Coordinates:
    """Name and line up what is free.

    Args:
        params: NamedTuple in natural units.
        transforms: the same type, holding a `Transform` for each.

    Returns:
        The coordinates of `params`.

    Raises:
        TypeError: if `params` and `transforms` do not match.
        ValueError: if a value is outside its range, everything is fixed, or a parameter is each subject's own.
    """
    check_params(params, transforms)
    if any(getattr(t, "own", False) for t in jax.tree.leaves(transforms, is_leaf=_is_transform)):
        raise ValueError("parameters per subject: give the parameters and the items of one subject, and fix the shared")
    tree = jax.tree.map(_strong, unconstrain(params, transforms))
    leaves, _ = jax.tree_util.tree_flatten_with_path(tree)
    if not any(leaf.size for _, leaf in leaves):
        raise ValueError("every parameter is fixed: free at least one of them by its transform")
    by_path = {
        jax.tree_util.keystr(path): transform
        for path, transform in jax.tree_util.tree_flatten_with_path(transforms, is_leaf=_is_transform)[0]
    }
    names: list[str] = []
    each: list[Transform] = []
    for path, leaf in leaves:
        key = jax.tree_util.keystr(path)
        for index in np.ndindex(leaf.shape):
            names.append(key.lstrip(".") + (f"[{', '.join(map(str, index))}]" if index else ""))
            each.append(by_path[key])
    return Coordinates(tuple(names), tuple(each), tree, ravel_pytree(tree)[0])


def natural(at: Coordinates, vectors: Any, transforms: Any, params: Any) -> Any:
    """Parameters in natural units from free vectors (…, p); a leading axis goes in front of every free leaf."""
    unflatten: Callable[[Any], Any] = ravel_pytree(at.tree)[1]
    for _ in range(jnp.ndim(vectors) - 1):
        unflatten = jax.vmap(unflatten)
    return constrain(unflatten(jnp.asarray(vectors, at.vector.dtype)), transforms, params)


def natural_numbers(at: Coordinates, vector: Any) -> tuple[np.ndarray, np.ndarray]:
    """Natural values (p,) of free numbers (p,), which may be infinite, and the slopes (p,) of the transforms there."""
    values = np.empty(len(at.names))
    slopes = np.empty(len(at.names))
    vector = jnp.asarray(vector, at.vector.dtype)
    for transform in dict.fromkeys(at.transforms):
        to_natural: Any = transform.to_natural
        assigned = np.array([other == transform for other in at.transforms])
        part = vector[np.flatnonzero(assigned)]
        values[assigned], slopes[assigned] = jax.jvp(to_natural, (part,), (jnp.ones_like(part),))
    return values, slopes


def check_items(data: Any, batched: bool) -> tuple[Any, int]:
    """Data with a leading axis of items, and how many there are.

    Raises:
        TypeError: if a leaf is no array or number.
        ValueError: if there is no data, or its leaves differ in the number of items.
    """
    flat, _ = jax.tree_util.tree_flatten_with_path(data)
    for path, leaf in flat:
        if not hasattr(leaf, "dtype") and not isinstance(leaf, int | float):
            name = "data" + jax.tree_util.keystr(path)
            raise TypeError(f"{name} must be an array or a number; got {type(leaf).__name__}")
    data = jax.tree.map(lambda leaf: jnp.asarray(leaf) if batched else jnp.asarray(leaf)[None], data)
    shapes = {"data" + jax.tree_util.keystr(path): np.shape(leaf) for path, leaf in flat}
    lengths = {leaf.shape[0] if leaf.ndim else 0 for leaf in jax.tree.leaves(data)}
    if len(lengths) != 1 or 0 in lengths:
        listed = ", ".join(f"{name}: {shape}" for name, shape in shapes.items()) or "nothing"
        raise ValueError(
            f"every leaf of data needs the same leading axis of items (batched=False for one item); got {listed}"
        )
    return data, lengths.pop()


def check_loss(loss: Callable[..., Any], params: Any, data: Any) -> None:
    """Refuse a loss that gives anything but one float for one item.

    Raises:
        ValueError: if it does.
    """
    out = jax.eval_shape(loss, params, jax.tree.map(lambda leaf: leaf[0], data))
    leaves = jax.tree.leaves(out)
    if len(leaves) != 1 or leaves[0].shape != () or not jnp.issubdtype(leaves[0].dtype, jnp.floating):
        got = ", ".join(f"{leaf.dtype}{list(leaf.shape)}" for leaf in leaves) or repr(out)
        raise ValueError(f"loss must return one floating-point scalar for one item; got {got}")
