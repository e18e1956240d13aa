"""Where the time of the cohort's evaluation went, and the errors of the estimator against the truth."""

from pathlib import Path
from typing import Any

import numpy as np

from experiments.common.row import Row, show
from jgait.evaluate import Cohort


def stages(measured: dict[str, Any], people: int) -> list[list[Any]]:
    """Where the time went: stage, in which thread, seconds by the clock and of computing, milliseconds a recording."""
    stage = {name: (value["wall"], value["own"]) for name, value in measured["stages"].items()}

    def took(name: str, *less: str) -> tuple[float, float]:
        wall, own = (stage[name][k] - sum(stage[other][k] for other in less) for k in (0, 1))
        return wall, own

    compiled = stage["compiled"][0]
    found = {
        "read files": ("beside", *took("read")),
        "prepare, pad": ("beside", *took("prepared", "read")),
        "trace, compile": ("main", compiled, float("nan")),
        "stack, start batches": ("main", took("started")[0] - compiled, float("nan")),
        "wait for batches": ("main", *took("waited")),
        "score, make tables": ("main", *took("finished", "waited")),
        "write tables": ("main", *took("appended")),
        "read all tables again": ("main", *took("tables")),
    }
    counted = sum(wall for where, wall, _ in found.values() if where == "main")
    rest = "start of Python, imports; waiting for what is prepared"
    found[rest] = ("main", measured["seconds"] - counted, float("nan"))
    lines = [[name, where, wall, own, 1e3 * wall / people] for name, (where, wall, own) in found.items()]
    return [*lines, ["all", "", measured["seconds"], measured["processor_seconds"],
                     1e3 * measured["seconds"] / people]]  # fmt: skip


def kind_of(recordings: Any) -> Any:
    """The way of each recording, from its name."""
    return recordings.str.split("_").str[1]


def quality(tables: Cohort, split: str) -> list[Row]:
    """How well the estimator agrees with the truth, over people and over strides."""
    distance = tables.quantities[tables.quantities["quantity"] == "distance_m"]
    strides = tables.strides[tables.strides["quantity"] == "stride_length_m"]
    compared = strides[strides["estimate"].notna()]
    lines = []
    for name, chosen in (("distance", distance), ("stride length", compared)):
        for kind in ("all", *sorted(set(kind_of(distance["recording"])))):
            own = chosen if kind == "all" else chosen[kind_of(chosen["recording"]) == kind]
            if own.empty:
                continue
            percent = 100.0 * own["rel_error"].to_numpy()
            low, middle, high = np.quantile(percent, [0.025, 0.5, 0.975])
            size = np.abs(percent)
            lines.append([name, kind, len(own), *map(float, (middle, low, high, np.median(size), size.max()))])
    columns = ["error %", "way", "n", "median", "2.5 %", "97.5 %", "median size", "largest"]
    show("Estimate against truth", columns, lines)
    worst = distance.reindex(distance["rel_error"].abs().sort_values(ascending=False).index).head(5)
    show("Worst distances", ["recording", "truth [m]", "error [m]", "error %"],
         [[r.recording, r.reference, r.error, 100.0 * r.rel_error] for r in worst.itertuples()])  # fmt: skip
    if len(tables.failures):
        counts = tables.failures["reason"].str.slice(0, 90).value_counts()
        show("Failures", ["reason", "recordings"], [[reason, int(n)] for reason, n in counts.head(10).items()])
    people, count = len(distance), len(compared)
    apart, lengths = 100.0 * distance["rel_error"], 100.0 * compared["rel_error"]
    line = "kinematics, own leg lengths, walks of a minute: distance error"
    tried = len(tables.recordings) + len(tables.failures)
    return [
        Row("distance_error_median_pct", float(apart.abs().median()), "%", None, people, split).on(
            line, "median", "people", simulated=True),
        Row("distance_error_worst_pct", float(apart.abs().max()), "%", None, people, split).on(
            line, "worst", "people", simulated=True),
        Row("distance_bias_pct", float(apart.mean()), "%", None, people, split),
        Row("stride_length_error_median_pct", float(lengths.abs().median()), "%", None, count, split),
        Row("stride_length_error_worst_pct", float(lengths.abs().max()), "%", None, count, split),
        Row("stride_length_error_median_cm", 100.0 * float(compared["abs_error"].median()), "cm", None, count, split),
        Row("strides_not_compared_pct", 100.0 * (1.0 - count / max(len(strides), 1)), "%", None, len(strides),
            "first and last strides, tight turns"),
        Row("failures_pct", 100.0 * len(tables.failures) / tried, "%", None, tried, split),
    ]  # fmt: skip


def figures(tables: Cohort, folder: Path) -> None:
    """Agreement of distance and stride length, and of people with small, middle and large errors."""
    from jgait import plot
    from jgait.plot import cohort as plot_cohort

    folder.mkdir(parents=True, exist_ok=True)
    rows = tables.paired()
    drawn = {"distance": plot_cohort.bland_altman(rows, "distance_m", unit="m")}
    strides = rows[(rows["quantity"] == "stride_length_m") & rows["estimate"].notna()]
    rng = np.random.default_rng(17)
    subjects = rng.permutation(np.sort(strides["subject"].unique()))[:100]
    drawn["stride_length"] = plot_cohort.bland_altman(
        strides[strides["subject"].isin(subjects)], "stride_length_m", unit="m"
    )
    order = strides["abs_error"].groupby(strides["subject"]).median().sort_values().index
    middle = len(order) // 2
    some = [*order[:10], *order[middle - 5 : middle + 5], *order[-10:]] if len(order) > 30 else list(order)
    chosen = strides[strides["subject"].isin(some)]
    title = f"{len(some)} of {len(order)} people: those with the smallest, middle and largest errors"
    drawn["people"] = plot_cohort.per_subject(chosen, "stride_length_m", unit="m", title=title)
    for name, figure in drawn.items():
        print(plot.save(figure, folder / f"cohort_{name}.png"))
