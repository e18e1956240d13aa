"""Table I in simulation: errors of z1 and z2 in three sections of the paper's walk."""

import math

import numpy as np

from experiments.common.row import Row, show
from experiments.potter import protocol
from experiments.potter.methods import METHODS, TITLES

WRONG_DEG = (5.0, -10.0, 15.0, -5.0, 10.0, -15.0)


def rows(quick: bool) -> list[Row]:
    """Table I."""
    people = 1 if quick else 6
    walks = protocol.walks(3, people, *((10.0, 6.0) if quick else (50.0, 25.0)))
    names = ["ekf", "rts"] if quick else ["ekf", "rts", "unscented_rts", "literal"]
    rows, lines = [], []
    for name in names:
        found, errors, spreads = [], [], []
        for walk, wrong in zip(walks, WRONG_DEG, strict=False):
            estimate = METHODS[name](walk.recording, walk.offset, (0.0, math.radians(wrong)))
            found.append(protocol.apart(walk, estimate))
            error, spread = protocol.width_errors(walk, estimate)
            errors.append(error)
            spreads.append(spread)
        table = _sections(found)
        lines.append([TITLES[name], *(f"{table[q][i]:.3f}" for i in range(3) for q in table)])
        width, stddev = np.concatenate(errors), np.concatenate(spreads)
        rows += _simulated_rows(name, table, width, stddev, people)
    paper = [f"{protocol.PAPER[q][i]:.3f}" for i in range(3) for q in protocol.PAPER]
    columns = ["", *(f"{q} {i + 1}" for i in range(3) for q in ("|z1|", "SD", "|z2|", "SD"))]
    show(
        f"The paper's walk in simulation, {people} people: errors of z1 and z2 at double support [m], three sections",
        columns, [["paper, measured", *paper], *lines],
    )  # fmt: skip
    return rows


def _sections(found: list[protocol.Apart]) -> dict[str, list[float]]:
    """Absolute means and standard deviations by section, medians over people."""
    table: dict[str, list[float]] = {}
    for field in ("z1", "z2"):
        parts = [[getattr(one, field)[i] for one in found if getattr(one, field)[i].size] for i in range(3)]
        table[f"{field}_mean"] = [float(np.median([abs(e.mean()) for e in of])) if of else math.nan for of in parts]
        table[f"{field}_sd"] = [float(np.median([e.std() for e in of])) if of else math.nan for of in parts]
    return table


WHAT = {
    "z1_mean": "size of the mean error of z₁",
    "z1_sd": "SD of z₁",
    "z2_mean": "size of the mean error of z₂",
    "z2_sd": "SD of z₂",
}


def _simulated_rows(
    name: str, table: dict[str, list[float]], width: np.ndarray, stddev: np.ndarray, people: int
) -> list[Row]:
    prefix = "sim_" if name == "rts" else f"sim_{name}_"
    unit = {"z1_mean": "z1_mean_m", "z1_sd": "z1_sd_m", "z2_mean": "z2_mean_m", "z2_sd": "z2_sd_m"}
    rows = [
        Row(f"{prefix}{unit[q]}_{section}", table[q][i], "m", protocol.PAPER[q][i], people, "simulated people").on(
            f"the paper's walk, {TITLES[name]}: {WHAT[q]}",
            section.replace("section", "section "),
            "people",
            simulated=True,
        )
        for q in table
        for i, section in enumerate(protocol.SECTIONS)
        if math.isfinite(table[q][i])
    ]
    inside = float(np.mean(np.abs(width) < 2.0 * stddev))
    return [
        *rows,
        Row(
            f"{prefix}width_mae_cm", 100.0 * float(np.abs(width).mean()), "cm", None, width.size, "simulated people"
        ).on(f"stride width, {TITLES[name]}: error", "MAE", "strides", simulated=True),
        Row(f"{prefix}width_nees", float(np.mean((width / stddev) ** 2)), "1", None, width.size, "simulated people"),
        Row(f"{prefix}width_inside_two_sigma", inside, "1", None, width.size, "simulated people"),
    ]
