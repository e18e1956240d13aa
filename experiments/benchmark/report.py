"""Tables, rows and a figure of the filter benchmark."""

import re
from pathlib import Path
from typing import Any

from experiments.benchmark.timing import GRADIENTS, JOBS, Cell, Key, Scope
from experiments.common.row import Row, show


def tables(cells: dict[Key, Cell], errors: dict[Key, float], scope: Scope) -> None:
    """Print everything, one table a job and type."""
    for job in scope.jobs:
        for dtype in scope.dtypes:
            chosen = {key: cell for key, cell in cells.items() if (key.job, key.dtype) == (job, dtype)}
            lines = []
            for name in [key.name for key in chosen if key.count == 64]:
                row = {key.count: cell for key, cell in chosen.items() if key.name == name}
                line: list[Any] = [name]
                for count in scope.sizes:
                    cell = row.get(count)
                    amount = None if cell is None else (1e3 * cell.seconds if job in GRADIENTS else cell.rate)
                    line.append("–" if amount is None else amount)
                one = row[64].program
                if name == "c":
                    line += ["–", "–", "–"]
                else:
                    line += [
                        one.temporary / 1e6,
                        one.compile_seconds,
                        " ".join(c.program.options for c in row.values()),
                    ]
                lines.append([*line, errors[Key(name, f"{job}_gradient" if job in GRADIENTS else job, 64, dtype)]])
            unit = "ms" if job in GRADIENTS else "million steps/s"
            columns = ["", *(f"B = {count}" for count in scope.sizes), "MB", "compile s", "vectors", "difference"]
            show(f"{JOBS[job]}; {dtype}, T = {scope.samples}, {unit}", columns, lines)
    print("MB: temporary memory, B = 64. compile: tracing and compiling for B = 64, nothing cached.")
    print("vectors: w compiled for wide ones, d XLA's default, for each B; where both were tried, the faster.")
    print("difference: largest from the core in float64 for B = 64, m, rad and rad/s alike; gradients relative.")
    print("C runs on one thread, XLA on as many as it takes.")


def rows_of(cells: dict[Key, Cell], errors: dict[Key, float], scope: Scope) -> list[Row]:
    """Raw numbers, ratios in float32, errors."""
    rows = []
    repeats = scope.repeats

    def add(metric: str, value: float, unit: str, dtype: str = "float32") -> None:
        rows.append(Row(metric, float(value), unit, None, repeats, f"simulated, T = {scope.samples}, {dtype}"))

    for key, cell in cells.items():
        tail = f"{key.name}_b{key.count}_{key.dtype}"
        if key.job in GRADIENTS:
            add(f"{key.job}_gradient_ms_{tail}", 1e3 * cell.seconds, "ms", key.dtype)
            add(f"{key.job}_temporary_mb_{tail}", cell.program.temporary / 1e6, "MB", key.dtype)
        else:
            add(f"{key.job}_msteps_{tail}", cell.rate, "million steps/s", key.dtype)
    for key, error in errors.items():
        unit = {"filter": "m, rad", "smoother": "m, rad", "log_likelihood": "nat a sample"}.get(key.job, "relative")
        add(f"{key.job}_{key.dtype}_error_{key.name}", error, unit, key.dtype)
    names = {"filter": "filter", "smoother": "smoother", "mse": "grad", "nll": "nll_grad"}
    for key, cell in cells.items():
        ours = cells.get(key._replace(name="fast"))
        if key.dtype != "float32" or key.name.startswith("fast") or ours is None:
            continue
        tail = f"{key.name}_b{key.count}"
        add(f"{names[key.job]}_ratio_{tail}", cell.seconds / ours.seconds, "ratio")
        if key.job in GRADIENTS:
            memory = ours.program.temporary / max(cell.program.temporary, 1)
            add(f"{names[key.job]}_memory_ratio_{tail}", memory, "ratio")
    for job, what in (("filter", "filter"), ("mse", "gradient")):
        for name in dict.fromkeys(key.name for key in cells if key.job == job and key.name != "c"):
            seconds = cells[Key(name, job, 64, "float32")].program.compile_seconds
            add(f"compile_seconds_{what}" + ("" if name == "fast" else f"_{name}"), seconds, "s")
    return rows


STYLES = {
    "c": ("none", "--", "black"), "fast": ("o", "-", "black"), "core": ("s", ":", "black"),
    "textbook": ("^", "-", "0.45"), "dynamax": ("D", "-.", "0.6"), "kalman_py": ("v", "-", "0.3"),
    "cuthbert": ("x", "-", "0.3"), "filterpy": ("*", "none", "0.3"),
}  # fmt: skip
"""Marker, line and grey of each line of the figure."""

LABELS = {"c": "hand-written C, one thread", "fast": "jgait", "core": "jgait, core", "kalman_py": "kalman-py"}


def draw(rows: list[Row], folder: Path, quick: bool) -> None:
    """Filter steps a second against the number of recordings, float32, both axes logarithmic."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(6.4, 4.2), layout="constrained")
    lines: dict[str, dict[int, float]] = {name: {} for name in STYLES}
    for row in rows:
        told = re.fullmatch(r"filter_msteps_(\w+)_b(\d+)_float(?:32|64)", row.metric)
        if told and told[1] in lines and row.metric.endswith("32") == (told[1] != "filterpy"):
            lines[told[1]][int(told[2])] = 1e6 * row.value
    for name, points in lines.items():
        if points:
            marker, style, grey = STYLES[name]
            counts = sorted(points)
            label = LABELS.get(name, name)
            rates = [points[count] for count in counts]
            axes.plot(counts, rates, linestyle=style, marker=marker, color=grey, label=label, markersize=6)
    axes.set(xscale="log", yscale="log", xlabel="recordings filtered at once", ylabel="filter steps a second")
    axes.set_xticks(sorted({c for points in lines.values() for c in points}))
    axes.xaxis.set_major_formatter("{x:.0f}")
    axes.minorticks_off()
    axes.grid(alpha=0.3)
    axes.set_title("Leg EKF of 8 states, float32" + (", quick" if quick else ""), fontsize=10)
    figure.legend(loc="outside right upper", frameon=False, fontsize=8)
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / "benchmark_filters.png", dpi=160)
