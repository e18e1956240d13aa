"""The computations of a filter, chosen by the model and the method; the results agree up to rounding.

core   `jgait.filtering.scan`: every model and method, short compilation
fast   `jgait.filtering.fast`: scalar components with the structure of the model, several times the rate of the core for
       filters and smoothed means by KF and EKF, on models with few states and observations that are no manifold
"""

from collections.abc import Callable
from typing import Any, Literal

from jgait.filtering.inputs import Inputs
from jgait.filtering.methods import IteratedSmoother, Method

Execution = Literal["auto", "core", "fast"]

EXECUTIONS = ("auto", "core", "fast")
"""The names of the executions; "auto" is `fast` for small models that it can compute, else `core`."""

FAST_UP_TO = 32
"""Error components × observed components below which "auto" uses components [1].

Compilation time grows with the components: 1 s at 8 × 2, ten at 15 × 3 (its gradient minutes), longer than most runs.
"""


def execution_of(
    given: Inputs, method: Method | IteratedSmoother, execution: Execution, covariances: bool
) -> Callable[..., dict[str, Any]] | None:
    """The function that computes it in place of the core, or None.

    Args:
        given: model and recording.
        method: how to linearise.
        execution: as the user chose.
        covariances: whether smoothed covariances are wanted.

    Raises:
        ValueError: if there is no such `execution`, or it cannot compute this.
    """
    if execution not in EXECUTIONS:
        raise ValueError(f"execution must be one of {', '.join(EXECUTIONS)}; got {execution!r}")
    shape = given.shape
    if execution == "core" or (execution == "auto" and shape.error.size * len(shape.measured) >= FAST_UP_TO):
        return None
    from jgait.filtering import fast

    refused = fast.refused(given, method, covariances)
    if execution == "fast" and refused:
        raise ValueError(refused)
    return None if refused else fast.solve
