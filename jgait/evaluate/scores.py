"""What is told of one recording: its quantities and its strides, estimate against reference; in NumPy, lean."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from jgait.evaluate.errors import FIELDS, common_samples
from jgait.types import SIDES, Estimate, Strides, Walk, as_float

STRIDE_QUANTITIES: dict[str, Callable[[Strides], np.ndarray]] = {
    "stride_length_m": lambda s: as_float(s.length),
    "stride_duration_s": lambda s: as_float(s.end) - as_float(s.start),
    "stride_width_m": lambda s: as_float(s.width),
}
"""Quantity of a stride → how it is read from `Strides`; the first also from `distance`, see `stride_rows`."""


class Scores(NamedTuple):
    """What is told of one recording; errors are formed from it later.

    Attributes:
        quantities: name → (estimate, reference); NaN where there is none.
        strides: columns (n,) `s_id side start end quantity estimate reference`, a row a stride and quantity; empty for
            none.
    """

    quantities: dict[str, tuple[float, float]]
    strides: dict[str, Any]


NAN = float("nan")

AS_FAR = 0.1
"""By how much the way over a stride may differ from the stride, for one to be told by the other [1]."""


def score(estimate: Estimate, walk: Walk) -> Scores:
    """What can be told of an estimate, with the reference where the walk has one.

    Over the times at which both are valid:
        distance_m: walked between the first and the last of them.
        hip_rmse_deg_right …: root mean square error of each angle and of the foot path of each leg that both have;
            its reference is 0, so that bias and limits of agreement are those of the RMSE over recordings. That of a
            whole walk is absolute: offsets while standing are in it.
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
        strides = stride_rows(estimate, reference)
    elif estimate.distance is not None:
        way = as_float(estimate.distance)[np.asarray(estimate.valid, bool)]
        quantities["distance_m"] = (float(way[-1] - way[0]), NAN) if way.size else (NAN, NAN)
    known = {} if reference is None else reference.diagnostics
    for name, value in estimate.diagnostics.items():
        if _is_number(value):
            quantities[name] = (float(value), float(known[name]) if _is_number(known.get(name)) else NAN)
    return Scores(quantities, strides)


def _is_number(value: Any) -> bool:
    return value is not None and np.ndim(value) == 0 and np.asarray(value).dtype.kind in "fiub"


def _on(reference: Estimate, estimate: Estimate, values: Any) -> np.ndarray:
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
    found = {}
    for side in SIDES:
        ours, theirs = getattr(estimate.legs, side), getattr(reference.legs, side)
        if ours is None or theirs is None:
            continue
        for column, (field, unit) in FIELDS.items():
            difference = (_on(reference, estimate, getattr(ours, field)) - as_float(getattr(theirs, field)))[common]
            part, suffix = column.split("_")
            rms = float(np.sqrt(np.mean(difference * difference))) * unit
            found[f"{part}_rmse_{suffix}_{side}"] = (rms, 0.0)
    return found


def stride_rows(estimate: Estimate, reference: Estimate) -> dict[str, Any]:
    """A row for each valid stride of the reference and each quantity that the estimate can say something of.

    Where the estimate has strides, a stride of the reference goes with that of the same foot whose middle is nearest,
    if each is the other's nearest and they are less than half a stride apart; length, duration and width are compared.
    Where it has none, its length is what `distance` gains between the stride's start and end, the estimate valid all
    the while: from one contact to the next on a straight way, the hip goes as far as the foot. It does not in the
    first stride from standing, in the last that closes up, and in tight turns: where the reference's own distance
    gains another length than the foot's by a tenth and more, there is no comparison. NaN for a stride that the
    estimate does not have or cannot be compared in.

    Returns:
        Columns as of `Scores.strides`; `s_id` counts the strides of the reference in the order in which they start.
    """
    strides = reference.strides
    if strides is None or not np.any(strides.valid):
        return {}
    theirs = _ordered(strides)
    own: dict[str, np.ndarray] = {}
    if estimate.strides is not None:
        ours = _ordered(estimate.strides)
        match = matched(ours, theirs)
        for name, read in STRIDE_QUANTITIES.items():
            values = np.append(read(ours), NAN)[match]
            if np.isfinite(values).any() or name == "stride_length_m":
                own[name] = values
    elif estimate.distance is not None:
        own["stride_length_m"] = np.where(_as_far(reference, theirs), _gained(estimate, theirs), NAN)
    count = len(theirs.start)
    fixed = {
        "s_id": np.arange(count), "side": np.array(SIDES)[theirs.side], "start": theirs.start, "end": theirs.end,
    }  # fmt: skip
    if not own:
        return {}
    return {name: np.concatenate([values] * len(own)) for name, values in fixed.items()} | {
        "quantity": np.repeat(list(own), count),
        "estimate": np.concatenate(list(own.values())),
        "reference": np.concatenate([STRIDE_QUANTITIES[name](theirs) for name in own]),
    }


def _ordered(strides: Strides) -> Strides:
    """The valid strides, in the order in which they start."""
    valid = np.flatnonzero(np.asarray(strides.valid, bool))
    order = valid[np.argsort(as_float(strides.start)[valid], kind="stable")]
    kept = {name: as_float(getattr(strides, name))[order] for name in Strides._fields[1:-1]}
    return Strides(side=np.asarray(strides.side)[order].astype(int), valid=np.ones(order.size, bool), **kept)


def matched(ours: Strides, theirs: Strides) -> np.ndarray:
    """For each stride of the second which one of the first it goes with, −1 for none; see `stride_rows`."""
    none = np.full(theirs.start.size, -1)
    if not ours.start.size:
        return none
    apart = np.abs(0.5 * (theirs.start + theirs.end)[:, None] - 0.5 * (ours.start + ours.end)[None, :])
    apart = np.where(theirs.side[:, None] == ours.side[None, :], apart, np.inf)
    nearest, back = apart.argmin(axis=1), apart.argmin(axis=0)
    rows = np.arange(theirs.start.size)
    good = (back[nearest] == rows) & (apart[rows, nearest] < 0.5 * (theirs.end - theirs.start))
    return np.where(good, nearest, none)


def _as_far(reference: Estimate, strides: Strides) -> np.ndarray:
    """Over which strides the reference says that the way walked was as long as the stride; all, if it says none."""
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
