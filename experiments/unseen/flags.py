"""Doubt: of all strides, how many are off by more than three stated deviations without a flag, or flagged though they
are good; and a reliability table of the stated deviations.

The model of doubt (`jgait.quality`) was learned on these sets; the experiment `quality` leaves people and sets out.
"""

from collections.abc import Sequence
from functools import cache
from pathlib import Path

import numpy as np

from experiments.common.row import Row, show
from experiments.unseen.judged import Judged, judged
from jgait import plot
from jgait.plot.style import BLUE, RED, REFERENCE, Figure, blank

ALLOWED = 3.0
"""[1] Stated deviations by which a good stride may be off."""

BANDS = (0.5, 1.0, 2.0, 3.0)
"""[1] Stated deviations of the reliability table."""

NORMAL = (38.3, 68.3, 95.4, 99.7)
"""[%] Share of a normal distribution within `BANDS`."""

MARKS, COLOURS = "os^D", (RED, "black", BLUE, "0.5")
"""Sets of an estimator in the reliability diagram."""


def rows(quick: bool) -> list[Row]:
    """Of the sets that are here."""
    return of_strides(measured(quick))


@cache
def measured(quick: bool) -> list[Judged]:
    """The strides of all sets, measured once for the table and the diagram."""
    return [one for one in judged(quick) if one.error.size]


def shares(found: list[Judged]) -> tuple[float, float, int]:
    """Missed among all and falsely flagged among the good strides [%], and the number of strides."""
    error, flagged = (np.concatenate([getattr(one, field) for one in found]) for field in ("error", "flagged"))
    off = error > ALLOWED
    missed, false = off & ~flagged, flagged[~off]
    return 100.0 * float(missed.mean()), 100.0 * float(false.mean()) if false.size else 0.0, error.size


def of_strides(found: list[Judged]) -> list[Row]:
    """Rows of the strides."""
    if not found:
        return []
    recordings = sorted({one.recording for one in found})
    halves = [[one for one in found if recordings.index(one.recording) % 2 == part] for part in (0, 1)]
    groups = sorted({one.group for one in found})
    sets = {group: [one for one in found if one.group == group] for group in groups}
    lines = []
    parts = zip(("every other recording", "the others"), halves, strict=True)
    for name, some in [*sets.items(), *(part for part in parts if part[1]), ("all", found)]:
        missed, false, n = shares(some)
        lines.append([name, n, missed, false, *(f"{share:.1f}" for share in inside(some))])
    columns = ["", "strides", "missed [%]", "false [%]", *(f"within {band:g} sd [%]" for band in BANDS)]
    show(
        "Flags of strides, and reliability of the stated deviations", columns, [*lines, ["normal", "", "", "", *NORMAL]]
    )
    missed, false, n = shares(found)
    line = "doubt, strides of feet, shanks and waists, all sets"
    return [
        Row("flags_missed_pct", missed, "%", n=n, split="limits chosen on these sets").on(
            f"{line}: off by more than three stated deviations and not flagged", "", "strides"
        ),
        Row("flags_false_pct", false, "%", n=n, split="limits chosen on these sets").on(
            f"{line}: flagged though good", "", "strides"
        ),
        *(
            Row(f"flags_{name}_pct_{part}", shares(some)[k], "%", n=shares(some)[2], split="half of the recordings")
            for part, some in zip(("even", "odd"), halves, strict=True)
            if some
            for k, name in enumerate(("missed", "false"))
        ),
        *(covered(name, some) for name, some in sets.items()),
    ]


def inside(some: Sequence[Judged]) -> list[float]:
    """Share of the strides within each of `BANDS` [%]."""
    error = np.concatenate([one.error for one in some])
    return [100.0 * float(np.mean(error <= band)) for band in BANDS]


def covered(group: str, some: list[Judged]) -> Row:
    """The share of a set's strides within two stated deviations."""
    value, n = inside(some)[BANDS.index(2.0)], sum(one.error.size for one in some)
    row = Row(f"within_two_sigma_pct_{group.replace(', ', '_')}", value, "%", n=n, split="defaults")
    return row.on("stride length, within two stated standard deviations", group, "strides")


def draw(_: list[Row], folder: Path, quick: bool) -> None:
    """Reliability diagram: a panel for each estimator, the share of strides within k stated deviations over k."""
    found = measured(quick)
    if found:
        folder.mkdir(parents=True, exist_ok=True)
        print(plot.save(reliability(found), folder / "reliability.png"))


def reliability(found: Sequence[Judged]) -> Figure:
    """The diagram of the strides of several sets, a line each."""
    sets: dict[str, dict[str, list[Judged]]] = {}
    for one in found:
        estimator, _, name = one.group.partition(", ")
        sets.setdefault(estimator, {}).setdefault(name, []).append(one)
    figure, axes = blank(1, len(sets), 3.6 * len(sets), 3.8, sharey=True)
    for axis, (estimator, of) in zip(axes[0], sets.items(), strict=True):
        axis.plot([0.0, *BANDS], [0.0, *NORMAL], label="normal distribution", **REFERENCE)
        for number, (name, some) in enumerate(of.items()):
            label = f"{name} ({sum(one.error.size for one in some)})"
            axis.plot([0.0, *BANDS], [0.0, *inside(some)], f"{MARKS[number]}-", label=label, color=COLOURS[number])
        axis.set(title=estimator, xlabel="stated standard deviations")
        axis.grid(alpha=0.3)
        axis.legend(fontsize=7, loc="lower right", frameon=False)
    axes[0, 0].set_ylabel("strides within [%]")
    return figure
