"""Scores of one recording for a cohort: quantities and strides, estimate beside reference; in NumPy."""

from typing import NamedTuple

import numpy as np
from jaxtyping import PyTree

from jgait.estimators.stride_flags import STRIDE_COLUMNS, STRIDE_FLAGS, as_far, regular
from jgait.estimators.walking import durations
from jgait.evaluate.clocks import clock_notes
from jgait.evaluate.errors import foot_position_error, leg_errors
from jgait.geometry.matching import common_samples, matched, span
from jgait.notes import Kind, Note, record
from jgait.types import SIDES, Estimate, Strides, Walk, as_float

WITHIN = 100.0 * 0.9544997361
"""Share of a normal distribution within two standard deviations [%]."""


@record
class Scores(NamedTuple):
    """Scores of one recording for a cohort; errors are computed from them later."""

    quantities: dict[str, tuple[float, float]]  #: name → (estimate, reference); NaN where a value is missing.
    #: columns (n,) `s_id side start end regular quantity estimate reference`, a row a stride and quantity, or empty;
    #: `regular`: no turn, stairs, half-step, other duration, or doubt about the quantity.
    strides: dict[str, np.ndarray]
    notes: tuple[Note, ...] = ()  #: what is doubtful about the reference.
    #: (quantity, note) of each quantity whose reference and estimate cannot both be right.
    contradicts: tuple[tuple[str, Note], ...] = ()


NAN = float("nan")

DISTANCE_OFF = Kind(
    "reference_distance_off", "check", "the reference says {reference:.2f} m, the estimate {estimate:.2f} m",
    "They differ by a factor of more than 2.5, so one of them is wrong. Look for a typing error or another unit in the "
    "reference; until one is corrected, the error is part of all means, and parameters are tuned to it.",
)  # fmt: skip

STRIDES_OFF = Kind(
    "reference_strides_off", "check",
    "the reference's strides are {reference:.2f} m long, the estimated {estimate:.2f} m (medians)",
    "They differ by a factor of more than 1.7, so one of them is wrong. Look for another unit in the reference, such "
    "as feet or centimetres, or for lengths of steps; until it is corrected, the error is part of all means, and "
    "parameters are tuned to it.",
)  # fmt: skip

FACTOR = 2.5
"""[1] Factor above which a distance and its reference cannot both be right: chosen above the public sets' largest of
defaults, 2.24 (daily activities, sensor at the waist), and below that of feet and metres."""


def score(estimate: Estimate, walk: Walk) -> Scores:
    """Scores of an estimate, on the host and without padding, for a cohort, with the reference where the walk has one.

    Quantities over the times at which both are valid:
        distance_m: distance walked from the first to the last of these times.
        hip_rmse_deg_right …: root mean square error of each angle and of the foot path of each leg, with the offsets
            while standing; its reference is 0.
        foot_rmse_cm_right, foot_height_rmse_cm_right …: that of the position of each foot, in the horizontal plane and
            in height, after the best-fitting turn about the vertical and shift.
        stride_length_within_2sd_percent …: share of the strides whose error is within two standard deviations of the
            estimate; its reference is the share of a normal distribution.
    Also every scalar diagnostic of the estimate (`nis_right`, `log_likelihood_right` …), with the reference's
    diagnostic of the same name, and every valid stride of the reference, see `stride_rows`.

    Raises:
        ValueError: if estimate and reference have no time in common.
    """
    reference = walk.reference
    quantities: dict[str, tuple[float, float]] = {}
    strides: dict[str, np.ndarray] = {}
    notes, contradicts = list[Note](), list[tuple[str, Note]]()
    if reference is not None:
        common = common_samples(estimate, reference)
        quantities |= _distance(estimate, reference, common) | _trajectories(estimate, reference, common)
        quantities |= within_two_sd(estimate, reference)
        strides, notes = stride_rows(estimate, reference), [*clock_notes(estimate, reference)]
        way, known_way = quantities.get("distance_m", (NAN, NAN))
        if max(way, known_way) >= 1.0 and _apart(way, known_way, FACTOR):
            notes.append(DISTANCE_OFF(reference=known_way, estimate=way))
            contradicts.append(("distance_m", notes[-1]))
        length, known_length = _median_lengths(strides, estimate, reference)
        # below the factor of strides and steps: two times 0.88, the least median of estimates over references of shoes
        # and waists on the public sets
        if _apart(length, known_length, 1.7):
            notes.append(STRIDES_OFF(reference=known_length, estimate=length))
            contradicts += [("stride_length_m", notes[-1])] if _apart(length, known_length, FACTOR) else []
    elif estimate.distance is not None:
        way = as_float(estimate.distance)[np.asarray(estimate.valid, bool)]
        quantities["distance_m"] = (float(way[-1] - way[0]), NAN) if way.size else (NAN, NAN)
    known = {} if reference is None else reference.diagnostics
    for name, value in estimate.diagnostics.items():
        if _is_number(value):
            quantities[name] = (float(value), float(known[name]) if _is_number(known.get(name)) else NAN)
    return Scores(quantities, strides, tuple(notes), tuple(contradicts))


