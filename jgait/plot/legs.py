"""Figures of a walk: joint angles, the foot relative to the hip, and distance, with their reference; and strides."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import jax
import numpy as np

from jgait.estimators import stride_flags
from jgait.estimators.columns import COLUMNS, Column
from jgait.io.strides import strides_to_dataframe
from jgait.plot.style import (
    ESTIMATE,
    FOOT,
    FOOTHOLD,
    RED,
    REFERENCE,
    Axes,
    Figure,
    Seconds,
    Style,
    band,
    check_overlap,
    legend,
    panels,
    single,
    windowed,
)
from jgait.types import SIDES, Estimate, LegTrajectory, as_float

if TYPE_CHECKING:
    import pandas as pd


SPECIAL: dict[str, Style] = {
    flag.name: {
        "marker": marker, "markersize": size, "markeredgewidth": width, "label": flag.label,
        "linestyle": "none", "markerfacecolor": "none", "color": "black", "zorder": 4,
    }
    for flag, marker, size, width in (
        (stride_flags.TURNING, "D", 10, 1.0), (stride_flags.STAIRS, "^", 12, 1.0), (stride_flags.CLIPPED, "x", 9, 1.4),
        (stride_flags.HALF, "s", 8, 1.0), (stride_flags.UNEVEN_DURATION, "p", 13, 1.0),
        (stride_flags.UNSURE, "v", 12, 1.0), (stride_flags.SIDE_UNKNOWN, "o", 10, 1.0),
        (stride_flags.DOUBTFUL, "+", 13, 1.2),
    )
}  # fmt: skip
"""Flag of strides → the mark around a stride with this flag; marks differ in shape, not in colour."""


def _worn(estimate: Estimate) -> list[tuple[str, LegTrajectory, LegTrajectory | None]]:
    spreads = estimate.stddev or (None, None)
    rows = zip(SIDES, estimate.legs, spreads, strict=True)
    worn = [(side, leg, spread) for side, leg, spread in rows if leg is not None]
    if not worn:
        raise ValueError("the estimate has no joint angles; they need walking, and sensors on thigh and shank of a leg")
    return worn


def _name(axis: Axes, estimate: Estimate, side: str) -> None:
    """Write the side above an axis, and whether an analysis found that its angles are not usable."""
    usable = estimate.diagnostics.get(f"angles_valid_{side}", True)
    axis.set_title(f"{side} leg" if usable else f"{side} leg: do not use", color="black" if usable else RED)


def _shown(estimate: Estimate, seconds: Seconds) -> Estimate:
    """The estimate with NaN where it is not valid, for example before the first result, and outside the window."""
    visible = np.asarray(estimate.valid, bool) & windowed(estimate.time, seconds)
    parts = {name: getattr(estimate, name) for name in ("legs", "stddev", "distance")}
    return estimate._replace(**jax.tree.map(lambda values: np.where(visible, as_float(values), np.nan), parts))


def joint_angles(
    estimate: Estimate, reference: Estimate | None = None, *, seconds: Seconds = None, title: str = ""
) -> Figure:
    """Hip and knee flexion of each leg with a band of two standard deviations, over the reference, dashed.

    The window `seconds` is from and to [s]. Legs whose angles are not usable are marked "do not use". Raises ValueError
    if the estimate has no joint angles, or none in the window.
    """
    angles = {"hip_angle": "hip flexion [°]", "knee_angle": "knee flexion [°]"}
    return _over_time(estimate, reference, angles, float(np.rad2deg(1.0)), seconds, title)


def foot_displacement(
    estimate: Estimate, reference: Estimate | None = None, *, seconds: Seconds = None, title: str = ""
) -> Figure:
    """Position of each ankle relative to the hip over time; as `joint_angles`."""
    positions = {"x": "ankle forward of hip [cm]", "y": "ankle above hip [cm]"}
    return _over_time(estimate, reference, positions, 100.0, seconds, title)


def _over_time(
    estimate: Estimate, reference: Estimate | None, fields: dict[str, str], scale: float, seconds: Seconds,
    title: str,
) -> Figure:  # fmt: skip
    """A figure with a row for each field of the legs' trajectories (→ label), times a scale; a column for each leg."""
    if seconds is not None:
        check_overlap(estimate.time, seconds)
    estimate, reference = _shown(estimate, seconds), None if reference is None else _shown(reference, seconds)
    worn = _worn(estimate)
    figure, axes = panels(len(fields), len(worn), 5.2 * len(worn) + 0.6, 5.6, sharey="row")
    for column, (side, leg, spread) in zip(axes.T, worn, strict=True):
        true = None if reference is None else getattr(reference.legs, side)
        for axis, (field, label) in zip(column, fields.items(), strict=True):
            value = scale * getattr(leg, field)
            if spread is not None:
                band(axis, estimate.time, value, scale * getattr(spread, field), color="#f0b7b0")
            if reference is not None and true is not None:
                axis.plot(reference.time, scale * getattr(true, field), label="reference", **REFERENCE)
            axis.plot(estimate.time, value, label="jgait", **ESTIMATE)
            axis.set_ylabel(label)
            axis.tick_params(labelleft=True)
        _name(column[0], estimate, side)
        column[-1].set_xlabel("time [s]")
    legend(figure, title)
    return figure


