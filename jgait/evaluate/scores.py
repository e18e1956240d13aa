"""What one recording adds to a cohort: its quantities and its strides, estimate against reference; in NumPy, lean."""

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from jgait.evaluate.errors import FIELDS, common_samples, foot_position_error
from jgait.types import SIDES, Estimate, Strides, Walk, as_float

DEGREES = 180.0 / np.pi
STRIDE_QUANTITIES: dict[str, tuple[str, float]] = {
    "stride_length_m": ("length", 1.0),
    "stride_duration_s": ("", 1.0),
    "stride_width_m": ("width", 1.0),
    "step_length_m": ("step_length", 1.0),
    "stride_height_m": ("height", 1.0),
    "walking_speed_mps": ("speed", 1.0),
    "turn_deg": ("turn", DEGREES),
    "lift_m": ("lift", 1.0),
    "contact_angle_deg": ("contact_angle", DEGREES),
    "push_off_angle_deg": ("push_off_angle", DEGREES),
}
"""Quantity of a stride → field of `Strides` and what its SI unit is multiplied by; the duration is end − start. The
length is also read from `distance`, see `stride_rows`."""

WITHIN = 100.0 * 0.9544997361
"""Share of a normal distribution within two standard deviations [%]."""


class Scores(NamedTuple):
    """What one recording adds to a cohort; errors are formed from it later.

    Attributes:
        quantities: name → (estimate, reference); NaN where there is none.
        strides: columns (n,) `s_id side start end quantity estimate reference`, a row a stride and quantity; empty for
            none.
    """

    quantities: dict[str, tuple[float, float]]
    strides: dict[str, Any]


NAN = float("nan")

AS_FAR = 0.1
"""By how much the way over a stride may differ from the stride, for one to be measured by the other [1]."""


def score(estimate: Estimate, walk: Walk) -> Scores:
    """What an estimate adds to a cohort, with the reference where the walk has one.

    Over the times at which both are valid:
        distance_m: walked between the first and the last of them.
        hip_rmse_deg_right …: root mean square error of each angle and of the foot path of each leg that both have;
            its reference is 0, so that bias and limits of agreement are those of the RMSE over recordings. That of a
            whole walk is absolute: offsets while standing are in it.
        foot_rmse_cm_right, foot_height_rmse_cm_right …: of the place of each foot that both have, seen from above and
            in height, the estimate turned about the vertical and shifted to fit.
        stride_length_within_2sd_percent …: how many strides of the reference lie within two standard deviations of
            the estimate's, where it states them; its reference is the share of a normal distribution.
    Every single number among the estimate's diagnostics (`nis_right`, `log_likelihood_right` …), with the reference's
    of the same name. Every valid stride of the reference, see `stride_rows`.

    Args:
        estimate: on the host, without padding.
        walk: what was recorded; its recording may come without sensors.

    Returns:
        See `Scores`.

    Raises:
        ValueError: if estimate and reference have no time in common.
    """
    reference = walk.reference
    quantities: dict[str, tuple[float, float]] = {}
    strides: dict[str, Any] = {}
    if reference is not None:
        common = common_samples(estimate, reference)
        quantities |= _distance(estimate, reference, common) | _trajectories(estimate, reference, common)
        quantities |= _places(estimate, reference) | within_two_sd(estimate, reference)
        strides = stride_rows(estimate, reference)
    elif estimate.distance is not None:
        way = as_float(estimate.distance)[np.asarray(estimate.valid, bool)]
        quantities["distance_m"] = (float(way[-1] - way[0]), NAN) if way.size else (NAN, NAN)
    known = {} if reference is None else reference.diagnostics
    for name, value in estimate.diagnostics.items():
        if _is_number(value):
            quantities[name] = (float(value), float(known[name]) if _is_number(known.get(name)) else NAN)
    return Scores(quantities, strides)


def _is_number(value: npt.ArrayLike | None) -> bool:
    return value is not None and np.ndim(value) == 0 and np.asarray(value).dtype.kind in "fiub"


def _on(reference: Estimate, estimate: Estimate, values: npt.ArrayLike) -> np.ndarray:
    """An estimate's values (T,) at the times of the reference."""
    theirs, ours = as_float(reference.time), as_float(estimate.time)
    return as_float(values) if np.array_equal(theirs, ours) else np.interp(theirs, ours, as_float(values))


