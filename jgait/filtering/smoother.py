"""Smoothing: a filter, then a scan back over the samples, with the equations and sources in `jgait.filtering.backward`;
and `infer`, filter or smoother, selected by an argument, with the same type of result.

On manifolds it equals the Rauch–Tung–Striebel smoother to first order in the smoother's corrections, else exactly.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from jgait.filtering import checks
from jgait.filtering.compile import compiled
from jgait.filtering.covariance import structure_names
from jgait.filtering.execution import Execution, smoothed
from jgait.filtering.filter import FIELDS, KEEP, Posterior, kalman_filter, named_covariance, posterior
from jgait.filtering.hidden import without_hidden
from jgait.filtering.inputs import inputs
from jgait.filtering.methods import EKF, IteratedSmoother, Method
from jgait.filtering.model import Belief, Model
from jgait.types import Values


class Inferred(NamedTuple):
    """A filtered or smoothed recording.

    Attributes:
        mean: mean in the state's type, time axis in front.
        cov: covariance of `mean`, or None if `covariance` is False.
        filtered: the filter's `Posterior`, with the fields in `keep`.
    """

    mean: PyTree
    cov: PyTree
    filtered: Posterior

    @property
    def log_likelihood(self) -> PyTree:
        """Log-likelihood of all observations, each given the past [nat]."""
        return jnp.sum(self.filtered.log_likelihood)

    @property
    def nis(self) -> PyTree:
        """Mean normalised innovation squared: 1 if the model's noise is equal to the noise of the observations."""
        return jnp.sum(self.filtered.nis) / jnp.maximum(jnp.sum(self.filtered.count), 1.0)


def kalman_smoother(
    model: Model,
    params: PyTree,
    observations: PyTree,
    *,
    controls: PyTree = None,
    dt: Values = 1.0,
    mask: PyTree = None,
    method: Method | IteratedSmoother = EKF(),
    initial: Belief | None = None,
    keep: tuple[str, ...] = KEEP,
    covariance: bool | tuple[str, ...] = True,
    execution: Execution = "auto",
) -> Inferred:
    """Filter forward, then smooth backward: every sample's estimate uses the whole recording.

    Arguments as of `kalman_filter`, `keep` of the filter's posterior. The method `IteratedSmoother(k)` linearises again
    at the smoothed trajectory; its `filtered` is that of the EKF.

    `covariance`: False omits the smoothed covariances, which is several times faster. A tuple of names selects
    components of the error, ("position",) all components of the position: the `Covariance` then has the error's tuple
    with None for the other components.

    Returns:
        Smoothed means and covariances, and the filter's posterior.

    Raises:
        ValueError: see `kalman_filter`.
    """
    first = EKF() if isinstance(method, IteratedSmoother) else method
    checks.check_arguments(model, first, keep, FIELDS, execution)
    if not isinstance(covariance, bool | tuple):
        raise ValueError(f"covariance is True, False or a tuple of names; got {covariance!r}")
    checks.check_values(observations, controls, dt)
    model, observations, mask = without_hidden(model, observations, mask)
    return _smoother(
        model, params, observations, controls, dt, mask, initial, method, tuple(keep), covariance, execution,
    )  # fmt: skip


def _smoothed(
    model: Model,
    params: PyTree,
    observations: PyTree,
    controls: PyTree,
    dt: Values,
    mask: PyTree,
    initial: Belief | None,
    method: Method | IteratedSmoother,
    keep: tuple[str, ...],
    covariance: bool | tuple[str, ...],
    execution: Execution,
) -> Inferred:
    given = inputs(model, params, observations, controls, dt, mask, initial)
    chosen = _components(covariance, given.cm.error)
    mean, cov, kept = smoothed(given, method, keep, execution, chosen)
    return Inferred(
        given.cm.state.unflatten(mean),
        named_covariance(cov, _part(chosen, given.cm.error)) if chosen else None,
        posterior(given, kept),
    )


_smoother = compiled(_smoothed, static_argnames=("model", "method", "keep", "covariance", "execution"))


def _components(covariance: bool | tuple[str, ...], error: PyTree) -> tuple[int, ...]:
    """The numbers of the error components with the given names; raises ValueError for an unknown name."""
    names = structure_names(error)
    if isinstance(covariance, bool):
        return tuple(range(len(names))) if covariance else ()
    for wanted in covariance:
        if not any(_means(wanted, name) for name in names):
            raise ValueError(f"covariance names components of the error ({', '.join(names)}); got {wanted!r}")
    return tuple(i for i, name in enumerate(names) if any(_means(wanted, name) for wanted in covariance))


def _means(wanted: str, name: str) -> bool:
    return name == wanted or name.startswith(f"{wanted}.")


def _part(chosen: tuple[int, ...], error: PyTree) -> PyTree:
    """The structure of the error's tuple with None for the components not selected."""
    return jax.tree.structure(error.unflatten([i if i in chosen else None for i in range(error.num_leaves)]))


SUMMARY = ("log_likelihood", "nis", "count", "valid")
"""Fields of the filter's posterior that measure how well the model fits."""


def infer(
    model: Model, params: PyTree, observations: PyTree, *, smooth: bool, controls: PyTree = None, dt: Values = 1.0,
    mask: PyTree = None, method: Method = EKF(), initial: Belief | None = None, keep: tuple[str, ...] = SUMMARY,
    covariance: bool | tuple[str, ...] = True, execution: Execution = "auto",
) -> Inferred:  # fmt: skip
    """Filter a recording, and smooth it if `smooth` is True; `smooth` is static.

    Other arguments as of `kalman_smoother`; `covariance` selects smoothed covariances, a filter returns all.

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
