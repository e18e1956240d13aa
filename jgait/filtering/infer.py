"""Filter or smoother, selected by an argument, with the same type of result."""

from jaxtyping import PyTree

from jgait.filtering.execution import Execution
from jgait.filtering.filter import kalman_filter
from jgait.filtering.methods import EKF, Method
from jgait.filtering.model import Belief, Model
from jgait.filtering.smoother import Inferred, kalman_smoother
from jgait.types import Values

SUMMARY = ("log_likelihood", "nis", "count", "valid")
"""Fields of the filter's posterior that measure how well the model fits."""


def infer(
    model: Model, params: PyTree, observations: PyTree, *, smooth: bool, controls: PyTree = None, dt: Values = 1.0,
    mask: PyTree = None, method: Method = EKF(), initial: Belief | None = None, keep: tuple[str, ...] = SUMMARY,
    covariance: bool | tuple[str, ...] = True, execution: Execution = "auto",
) -> Inferred:  # fmt: skip
    """Filter a recording, and smooth it if `smooth` is True.

    Args:
        model: state-space model, see `kalman_filter`.
        params: passed on to the model's functions.
        observations: observation tuple of (T,) arrays.
        smooth: Rauch–Tung–Striebel smoothing after the filter; static.
        controls: control tuple of (T,) arrays, or None.
        dt: interval [s], scalar or (T,).
        mask: observation tuple of (T,) bools, one (T,) bool, or None; a leaf that is Python's False removes its
            component from the model.
        method: how to linearise.
        initial: belief before the first interval; None: the model's `initial`.
        keep: fields of the filter's `Posterior` to return.
        covariance: smoothed covariances to return, see `kalman_smoother`; a filter returns all.
        execution: implementation, see `jgait.filtering.execution`.

    Returns:
        Means, covariances and the filter's posterior.

    Raises:
        ValueError: see `kalman_filter`.
    """
    if smooth:
        return kalman_smoother(
            model, params, observations, controls=controls, dt=dt, mask=mask, method=method, initial=initial, keep=keep,
            covariance=covariance, execution=execution,
        )  # fmt: skip
    posterior = kalman_filter(
        model, params, observations, controls=controls, dt=dt, mask=mask, method=method, initial=initial,
        keep=("mean", "cov", *(name for name in keep if name not in ("mean", "cov"))), execution=execution,
    )  # fmt: skip
    return Inferred(posterior.mean, posterior.cov, posterior)
