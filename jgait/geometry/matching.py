"""An estimate beside its reference: common samples, which strides are the same, the turn and shift between two paths.

Strides and paths by NumPy or JAX, as the arrays are.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from jgait.geometry.arrays import xp
from jgait.types import AnyArray, Estimate, Strides, Values, as_float


def common_samples(estimate: Estimate, reference: Estimate) -> np.ndarray:
    """Which samples (T,) of the reference are valid and lie between valid samples of the estimate. Raises ValueError if
    there is none, or times do not increase.
    """
    ours, theirs = as_float(estimate.time), as_float(reference.time)
    valid = np.asarray(estimate.valid, bool)
    for name, time in (("estimate", ours), ("reference", theirs)):
        # an estimate at single instants may have two values at one instant
        if time.ndim != 1 or time.size < 2 or not np.all(np.diff(time) >= 0) or time[-1] == time[0]:
            raise ValueError(f"the {name}'s time must be (T,) with T >= 2 and must not run backwards")
    inside = np.interp(theirs, ours, valid.astype(float), left=0.0, right=0.0) > 1.0 - 1e-9
    common = inside & np.asarray(reference.valid, bool)
    if not common.any():
        raise ValueError(
            f"estimate and reference have no valid time in common; the estimate spans {ours[0]:g} to {ours[-1]:g} s, "
            f"the reference {theirs[0]:g} to {theirs[-1]:g} s"
        )
    return common


def span(strides: Strides, standing: bool) -> tuple[Values, Values]:
    """Start and end (n,) [s] of each stride: from standing to standing, or from contact to contact."""
    return (strides.standing, strides.standing_end) if standing else (strides.start, strides.end)


def matched(ours: Strides, theirs: Strides) -> tuple[Int[AnyArray, "stride"], Bool[AnyArray, "stride"]]:
    """For each of n strides of `theirs` the row of the matching stride of `ours`, and (n,) bool, whether there is one.

    Two strides match if they are of one foot, each is the other's nearest in time, and their middles differ by less
    than half the duration of the reference's stride. They are compared from standing to standing if both tables have
    times of standing, else from contact to contact; a table without contacts by its times of standing. No gradient.
    """
    both = ours.standing is not None and theirs.standing is not None
    (first, last), (start, end) = (span(strides, both or strides.start is None) for strides in (ours, theirs))
    apart = xp.abs(0.5 * (start + end)[:, None] - 0.5 * (first + last)[None, :])
    same = (theirs.side[:, None] == ours.side[None, :]) & (theirs.valid[:, None] & ours.valid[None, :])
    apart = xp.where(same, apart, np.inf)
    nearest, back = xp.argmin(apart, axis=1), xp.argmin(apart, axis=0)
    rows = np.arange(len(start))
    return nearest, (back[nearest] == rows) & (apart[rows, nearest] < 0.5 * (end - start))


def aligned_error(
    path: Float[AnyArray, "time 3"], reference: Float[AnyArray, "time 3"], valid: Bool[AnyArray, "time"]
) -> Float[AnyArray, "time 3"]:
    """Path minus reference [m], after the yaw and the shift of the path that give the smallest mean square.

    With both paths relative to their means, the yaw is atan2(Σ a × b, Σ a · b) of their horizontal parts. No rotation
    about a horizontal axis is removed: it would change heights. Rows that are not valid are 0.
    """
    weight = xp.asarray(valid)[:, None]
    count = xp.maximum(xp.sum(weight, dtype=path.dtype), 1.0)

    def centred(values: Float[AnyArray, "time 3"]) -> Values:
        known = xp.where(weight, values, 0.0)
        return xp.where(weight, known - xp.sum(known, axis=0, keepdims=True) / count, 0.0)

    a, b = centred(path), centred(reference)
    along, across = xp.sum(a[:, :2] * b[:, :2]), xp.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    # The root's argument is above 0, so that paths without extent have a finite gradient.
    size = xp.sqrt(along * along + across * across + np.finfo(a.dtype).tiny ** 0.5)
    c, s = along / size, across / size
    return xp.stack([c * a[:, 0] - s * a[:, 1], s * a[:, 0] + c * a[:, 1], a[:, 2]], axis=1) - b
