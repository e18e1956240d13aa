"""Variability of the stride length within a walk, beside that of the reference in the same strides.

What an estimator adds to the variability is the part of its error that changes from stride to stride. Strides that are
flagged, and those whose reference is far from the walk's median (turns, steps from and to standing), do not count. The
variance that a noisy reference adds itself is subtracted.
"""

from collections.abc import Sequence

import numpy as np

from experiments.common.row import Row, show
from experiments.unseen.flags import measured
from experiments.unseen.judged import Judged

FEWEST = 8
"""[1] Strides of one sensor in one walk of which a standard deviation is computed."""

USUAL = 0.2
"""[1] Largest relative difference from the median of the walk."""


def rows(quick: bool) -> list[Row]:
    """Of the sets that are here."""
    return of_walks(measured(quick))


def spreads(one: Judged) -> tuple[float, float] | None:
    """Variability of the reference and of the estimate [% of the mean]; None for few strides, or noise alone."""
    middle = np.median(one.true)
    usual = ~one.flagged & (np.abs(one.true / middle - 1.0) < USUAL)
    if usual.sum() < FEWEST:
        return None
    true, ours = (float(np.var(part[usual], ddof=1)) for part in (one.true, one.length))
    own = true - one.noise**2  # without what the reference adds itself
    return (100.0 * np.sqrt(own) / middle, 100.0 * np.sqrt(ours) / middle) if own > 0.0 else None


def of_walks(found: Sequence[Judged]) -> list[Row]:
    """Rows of the walks of all sets."""
    lines, made = [], []
    for group in sorted({one.group for one in found}):
        pairs = np.array([pair for pair in map(spreads, (one for one in found if one.group == group)) if pair])
        if not len(pairs):
            continue
        true, ours = pairs.T
        ratio, name = ours / true, group.replace(", ", "_")
        related = float(np.corrcoef(true, ours)[0, 1]) if len(pairs) > 2 else np.nan
        lines.append([group, len(pairs), np.median(true), np.median(ours), np.median(ratio), ratio.max(), related])
        row = Row(f"cv_ratio_{name}", float(np.median(ratio)), "ratio", n=len(pairs), split="defaults")
        made.append(row.on("variability of stride length over that of the reference, median", group, "walks"))
        made.append(Row(f"cv_error_{name}_points", float(np.median(np.abs(ours - true))), "%", n=len(pairs)))
    columns = ["", "walks", "CV reference [%]", "CV estimate [%]", "ratio, median", "largest", "correlation"]
    if lines:
        show("Variability of stride length within a walk", columns, lines)
    return made
