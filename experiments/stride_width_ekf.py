"""Stride width from two feet: Table I and figures 6 to 9 of the paper in simulation, and a real walk.

Source: M. Potter, K. Liu, M. Selamet, G. Kumaravelu, "EKF estimation of stride width from individual IMU-based foot
trajectory estimates". Nothing is tuned on any walk: parameters are the defaults, the offset of the range is measured
while the person stands (simulation) or zero by construction (the real walk, whose range is made from its markers).

    .venv/bin/python experiments/stride_width_ekf.py [--quick] [--json FILE]
"""

import math
from collections.abc import Callable

import _width_protocol as protocol
import _width_real as real
import numpy as np
from common import Row, main, show

from jgait import datasets, filtering
from jgait.estimators import stride_width_ekf, two_feet
from jgait.estimators.stride_width_ekf import PAPER, Particles, WidthOptions, WidthParams
from jgait.types import Estimate, Recording

Method = Callable[[Recording, float, tuple[float, float] | None], Estimate]
"""(recording, offset of the range [m], first headings) → estimate."""

WRONG_DEG = (5.0, -10.0, 15.0, -5.0, 10.0, -15.0)


def by(options: WidthOptions) -> Method:
    """The 6-state filter with some options, on the feet's own trajectories."""

    def run(recording: Recording, offset: float, headings: tuple[float, float] | None) -> Estimate:
        p = WidthParams(range_offset=offset, offset_noise=1e-3)
        return stride_width_ekf.estimate(p, recording, options, start_heading=headings)

    return run


def joint(recording: Recording, offset: float, headings: tuple[float, float] | None) -> Estimate:
    """Both feet in one filter on their raw signals."""
    p = two_feet.TwoFeetParams(range_offset=offset, offset_noise=1e-3)
    return two_feet.estimate(p, recording, start_heading=headings)


DEFAULT = WidthOptions()
METHODS: dict[str, Method] = {
    "ekf": by(PAPER),
    "rts": by(DEFAULT),
    "unscented_rts": by(DEFAULT._replace(method=filtering.UKF())),
    "particles": by(DEFAULT._replace(method=Particles(), smooth=False, check_swap=False)),
    "literal": by(PAPER._replace(literal=True)),
    "joint": joint,
}
TITLES = {
    "ekf": "EKF, as the paper's", "rts": "iterated EKF + RTS, the default", "unscented_rts": "unscented + RTS",
    "particles": "particles", "literal": "EKF with the misprints", "joint": "one filter on both feet's signals, RTS",
    "no_range": "without the range",
}  # fmt: skip


def simulated(quick: bool) -> list[Row]:
    """Table I."""
    people = 1 if quick else 6
    walks = protocol.walks(3, people, *((10.0, 6.0) if quick else (50.0, 25.0)))
    names = ["ekf", "rts"] if quick else ["ekf", "rts", "unscented_rts", "particles", "literal", "joint"]
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


def _simulated_rows(
    name: str, table: dict[str, list[float]], width: np.ndarray, stddev: np.ndarray, people: int
) -> list[Row]:
    prefix = "sim_" if name == "rts" else f"sim_{name}_"
    unit = {"z1_mean": "z1_mean_m", "z1_sd": "z1_sd_m", "z2_mean": "z2_mean_m", "z2_sd": "z2_sd_m"}
    rows = [
        Row(f"{prefix}{unit[q]}_{section}", table[q][i], "m", protocol.PAPER[q][i], people, "simulated people")
        for q in table
        for i, section in enumerate(protocol.SECTIONS)
        if math.isfinite(table[q][i])
    ]
    inside = float(np.mean(np.abs(width) < 2.0 * stddev))
    return [
        *rows,
        Row(f"{prefix}width_mae_cm", 100.0 * float(np.abs(width).mean()), "cm", None, width.size, "simulated people"),
        Row(f"{prefix}width_nees", float(np.mean((width / stddev) ** 2)), "1", None, width.size, "simulated people"),
        Row(f"{prefix}width_inside_two_sigma", inside, "1", None, width.size, "simulated people"),
    ]


def measured(quick: bool) -> list[Row]:
    """The walk of `gaitmap_example`, a range made from its markers, first headings wrong by 5 to 15°."""
    reason = _absent()
    if reason is not None:
        print(f"gaitmap_example left out: {reason}")
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
    split = "untuned; range made from markers"
    inside = float(np.mean(np.abs(width) < 2.0 * stddev))
    paper = 15.0 if name == "ekf" else None
    true = np.concatenate([e.true for e in errors]).mean()
    return [
        Row(f"width_mae_cm_{name}", 100.0 * float(np.abs(width).mean()), "cm", None, width.size, split),
        Row(f"width_mae_pct_{name}", 100.0 * float(np.abs(width).mean() / true), "%", paper, width.size, split),
        Row(f"width_bias_cm_{name}", 100.0 * float(width.mean()), "cm", None, width.size, split),
        Row(f"width_worst_cm_{name}", 100.0 * float(np.abs(width).max()), "cm", None, width.size, split),
        Row(f"width_late_mean_cm_{name}", 100.0 * float(late.mean()), "cm", None, late.size, split),
        Row(f"width_late_sd_cm_{name}", 100.0 * float(late.std()), "cm", None, late.size, split),
        Row(f"width_inside_two_sigma_{name}", inside, "1", None, width.size, split),
    ]


def _absent() -> str | None:
    return None if datasets.available("gaitmap_example") else datasets.unavailable_reason("gaitmap_example")


def experiment(quick: bool) -> list[Row]:
    """All parts."""
    return [*measured(quick), *simulated(quick)]


if __name__ == "__main__":
    main("stride_width_ekf", "Stride width from two feet and a range between them.", experiment)
