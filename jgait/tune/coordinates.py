"""Free coordinates of the parameters as one vector, with a name for each number."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Float, PyTree

from jgait.params import Transform, check_params, constrain
from jgait.tune.checks import is_transform, start, transforms_of
from jgait.types import AnyArray


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
