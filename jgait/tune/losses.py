"""Losses of an estimate against a reference: masked, pure JAX, with finite gradients wherever the inputs are finite."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jgait.estimators.stride_flags import as_far
from jgait.geometry.matching import aligned_error, matched, span
from jgait.types import AnyArray, Estimate, Scalar, Strides, Values

_DEGREE, _CENTIMETRE = jnp.pi / 180.0, 0.01
"""[rad], [m] Errors that have a loss of 1; chosen by hand, so that angles and lengths count alike."""


class TrajectoryWeights(NamedTuple):
    """The weight of a squared error in each field of a leg [1/rad²] or [1/m²]; a weight of 0 leaves the field out.

    By default an error of one degree or of one centimetre has a loss of 1.
    """

    hip_angle: Scalar = 1.0 / _DEGREE**2
    knee_angle: Scalar = 1.0 / _DEGREE**2
    x: Scalar = 1.0 / _CENTIMETRE**2
    y: Scalar = 1.0 / _CENTIMETRE**2


def masked_mean(
    values: Float[AnyArray, "*shape"], valid: Bool[AnyArray, "..."] | None = None, empty: float = 0.0
) -> Float[Array, ""]:
    """Mean of `values` (T,) where `valid` (T,) is True; `empty` if none is. The gradient of masked values is 0."""
    values = jnp.asarray(values)
    if valid is None:
        return jnp.mean(values)
    kept = jnp.where(valid, values, jnp.zeros_like(values))
    count = jnp.sum(jnp.broadcast_to(valid, values.shape), dtype=values.dtype)
    return jnp.where(count > 0.0, jnp.sum(kept) / jnp.maximum(count, 1.0), empty)


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
    estimate: Float[AnyArray, "..."], reference: Float[AnyArray, "..."], valid: Bool[AnyArray, "..."] | None = None,
    empty: float = 0.0,
) -> Float[Array, ""]:  # fmt: skip
    """Mean squared difference (1/n) Σ (estimate − reference)² over the n valid samples of (T,), which must have the
    same shape; `empty` if there are none.
    """
    return masked_mean(_difference(estimate, reference, valid) ** 2, valid, empty)


def _window(estimate: Estimate, reference: Estimate, window: Bool[AnyArray, "time"] | None) -> Bool[Array, "time"]:
    """(T,) True where estimate and reference are valid, inside the window."""
    both = jnp.asarray(estimate.valid) & jnp.asarray(reference.valid)
    return both if window is None else both & jnp.asarray(window)


def trajectory(
    estimate: Estimate, reference: Estimate, weights: TrajectoryWeights | None = None, *,
    window: Bool[AnyArray, "time"] | None = None, relative_to: Bool[AnyArray, "time"] | None = None,
) -> Float[Array, ""]:  # fmt: skip
    """Weighted mean squared error of a leg's angles and foot path [1].

    Σ_f w_f · mean squared difference of field f, averaged over the legs that the estimate and the reference have

    `window` (T,) bool has the samples to use, None for all; samples invalid in either record are never used.
    `relative_to` (T,) bool has samples (of standing) whose mean difference is subtracted first.

    Raises:
        ValueError: if no leg is shared, or the numbers of samples differ.
    """
    look = _window(estimate, reference, window)
    still = None if relative_to is None else _window(estimate, reference, relative_to)
    weights = TrajectoryWeights() if weights is None else weights

    def field(a: Float[AnyArray, "time"], b: Float[AnyArray, "time"]) -> Float[Array, ""]:
        if still is None:
            return mean_squared(a, b, look)
        offset = masked_mean(_difference(a, b, still), still)
        return masked_mean((_difference(a, b, look) - offset) ** 2, look)

    pairs = [(a, b) for a, b in zip(estimate.legs, reference.legs, strict=True) if a is not None and b is not None]
    if not pairs:
        raise ValueError("estimate and reference share no leg")
    terms = [
        w * field(a, b) for leg, other in pairs for w, a, b in zip(weights, leg, other, strict=True)
        if not (isinstance(w, float) and w == 0.0)  # a reference of angles has no foot path
    ]  # fmt: skip
    return jax.tree.reduce(jnp.add, terms) / len(pairs)


def _finite(values: Values, also: AnyArray) -> Array:
    """(n,) True where `also` is True and the values are finite."""
    return jnp.asarray(also) & jnp.isfinite(jnp.asarray(values))


def _duration(strides: Strides, standing: bool) -> Array:
    first, last = span(strides, standing)
    return jnp.asarray(last) - jnp.asarray(first)


def stride(estimate: Estimate, reference: Estimate, field: str, empty: float = 0.0) -> Float[Array, ""]:
    """Mean squared error of one quantity of the strides that the estimate and the reference share; `empty` without any.

    `field` is a field of `Strides`, or "duration" [s]. NaN in the reference or the estimate leaves the stride out. An
    estimate without strides, but with a distance, gives lengths: d(end) − d(start), of the strides in which a body
    advances as far as the foot, see `estimators.stride_flags.as_far`.

    Raises:
        ValueError: if the estimate or the reference does not have the quantity.
    """
    theirs, ours = reference.strides, estimate.strides
    if theirs is None:
        raise ValueError("the reference has no strides to compare")
    if field == "length" and ours is None and estimate.distance is not None and theirs.start is not None:
        ends = [jax.lax.stop_gradient(jnp.asarray(at)) for at in (theirs.start, theirs.end)]
        before, after = (jnp.interp(at, estimate.time, estimate.distance) for at in ends)
        known = reference.distance is not None
        gained = [jnp.interp(at, reference.time, reference.distance) if known else jnp.nan * at for at in ends]
        far = as_far(theirs, gained[1] - gained[0], jnp)
        return mean_squared(after - before, theirs.length, jax.lax.stop_gradient(far), empty)
    if ours is None:
        raise ValueError(f"the estimate has no strides, so no {field} of strides to compare")
    row, paired = matched(ours, theirs)
    if field == "duration":
        standing = theirs.start is None
        values, true = _duration(ours, standing), _duration(theirs, standing)
    else:
        for name, strides in (("estimate", ours), ("reference", theirs)):
            if getattr(strides, field) is None:
                raise ValueError(f"the strides of the {name} have no {field}")
        values, true = getattr(ours, field), getattr(theirs, field)
    return _of_pairs(values, true, row, paired, empty)


def _of_pairs(values: Values, true: Values, row: AnyArray, paired: AnyArray, empty: float) -> Float[Array, ""]:
    """Mean squared error of the strides that are paired, where both numbers are finite."""
    values, true = jnp.asarray(values)[row], jnp.asarray(true)
    return mean_squared(values, true, _finite(true, _finite(values, paired)), empty)


def contact_times(estimate: Estimate, reference: Estimate, empty: float = 0.0) -> Float[Array, ""]:
    """Mean squared error of the initial contacts at the end of the matched strides, and of the final contacts if both
    records have them [s²]; `empty` without matched strides. Raises ValueError if a record has no contacts.
    """
    theirs, ours = reference.strides, estimate.strides
    for name, strides in (("estimate", ours), ("reference", theirs)):
        if strides is None or strides.end is None:
            raise ValueError(f"the {name} has no contacts to compare")
    row, paired = matched(ours, theirs)
    fields = [f for f in ("end", "final_contact") if getattr(ours, f) is not None and getattr(theirs, f) is not None]
    terms = [_of_pairs(getattr(ours, field), getattr(theirs, field), row, paired, empty) for field in fields]
    return jax.tree.reduce(jnp.add, terms) / len(terms)


def position(estimate: Estimate, reference: Estimate, window: Bool[AnyArray, "time"] | None = None) -> Float[Array, ""]:
    """Mean squared 3-D error of the path of each foot [m²], see `aligned_error`; mean of the feet that both have.
    Raises ValueError if they share none.
    """
    look = _window(estimate, reference, window)
    ours, theirs = estimate.feet or (None, None), reference.feet or (None, None)
    pairs = [(a.position, b.position) for a, b in zip(ours, theirs, strict=True) if a is not None and b is not None]
    if not pairs:
        raise ValueError("the estimate and the reference share no path of a foot")
    terms = [masked_mean(jnp.sum(aligned_error(a, b, look) ** 2, axis=1), look) for a, b in pairs]
    return jax.tree.reduce(jnp.add, terms) / len(terms)


def calibration(
    estimate: Estimate, reference: Estimate, window: Bool[AnyArray, "time"] | None = None,
    relative_to: Bool[AnyArray, "time"] | None = None,
) -> Float[Array, ""]:  # fmt: skip
    """Mean negative log-likelihood of the reference under the stated deviations [nat], without the constant ½ log 2π.

    ½ (e/σ)² + log σ, over the stride lengths with a stated deviation, and over the joint angles of the legs, in units
    of 1 cm and 1°; the mean of both if both exist. `window` and `relative_to` as in `trajectory`, for angles.

    Raises:
        ValueError: if nothing of the reference has a stated deviation.
    """
    terms = []
    if reference.strides is not None and estimate.strides_stddev is not None and estimate.strides is not None:
        row, paired = matched(estimate.strides, reference.strides)
        values, spread = (jnp.asarray(strides.length)[row] for strides in (estimate.strides, estimate.strides_stddev))
        terms.append(_normal(values, reference.strides.length, spread, paired, _CENTIMETRE))
    if estimate.stddev is not None:
        look = _window(estimate, reference, window)
        still = None if relative_to is None else _window(estimate, reference, relative_to)
        for leg, true, deviation in zip(estimate.legs, reference.legs, estimate.stddev, strict=True):
            if leg is None or true is None or deviation is None:
                continue
            for field in ("hip_angle", "knee_angle"):
                a, b, stated = (getattr(angles, field) for angles in (leg, true, deviation))
                offset = 0.0 if still is None else masked_mean(_difference(a, b, still), still)
                terms.append(_normal(jnp.asarray(a) - offset, b, stated, look, _DEGREE))
    if not terms:
        raise ValueError("nothing of the reference has a deviation that the estimate states")
    return jax.tree.reduce(jnp.add, terms) / len(terms)


def _normal(values: Values, true: Values, stddev: Values, valid: AnyArray, unit: float) -> Float[Array, ""]:
    """Mean of ½ (e/σ)² + log σ with σ in `unit`, over the valid rows with finite numbers."""
    use = _finite(true, _finite(values, _finite(stddev, valid))) & (jnp.asarray(stddev) > 0.0)
    error = _difference(values, true, use)
    spread = jnp.where(use, stddev, unit)
    return masked_mean(0.5 * (error / spread) ** 2 + jnp.log(spread / unit), use)
