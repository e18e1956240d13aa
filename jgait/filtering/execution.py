"""The two computations of a filter, chosen by the model and the method; the results agree up to rounding.

core   vectors and matrices over a batch (`core`, `backward`): every model and method, short compilation
fast   scalar components with the structure of the model (`fast`, `bryson_frazier`): several times the rate of the core
       for KF and EKF on models with few states and observations that are no manifold, for filters and smoothed means
"""

from typing import Any, Literal

from jaxtyping import PyTree

from jgait.filtering import bryson_frazier, fast
from jgait.filtering.batched_call import call
from jgait.filtering.core import linearises_once
from jgait.filtering.finish import closure
from jgait.filtering.inputs import Inputs
from jgait.filtering.methods import IteratedSmoother, Method
from jgait.filtering.passes import iterated
from jgait.filtering.recorded import Recorded

Execution = Literal["auto", "core", "fast"]

FAST_UP_TO = 32
"""Error components × observed components below which "auto" uses components [1].

Compilation time grows with the components: 1 s at 8 × 2, ten at 15 × 3 (its gradient minutes), longer than most runs.
"""


def chosen(
    given: Inputs, method: Method | IteratedSmoother, execution: Execution, covariances: bool = False
) -> Execution:
    """The selected computation; `covariances`: whether smoothed ones are wanted.

    Raises:
        ValueError: if `execution` cannot compute it.
    """
    needs = {
        f"the method {method!r}": not linearises_once(method), "states on a manifold": given.cm.curved,
        "covariances of a smoother": covariances,
    }  # fmt: skip
    can = not any(needs.values())
    if execution == "auto":
        return "fast" if can and len(given.cov) * len(given.measured) < FAST_UP_TO else "core"
    if execution == "fast" and not can:
        wrong = " and ".join(what for what, needed in needs.items() if needed)
        raise ValueError(
            "execution='fast' has KF() and EKF() on states that are no manifold, and smoothed means without "
            f"covariances; this call has {wrong}, and needs 'core'"
        )
    return execution


def filtered(
    given: Inputs, method: Method, keep: tuple[str, ...], execution: Execution, segments: bool
) -> dict[str, Any]:
    """Fields of `Posterior` by name, as lists of (T,) arrays or arrays (T, …); `segments` as in `fast.scanned`."""
    fast.check_linear(given, method)
    if chosen(given, method, execution) == "fast":
        return fast.scanned(given, keep, segments=segments)
    return _named(keep, call(Recorded(given.shape, method, keep), *given.arrays()))


def smoothed(
    given: Inputs,
    method: Method | IteratedSmoother,
    keep: tuple[str, ...],
    execution: Execution,
    components: tuple[int, ...],
) -> tuple[PyTree, PyTree, dict[str, PyTree]]:
    """Smoothed mean, covariance of the selected error components (None without any), the filter's fields by name."""
    if isinstance(method, IteratedSmoother):
        chosen(given, method, execution)  # "fast" is refused
        mean, cov, first = iterated(given, method.passes, keep, components)
        return list(mean.T), cov, _named(keep, first)
    fast.check_linear(given, method)
    if chosen(given, method, execution, bool(components)) == "fast":
        mean, fields = bryson_frazier.bryson_frazier(given, keep)
        return mean, None, fields
    inner = closure(given.shape, components)
    outputs = call(Recorded(given.shape, method, keep, True, components, inner), *given.arrays())
    fields = _named(keep, outputs[: len(keep)])
    mean, *cov = outputs[len(keep) :]
    return list(mean.T), cov[0] if components else None, fields


def _named(keep: tuple[str, ...], outputs: list[PyTree]) -> dict[str, Any]:
    lists = ("mean", "predicted_mean", "innovation", "innovation_stddev")
    return {name: list(v.T) if name in lists else v for name, v in zip(keep, outputs, strict=True)}