def _apart(estimate: float, reference: float, factor: float) -> bool:
    """Whether an estimate and its reference differ by more than a factor; False where one of them is NaN."""
    low, high = sorted((estimate, reference))
    return high > 0.0 and high > factor * low


def _is_number(value: PyTree) -> bool:
    return not isinstance(value, tuple | dict) and np.ndim(value) == 0 and np.asarray(value).dtype.kind in "fiub"


def _distance(estimate: Estimate, reference: Estimate, common: np.ndarray) -> dict[str, tuple[float, float]]:
    if estimate.distance is None:
        return {}
    first, last = np.flatnonzero(common)[[0, -1]]
    ours = np.interp(as_float(reference.time), as_float(estimate.time), as_float(estimate.distance))
    theirs = np.full(ours.size, NAN) if reference.distance is None else as_float(reference.distance)
    return {"distance_m": (float(ours[last] - ours[first]), float(theirs[last] - theirs[first]))}


def _median_lengths(rows: dict[str, np.ndarray], estimate: Estimate, reference: Estimate) -> tuple[float, float]:
    """Median length of strides by the estimate and by the reference [m], of strides that both have; NaN without any."""
    if not rows:
        return NAN, NAN
    lengths = rows["quantity"] == "stride_length_m"
    ours, theirs = rows["estimate"][lengths], rows["reference"][lengths]
    if estimate.strides is None and not np.isfinite(ours).any() and reference.strides is not None:
        # No stride is as long as the reference's distance: the lengths of all may be wrong.
        ours = _gained(estimate, _ordered(reference.strides))
    known = np.isfinite(ours) & np.isfinite(theirs) & (theirs > 0.0)
    return (float(np.median(ours[known])), float(np.median(theirs[known]))) if known.any() else (NAN, NAN)


def _trajectories(estimate: Estimate, reference: Estimate, common: np.ndarray) -> dict[str, tuple[float, float]]:
    quantities = {}
    for side, column, error in leg_errors(estimate, reference):
        part, suffix = column.split("_")
        known = error[common & np.isfinite(error)]
        if known.size:
            quantities[f"{part}_rmse_{suffix}_{side}"] = (float(np.sqrt(np.mean(known**2))), 0.0)
    for side in SIDES:
        of_foot = foot_position_error(estimate, reference, side)
        if of_foot is not None:
            quantities[f"foot_rmse_cm_{side}"] = (100.0 * of_foot.plan, 0.0)
            quantities[f"foot_height_rmse_cm_{side}"] = (100.0 * of_foot.height, 0.0)
    return quantities


def stride_rows(estimate: Estimate, reference: Estimate) -> dict[str, np.ndarray]:
    """A row for each valid stride of the reference and each quantity that both have.

    If the estimate has strides, they are matched (`geometry.matching.matched`), and every quantity that both have in
    any stride is compared. If it has none, its stride length is the gain of `distance` from the stride's start to its
    end, valid throughout: between two contacts on a straight path, the hip moves as far as the foot. This does not hold
    in the first stride from standing, in the last before standing, and in tight turns: only strides `as_far` are
    compared. Strides that the estimate lacks, or that are not compared, are NaN.

    Returns:
        Columns as of `Scores.strides`; `s_id` counts the strides of the reference in the order in which they start.
    """
    strides = reference.strides
    if strides is None or not np.any(strides.valid):
        return {}
    theirs = _ordered(strides)
    known: dict[str, np.ndarray] = {}
    rows: dict[str, np.ndarray] = {}
    whole: list[np.ndarray] = []
    if estimate.strides is not None:
        ours = _ordered(estimate.strides)
        match = _matches(ours, theirs)
        for name in STRIDE_COLUMNS:
            values, truth = values_of(ours, name), values_of(theirs, name)
            if values is None or truth is None:
                continue
            values = np.append(values, NAN)[match]
            if name == "stride_length_m" or (np.isfinite(values).any() and np.isfinite(truth).any()):
                rows[name], known[name] = values, truth
                whole.append(np.append(regular(estimate, STRIDE_FLAGS, name), False)[match])
    elif estimate.distance is not None:
        way = np.full(len(theirs.length), NAN) if reference.distance is None else _gained(reference, theirs)
        whole = [np.asarray(as_far(theirs, way))]
        rows["stride_length_m"] = np.where(whole[0], _gained(estimate, theirs), NAN)
        known["stride_length_m"] = as_float(theirs.length)
    if not rows:
        return {}
    count = len(theirs.length)
    start, end = span(theirs, standing=theirs.start is None)
    fixed = {"s_id": np.arange(count), "side": np.array(SIDES)[theirs.side], "start": start, "end": end}
    return {name: np.tile(values, len(rows)) for name, values in fixed.items()} | {
        "regular": np.concatenate(whole),
        "quantity": np.repeat(list(rows), count),
        "estimate": np.concatenate(list(rows.values())),
        "reference": np.concatenate(list(known.values())),
    }


