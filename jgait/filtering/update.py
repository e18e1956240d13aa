"""The update of a covariance by one linear observation, for a batch."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from jgait.filtering.lanes import (
    applied,
    held,
    inverse,
    product,
    product_transposed,
    summed,
    transposed,
    unheld_product_transposed,
    where,
)


class Update(NamedTuple):
    """One linear update: K (n, m), G (m, m), G e (m,), H P⁻ (m, n), S (m, m), log |S|, and whether it is finite."""

    gain: PyTree
    information: PyTree
    weighted: PyTree
    cross: PyTree
    total: PyTree
    log_det: PyTree
    good: PyTree


def updated(cov: PyTree, observation: PyTree, innovation: PyTree, spread: PyTree, finite: PyTree = True) -> Update:
    """The update of a covariance P⁻ by an observation with H, e and R; nothing is updated where it is not finite, or
    where `finite` (B,) is False.
    """
    cross = product(observation, cov)
    total = product_transposed(cross, observation) + spread
    information, log_det, positive = inverse(total)
    gain, weighted = product(transposed(cross), information), applied(information, innovation)
    # Without `held`, XLA computes the flag again for each entry of each matrix that the flag selects.
    good = held(finite & positive & jnp.isfinite(summed(gain) + summed(weighted) + log_det))
    update = Update(gain, information, weighted, cross, total, log_det, good)
    return kept(update, good)


def joseph(cov: PyTree, gain: PyTree, observation: PyTree, spread: PyTree) -> PyTree:
    """P after the update in Joseph's form, (I − K H) P (I − K H)ᵀ + K R Kᵀ, by products with H and K alone; not held.

    A variance that the observation makes far smaller keeps its digits.
    """
    left = held(product(-gain, product(observation, cov), cov))
    right = product_transposed(left, observation, -product(gain, spread))
    return unheld_product_transposed(-right, gain, left)


def kept(update: Update, good: PyTree) -> Update:
    """The update where `good` (B,), else none."""
    return jax.tree.map(lambda value: where(good, value, jnp.zeros_like(value)), update)
