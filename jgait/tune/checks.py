"""Checks of the arguments of a fit: parameters, transforms, priors, data, subjects, loss."""

from collections.abc import Callable, Hashable, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Int, PyTree

from jgait.params import Prior, Transform, check_params, unconstrain
from jgait.types import AnyArray, numbered_people


def is_transform(node: object) -> bool:
    """Whether a node of a tree of transforms is a leaf."""
    return isinstance(node, Transform)


def transforms_of(transforms: PyTree) -> list[Transform]:
    """The transforms in the order of the parameters."""
    return jax.tree.leaves(transforms, is_leaf=is_transform)


def over_transforms(function: Callable[..., PyTree], transforms: PyTree, *trees: PyTree) -> PyTree:
    """Map a function of (transform, subtrees) over parameters; a subtree has the place of the transform in its tree."""
    return jax.tree.map(function, transforms, *trees, is_leaf=is_transform)


def check_data(data: PyTree, batched: bool) -> tuple[PyTree, int]:
    """Data as NumPy arrays with a leading axis of items, and the number of items; one item if not `batched`.

    Raises:
        TypeError: if `data` holds anything but numbers.
        ValueError: if `data` is empty or has floating-point numbers and none of them is finite, or the lengths differ.
    """
    flat, _ = jax.tree_util.tree_flatten_with_path(data)
    if not flat:
        raise ValueError("data is empty: there must be at least one array to compare with")
    lengths: dict[str, int] = {}
    for path, leaf in flat:
        name = "data" + jax.tree_util.keystr(path)
        if not hasattr(leaf, "dtype") and not isinstance(leaf, int | float):
            raise TypeError(f"{name} must be an array or a number; got {type(leaf).__name__}")
        if batched and np.ndim(leaf) == 0:
            raise ValueError(
                f"{name} is a single number; every leaf needs a leading axis of items (batched=False for one item)"
            )
        lengths[name] = np.shape(leaf)[0] if batched else 1
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"{name}: {length}" for name, length in lengths.items())
        raise ValueError(f"every leaf of data needs the same number of items; got {listed}")
    n = next(iter(lengths.values()))
    if n == 0:
        raise ValueError("data is empty: its leading axis has no items")
    leaves = jax.tree.map(lambda leaf: np.asarray(leaf) if batched else np.asarray(leaf)[None], data)
    numbers = [leaf for leaf in jax.tree.leaves(leaves) if jnp.issubdtype(leaf.dtype, jnp.floating)]
    if numbers and not any(np.isfinite(leaf).any() for leaf in numbers):
        raise ValueError("data holds no finite number: every value is NaN or infinite")
    return leaves, n


def numbered(subjects: Sequence[Hashable] | AnyArray | None, n: int) -> tuple[tuple[str, ...], Int[np.ndarray, "item"]]:
    """Subjects in order of appearance (see `types.people`), and the number (n,) of each item's; None: one subject.
    Raises ValueError if there is not one subject for each item.
    """
    if subjects is None:
        return (), np.zeros(n, np.int32)
    if len(subjects) != n:
        raise ValueError(f"subjects needs one label for each of the {n} items; got {len(subjects)}")
    return numbered_people(subjects)


def spread_out(params: PyTree, transforms: PyTree, subjects: int) -> PyTree:
    """Give every parameter that is declared `per_subject` one value for each subject; raises as `check_params`, or
    ValueError if there are no subjects or not one value for each.
    """
    check_params(params, transforms)

    def widen(transform: Transform, value: PyTree) -> PyTree:
        if not transform.per_subject:
            return value
        if subjects == 0:
            raise ValueError("parameters per subject need subjects=…, a label for each item")
        have = np.shape(value)
        if have and have[0] != subjects:
            raise ValueError(f"a parameter per subject needs one value, or one for each of {subjects}; got {have[0]}")
        return value if have else np.full(subjects, value)

    return over_transforms(widen, transforms, params)


def check_priors(priors: PyTree, transforms: PyTree) -> None:
    """Raise TypeError if the priors do not have the structure of the parameters, or one is not a `Prior`."""
    if priors is None:
        return

    def check(_: Transform, prior: PyTree) -> None:
        if prior is not None and not isinstance(prior, Prior):
            raise TypeError(f"priors must hold a jgait.params.Prior or None for every parameter; got {prior!r}")

    try:
        over_transforms(check, transforms, priors)
    except ValueError as error:
        raise TypeError(f"priors and transforms must have the same structure: {error}") from error


def start(params: PyTree, transforms: PyTree) -> PyTree:
    """Free coordinates as arrays, each of one fixed dtype, as the carry of `lax.scan` requires; raises ValueError if
    every parameter is fixed.
    """

    def strong(leaf: PyTree) -> PyTree:
        kind = leaf.dtype if jnp.issubdtype(leaf.dtype, jnp.floating) else jnp.result_type(float)
        return jnp.asarray(leaf, kind)

    free = jax.tree.map(strong, unconstrain(params, transforms))
    if not jax.tree.leaves(free):
        raise ValueError("every parameter is fixed: free at least one of them by its transform")
    return free
