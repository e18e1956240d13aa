"""Figures of a cohort: agreement with the reference, errors of each subject, and changes of errors."""

from typing import TYPE_CHECKING

import numpy as np

from jgait.evaluate.statistics import Limits, limits_of_agreement, paired_difference, require_columns
from jgait.plot.style import BLUE, DASHED, RED, REFERENCE, Axes, Figure, Style, single
from jgait.types import numbered_people, people

if TYPE_CHECKING:
    import pandas as pd

MARKS = (
    ("o", "#1b1b1b"), ("s", RED), ("^", BLUE), ("D", "#8a6d00"),
    ("v", "#707070"), ("P", "#8e2f86"), ("X", "#1d6f42"), ("<", "#d98a2b"),
)  # fmt: skip
"""Shape and colour of the marks of the first subjects; all shapes differ."""


def _unit(text: str, unit: str) -> str:
    return f"{text} [{unit}]" if unit else text


def _rows(table: "pd.DataFrame", quantity: str) -> "pd.DataFrame":
    require_columns(table, ("subject", "quantity", "estimate", "reference"))
    chosen = table[table["quantity"] == quantity]
    if chosen.empty:
        raise ValueError(f"quantity must be among {sorted(table['quantity'].unique())}; got {quantity!r}")
    finite = np.isfinite(chosen[["estimate", "reference"]].to_numpy(dtype=float)).all(axis=1)
    if not finite.any():
        raise ValueError(f"none of the {len(chosen)} rows of {quantity!r} has both an estimate and a reference")
    return chosen[finite].assign(subject=people(chosen["subject"][finite]))


def bland_altman(table: "pd.DataFrame", quantity: str, *, unit: str = "") -> Figure:
    """Difference against mean of estimate and reference, with bias and limits of agreement and their intervals.

    The table is long, with columns `quantity`, `estimate`, `reference` and `subject`, as `jgait.evaluate.agreement`
    takes it; rows of one subject are repeated measurements, rows that are not finite are left out. Up to eight subjects
    are marked in different shapes and colours. Raises ValueError if a column or the quantity is missing, or there are
    fewer than two subjects.
    """
    rows = _rows(table, quantity)
    names, codes = numbered_people(rows["subject"])
    count = len(names)
    estimate, reference = (rows[name].to_numpy(dtype=float) for name in ("estimate", "reference"))
    limits = limits_of_agreement(estimate, reference, subjects=codes)
    mean, difference = (estimate + reference) / 2.0, estimate - reference
    figure, axis = single(7.0, 4.2)
    ends = np.array([difference.min(), limits.lower_low, difference.max(), limits.upper_high])
    # if all differences are rounding errors, the axes still have a height above 0
    room = max(0.04 * np.ptp(ends), 1e-6 * np.abs(mean).max(), np.finfo(float).tiny)
    axis.set_ylim(ends[:2].min() - room, ends[2:].max() + room)
    _limits(axis, limits, unit)
    size = 26.0 if len(rows) < 300 else 12.0
    if count <= len(MARKS):
        for code, (name, (marker, color)) in enumerate(zip(names, MARKS, strict=False)):
            of_subject = codes == code
            style: Style = {"marker": marker, "color": color, "alpha": 0.85, "label": name}
            axis.scatter(mean[of_subject], difference[of_subject], s=size, linewidths=0, **style)
        figure.legend(loc="outside right upper", fontsize=8, title="subject", title_fontsize=8, frameon=False)
    else:
        axis.scatter(mean, difference, s=size, linewidths=0, marker="o", color="0.35", alpha=0.45)
    axis.set_xlabel(_unit(f"{quantity}: mean of estimate and reference", unit))
    axis.set_ylabel(_unit("estimate − reference", unit))
    axis.set_title(f"{len(rows)} measurements of {count} subjects", fontsize=10)
    return figure


def _limits(axis: Axes, limits: Limits, unit: str) -> None:
    """Draw bias and limits as lines, and write their values and intervals beside the axes."""
    axis.axhline(0.0, color="0.75", linewidth=0.8, zorder=0)
    beside, bias, upper, lower = axis.get_yaxis_transform(), limits.bias, limits.upper, limits.lower
    apart = 0.11 * float(np.ptp(axis.get_ylim()))  # labels of two lines do not overlap
    for name, style, at, value, low, high, place in (
        ("bias", "-", 1.035, bias, limits.bias_low, limits.bias_high, bias),
        ("upper 95 %", DASHED, 1.01, upper, limits.upper_low, limits.upper_high, max(upper, bias + apart)),
        ("lower 95 %", DASHED, 1.06, lower, limits.lower_low, limits.lower_high, min(lower, bias - apart)),
    ):
        axis.axhline(value, color="black", linewidth=1.2, linestyle=style)
        axis.plot([at, at], [low, high], "_-", color="black", transform=beside, clip_on=False, markersize=6)
        text = f"{name}\n{_number(value)}{' ' + unit if unit else ''}"
        axis.text(1.08, place, text, transform=beside, fontsize=8, va="center")