def foot_path(
    estimate: Estimate, reference: Estimate | None = None, *, seconds: Seconds = None, title: str = ""
) -> Figure:
    """Path of the ankle relative to the hip, in the sagittal plane; as `joint_angles`."""
    estimate, reference = _shown(estimate, seconds), None if reference is None else _shown(reference, seconds)
    worn = _worn(estimate)
    figure, axes = panels(1, len(worn), 4.8 * len(worn) + 0.6, 3.6)
    for axis, (side, leg, _) in zip(axes[0], worn, strict=True):
        true = None if reference is None else getattr(reference.legs, side)
        if true is not None:
            axis.plot(100.0 * true.x, 100.0 * true.y, label="reference", **REFERENCE)
        axis.plot(100.0 * leg.x, 100.0 * leg.y, label="jgait", **ESTIMATE)
        axis.set_aspect("equal", adjustable="datalim")
        axis.set_xlabel("ankle forward of hip [cm]")
        _name(axis, estimate, side)
    axes[0, 0].set_ylabel("ankle above hip [cm]")
    legend(figure, title)
    return figure


def distance(estimate: Estimate, reference: Estimate | None = None, *, title: str = "") -> Figure:
    """Walked distance over time, over the reference, dashed, with a band of two standard deviations if the diagnostics
    have `distance_stddev`; that of the whole distance alone grows with the way. Raises ValueError without a distance.
    """
    if estimate.distance is None:
        raise ValueError("the estimate has no distance: no walking was found, or its sensors do not measure it")
    figure, axis = single(6.4, 3.8)
    axis.grid(alpha=0.3)

    def draw(what: Estimate, name: str, style: Style) -> None:
        values = _shown(what, None).distance
        finite = np.flatnonzero(np.isfinite(values))
        axis.plot(what.time, values - values[finite[0]] if finite.size else values, label=name, **style)

    if reference is not None and reference.distance is not None:
        draw(reference, "reference", REFERENCE)
    spread = estimate.diagnostics.get("distance_stddev")
    if spread is not None:
        way = np.asarray(estimate.distance, float)
        if np.size(spread) == 1:  # of the whole walk
            gained = way - way[0]
            spread = spread * gained / max(np.nanmax(gained), 1e-6)
        until = np.flatnonzero(np.append(True, np.asarray(estimate.valid, bool)))[-1]  # padding follows
        time, way, spread = (np.asarray(part)[:until] for part in (estimate.time, way, spread))
        band(axis, time, way, spread, color="0.85")
    draw(estimate, "jgait", ESTIMATE)
    axis.set_xlabel("time [s]")
    axis.set_ylabel("distance walked [m]")
    axis.legend(loc="upper left", fontsize=8)
    axis.set_title(title)
    return figure