def _distance(estimate: Estimate, reference: Estimate, common: np.ndarray) -> dict[str, tuple[float, float]]:
    if estimate.distance is None:
        return {}
    first, last = np.flatnonzero(common)[[0, -1]]
    ours = _on(reference, estimate, estimate.distance)
    if reference.distance is None:
        return {"distance_m": (float(ours[last] - ours[first]), NAN)}
    theirs = as_float(reference.distance)
    return {"distance_m": (float(ours[last] - ours[first]), float(theirs[last] - theirs[first]))}


def _trajectories(estimate: Estimate, reference: Estimate, common: np.ndarray) -> dict[str, tuple[float, float]]:
    quantities = {}
    for side in SIDES:
        ours, theirs = getattr(estimate.legs, side), getattr(reference.legs, side)
        if ours is None or theirs is None:
            continue
        for column, (field, unit) in FIELDS.items():
            difference = (_on(reference, estimate, getattr(ours, field)) - as_float(getattr(theirs, field)))[common]
            part, suffix = column.split("_")
            rms = float(np.sqrt(np.mean(difference * difference))) * unit
            quantities[f"{part}_rmse_{suffix}_{side}"] = (rms, 0.0)
    return quantities


def _places(estimate: Estimate, reference: Estimate) -> dict[str, tuple[float, float]]:
    quantities = {}
    for side in SIDES:
        error = foot_position_error(estimate, reference, side)
        if error is not None:
            quantities[f"foot_rmse_cm_{side}"] = (100.0 * error.plan, 0.0)
            quantities[f"foot_height_rmse_cm_{side}"] = (100.0 * error.height, 0.0)
    return quantities


def stride_rows(estimate: Estimate, reference: Estimate) -> dict[str, Any]:
    """A row for each valid stride of the reference and each quantity that both have.

    Where the estimate has strides, a stride of the reference goes with that of the same foot whose middle is nearest,
    if each is the other's nearest and they are less than half a stride apart; every quantity that both have anywhere
    is compared. Where it has none, its length is what `distance` gains between the stride's start and end, the
    estimate valid all the while: from one contact to the next on a straight way, the hip goes as far as the foot. It
    does not in the first stride from standing, in the last that closes up, and in tight turns: where the reference's
    own distance gains another length than the foot's by a tenth and more, there is no comparison. NaN for a stride
    that the estimate does not have or cannot be compared in.

    Returns:
        Columns as of `Scores.strides`; `s_id` counts the strides of the reference in the order in which they start.
    """
    strides = reference.strides
    if strides is None or not np.any(strides.valid):
        return {}
    theirs = _ordered(strides)
    known: dict[str, np.ndarray] = {}
    rows: dict[str, np.ndarray] = {}
    if estimate.strides is not None:
        ours = _ordered(estimate.strides)
        match = matched(ours, theirs)
        for name in STRIDE_QUANTITIES:
            values, truth = values_of(ours, name), values_of(theirs, name)
            if values is None or truth is None:
                continue
            values = np.append(values, NAN)[match]
            if name == "stride_length_m" or (np.isfinite(values).any() and np.isfinite(truth).any()):
                rows[name], known[name] = values, truth
    elif estimate.distance is not None:
        rows["stride_length_m"] = np.where(_as_far(reference, theirs), _gained(estimate, theirs), NAN)
        known["stride_length_m"] = as_float(theirs.length)
    if not rows:
        return {}
    count = len(theirs.length)
    start, end = _span(theirs, standing=theirs.start is None)
    fixed = {"s_id": np.arange(count), "side": np.array(SIDES)[theirs.side], "start": start, "end": end}
    return {name: np.concatenate([values] * len(rows)) for name, values in fixed.items()} | {
        "quantity": np.repeat(list(rows), count),
        "estimate": np.concatenate(list(rows.values())),
        "reference": np.concatenate(list(known.values())),
    }


