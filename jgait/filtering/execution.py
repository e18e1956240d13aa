"""The choice of a filter's implementation: all give the same results and differ in speed and rounding.

fast         components, structure detected while tracing (`structured`); KF, EKF, iterated EKF
dense        vectors and matrices (`dense`): the reference, for every method and size
square_root  factors of the covariances (`square_root`): accurate in float32 on ill-conditioned problems
parallel     associative scan over time (`parallel`): for accelerators; linear, or linearised about a trajectory
auto         fast if the method supports it and the state is small enough for a short compilation, else dense
"""

from typing import Any, Literal

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import PyTree

from jgait.filtering import bryson_frazier, dense, fast, fast_smoother, parallel, square_root
from jgait.filtering.component_model import scalars
from jgait.filtering.inputs import Inputs
from jgait.filtering.methods import EKF, KF, Method

Execution = Literal["auto", "fast", "dense", "square_root", "parallel"]

Form = Literal["auto", "rts", "bryson_frazier"]

FAST_UP_TO = 32
"""Error components × observed components × iterations below which "auto" uses the fast path [1].

Compilation time grows with the components: 1 s at 8 × 2, ten at 15 × 3 (its gradient minutes), longer than most
runs. The smoother's covariances take about n times as many operations, so "auto" uses the dense path for them.
"""


def chosen(given: Inputs, method: Method, execution: Execution, about: PyTree, small: bool = True) -> Execution:
    """The selected implementation; `small`: whether the problem is small enough for components.

    Raises:
        ValueError: if `execution` does not support `method`, or `about` is missing or not used.
    """
    if about is not None and execution != "parallel":
        raise ValueError(f"about is the trajectory of execution='parallel'; got execution={execution!r}")
    jacobian = isinstance(method, KF | EKF)
    if execution == "auto":
        size = len(given.cov) * len(given.measured) * method.iterations
        return "fast" if jacobian and small and size < FAST_UP_TO else "dense"
    if execution == "fast" and not jacobian:
        raise ValueError(f"execution='fast' has KF, EKF and iterated EKF; got {method!r}, which needs 'dense'")
    if execution == "parallel":
        if not jacobian or method.iterations > 1:
            raise ValueError(f"execution='parallel' has KF() and EKF(); got {method!r}")
        if isinstance(method, EKF) and about is None:
            raise ValueError("execution='parallel' needs `about`, the states that the EKF() is linearised about")
    return execution


def filtered(
    given: Inputs, method: Method, keep: tuple[str, ...], execution: Execution, about: PyTree, segments: bool
) -> dict[str, Any]:
    """Fields of `Posterior` by name, as arrays (T, …) or lists of (T,) arrays; `segments` as in `fast.scanned`."""
    execution = chosen(given, method, execution, about)
    if execution == "fast":
        fast.check_linear(given, method)  # type: ignore[arg-type]
        return fast.scanned(given, method, keep, segments=segments)  # type: ignore[arg-type]
    ready = given.vectors()
    if execution == "parallel":
        everything = parallel.parallel_filter(ready, trajectory(given, about))
        return {name: everything[name] for name in keep}
    return (square_root if execution == "square_root" else dense).scanned(ready, method, keep)


def smoothed(
    given: Inputs,
    method: Method,
    keep: tuple[str, ...],
    execution: Execution,
    about: PyTree,
    components: tuple[int, ...],
    form: Form = "auto",
) -> tuple[PyTree, PyTree, dict[str, PyTree]]:
    """Smoothed mean, covariance of the selected error components (None without any), the filter's fields by name."""
    size = len(given.cov)
    everything = components == tuple(range(size))
    flat = not given.cm.curved
    execution = chosen(given, method, execution, about, small=flat and not components)
    if form == "bryson_frazier" and execution != "fast":
        raise ValueError(f"form='bryson_frazier' belongs to execution='fast'; this is {execution!r}")
    if execution == "fast":
        fast.check_linear(given, method)  # type: ignore[arg-type]
        if form == "bryson_frazier" or (form == "auto" and not everything and (flat or given.cm.error_shift)):
            return bryson_frazier.bryson_frazier(given, method, keep, components)  # type: ignore[arg-type]
        mean, cov, kept = fast_smoother.rts(given, method, keep)  # type: ignore[arg-type]
        place = [[min(i, j) * size - min(i, j) * (min(i, j) - 1) // 2 + abs(i - j) for j in components]
                 for i in components]  # fmt: skip
        return mean, [cov[place[a][b]] for a in range(len(place)) for b in range(a, len(place))], kept
    mean, cov, kept = _smoothed_vectors(given, method, keep, execution, about)
    return mean, cov if everything else cov[..., components, :][..., components], kept


def _smoothed_vectors(
    given: Inputs, method: Method, keep: tuple[str, ...], execution: Execution, about: PyTree
) -> tuple[PyTree, PyTree, dict[str, PyTree]]:
    ready = given.vectors()
    if execution == "parallel":
        found = parallel.parallel_smoother(ready, trajectory(given, about))
        return found["mean"], found["cov"], {name: found["filtered"][name] for name in keep}
    if execution == "square_root":
        kept = square_root.scanned(ready, method, tuple(dict.fromkeys((*keep, "mean", "factor"))))
        found = square_root.smoothed_scan(ready, kept, method)
        return found["mean"], found["cov"], {name: kept[name] for name in keep}
    kept = dense.scanned(ready, method, tuple(dict.fromkeys((*keep, *dense.SMOOTHED_FROM))))
    mean, cov = dense.smoothed_scan(ready, kept)
    return mean, cov, {name: kept[name] for name in keep}


def trajectory(given: Inputs, about: PyTree) -> PyTree:
    """A state tuple of (T,) arrays as one array (T, k); raises ValueError for another tuple or shape."""
    if about is None:
        return None
    first = jax.tree.map(lambda leaf: jnp.asarray(leaf)[0] if jnp.ndim(leaf) else leaf, about)
    scalars(first, given.cm.state, given.dtype, "about")
    for leaf in jax.tree.leaves(about):
        if jnp.shape(leaf) != (given.length,):
            raise ValueError(f"about must hold arrays of shape ({given.length},); got {jnp.shape(leaf)}")
    return jnp.stack([lax.convert_element_type(leaf, given.dtype) for leaf in jax.tree.leaves(about)], axis=-1)
