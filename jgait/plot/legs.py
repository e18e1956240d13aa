"""Figures of legs: joint angles, the foot relative to the hip, and distance, beside their reference."""

from pathlib import Path
from typing import Any

import numpy as np

from jgait.plot.walk import blank
from jgait.types import SIDES, Estimate, LegTrajectory, as_float

ESTIMATE = {"color": "#c0392b", "linewidth": 1.4}
REFERENCE = {"color": "black", "linewidth": 1.2, "linestyle": (0, (4, 2))}
FIELDS = (
    ("hip_angle", "hip flexion [°]", 180.0 / np.pi),
    ("knee_angle", "knee flexion [°]", 180.0 / np.pi),
    ("x", "ankle forward of hip [cm]", 100.0),
    ("y", "ankle above hip [cm]", 100.0),
)


def _worn(estimate: Estimate) -> list[tuple[str, LegTrajectory, LegTrajectory | None]]:
    spreads = estimate.stddev or (None, None)
    rows = zip(SIDES, estimate.legs, spreads, strict=True)
    return [(side, leg, spread) for side, leg, spread in rows if leg is not None]


def _window(estimate: Estimate, seconds: tuple[float, float] | None) -> slice:
    time = np.asarray(estimate.time)
    if seconds is None:
        return slice(0, time.size)
    return slice(*np.searchsorted(time, seconds))


def _shown(estimate: Estimate) -> Estimate:
    """The same with gaps where it says nothing: padding, no data yet."""
    valid = np.asarray(estimate.valid, bool)

    def gapped(values: Any) -> np.ndarray:
        return np.where(valid, np.asarray(values, float), np.nan)

    def legs(both: Any) -> Any:
        return None if both is None else type(both)(
            *(None if leg is None else type(leg)(*map(gapped, leg)) for leg in both)
        )  # fmt: skip

    way = None if estimate.distance is None else gapped(estimate.distance)
    return estimate._replace(legs=legs(estimate.legs), stddev=legs(estimate.stddev), distance=way)


def joint_angles(
    estimate: Estimate,
    reference: Estimate | None = None,
    *,
    seconds: tuple[float, float] | None = None,
    title: str = "",
    label: str = "jgait",
    reference_label: str = "reference",
) -> Any:
    """Hip and knee flexion of each leg with a band of two standard deviations, over the reference.

    Args:
        estimate: what to draw.
        reference: motion capture or simulated truth, dashed.
        seconds: from and to [s]; None draws everything.
        title: above the figure.
        label: name of the estimate.
        reference_label: name of the reference.

    Returns:
        A matplotlib figure.
    """
    return _over_time(estimate, reference, FIELDS[:2], seconds, title, (label, reference_label))


def foot_displacement(
    estimate: Estimate,
    reference: Estimate | None = None,
    *,
    seconds: tuple[float, float] | None = None,
    title: str = "",
    label: str = "jgait",
    reference_label: str = "reference",
) -> Any:
    """Where each ankle is relative to its hip over time, with a band of two standard deviations, over the reference.

    Args:
        estimate: what to draw.
        reference: motion capture or simulated truth, dashed.
        seconds: from and to [s]; None draws everything.
        title: above the figure.
        label: name of the estimate.
        reference_label: name of the reference.

    Returns:
        A matplotlib figure.
    """
    return _over_time(estimate, reference, FIELDS[2:], seconds, title, (label, reference_label))


def _over_time(
    estimate: Estimate,
    reference: Estimate | None,
    fields: tuple[tuple[str, str, float], ...],
    seconds: tuple[float, float] | None,
    title: str,
    labels: tuple[str, str],
) -> Any:
    """A row for each field of the legs' trajectories, a column for each leg."""
    estimate, reference = _shown(estimate), None if reference is None else _shown(reference)
    worn = _worn(estimate)
    figure, axes = blank(len(fields), len(worn), 5.2 * len(worn) + 0.6, 5.6)
    part = _window(estimate, seconds)
    time = np.asarray(estimate.time)[part]
    for column, (side, leg, spread) in enumerate(worn):
        for row, (field, unit, scale) in enumerate(fields):
            axis = axes[row, column]
            value = scale * np.asarray(getattr(leg, field))[part]
            if spread is not None:
                band = 2.0 * scale * np.asarray(getattr(spread, field))[part]
                axis.fill_between(time, value - band, value + band, color="#f0b7b0", linewidth=0, label="±2σ")
            if reference is not None and getattr(reference.legs, side) is not None:
                _reference(axis, reference, side, field, scale, seconds, labels[1])
            axis.plot(time, value, label=labels[0], **ESTIMATE)
            axis.set_ylabel(unit)
            axis.grid(alpha=0.3)
            if row == 0:
                axis.set_title(f"{side} leg")
    for axis in axes[-1]:
        axis.set_xlabel("time [s]")
    axes[0, 0].legend(loc="upper right", fontsize=8, framealpha=0.9)
    if title:
        figure.suptitle(title)
    return figure


