"""Losses of an estimate against a reference: masked, pure JAX, with finite gradients wherever the inputs are finite."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PyTree

from jgait.types import SIDES, AnyArray, Estimate, LegTrajectory, Scalar

_DEGREE = jnp.pi / 180.0
_CENTIMETRE = 0.01


class TrajectoryWeights(NamedTuple):
    """The weight of a squared error in each field of a leg [1/rad²] or [1/m²]; a weight of 0 leaves the field out.

    By default an error of one degree or of one centimetre has a loss of 1.
    """

    hip_angle: Scalar = 1.0 / _DEGREE**2
    knee_angle: Scalar = 1.0 / _DEGREE**2
    x: Scalar = 1.0 / _CENTIMETRE**2
    y: Scalar = 1.0 / _CENTIMETRE**2


def masked_mean(values: Float[AnyArray, "*shape"], valid: Bool[AnyArray, "..."] | None = None) -> Float[Array, ""]:
    """Mean of `values` (T,) where `valid` (T,) is True; 0 if no sample is valid. The gradient of masked values is 0."""
    values = jnp.asarray(values)
    if valid is None:
        return jnp.mean(values)
    kept = jnp.where(valid, values, jnp.zeros_like(values))
    count = jnp.sum(jnp.broadcast_to(valid, values.shape), dtype=values.dtype)
    return jnp.sum(kept) / jnp.maximum(count, 1.0)


def _difference(
    estimate: Float[AnyArray, "..."], reference: Float[AnyArray, "..."], valid: Bool[AnyArray, "..."] | None
) -> Float[Array, "*shape"]:
    """The difference, 0 where masked, so that masked values have no influence on later arithmetic."""
    estimate, reference = jnp.asarray(estimate), jnp.asarray(reference)
    if estimate.shape != reference.shape:
        raise ValueError(f"estimate and reference must have the same shape; got {estimate.shape} and {reference.shape}")
    if valid is None:
        return estimate - reference
    zero = jnp.zeros_like(estimate)
    return jnp.where(valid, estimate, zero) - jnp.where(valid, reference, jnp.zeros_like(reference))


def mean_squared(
    estimate: Float[AnyArray, "..."], reference: Float[AnyArray, "..."], valid: Bool[AnyArray, "..."] | None = None
) -> Float[Array, ""]:
    """Mean squared difference (1/n) Σ (estimate − reference)² over the n valid samples of (T,); 0 if nothing is valid.

    Raises:
        ValueError: if the shapes differ.
    """
    return masked_mean(_difference(estimate, reference, valid) ** 2, valid)


def _window(estimate: Estimate, reference: Estimate, window: Bool[AnyArray, "time"] | None) -> Bool[Array, "time"]:
    """(T,) True where estimate and reference are valid, inside the window."""
    both = jnp.asarray(estimate.valid) & jnp.asarray(reference.valid)
    return both if window is None else both & jnp.asarray(window)


def _pairs(
    estimate: Estimate, reference: Estimate, sides: tuple[str, ...]
) -> list[tuple[LegTrajectory, LegTrajectory]]:
    """The legs among `sides` that both the estimate and the reference have."""
    unknown = [side for side in sides if side not in SIDES]
    if unknown:
        raise ValueError(f"sides must be among {SIDES}; got {unknown[0]!r}")
    legs = [(getattr(estimate.legs, side), getattr(reference.legs, side)) for side in sides]
    pairs = [(a, b) for a, b in legs if a is not None and b is not None]
    if not pairs:
        raise ValueError(f"estimate and reference share none of the legs {list(sides)}")
    return pairs


def trajectory(
    estimate: Estimate,
    reference: Estimate,
    weights: TrajectoryWeights | None = None,
    *,
    window: Bool[AnyArray, "time"] | None = None,
    relative_to: Bool[AnyArray, "time"] | None = None,
    sides: tuple[str, ...] = SIDES,
) -> Float[Array, ""]:
    """Weighted mean squared error of a leg's angles and foot path.

    Σ_f w_f · mean squared difference of field f, averaged over the legs that the estimate and the reference have

    Args:
        estimate: of T samples at the reference's times.
        reference: the true or measured trajectory.
        weights: weights of the fields; None: an error of one degree or one centimetre has a loss of 1.
        window: (T,) bool, samples to use; None for all. Samples invalid in either input are never used.
        relative_to: (T,) bool, samples (of standing) whose mean difference is subtracted first; None: no subtraction.
        sides: the legs to compare.

    Returns:
        A scalar [1].

    Raises:
        ValueError: if no leg is shared, a side is unknown, or the numbers of samples differ.
    """
    weights = TrajectoryWeights() if weights is None else weights
    look = _window(estimate, reference, window)
    still = None if relative_to is None else _window(estimate, reference, relative_to)

    def field(a: Float[AnyArray, "time"], b: Float[AnyArray, "time"]) -> Float[Array, ""]:
        if still is None:
            return mean_squared(a, b, look)
        offset = masked_mean(_difference(a, b, still), still)
        return masked_mean((_difference(a, b, look) - offset) ** 2, look)

    pairs = _pairs(estimate, reference, sides)
    terms = [w * field(a, b) for one, other in pairs for w, a, b in zip(weights, one, other, strict=True)]
    return jax.tree.reduce(jnp.add, terms) / len(pairs)


def _last(values: Float[AnyArray, "time"], valid: Bool[Array, "time"]) -> Float[Array, ""]:
    """The last valid value of (T,) values; the last value if none is valid."""
    from_end = jnp.argmax(jnp.flip(valid))
    return jnp.asarray(values)[valid.shape[0] - 1 - from_end]


def distance(estimate: Estimate, reference: Estimate) -> Float[Array, ""]:
    """Squared relative error of the distance walked, ((d − d_ref) / d_ref)² [1] at the last sample where both are
    valid.

    Raises:
        ValueError: if the estimate or the reference has no distance.
    """
    for name, one in (("estimate", estimate), ("reference", reference)):
        if one.distance is None:
            raise ValueError(f"the {name} has no distance to compare")
    valid = _window(estimate, reference, None)
    ours, theirs = _last(estimate.distance, valid), _last(reference.distance, valid)
    return ((ours - theirs) / theirs) ** 2


def stride_length(estimate: Estimate, reference: Estimate) -> Float[Array, ""]:
    """Mean squared error of the stride lengths [m²], computed from the distance walked; 0 if no stride is valid.

    (1/n) Σ (d(end) − d(start) − length)² over the n valid strides of the reference, whose times carry no gradient

    Raises:
        ValueError: if the estimate has no distance, or the reference has no strides.
    """
    if estimate.distance is None or reference.strides is None:
        raise ValueError("stride_length needs an estimate with distance and a reference with strides")
    rows = reference.strides
    at = [jnp.interp(jax.lax.stop_gradient(ends), estimate.time, estimate.distance) for ends in (rows.start, rows.end)]
    return mean_squared(at[1] - at[0], rows.length, rows.valid)


def event_time(
    estimate: Float[AnyArray, "event"],
    reference: Float[AnyArray, "event"],
    valid: Bool[AnyArray, "event"] | None = None,
) -> Float[Array, ""]:
    """Mean squared difference of the times (n,) [s] of matched events [s²]; 0 if nothing is valid.

    An estimator's event times are differentiable if they are computed between samples, for example by a soft argmax.

    Raises:
        ValueError: if the shapes differ.
    """
    return mean_squared(estimate, reference, valid)


def negative_log_likelihood(posterior: PyTree, valid: Bool[AnyArray, "time"] | None = None) -> Float[Array, ""]:
    """Mean negative log-likelihood of the measurements [nat per component], from the filter's innovations.

    −Σ log p(y_k | y_1…y_{k−1}) / number of measured components; 0 if nothing was measured. `valid` (T,) selects
    samples; those that the filter marks as invalid are never used.

    Raises:
        ValueError: if the posterior has no likelihood or no count.
    """
    missing = [name for name in ("log_likelihood", "count", "valid") if getattr(posterior, name) is None]
    if missing:
        raise ValueError(f"the posterior must keep {missing[0]!r}; add it to the filter's keep=(...)")
    use = posterior.valid if valid is None else posterior.valid & valid
    terms = posterior.log_likelihood
    total = jnp.sum(jnp.where(use, terms, jnp.zeros_like(terms)))
    count = jnp.sum(jnp.where(use, posterior.count, jnp.zeros_like(posterior.count)), dtype=terms.dtype)
    return -total / jnp.maximum(count, 1.0)