def stride_series(estimate: Estimate, *, title: str = "") -> Figure:
    """Length, width and rise of every stride over time, with bars of two standard deviations where they are stated.

    Widths that are not trusted (`diagnostics["width_valid"]`) are hollow and without bars; flags are marks around a
    stride. Raises ValueError if no stride is valid.
    """
    return _series(estimate, ("stride_length_m", "stride_width_m", "stride_height_m"), "foot", title)


def leg_strides(estimate: Estimate, *, title: str = "") -> Figure:
    """Length, time, rise and turn of every stride over time, bars of two standard deviations, flags as marks, of any
    estimate with strides. Raises ValueError if no stride is valid.
    """
    return _series(estimate, ("stride_length_m", "stride_duration_s", "stride_height_m", "turn_deg"), "leg", title)


def _series(estimate: Estimate, columns: Sequence[str], part: str, title: str) -> Figure:
    """A figure with one row for each column of the table of strides that any stride has; those of legs are joined."""
    table, joined = strides_to_dataframe(estimate), part == "leg"
    if not len(table):
        raise ValueError("no stride is valid: there is nothing to draw")
    present = [COLUMNS[name] for name in columns if name in table and table[name].notna().any()]
    figure, axes = panels(len(present), 1, 8.6, 1.9 * len(present) + 1.0, sharex=True)
    marked = special(estimate)
    for number, (axis, column) in enumerate(zip(axes[:, 0], present, strict=True)):
        series_of(axis, table, column, labelled=number == 0, part=part, joined=joined)
        axis.set_ylabel(column.heading)
        when, values = _when(table), column.scale * table[column.name]
        for name, flags in marked.items():
            if (there := flags & values.notna()).any():
                axis.plot(when[there], values[there], **SPECIAL[name])
        if joined:
            axis.margins(y=0.15)
            if column.quantity in ("stride_height", "turn"):
                axis.axhline(0.0, color="0.6", linewidth=0.8)
    axes[-1, 0].set_xlabel("time [s]")
    legend(figure, title, columns=4 if joined else 5)
    return figure


def series_of(
    axis: Axes, table: "pd.DataFrame", column: Column, *, labelled: bool, part: str = "foot", joined: bool = False
) -> None:
    """One column of the table of strides of both sides over time; with `joined`, a line goes through the strides of a
    side, with a gap at pauses of 10 s.
    """
    for side in SIDES:
        rows = table[table["side"] == side]
        values, when = column.scale * rows[column.name], _when(rows)
        trusted = rows.get("width_valid", values.notna()) if column.quantity == "stride_width" else values.notna()
        bars = 2.0 * column.scale * rows[column.deviation].fillna(0.0) if column.deviation in rows else 0.0 * values
        if not len(rows):
            continue
        good, bad = values.notna() & trusted, values.notna() & ~trusted
        stated = bool(bars.any())
        axis.errorbar(when[good], values[good], yerr=bars[good] if stated else None,
                      label=f"{side} {part}{', ±2σ' if stated else ''}" if labelled else None,
                      **FOOTHOLD[side], elinewidth=1.0, ecolor=FOOT[side]["color"])  # fmt: skip
        hollow = {**FOOTHOLD[side], "markerfacecolor": "white"}
        axis.plot(when[bad], values[bad], label=f"{side} {part}, not trusted" if bad.any() else None, **hollow)
        if joined:
            gaps = np.flatnonzero(np.diff(when) >= 10.0) + 1
            times, heights = (np.insert(line.to_numpy(float), gaps, np.nan) for line in (when, values))
            axis.plot(times, heights, color=FOOT[side]["color"], linewidth=0.6, alpha=0.6)


def special(estimate: Estimate) -> dict[str, np.ndarray]:
    """Flag of `SPECIAL` → (rows,) bool for the rows of the table of strides; only flags that a stride has."""
    marked = stride_flags.marks(estimate, stride_flags.STRIDE_FLAGS)
    return {name: flags for name, flags in marked.items() if name in SPECIAL and flags.any()}


def _when(table: "pd.DataFrame") -> "pd.Series":
    """Time at which each stride is drawn [s]: its end."""
    return table["end_s" if "end_s" in table else "standing_end_s"]
