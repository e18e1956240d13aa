"""Doubt and deviations of strides by a model that has not seen the person, the set, or the kind of fault.

A stride is wrong if its length is off by more than three stated deviations. It is missed if it is wrong and not in
doubt. The expected calibration error compares the doubt with the share of wrong strides, in bins of the doubt.
Intervals of 95 % are the same multiple of the deviation for all strides of a method.
"""

import json
from functools import cache
from pathlib import Path

import numpy as np

from experiments.common.row import Row, show
from experiments.quality.learn import chosen, interval, kind, learned, left_out, to_dict
from experiments.quality.strides import FAULTS, Table, faults, gaits, joined, public
from jgait.quality import DOUBTFUL_FROM
from jgait.quality.model import WRONG

FEWEST = 50
"""Least number of strides of a set for a row of its own."""

BINS = (0.0, 0.02, 0.05, 0.1, 0.2, 0.4, 1.0)
"""Edges of the bins of the doubt."""

FOLDS = 5
"""Number of parts of the people."""


@cache
def measured(quick: bool) -> Table:
    """All strides."""
    return joined([table for part in (public, gaits, faults) for table in part(quick)])


def rows(quick: bool) -> list[Row]:
    """Of every estimator and set."""
    return of_table(measured(quick))


def of_table(table: Table) -> list[Row]:
    """Rows of strides, each judged by numbers that were learned without its person, its set or its kind of fault."""
    lines, worst, pooled = [], {"missed": [], "false": [], "ece": [], "inside": []}, []
    unseen = []
    for estimator in sorted(set(table.estimator)):
        mine = chosen(table, table.estimator == estimator)
        groups = np.array([group if kind(group) == "public" else kind(group) for group in mine.group])
        by_person = left_out(mine, np.array([f"{g}|{p}" for g, p in zip(groups, mine.person, strict=True)]), FOLDS)
        by_set = left_out(mine, groups, None)
        by_kind = left_out(mine, np.where(groups == "fault", fault_kinds(mine.group), "none"), None)
        pooled.append((by_person[0], by_person[1]))
        for split, (error, doubt, inside), names in (
            ("people left out", by_person, sorted(set(groups))),
            ("set left out", by_set, sorted(set(groups))),
            ("kind of fault left out", by_kind, ["fault"]),
        ):
            for name in names:
                some = groups == name
                if some.sum() < FEWEST:
                    continue
                missed, false, off = shares(error[some], doubt[some])
                ece, covered = calibration(error[some], doubt[some]), 100.0 * float(np.mean(inside[some]))
                lines.append([f"{estimator}, {name}", split, int(some.sum()), off, missed, false, ece, covered])
                if name == "fault" and split.startswith("kind"):
                    unseen.append(missed)
                elif kind(name) == "public" and split == "people left out":
                    for key, value in zip(worst, (missed, false, ece, covered), strict=True):
                        worst[key].append(value)
    columns = ["", "judged on", "strides", "wrong [%]", "missed [%]", "false [%]", "ECE", "in interval [%]"]
    show("Doubt and deviations of strides", columns, lines)
    error, doubt = (np.concatenate(part) for part in zip(*pooled, strict=True))
    n, people, kinds = len(error), "people left out", "kinds of faults left out"
    line = "doubt of strides of feet, shanks and waists"

    def row(metric: str, value: float, what: str, part: str = "", unit: str = "%", split: str = people) -> Row:
        return Row(metric, value, unit, n=n, split=split).on(f"{line}, {split}: {what}", part, "strides")

    wrong, doubted = "off by more than three deviations and not in doubt", "in doubt though good"
    return [
        row("missed_pct_worst", max(worst["missed"]), wrong, "worst public set"),
        row("missed_pct_unseen_faults", max(unseen, default=np.nan), wrong, "worst estimator", split=kinds),
        row("false_doubt_pct_worst", max(worst["false"]), doubted, "worst public set"),
        row("ece_pooled", calibration(error, doubt), "expected calibration error", unit="1"),
        row("ece_worst", max(worst["ece"]), "expected calibration error", "worst public set", "1"),
        row("interval95_lowest_pct", min(worst["inside"]), "inside the interval of 95 %", "lowest public set"),
        row("interval95_highest_pct", max(worst["inside"]), "inside the interval of 95 %", "highest public set"),
    ]


def fault_kinds(groups: np.ndarray) -> np.ndarray:
    """The kind of each fault: every fifth of `FAULTS`, so that no damage is learned at another size only."""
    number = {f"fault {name}": str(5 * k // len(FAULTS)) for k, name in enumerate(FAULTS)}
    return np.array([number.get(group, "none") for group in groups])


def shares(error: np.ndarray, doubt: np.ndarray) -> tuple[float, float, float]:
    """Missed among all, falsely doubted among the good, and wrong among all strides [%]."""
    off, flagged = error > WRONG, doubt > DOUBTFUL_FROM
    false = float(np.mean(flagged[~off])) if (~off).any() else 0.0
    return 100.0 * float(np.mean(off & ~flagged)), 100.0 * false, 100.0 * float(np.mean(off))


def calibration(error: np.ndarray, doubt: np.ndarray) -> float:
    """The expected calibration error [1]."""
    number, off = np.digitize(doubt, BINS[1:-1]), error > WRONG
    parts = [number == k for k in range(len(BINS) - 1)]
    return float(sum(part.mean() * abs(doubt[part].mean() - off[part].mean()) for part in parts if part.any()))


def draw(_: list[Row], folder: Path, quick: bool) -> None:
    """Write the numbers that are learned from all strides, as `jgait/quality/learned.json` has them."""
    table = measured(quick)
    found = {}
    for name in sorted(set(table.estimator)):
        mine = chosen(table, table.estimator == name)
        p = learned(mine)
        p = p._replace(within95=interval(p, mine))
        groups = sorted({group if kind(group) == "public" else f"simulated, {kind(group)}s" for group in mine.group})
        found[name] = {**to_dict(p), "strides": len(mine.error)}
        found[name]["groups"] = groups
    text = json.dumps({"made_by": "python -m experiments quality --figures FOLDER", "estimators": found}, indent=1)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "learned.json").write_text(text + "\n", encoding="utf-8")
