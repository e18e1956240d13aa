"""The model of doubt learned from strides beside a reference, and judged on people and sets that were left out."""

from collections.abc import Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from scipy.optimize import Bounds, minimize

from experiments.quality.strides import Table
from jgait import params
from jgait.quality import EVIDENCE, QualityParams, doubt, factor
from jgait.quality.model import NUMBERS, weighted
from jgait.types import Values

SHARES = (("public", 0.5), ("gait", 0.2), ("fault", 0.3))
"""Kind of a group → its share of the weight of all strides: each set, gait and fault of a kind counts the same."""

PER_RECORDING = 4.0
"""Weight of a recording, in independent strides: those of one recording are alike."""


def kind(group: str) -> str:
    """ "public", "gait" or "fault"."""
    first = group.partition(" ")[0]
    return first if first in ("gait", "fault") else "public"


def weights(table: Table) -> np.ndarray:
    """(n,) weight of each stride."""
    kinds = np.array([kind(group) for group in table.group])
    share, total = np.zeros(len(kinds)), PER_RECORDING * len(set(table.recording))
    for name, part in SHARES:
        groups = [table.group == group for group in sorted(set(table.group[kinds == name]))]
        for rows in groups:
            share[rows] = part / len(groups) / rows.sum()
    return total * share / share.sum()


def learned(table: Table, rows: np.ndarray | None = None) -> QualityParams:
    """The numbers with the largest likelihood of the errors of some rows (n,) bool, each weight with an exponential
    prior: those that no error asks for are 0.
    """
    kept = np.ones(len(table.error), bool) if rows is None else rows
    weight = np.zeros(len(kept))
    weight[kept] = weights(chosen(table, kept))
    data = tuple(map(jnp.asarray, (table.evidence, table.error, table.stated, table.length, table.reference, weight)))
    start, shape = ravel_pytree(jax.tree.map(jnp.asarray, QualityParams()))
    low, high = (ravel_pytree(jax.tree.map(_like, QualityParams(), limit))[0] for limit in (LOWEST, HIGHEST))
    fit = minimize(
        lambda x: tuple(np.asarray(part, np.float64) for part in _cost(jnp.asarray(x), data)), np.asarray(start),
        jac=True, method="L-BFGS-B", bounds=Bounds(np.asarray(low), np.asarray(high)),
    )  # fmt: skip
    return jax.tree.map(np.asarray, shape(jnp.asarray(fit.x)))


FIXED = QualityParams()
LOWEST = FIXED._replace(shift=0.0, spread=0.0, odds=-np.inf, wrong=0.0, tail=2.0)
HIGHEST = FIXED._replace(shift=np.inf, spread=np.inf, odds=np.inf, wrong=np.inf, tail=30.0)
"""Limits of the numbers."""


def _like(value: Values, limit: float) -> Values:
    return jnp.full(jnp.shape(value), limit, float)


@jax.jit
@jax.value_and_grad
def _cost(x: Values, data: tuple[Values, ...]) -> Values:
    """Minus the logarithm of the posterior density [nat]."""
    evidence, error, stated, length, reference, weight = data
    p = ravel_pytree(jax.tree.map(jnp.asarray, QualityParams()))[1](x)
    named = dict(zip(EVIDENCE, evidence.T, strict=True))
    each = jnp.where(weight > 0.0, log_likelihood(p, named, error, stated, length, reference), 0.0)
    return -jnp.sum(weight * each) + _prior(p)


def log_likelihood(
    p: QualityParams, evidence: Mapping[str, Values], error: Values, stated: Values, length: Values, reference: Values
) -> Values:
    """The logarithm of the density of each error of a length (n,) [m]; `reference` (n,) is the deviation of
    the reference itself [m], other arguments are those of `factor`.
    """
    odds, usual = p.odds + weighted(p.wrong, evidence), factor(p, evidence, stated, length) * stated

    def density(deviation: Values) -> Values:
        variance = deviation**2 + reference**2
        return -0.5 * (error**2 / variance + jnp.log(2.0 * jnp.pi * variance))

    right, wrong = -jax.nn.softplus(odds) + density(usual), -jax.nn.softplus(-odds) + density(p.tail * usual)
    return jnp.logaddexp(right, wrong)


def _prior(p: QualityParams) -> Values:
    """Minus the logarithm of the prior density of the numbers [nat]."""
    priors = params.priors(p)
    return sum(jnp.sum(prior.penalty(value)) for value, prior in zip(p, priors, strict=True) if prior is not None)


def judged_by(p: QualityParams, table: Table) -> tuple[np.ndarray, np.ndarray]:
    """Errors over the deviation that the model gives (n,), with that of the reference, and the doubt (n,)."""
    named = dict(zip(EVIDENCE, table.evidence.T, strict=True))
    spread = np.hypot(factor(p, named, table.stated, table.length) * table.stated, table.reference)
    return np.abs(table.error) / spread, np.asarray(doubt(p, named))


def interval(p: QualityParams, table: Table) -> float:
    """Deviations within which 95 % of the errors on public recordings are [1], each set, and each recording of a set,
    counting the same, so that the interval of a set that was not seen is as good a guess as any.
    """
    error, _ = judged_by(p, table)
    public = np.array([kind(group) == "public" for group in table.group])
    if not public.any():
        return 2.0
    share = np.zeros(len(error))
    for group in sorted(set(table.group[public])):
        names = sorted(set(table.recording[table.group == group]))
        for name in names:
            rows = (table.group == group) & (table.recording == name)
            share[rows] = 1.0 / len(names) / rows.sum()
    order = np.argsort(error)
    total = np.cumsum(share[order])
    return float(error[order][np.searchsorted(total, 0.95 * total[-1])])


def chosen(table: Table, rows: np.ndarray | Sequence[int]) -> Table:
    """Some rows."""
    return Table(*(column[rows] for column in table))


def left_out(table: Table, by: np.ndarray, folds: int | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`judged_by` of every stride, with numbers learned without its part, and whether it is in its interval: `by` names
    a part of each stride; `folds` puts parts together, None leaves each out alone.
    """
    names = sorted(set(by))
    part = {name: number % (folds or len(names)) for number, name in enumerate(names)}
    number = np.array([part[name] for name in by])
    error, doubts, inside = np.zeros(len(by)), np.zeros(len(by)), np.zeros(len(by), bool)
    for fold in sorted(set(number)):
        out = number == fold
        p = learned(table, ~out)
        error[out], doubts[out] = judged_by(p, chosen(table, out))
        inside[out] = error[out] <= interval(p, chosen(table, ~out))
    return error, doubts, inside


def to_dict(p: QualityParams) -> dict[str, Any]:
    """The numbers for JSON, inverse of `quality.model.from_dict`, without weights below 0.01."""
    weights = {
        name: {k: round(float(w), 4) for k, w in zip(EVIDENCE, getattr(p, name), strict=True) if w > 1e-2}
        for name in ("spread", "wrong")
    }
    return {**{name: round(float(getattr(p, name)), 4) for name in NUMBERS}, **weights}
