"""Checks of the arguments of a filter: structure and shapes while tracing, values before the trace.

No check raises inside compiled code: structures and shapes are known while tracing, and values are checked only
where they are concrete.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import PyTree

from jgait.filtering.covariance import Covariance, names_of
from jgait.filtering.methods import Method
from jgait.filtering.model import Belief, Model
from jgait.types import Values


def common_dtype(*trees: PyTree) -> PyTree:
    """The widest float type among the leaves; Python numbers and integers have no influence."""
    leaves = jax.tree.leaves(trees)
    with jax.numpy_dtype_promotion("standard"):
        dtype = jnp.result_type(*leaves) if leaves else jnp.result_type(float)
    return dtype if jnp.issubdtype(dtype, jnp.floating) else jnp.result_type(float)


def in_dtype(tree: PyTree, dtype: DTypeLike) -> PyTree:
    """The same tree with every floating leaf cast to the dtype; integers and booleans do not change."""

    def cast(leaf: PyTree) -> PyTree:
        return jnp.asarray(leaf, dtype) if jnp.issubdtype(jnp.result_type(leaf), jnp.floating) else jnp.asarray(leaf)

    return jax.tree.map(cast, tree)


EXECUTIONS = ("auto", "core", "fast")
"""The ways to run a filter, see `jgait.filtering.execution`."""


def check_arguments(
    model: PyTree, method: PyTree, keep: tuple[str, ...], fields: tuple[str, ...], execution: str = "auto"
) -> None:
    """Raise if a static argument of a filter is not valid.

    Raises:
        ValueError: if the model is not a hashable `Model`, `method` is not a method, `keep` has a name that is not a
            field, or `execution` is not one of `EXECUTIONS`.
    """
    if not isinstance(model, Model):
        raise ValueError(f"model must be a jgait.filtering.Model; got {model!r}")
    try:
        hash(model)
    except TypeError as error:
        raise ValueError(f"a model must be hashable, its functions at module level or frozen; {error}") from error
    if not isinstance(method, Method):
        raise ValueError(f"method must be KF(), EKF(), IteratedEKF(k), UKF() or CKF(); got {method!r}")
    if execution not in EXECUTIONS:
        raise ValueError(f"execution must be one of {', '.join(EXECUTIONS)}; got {execution!r}")
    if isinstance(keep, str):
        raise ValueError(f"keep is a tuple of names, such as ({keep!r},); got the string {keep!r}")
    unknown = [name for name in keep if name not in fields]
    if unknown:
        raise ValueError(f"keep names fields of Posterior ({', '.join(fields)}); got {unknown[0]!r}")


STAMPS = 5
"""[1] Intervals that all grow, from so many on, are times."""


def check_values(observations: PyTree, controls: PyTree, dt: Values) -> None:
    """Raise if concrete values cannot be used by any filter.

    Raises:
        ValueError: for lists, pandas' columns, non-numbers, NaN or infinity in observations or controls, and for
            time intervals that are negative, or times.
    """
    for kind, tree in (("observation", observations), ("control", controls)):
        for path, leaf in jax.tree_util.tree_flatten_with_path(tree, is_leaf=_is_list)[0]:
            if _is_list(leaf) or hasattr(leaf, "to_numpy"):
                name = jax.tree_util.keystr(path, simple=True, separator=".")
                what = type(leaf).__name__
                raise ValueError(f"{kind} '{name}' must be an array; got a {what}: convert it by numpy.asarray")
        for name, leaf in zip(names_of(tree), jax.tree.leaves(tree), strict=True):
            if isinstance(leaf, jax.core.Tracer | jax.ShapeDtypeStruct):
                continue
            array = np.asarray(leaf)
            if array.dtype.kind == "O" or array.dtype.kind in "USMmc":
                raise ValueError(f"{kind} '{name}' must be real numbers; got {array.dtype}")
            bad = int(np.size(array) - np.count_nonzero(np.isfinite(array)))
            if bad:
                advice = "put any finite number there and False in the mask" if kind == "observation" else "fill them"
                raise ValueError(f"{kind} '{name}' holds NaN or infinity ({bad} of {np.size(array)} values); {advice}")
    if _is_list(dt) or hasattr(dt, "to_numpy"):
        raise ValueError(f"dt must be a number or an array; got a {type(dt).__name__}: convert it by numpy.asarray")
    if not isinstance(dt, jax.core.Tracer):
        interval = np.asarray(dt)
        if interval.dtype.kind not in "fiu" or not np.all(np.isfinite(interval)) or np.any(interval < 0):
            worst = interval if interval.ndim == 0 else f"a minimum of {interval.min()}"
            raise ValueError(f"dt must be finite and not negative, the time since the sample before [s]; got {worst}")
        if interval.ndim == 1 and interval.size >= STAMPS and np.all(np.diff(interval) > 0):
            raise ValueError(
                f"dt must be the time since the sample before [s]; got times that grow from {interval[0]:g} to "
                f"{interval[-1]:g}: take numpy.diff of them, with one value more for the first sample"
            )


def _is_list(leaf: PyTree) -> bool:
    """Whether this is a list of numbers, which JAX would take for so many observations."""
    return isinstance(leaf, list) and all(isinstance(value, int | float) for value in leaf)


def check_belief(belief: PyTree) -> None:
    """Raise if a belief's mean is not a tuple of scalars, or its covariance is not a `Covariance`.

    Raises:
        ValueError: the message names the leaf.
    """
    if not isinstance(belief, Belief) or not isinstance(belief.cov, Covariance):
        raise ValueError(f"a belief is a jgait.filtering.Belief(mean, Covariance); got {belief!r}")
    for name, leaf in zip(names_of(belief.mean), jax.tree.leaves(belief.mean), strict=True):
        if jnp.shape(leaf) != ():
            raise ValueError(f"a state is a tuple of scalars; '{name}' has shape {jnp.shape(leaf)}")


def check_observation(model: Model, params: PyTree, mean: PyTree, control: PyTree, observation: PyTree) -> None:
    """Raise if the observations' type is not that of the model's observations.

    Raises:
        ValueError: the message names the expected and the given type.
    """
    expected = jax.eval_shape(model.observation, params, mean, control)
    structure: PyTree = jax.tree.structure(expected)
    given: PyTree = jax.tree.structure(observation)
    if structure != given:
        name, fields = type(expected).__name__, names_of(expected)
        bare = given.num_nodes == 1 and given.num_leaves == 1
        got = (
            f"a bare array; pass {name}({fields[0]}=…)"
            if bare
            else f"a {type(observation).__name__} of ({', '.join(names_of(observation))})"
        )
        raise ValueError(f"the model observes a {name} of ({', '.join(fields)}); got {got}")


def series(tree: PyTree, kind: str, length: int | None) -> tuple[PyTree, int]:
    """Check that all leaves are (T,) of the same length; return them as arrays, and T.

    Raises:
        ValueError: the message names the leaf with another shape.
    """
    for name, leaf in zip(names_of(tree), jax.tree.leaves(tree), strict=True):
        shape = jnp.shape(leaf)
        if len(shape) != 1:
            raise ValueError(f"{kind} '{name}' must have shape (T,), one value a sample; got {shape}")
        if length is None:
            length = shape[0]
        if shape[0] != length:
            raise ValueError(f"{kind} '{name}' has {shape[0]} samples; expected {length}")
    if not length:
        raise ValueError("a filter needs at least one sample; got none")
    return jax.tree.map(jnp.asarray, tree), length


def interval(dt: Values, length: int, dtype: DTypeLike) -> PyTree:
    """The interval dt, () or (T,); raises ValueError if its shape is another."""
    shape = jnp.shape(dt)
    if shape not in ((), (length,)):
        raise ValueError(f"dt must be a scalar or have shape ({length},), like the observations; got {shape}")
    return jnp.asarray(dt, dtype)


def mask_leaves(mask: PyTree, observation: PyTree, shape: tuple[int, ...]) -> list[PyTree]:
    """The mask of each component of the observation: an array of bools, or True if there is no mask.

    Raises:
        ValueError: if the mask is neither one bool array of the shape nor an observation tuple of such arrays.
    """
    names = names_of(observation)
    structure: PyTree = jax.tree.structure(observation)
    if mask is None:
        return [True] * len(names)
    given: PyTree = jax.tree.structure(mask)
    if given == structure:
        leaves = jax.tree.leaves(mask)
    elif given.num_nodes == 1 and given.num_leaves == 1:
        leaves = [mask] * len(names)
    else:
        raise ValueError(
            f"the mask is one array of bools or a {type(observation).__name__} of them ({', '.join(names)}); "
            f"got a {type(mask).__name__} of ({', '.join(names_of(mask))})"
        )
    for name, leaf in zip(names, leaves, strict=True):
        if jnp.shape(leaf) != shape or jnp.result_type(leaf) != jnp.bool_:
            raise ValueError(
                f"the mask of '{name}' must be bool of shape {shape}; got {jnp.result_type(leaf)} of {jnp.shape(leaf)}"
            )
    return [jnp.asarray(leaf) for leaf in leaves]
