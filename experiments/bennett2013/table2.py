"""Table II of the paper in simulation: distance and displacement of walks of 3 to 4 m."""

from typing import Any

import jax
import numpy as np

from experiments.common import protocols
from experiments.common.row import Row, show
from jgait.estimators import leg_ekf
from jgait.estimators.leg_ekf import DEFAULT, PAPER, BySide, LegOptions, LegParams
from jgait.types import Recording, as_float

LINES = {
    "paper_calibrated": "paper's pipeline, scale learned on other people",
    "": "default, scale learned on other people",
}
"""Case → its line of the table of all experiments."""


def rows(quick: bool) -> list[Row]:
    """Table II: 3 to 4 m at 50 Hz with IDG-300-like gyroscopes; the scale is learned on as many other people.

    With the right leg alone, as in the paper, the foot's displacement is judged; with both legs the hip's.
    """
    people = 4 if quick else 32
    learn, test = (protocols.bennett(jax.random.key(seed), people) for seed in (1, 2))

    def one_leg(recording: Recording) -> Recording:
        kept = {name: imu for name, imu in recording.sensors.items() if name.endswith("right")}
        return recording._replace(sensors=kept)

    def run(cohort: Any, options: LegOptions, both: bool) -> list[tuple[np.ndarray, np.ndarray]]:
        pairs = []
        for recording, known, _ in cohort:
            truth = known.estimate
            own = truth.diagnostics
            p = LegParams(
                thigh_length=BySide(*(float(own["thigh_length"]),) * 2),
                shank_length=BySide(*(float(own["shank_length"]),) * 2),
            )
            estimate = leg_ekf.estimate(p, recording if both else one_leg(recording), options)
            ours = np.interp(as_float(truth.time), as_float(estimate.time), as_float(estimate.distance))
            pairs.append((ours, as_float(truth.distance if both else own["foot_displacement_right"])))
        return pairs

    lines, rows = [], []
    cases = [
        ("paper", "paper: Σ Δx⁺ + Σ |Δy|", PAPER, False, False),
        ("paper_calibrated", "paper, calibrated", PAPER, False, True),
        ("one_leg", "default, right leg only, Σ Δx⁺ calibrated", DEFAULT._replace(distance="forward"), False, True),
        ("", "default, both legs, calibrated", DEFAULT, True, True),
    ]
    for name, label, options, both, calibrated in cases:
        scale = float(np.median([t[-1] / o[-1] for o, t in run(learn, options, both)])) if calibrated else 1.0
        pairs = run(test, options, both)
        percent = np.array([100.0 * (scale * o[-1] / t[-1] - 1.0) for o, t in pairs])
        displacement = np.array([100.0 * np.sqrt(np.mean((scale * o - t) ** 2)) for o, t in pairs])
        error, rmse = float(np.mean(np.abs(percent))), float(np.mean(displacement))
        lines.append([label, scale, error, float(np.max(np.abs(percent))), rmse, float(np.max(displacement))])
        split = f"scale learned on {people} other simulated people" if calibrated else "simulated, untuned"
        prefix = f"sim_{name}_" if name else "sim_"
        of_case = [
            Row(f"{prefix}distance_error_pct", error, "%", 2.04, people, split),
            Row(f"{prefix}displacement_rmse_cm", rmse, "cm", 7.0, people, split),
        ]
        if name in LINES:
            figures = zip(of_case, ("distance error", "RMSE of the displacement"), strict=True)
            of_case = [row.on(f"{LINES[name]}: {what}", "mean", "people", simulated=True) for row, what in figures]
        rows += of_case
    lines.append(["paper, real walks", "–", 2.04, "–", 7.0, "–"])
    columns = ["read-out", "scale", "distance error %", "worst %", "displacement RMSE cm", "worst cm"]
    show(f"Table II in simulation: {people} people of 3 to 4 m, 50 Hz", columns, lines)
    return rows