def _reference(
    axis: Any, reference: Estimate, side: str, field: str, scale: float, seconds: tuple[float, float] | None, label: str
) -> None:
    part = _window(reference, seconds)
    values = scale * np.asarray(getattr(getattr(reference.legs, side), field))[part]
    axis.plot(np.asarray(reference.time)[part], values, label=label, **REFERENCE)


def foot_path(
    estimate: Estimate,
    reference: Estimate | None = None,
    *,
    seconds: tuple[float, float] | None = None,
    title: str = "",
    label: str = "jgait",
    reference_label: str = "reference",
) -> Any:
    """Where the ankle goes relative to the hip, in the sagittal plane.

    Args:
        estimate: what to draw.
        reference: motion capture or simulated truth, dashed.
        seconds: from and to [s].
        title: above the figure.
        label: name of the estimate.
        reference_label: name of the reference.

    Returns:
        A matplotlib figure.
    """
    estimate, reference = _shown(estimate), None if reference is None else _shown(reference)
    worn = _worn(estimate)
    figure, axes = blank(1, len(worn), 4.8 * len(worn) + 0.6, 3.6)
    part = _window(estimate, seconds)
    for column, (side, leg, _) in enumerate(worn):
        axis = axes[0, column]
        if reference is not None and getattr(reference.legs, side) is not None:
            true = getattr(reference.legs, side)
            span = _window(reference, seconds)
            axis.plot(
                100 * np.asarray(true.x)[span], 100 * np.asarray(true.y)[span], label=reference_label, **REFERENCE
            )
        axis.plot(100 * np.asarray(leg.x)[part], 100 * np.asarray(leg.y)[part], label=label, **ESTIMATE)
        axis.set_aspect("equal", adjustable="datalim")
        axis.set_xlabel("ankle forward of hip [cm]")
        axis.set_title(f"{side} leg")
        axis.grid(alpha=0.3)
    axes[0, 0].set_ylabel("ankle above hip [cm]")
    axes[0, 0].legend(loc="upper center", fontsize=8, framealpha=0.9)
    if title:
        figure.suptitle(title)
    return figure


def distance(
    estimate: Estimate,
    reference: Estimate | None = None,
    *,
    seconds: tuple[float, float] | None = None,
    title: str = "",
    label: str = "jgait",
    reference_label: str = "reference",
    others: dict[str, Estimate] | None = None,
) -> Any:
    """Walked distance over time, from the start of the window, with a band of two standard deviations where stated.

    Args:
        estimate: what to draw; a band if its diagnostics have `distance_stddev` and no window is asked for.
        reference: motion capture or simulated truth, dashed.
        seconds: from and to [s].
        title: above the figure.
        label: name of the estimate.
        reference_label: name of the reference.
        others: name → further estimates, in grey.

    Returns:
        A matplotlib figure.
    """
    figure, axes = blank(1, 1, 6.4, 3.8)
    axis = axes[0, 0]

    def draw(what: Estimate, name: str, style: dict[str, Any]) -> None:
        what = _shown(what)
        part = _window(what, seconds)
        values = np.asarray(what.distance)[part]
        told = np.flatnonzero(np.isfinite(values))
        from_start = values - values[told[0]] if told.size else values
        axis.plot(np.asarray(what.time)[part], from_start, label=name, **style)

    for number, (name, other) in enumerate((others or {}).items()):
        draw(other, name, {"color": "0.55", "linewidth": 1.2, "linestyle": (":", "-.")[number % 2]})
    if reference is not None and reference.distance is not None:
        draw(reference, reference_label, REFERENCE)
    spread = estimate.diagnostics.get("distance_stddev")
    if spread is not None and seconds is None:
        way, off = as_float(estimate.distance), 2.0 * as_float(spread)
        axis.fill_between(np.asarray(estimate.time), way - off, way + off, color="0.85", linewidth=0.0, label="±2σ")
    draw(estimate, label, ESTIMATE)
    axis.set_xlabel("time [s]")
    axis.set_ylabel("distance walked [m]")
    axis.grid(alpha=0.3)
    axis.legend(loc="upper left", fontsize=8)
    if title:
        axis.set_title(title)
    return figure


def save(figure: Any, path: str | Path, *, dpi: int = 130) -> Path:
    """Write a figure to a file, whole or not at all.

    Args:
        figure: a matplotlib figure.
        path: where; the ending gives the format.
        dpi: dots an inch for pixel formats.

    Returns:
        The path.
    """
    from jgait.io.atomic import replaced

    path = Path(path)
    with replaced(path) as part:
        figure.savefig(part, dpi=dpi)
    return path
