"""The two computations of a filter, chosen by the model and the method; the results agree up to rounding.

core   vectors and matrices over a batch (`core`, `backward`): every model and method, short compilation
fast   scalar components with the structure of the model (`fast`, `bryson_frazier`): several times the rate of the core
       for KF and EKF on models with few states and observations, where it compiles as quickly
"""

from typing import Any, Literal

import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from jgait.filtering import bryson_frazier, fast
from jgait.filtering.backward import Backward
from jgait.filtering.batched_call import call
from jgait.filtering.core import FOR_SMOOTHER, Filter, block_of
from jgait.filtering.finish import States, Turned, closure
from jgait.filtering.inputs import Inputs
from jgait.filtering.methods import EKF, KF, Method
from jgait.filtering.structured import LOG_2PI

Execution = Literal["auto", "core", "fast"]

FAST_UP_TO = 32
"""Error components × observed components × iterations below which "auto" uses components [1].

Compilation time grows with the components: 1 s at 8 × 2, ten at 15 × 3 (its gradient minutes), longer than most runs.
"""

NEEDS = {
    "mean": ("predicted", "delta"), "cov": ("predicted", "delta", "cov"),
    "predicted_mean": ("predicted", "delta", "valid"),
    "predicted_cov": ("predicted", "delta", "cov", "predicted_cov", "valid"), "innovation": ("innovation",),
    "innovation_stddev": ("variance",), "log_likelihood": ("nis", "log_det", "valid"), "nis": ("nis",),
    "count": ("valid",), "valid": ("valid",),
}  # fmt: skip
"""Field of `Posterior` → outputs of the core that it is computed from."""


def chosen(given: Inputs, method: Method, execution: Execution, small: bool = True) -> Execution:
    """The selected computation; `small`: whether the problem is small enough for components.

    Raises:
        ValueError: if `execution` does not support `method`.
    """
    jacobian = isinstance(method, KF | EKF)
    if execution == "auto":
        size = len(given.cov) * len(given.measured) * method.iterations
        return "fast" if jacobian and small and size < FAST_UP_TO else "core"
    if execution == "fast" and not jacobian:
        raise ValueError(f"execution='fast' has KF, EKF and iterated EKF; got {method!r}, which needs 'core'")
    return execution


def filtered(
    given: Inputs, method: Method, keep: tuple[str, ...], execution: Execution, segments: bool
) -> dict[str, Any]:
    """Fields of `Posterior` by name, as lists of (T,) arrays or (T,) arrays; `segments` as in `fast.scanned`."""
    fast.check_linear(given, method)
    if chosen(given, method, execution) == "fast":
        return fast.scanned(given, method, keep, segments=segments)  # type: ignore[arg-type]
    return _fields(given, _outputs(given, method, tuple(n for name in keep for n in NEEDS[name])), keep)


def smoothed(
    given: Inputs, method: Method, keep: tuple[str, ...], execution: Execution, components: tuple[int, ...]
) -> tuple[PyTree, PyTree, dict[str, PyTree]]:
    """Smoothed mean, covariance of the selected error components (None without any), the filter's fields by name."""
    fast.check_linear(given, method)
    flat = not given.cm.curved
    if chosen(given, method, execution, small=flat and not components) == "fast":
        return bryson_frazier.bryson_frazier(given, method, keep, components)  # type: ignore[arg-type]
    wanted = ("predicted", "delta", *FOR_SMOOTHER, *(n for name in keep for n in NEEDS[name]))
    told = _outputs(given, method, wanted)
    inner = closure(given.shape, components)
    move, *cov = call(Backward(inner, block_of(given.shape)), *(told[name] for name in FOR_SMOOTHER))
    at, spread = (told["predicted"], told["delta"]), None
    if components:
        place = np.asarray([inner.index(i) for i in components])
        spread = call(Turned(given.shape, inner), *at, cov[0], move)[0][:, place[:, None], place[None]]
    return list(call(States(given.shape), *at, move)[0].T), spread, _fields(given, told, keep)


def _outputs(given: Inputs, method: Method, names: tuple[str, ...]) -> dict[str, PyTree]:
    keep = tuple(dict.fromkeys(names))
    return dict(zip(keep, call(Filter(given.shape, method, keep), *given.arrays()), strict=True))


def _fields(given: Inputs, told: dict[str, PyTree], keep: tuple[str, ...]) -> dict[str, Any]:
    """Fields of `Posterior` from the outputs of the core."""
    found: dict[str, Any] = {}
    seen = sum(jnp.where(leaf, 1.0, 0.0) for leaf in given.seen)
    for name in keep:
        match name:
            case "mean" | "predicted_mean":
                mean = call(States(given.shape), told["predicted"], told["delta"])[0]
                if name == "predicted_mean":  # where nothing was updated, the belief
                    mean = jnp.where(told["valid"][:, None], told["predicted"], mean)
                found[name] = list(mean.T)
            case "cov" | "predicted_cov":
                every = tuple(range(len(given.cov)))
                cov = call(Turned(given.shape, every), told["predicted"], told["delta"], told["cov"])[0]
                found[name] = cov if name == "cov" else jnp.where(told["valid"][:, None, None], told[name], cov)
            case "innovation":
                found[name] = list(told["innovation"].T)
            case "innovation_stddev":
                variance = told["variance"]
                root = jnp.sqrt(jnp.where(variance > 0.0, variance, 1.0))
                found[name] = list(jnp.where(variance > 0.0, root, 0.0).T)
            case "count":
                found[name] = jnp.where(told["valid"], seen, 0.0).astype(given.dtype)
            case "log_likelihood":
                terms = told["nis"] + told["log_det"] + seen * LOG_2PI
                found[name] = jnp.where(told["valid"], -0.5 * terms, 0.0).astype(given.dtype)
            case _:
                found[name] = told[name]
    return found
