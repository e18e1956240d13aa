"""Stride lengths of four public sets with the defaults, and gaitmap's filter on the same strides."""

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from experiments.common.recordings import attempt
from experiments.common.row import Row, show
from experiments.foot_ins import gaitmap
from experiments.foot_ins.feet import Matched, matched
from experiments.foot_ins.run import Ready, estimated, rows_of, score, sets
from jgait.estimators.foot_ins import FootParams


def rows(quick: bool) -> list[Row]:
    """Of all sets."""
    chosen = sets(quick)
    return of_sets(chosen, quick) if chosen else []


def of_sets(sets: Mapping[str, Sequence[Ready]], quick: bool = False) -> list[Row]:
    """Stride lengths, positions and stated uncertainty with the defaults; and gaitmap's beside them."""
    rows, lines, every = [], [], []
    beside: dict[str, list[tuple[Ready, Matched, np.ndarray]]] = {}
    for name, items in sets.items():
        found = []
        beside[name] = []
        for item in items:
            foot = item.foot
            estimate = attempt(f"{name}: {foot.name}", partial(estimated, FootParams(), item.inputs))
            one = estimate and attempt(f"{name}: {foot.name}", partial(matched, foot, estimate))
            if one is None:
                continue
            found.append(one)
            if one.error.size:
                beside[name].append((item, one, getattr(estimate.feet, foot.side).position))
            lines.append([f"{name}: {foot.name}", *score([one])])
        if not found:
            continue
        whole = score(found)
        lines.append([f"{name}: all", *whole])
        rows += rows_of(name, whole, f"{name}, untuned")
        every += found
    columns = ["", "MAE cm", "bias cm", "median cm", "worst cm", "within 2σ %", "position RMSE m", "lost", "strides"]
    show("stride length, defaults", columns, lines)
    if every:
        total = score(every)
        rows += [
            Row("foot_within_two_sigma_pct", total.within, "%", n=total.n, split="all sets, untuned"),
            Row("foot_strides_lost", float(total.lost), "strides", n=total.n + total.lost, split="all sets, untuned"),
        ]
    if quick:
        print("left out of the quick form: gaitmap, which compiles for longer than all the rest")
        return rows
    return rows + gaitmap.compared(beside)