def within_two_sd(estimate: Estimate, reference: Estimate) -> dict[str, tuple[float, float]]:
    """For each quantity of the strides the share of errors within two stated standard deviations [%], and `WITHIN`."""
    if estimate.strides is None or estimate.strides_stddev is None or reference.strides is None:
        return {}
    ours, theirs = _ordered(estimate.strides), _ordered(reference.strides)
    stated = _ordered(estimate.strides_stddev._replace(valid=estimate.strides.valid), like=estimate.strides)
    match = matched(ours, theirs)
    quantities = {}
    for name, (field, _) in STRIDE_QUANTITIES.items():
        values, truth = values_of(ours, name), values_of(theirs, name)
        spread = values_of(stated, name) if field else None
        if values is None or truth is None or spread is None:
            continue
        error = np.append(values, NAN)[match] - truth
        allowed = 2.0 * np.append(spread, NAN)[match]
        usable = np.isfinite(error) & (allowed > 0.0)
        if usable.any():
            share = 100.0 * float(np.mean(np.abs(error[usable]) <= allowed[usable]))
            quantities[f"{name.rpartition('_')[0]}_within_2sd_percent"] = (share, WITHIN)
    return quantities


def values_of(strides: Strides, quantity: str) -> np.ndarray | None:
    """A quantity of every stride in the unit that its name ends with; None where the source does not give it."""
    field, scale = STRIDE_QUANTITIES[quantity]
    if field:
        values = getattr(strides, field)
        return None if values is None else scale * as_float(values)
    if strides.start is None or strides.end is None:
        return None
    return as_float(strides.end) - as_float(strides.start)


def _ordered(strides: Strides, like: Strides | None = None) -> Strides:
    """The valid strides, in the order in which they start; or in that in which those of another table do."""
    by = strides if like is None else like
    valid = np.flatnonzero(np.asarray(by.valid, bool))
    order = valid[np.argsort(_span(by, standing=by.start is None)[0][valid], kind="stable")]
    kept = {name: None if column is None else as_float(column)[order] for name, column in strides._asdict().items()}
    columns: dict[str, Any] = {"side": np.asarray(by.side)[order].astype(int), "valid": np.ones(order.size, bool)}
    return Strides(**kept | columns)


def _span(strides: Strides, *, standing: bool) -> tuple[np.ndarray, np.ndarray]:
    """From when to when strides last [s]: from contact to contact, or from standing to standing."""
    return (
        (as_float(strides.standing), as_float(strides.standing_end))
        if standing
        else (as_float(strides.start), as_float(strides.end))
    )


def matched(ours: Strides, theirs: Strides) -> np.ndarray:
    """For each stride of the second which one of the first it goes with, −1 for none; see `stride_rows`.

    Strides are compared from standing to standing where both state when that is, and else from contact to contact; a
    source without contacts is compared by its standing.
    """
    none = np.full(theirs.side.size, -1)
    if not ours.side.size:
        return none
    both = ours.standing is not None and theirs.standing is not None
    (first, last), (start, end) = (_span(s, standing=both or s.start is None) for s in (ours, theirs))
    apart = np.abs(0.5 * (start + end)[:, None] - 0.5 * (first + last)[None, :])
    apart = np.where(theirs.side[:, None] == ours.side[None, :], apart, np.inf)
    nearest, back = apart.argmin(axis=1), apart.argmin(axis=0)
    rows = np.arange(theirs.side.size)
    good = (back[nearest] == rows) & (apart[rows, nearest] < 0.5 * (end - start))
    return np.where(good, nearest, none)


def _as_far(reference: Estimate, strides: Strides) -> np.ndarray:
    """Over which strides the way walked was as long as the stride, by the reference; all, if it states none."""
    if reference.distance is None:
        return np.ones(strides.start.size, bool)
    with np.errstate(invalid="ignore"):
        return ~(np.abs(_gained(reference, strides) - strides.length) > AS_FAR * strides.length)


def _gained(estimate: Estimate, strides: Strides) -> np.ndarray:
    """How far an estimate's distance grows over each stride [m]; NaN where it is not valid throughout."""
    time, valid = as_float(estimate.time), np.asarray(estimate.valid, bool)
    first = np.searchsorted(time, strides.start, side="right") - 1
    last = np.searchsorted(time, strides.end, side="left")
    inside = (first >= 0) & (last < time.size)
    lost = np.concatenate([[0], np.cumsum(~valid)])
    whole = inside & (lost[np.clip(last + 1, 0, time.size)] == lost[np.clip(first, 0, None)])
    way = as_float(estimate.distance)
    return np.where(whole, np.interp(strides.end, time, way) - np.interp(strides.start, time, way), NAN)
