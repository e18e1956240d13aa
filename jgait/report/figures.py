"""The figures of the page of a recording, each with a caption and a text for readers who cannot see the figure."""

from collections.abc import Sequence

import numpy as np

from jgait import plot
from jgait.estimators.about import EstimatedRecording, EstimateFigure
from jgait.estimators.totals import has_strides, joint_ranges
from jgait.plot.legs import special
from jgait.report.page import Picture, picture
from jgait.types import SIDES, Estimate, Feet, Legs, as_float

CLOSE = 8.0
"""[s] Length of the close-up of angles in a longer recording, some strides; chosen by hand."""

BAND = "The band is ± two standard deviations, as the estimator states them."


def pictures(
    estimate: Estimate, reference: Estimate | None = None, special: Sequence[EstimateFigure] = (),
    made: EstimatedRecording | None = None,
) -> list[Picture]:  # fmt: skip
    """The figures of an estimate, the reference dashed, and those of the estimator's `about`, which need `made`."""
    drawn: list[Picture] = []
    measured = bool(np.any(estimate.valid))
    if has_strides(estimate):
        drawn.append(_strides(estimate))
    if measured and _worn(estimate.feet):
        drawn += _feet(estimate, reference)
    if any(leg is not None for leg in estimate.legs):
        drawn += _legs(estimate, reference)
    if estimate.distance is not None and measured:
        way = as_float(estimate.distance)[np.asarray(estimate.valid, bool)]
        caption = "Distance walked since the start." + f" {BAND}" * ("distance_stddev" in estimate.diagnostics)
        alt = f"Distance over time, {way[-1] - way[0]:.1f} m in all"
        drawn.append(picture(plot.distance(estimate, reference), alt, caption))
    for figure in special:
        if made is not None and figure.caption and figure.when(estimate):
            arguments, words = figure.arguments(made)
            drawn.append(picture(getattr(plot, figure.plot)(*arguments, **words), figure.caption, figure.caption))
    return drawn


def middle(estimate: Estimate) -> tuple[float, float] | None:
    """From and to [s] of a close-up in the middle of the walked distance; None for a short recording."""
    time = as_float(estimate.time)
    if time[-1] - time[0] <= 1.5 * CLOSE:
        return None
    way = np.zeros(time.size) if estimate.distance is None else np.nan_to_num(as_float(estimate.distance))
    at = time[np.searchsorted(way, 0.5 * (way[0] + way[-1]))] if way[-1] > way[0] else 0.5 * (time[0] + time[-1])
    start = float(np.clip(at - 0.5 * CLOSE, time[0], time[-1] - CLOSE))
    return start, start + CLOSE


def _worn(pair: Legs | Feet | None) -> str:
    return " and ".join(side for side, part in zip(SIDES, pair or (), strict=False) if part is not None)


def _legs(estimate: Estimate, reference: Estimate | None) -> list[Picture]:
    spans = []
    for joint, pair in joint_ranges(estimate).items():
        spans += [] if pair is None else [f"{' '.join(joint.split()[::-1])} {pair[0]:.0f} to {pair[1]:.0f}°"]
    ranges = "; ".join(spans).replace("-", "−")
    remarks = "" if reference is None else " Dashed: the reference."
    unusable = [side for side in SIDES if not estimate.diagnostics.get(f"angles_valid_{side}", True)]
    remarks += f" Do not use the angles of the {' and '.join(unusable)} leg." if unusable else ""
    close = middle(estimate)
    made = []
    if close is not None:
        figure = plot.joint_angles(estimate, reference, seconds=close)
        alt = f"Hip and knee flexion of the {_worn(estimate.legs)} leg from {close[0]:.0f} to {close[1]:.0f} s"
        caption = f"Hip and knee angles, {CLOSE:.0f} seconds from the middle of the walk. {BAND}{remarks}"
        made.append(picture(figure, alt, caption))
    figure = plot.joint_angles(estimate, reference)
    caption = f"Hip and knee angles of the whole recording; flexion is positive, upright standing is 0. {BAND}{remarks}"
    made.append(picture(figure, f"Hip and knee flexion over time: {ranges}", caption))
    caption = f"Path of the ankle, seen from the side with the hip at the origin; forward is to the right.{remarks}"
    alt = f"Path of the {_worn(estimate.legs)} ankle relative to the hip"
    made.append(picture(plot.foot_path(estimate, reference, seconds=close), alt, caption))
    return made


def _strides(estimate: Estimate) -> Picture:
    """Every stride over time, of feet or of another sensor."""
    strides = estimate.strides
    valid = np.asarray(strides.valid, bool)
    marks = " Marks around a stride are explained below the figure: turns, doubts and the like."
    marks = marks if special(estimate) else ""
    if _worn(estimate.feet):
        width = ", width" if np.isfinite(as_float(strides.width)[valid]).any() else ""
        caption = f"Length{width} and rise of every stride. Bars are ± two standard deviations.{marks}"
        return picture(plot.stride_series(estimate), f"Measures of {valid.sum()} strides over time", caption)
    caption = "Every stride, when it ends. Bars are ± two standard deviations of the error, by the estimator."
    length = as_float(strides.length)[valid]
    lengths = f"lengths from {np.nanmin(length):.2f} to {np.nanmax(length):.2f} m"
    alt = f"Measures of {valid.sum()} strides over time; {lengths}"
    return picture(plot.leg_strides(estimate), alt, f"{caption}{marks}")


def _feet(estimate: Estimate, reference: Estimate | None) -> list[Picture]:
    worn = _worn(estimate.feet)
    shown = reference if reference is not None and reference.feet is not None else None
    together = estimate.strides is not None and "width_valid" in estimate.diagnostics
    caption = "Paths of the sensors on the feet, seen from above; marks are footholds."
    caption += "" if together else " Each foot starts at the origin; how far apart the feet are is not known."
    made = [picture(plot.foot_paths(estimate, shown), f"Path of the {worn} foot from above", caption)]
    caption = "Height of the sensor along the way; marks are footholds. Heights are drawn larger than lengths."
    made.append(picture(plot.foot_height(estimate), f"Height of the {worn} foot along its way", caption))
    wide = has_strides(estimate) and np.isfinite(as_float(estimate.strides.width)[np.asarray(estimate.strides.valid)])
    if estimate.feet is not None and None not in estimate.feet and np.any(wide):
        caption = (
            "Both feet in one world, with stride widths as lines between the footholds: from above, in straight "
            "parts, and over time. Hollow marks are unreliable."
        )
        made.append(picture(plot.two_feet(estimate), "Stride widths from above and over time", caption))
    return made
