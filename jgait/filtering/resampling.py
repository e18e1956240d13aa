r"""Resampling of weighted particles, with a gradient: which particles go on, and what they then weigh.

    a ~ q,  q_i = λ w_i + (1 − λ) / N,  w'_j ∝ w_{a_j} / q_{a_j}

λ = 1 is the usual resampling, after which all particles weigh the same; λ < 1 is soft resampling (Karkus et al.), a
mixture with the uniform law that lets particles of low weight go on. The indices a are drawn systematically: one
uniform number u, and the particles that the points (u + j) / N fall on in the cumulative sum of q. So particle i
goes on ⌊N q_i⌋ or ⌈N q_i⌉ times, N q_i times on average.

Indices have no derivative. The gradient goes through w_{a_j}, while the q that a was drawn with is held fixed. So
the value is that of the ratio, and its gradient that of Σ_i w_i g(x_i), the sum that resampling estimates, in
expectation; both for λ = 1 and for λ < 1. Karkus et al. also differentiate q, as if what was drawn did not depend on
it: then nothing is left of the gradient of the weights for λ = 1, and a part of it for λ < 1. On 20 samples of a cart
seen through noise (tests/filtering/test_particle.py) that gave seven times the derivative by the process noise.

Sources: G. Kitagawa, "Monte Carlo filter and smoother for non-Gaussian nonlinear state space models", JCGS 5(1), 1996,
and R. Douc, O. Cappé, E. Moulines, "Comparison of resampling schemes for particle filtering", ISPA 2005, for systematic
resampling (Douc and Cappé show that its variance may exceed that of the multinomial one in odd cases); P. Karkus,
D. Hsu, W. S. Lee, "Particle filter networks with application to visual localization", CoRL 2018, and X. Ma, P. Karkus,
D. Hsu, W. S. Lee, "Particle filter recurrent neural networks", AAAI 2020, for the soft one; A. Ścibior, F. Wood,
"Differentiable particle filtering without modifying the forward pass", arXiv:2106.10314, 2021, for the gradient.
"""

import math
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax


# Frozen dataclasses and no tuples, for the reason given in `linearise`.
@dataclass(frozen=True)
class Systematic:
    """Systematic resampling by the weights; afterwards all particles weigh the same."""


@dataclass(frozen=True)
class Soft:
    """Systematic resampling by a mixture of the weights and the uniform law; afterwards weights make up for it.

    Attributes:
        share: λ of the weights in the mixture, above 0 and up to 1.
    """

    share: float = 0.5

    def __post_init__(self) -> None:
        if not isinstance(self.share, int | float) or not 0.0 < self.share <= 1.0 or math.isnan(self.share):
            raise ValueError(f"Soft needs a share above 0 and up to 1; got {self.share!r}")


Resampling = Systematic | Soft


def check_resampling(resampling: Any) -> None:
    """Refuse what is no way to resample; raises ValueError."""
    if not isinstance(resampling, Systematic | Soft):
        raise ValueError(f"resampling must be Systematic() or Soft(share); got {resampling!r}")


def lowest(dtype: Any) -> float:
    """The log-weight of a particle that counts for nothing: finite, so that differences and gradients are."""
    return -float(jnp.finfo(dtype).max) / 8.0


def normalised(log_weights: Any) -> Any:
    """Log-weights (N,) that sum to one, none below `lowest`."""
    return jnp.maximum(log_weights - jax.nn.logsumexp(log_weights), lowest(log_weights.dtype))


def effective_size(weights: Any) -> Any:
    """(Σ w)² / Σ w²: how many equally weighted particles would be worth as much as weights (N,)."""
    return jnp.square(jnp.sum(weights)) / jnp.sum(weights * weights)


def systematic_ancestors(key: Any, weights: Any) -> Any:
    """Draw N of N particles by their weights, systematically.

    Args:
        key: PRNG key.
        weights: (N,), not negative, with a positive sum.

    Returns:
        Indices (N,), ascending; i occurs ⌊N w_i⌋ or ⌈N w_i⌉ times (up to the rounding of the cumulative sum), where
        w_i is its share of the sum, and N w_i times on average.
    """
    count, dtype = weights.shape[0], weights.dtype
    # The sum is taken in a tree, and is ascending only up to rounding.
    edges = lax.cummax(jnp.cumsum(weights))
    points = (jnp.arange(count).astype(dtype) + jax.random.uniform(key, (), dtype)) / count
    # Below the last edge whatever is rounded, so that trailing particles without weight are never drawn.
    points = jnp.minimum(points, 1.0 - float(jnp.finfo(dtype).epsneg))
    return jnp.searchsorted(edges / edges[-1], points, side="right").astype(jnp.int32)


def resampled(key: Any, log_weights: Any, resampling: Resampling) -> tuple[Any, Any]:
    """Which particles go on, and their log-weights (N,) afterwards.

    Args:
        key: PRNG key.
        log_weights: (N,), normalised.
        resampling: how.
    """
    held = lax.stop_gradient(log_weights)
    if isinstance(resampling, Soft) and resampling.share < 1.0:
        share, count = resampling.share, log_weights.shape[0]
        held = jnp.logaddexp(held + math.log(share), jnp.full_like(held, math.log((1.0 - share) / count)))
    ancestors = systematic_ancestors(key, jnp.exp(held))
    return ancestors, normalised(log_weights[ancestors] - held[ancestors])