def within_two_sd(estimate: Estimate, reference: Estimate) -> dict[str, tuple[float, float]]:
    """Quantity of the strides → share of errors within two standard deviations of the estimate [%], and `WITHIN`."""
    if estimate.strides is None or estimate.strides_stddev is None or reference.strides is None:
        return {}
    ours, theirs = _ordered(estimate.strides), _ordered(reference.strides)
    stated = _ordered(estimate.strides_stddev._replace(valid=estimate.strides.valid), like=estimate.strides)
    match = _matches(ours, theirs)
    quantities = {}
    for name, (field, _) in STRIDE_COLUMNS.items():
        values, truth, spread = (values_of(strides, name) for strides in (ours, theirs, stated))
        if field and values is not None and truth is not None and spread is not None:
            error, allowed = np.append(values, NAN)[match] - truth, 2.0 * np.append(spread, NAN)[match]
            usable = np.isfinite(error) & (allowed > 0.0)
            if usable.any():
                share = 100.0 * float(np.mean(np.abs(error[usable]) <= allowed[usable]))
                quantities[f"{name.rpartition('_')[0]}_within_2sd_percent"] = (share, WITHIN)
    return quantities


def values_of(strides: Strides, quantity: str) -> np.ndarray | None:
    """A quantity of every stride, in the unit at the end of its name; None where `strides` lacks the quantity."""
    field, scale = STRIDE_COLUMNS[quantity]
    if field:
        values = getattr(strides, field)
        return None if values is None else scale * as_float(values)
    if strides.start is None or strides.end is None:
        return None
    return durations(strides)


def _matches(ours: Strides, theirs: Strides) -> np.ndarray:
    """For each stride of `theirs`, the index of the matching stride of `ours`, −1 for none."""
    row, paired = matched(ours, theirs) if ours.side.size else (np.full(theirs.side.size, -1), True)
    return np.where(paired, row, -1)


def _ordered(strides: Strides, like: Strides | None = None) -> Strides:
    """The valid strides in the order of their start, or, with `like`, in the order of the strides of `like`."""
    by = strides if like is None else like
    valid = np.flatnonzero(np.asarray(by.valid, bool))
    order = valid[np.argsort(as_float(span(by, standing=by.start is None)[0])[valid], kind="stable")]
    kept = {name: None if column is None else as_float(column)[order] for name, column in strides._asdict().items()}
    columns: dict[str, PyTree] = {"side": np.asarray(by.side)[order].astype(int), "valid": np.ones(order.size, bool)}
    return Strides(**kept | columns)


def _gained(estimate: Estimate, strides: Strides) -> np.ndarray:
    """Gain of an estimate's distance over each stride [m]; NaN where the estimate is not valid throughout."""
    time, valid = as_float(estimate.time), np.asarray(estimate.valid, bool)
    first = np.searchsorted(time, strides.start, side="right") - 1
    last = np.searchsorted(time, strides.end, side="left")
    inside = (first >= 0) & (last < time.size)
    lost = np.concatenate([[0], np.cumsum(~valid)])
    whole = inside & (lost[np.clip(last + 1, 0, time.size)] == lost[np.clip(first, 0, None)])
    way = as_float(estimate.distance)
    return np.where(whole, np.interp(strides.end, time, way) - np.interp(strides.start, time, way), NAN)
