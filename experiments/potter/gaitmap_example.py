"""Stride width on the walk of `gaitmap_example`: a range made from its markers, first headings wrong by 5 to 15°."""

import numpy as np

from experiments.common.recordings import available
from experiments.common.row import Row, show
from experiments.potter import capture as real
from experiments.potter.methods import METHODS, TITLES
from jgait.types import Estimate


def rows(quick: bool) -> list[Row]:
    """The walk of `gaitmap_example`, a range made from its markers, first headings wrong by 5 to 15°."""
    if not available("gaitmap_example"):
        return []
    walk = real.capture()
    names = ["ekf", "rts"] if quick else ["no_range", *METHODS]
    rows, lines = [], []
    for name in names:
        errors = [
            real.errors(walk, _on(name, walk, seed, wrong))
            for seed, wrong in enumerate(real.WRONG[:1] if quick else real.WRONG)
        ]
        rows += _measured_rows(name, errors)
        width = np.concatenate([e.width for e in errors])
        true = np.concatenate([e.true for e in errors])
        step = np.concatenate([e.step for e in errors])
        lines.append([
            TITLES[name], 100.0 * float(np.abs(width).mean()), 100.0 * float(np.abs(width).mean() / true.mean()),
            100.0 * float(width.mean()), 100.0 * float(np.abs(width).max()), 100.0 * float(np.abs(step).mean()),
            width.size,
        ])  # fmt: skip
    show(
        "gaitmap_example, range made from markers, first headings wrong by ±5, ±10 and ±15°: stride width",
        ["", "MAE [cm]", "of the width [%]", "bias [cm]", "worst [cm]", "step MAE [cm]", "n"], lines,
    )  # fmt: skip
    return rows


def _on(name: str, walk: real.Capture, seed: int, wrong: float) -> Estimate:
    headings = real.start_heading(walk, wrong)
    if name == "no_range":
        return METHODS["rts"](walk.recording, 0.0, headings)
    return METHODS[name](real.with_range(walk, seed), 0.0, headings)


def _measured_rows(name: str, errors: list[real.Errors]) -> list[Row]:
    width = np.concatenate([e.width for e in errors])
    stddev = np.concatenate([e.stddev for e in errors])
    late = np.concatenate([e.width[e.end > np.median(e.end)] for e in errors])
    split, line = "untuned; range made from markers", f"stride width, {TITLES[name]}: error"
    inside = float(np.mean(np.abs(width) < 2.0 * stddev))
    paper = 15.0 if name == "ekf" else None
    true = np.concatenate([e.true for e in errors]).mean()
    return [
        Row(f"width_mae_cm_{name}", 100.0 * float(np.abs(width).mean()), "cm", None, width.size, split).on(
            line, "MAE", "strides"
        ),
        Row(f"width_mae_pct_{name}", 100.0 * float(np.abs(width).mean() / true), "%", paper, width.size, split).on(
            f"{line} over the width", "MAE", "strides"
        ),
        Row(f"width_bias_cm_{name}", 100.0 * float(width.mean()), "cm", None, width.size, split),
        Row(f"width_worst_cm_{name}", 100.0 * float(np.abs(width).max()), "cm", None, width.size, split).on(
            line, "worst", "strides"
        ),
        Row(f"width_late_mean_cm_{name}", 100.0 * float(late.mean()), "cm", None, late.size, split),
        Row(f"width_late_sd_cm_{name}", 100.0 * float(late.std()), "cm", None, late.size, split),
        Row(f"width_inside_two_sigma_{name}", inside, "1", None, width.size, split),
    ]