def _number(value: float) -> str:
    return f"{value:+.3g}".replace("-", "−")


def per_subject(table: "pd.DataFrame", quantity: str, *, unit: str = "", title: str = "") -> Figure:
    """Absolute errors of each subject: all errors, the middle half, the median and the worst, the best subject on top.

    Table, quantity, unit and errors as `bland_altman`, but one subject is enough.
    """
    rows = _rows(table, quantity)
    size = (rows["estimate"] - rows["reference"]).abs().astype(float)
    sizes = {str(name): values.to_numpy() for name, values in size.groupby(rows["subject"], sort=True)}
    names = sorted(sizes, key=lambda name: (float(np.median(sizes[name])), sizes[name].max()))
    figure, axis = _list(names)
    several = max(map(len, sizes.values())) > 1  # of one error a person there is no middle half
    for row, name in enumerate(names):
        low, middle, high = np.quantile(sizes[name], [0.25, 0.5, 0.75])
        label = {} if row else {"half": "middle half", "median": "median", "worst": "worst"}
        if several:
            axis.plot([sizes[name].min(), sizes[name].max()], [row, row], color="0.7", linewidth=1.0)
            axis.plot([low, high], [row, row], "0.45", linewidth=5.0, label=label.get("half"), solid_capstyle="butt")
        axis.plot(middle, row, "ow", markeredgecolor="black", markersize=5.5, label=label.get("median"))
        axis.plot(sizes[name].max(), row, "|", color=RED, markersize=9.0, markeredgewidth=2.0, label=label.get("worst"))
    whole = float(np.median([np.median(values) for values in sizes.values()]))
    axis.axvline(whole, zorder=0, label="median of the subjects' medians", **REFERENCE)
    axis.set_xlim(left=0.0)
    axis.set_xlabel(_unit(f"{quantity}: |estimate − reference|", unit))
    axis.set_title(title or f"{len(rows)} measurements of {len(names)} subjects", fontsize=10)
    figure.legend(loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    return figure


def _list(names: list[str]) -> tuple[Figure, Axes]:
    """A figure with one row a subject, the first on top."""
    figure, axis = single(6.4, float(np.clip(1.6 + 0.22 * len(names), 2.6, 14.0)))
    axis.set_yticks(range(len(names)), names, fontsize=8 if len(names) <= 50 else 5)
    axis.set_ylim(len(names) - 0.4, -0.6)
    axis.grid(alpha=0.3, axis="x")
    return figure, axis


def before_after(table: "pd.DataFrame", *, unit: str = "", name: str = "|error|", title: str = "") -> Figure:
    """Each subject's error before and after a change, the largest before on top, dashed where the error increased.

    The table has columns `subject`, `error_before` and `error_after`, sizes of errors; a subject's rows are averaged.
    Raises ValueError if a column is missing, a value is not finite or there are fewer than two subjects.
    """
    require_columns(table, ("subject", "error_before", "error_after"))
    change = paired_difference(table["error_before"], table["error_after"], table["subject"], seed=0)
    means = table.assign(subject=people(table["subject"])).groupby("subject")[["error_before", "error_after"]].mean()
    means = means.sort_values("error_before", ascending=False, kind="stable")
    before, after = (means[column].to_numpy(dtype=float) for column in ("error_before", "error_after"))
    figure, axis = _list(list(means.index))
    for row, (first, second) in enumerate(zip(before, after, strict=True)):
        style = {"color": RED, "linestyle": (0, (2, 1))} if second > first else {"color": "0.5"}
        axis.plot([first, second], [row, row], linewidth=1.8, zorder=1, **style)
    rows = np.arange(len(means))
    axis.scatter(before, rows, s=48, facecolor="white", edgecolor="black", zorder=2, label="before")
    axis.scatter(after, rows, s=24, color="black", zorder=3, label="after")
    axis.axvline(np.median(before), zorder=0, label="median before", **REFERENCE)
    axis.axvline(np.median(after), zorder=0, label="median after", color="black", linewidth=1.2)
    axis.set_xlim(left=0.0)
    axis.set_xlabel(_unit(name, unit))
    low, median, high = map(_number, (change.low, change.estimate, change.high))
    summary = f"median change {median} ({low} to {high}){' ' + unit if unit else ''}"
    summary += f"; {change.better} better, {change.worse} worse"
    axis.set_title(f"{title}\n{summary}" if title else summary, fontsize=10)
    figure.legend(loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    return figure
