"""The two computations of a filter, chosen by the model and the method; the results agree up to rounding.

core   vectors and matrices over a batch (`core`, `backward`): every model and method, short compilation
fast   scalar components with the structure of the model (`fast`, `bryson_frazier`): several times the rate of the core
       for KF and EKF on models with few states and observations, where it compiles as quickly
"""

from typing import Any, Literal

from jaxtyping import PyTree

from jgait.filtering import bryson_frazier, fast
from jgait.filtering.batched_call import call
from jgait.filtering.finish import closure
from jgait.filtering.inputs import Inputs
from jgait.filtering.methods import EKF, KF, Method
from jgait.filtering.recorded import Recorded

Execution = Literal["auto", "core", "fast"]

FAST_UP_TO = 32
"""Error components × observed components × iterations below which "auto" uses components [1].

Compilation time grows with the components: 1 s at 8 × 2, ten at 15 × 3 (its gradient minutes), longer than most runs.
"""


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
    """Fields of `Posterior` by name, as lists of (T,) arrays or arrays (T, …); `segments` as in `fast.scanned`."""
    fast.check_linear(given, method)
    if chosen(given, method, execution) == "fast":
        return fast.scanned(given, method, keep, segments=segments)  # type: ignore[arg-type]
    return _named(keep, call(Recorded(given.shape, method, keep), *given.arrays()))


def smoothed(
    given: Inputs, method: Method, keep: tuple[str, ...], execution: Execution, components: tuple[int, ...]
) -> tuple[PyTree, PyTree, dict[str, PyTree]]:
    """Smoothed mean, covariance of the selected error components (None without any), the filter's fields by name."""
    fast.check_linear(given, method)
    flat = not given.cm.curved
    if chosen(given, method, execution, small=flat and not components) == "fast":
        return bryson_frazier.bryson_frazier(given, method, keep, components)  # type: ignore[arg-type]
    inner = closure(given.shape, components)
    outputs = call(Recorded(given.shape, method, keep, True, components, inner), *given.arrays())
    told = _named(keep, outputs[: len(keep)])
    mean, *cov = outputs[len(keep) :]
    return list(mean.T), cov[0] if components else None, told


def _named(keep: tuple[str, ...], outputs: list[PyTree]) -> dict[str, Any]:
    lists = ("mean", "predicted_mean", "innovation", "innovation_stddev")
    return {name: list(v.T) if name in lists else v for name, v in zip(keep, outputs, strict=False)}
