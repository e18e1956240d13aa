"""Joint angles of `duty_cycled_gyro` on walks with a U-turn, and the errors of filled rates by their distance.

The gyroscope's one axis measures a part of a turn if the segment is tilted to the side. Angles are judged with
`turn_tilt` and without it; filled rates are those of both shanks, whose gyroscopes follow a schedule. `turn_tilt`,
`filled_noise` and `FURTHEST` were chosen in view of these walks.
"""

import itertools
from collections.abc import Sequence

import jax
import numpy as np

from experiments.common.recordings import available
from experiments.common.row import Row, show
from experiments.udaya2010.walked import neura
from jgait import simulate
from jgait.duty_cycle.fillers import neighbours
from jgait.duty_cycle.filling import MEASURED, Thigh
from jgait.estimators import duty_cycled_gyro
from jgait.estimators.duty_cycled_gyro import DEFAULT, DutyCycledParams
from jgait.simulate.sensors import OPAL
from jgait.types import SIDES, Estimate, Recording, as_float, leg_of

DUTY = 0.4
WARM_S = {"neura_sparse": 16.0, "simulation": 6.0}
"""Set → time for which the gyroscopes are on at first [s]: standing, and the first strides."""

EDGES = (0.0, 0.07, 0.13, 0.27, 0.67, 1.0, np.inf)
"""[1] Limits of the distances for which errors of filled rates are printed."""

WITHOUT = DutyCycledParams(turn_tilt=1e-6)
SPLIT = "constants chosen in view of these walks"


def _walks(quick: bool) -> dict[str, list[tuple[Recording, Estimate]]]:
    key, route = jax.random.key(3), simulate.u_turn(6.0)
    made = simulate.cohort(key, 1 if quick else 5, route, OPAL, 100.0, simulate.FOUR, recorded=False)
    sets = {"simulation": [(recording, truth.estimate) for recording, truth in made]}
    if not quick and available("neura_sparse"):
        sets["neura_sparse"] = [(one.recording, one.truth) for one in neura()]
    return sets


def _joints(p: DutyCycledParams, recording: Recording, truth: Estimate) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Joint and side → its error after the first standing, relative to it, and the stated deviation [rad]."""
    found = duty_cycled_gyro.estimate(p, recording)
    standing, found_at = slice(*found.diagnostics["standing"]), as_float(found.time)
    errors = {}
    for side in SIDES:
        for joint in ("hip_angle", "knee_angle"):
            ours, theirs, stated = (
                as_float(getattr(leg_of(legs, side), joint)) for legs in (found.legs, truth.legs, found.stddev)
            )
            theirs = np.interp(found_at, as_float(truth.time), theirs)
            off = (ours - ours[standing].mean()) - (theirs - theirs[standing].mean())
            errors[f"{joint.split('_')[0]}_{side}"] = off[standing.stop :], stated[standing.stop :]
    return errors


def _filled(recording: Recording, warm_up: float) -> tuple[np.ndarray, np.ndarray]:
    """Errors of the rates of both shanks that `neighbours` fills [rad/s], and their distances [1]."""
    always = duty_cycled_gyro.prepared(recording).inputs
    asleep = duty_cycled_gyro.prepared(recording, DEFAULT._replace(schedule=DUTY, warm_up=warm_up)).inputs
    found = []
    for side in SIDES:
        thigh, shank = getattr(asleep, side)
        above = Thigh(thigh.gyr - thigh.bias, thigh.acc)
        rate = np.where(shank.on, shank.gyr - shank.bias, 0.0)
        told = neighbours(rate, shank.on, shank.acc, recording.sampling_rate_hz, thigh=above)
        true, off = getattr(always, side).shank, np.asarray(told.how) != MEASURED
        found.append(((np.asarray(told.rate) - (true.gyr - true.bias))[off], np.asarray(told.unlike)[off]))
    errors, distances = zip(*found, strict=True)
    return np.concatenate(errors), np.concatenate(distances)


def _by_distance(pairs: Sequence[tuple[np.ndarray, np.ndarray]]) -> list[Row]:
    errors, distances = (np.concatenate(values) for values in zip(*pairs, strict=True))
    rows, lines = [], []
    for low, high in itertools.pairwise(EDGES):
        of = errors[(distances >= low) & (distances < high)]
        if of.size:
            size = float(np.sqrt(np.mean(of**2)))
            lines.append([f"{low:g} to {high:g}", size, of.size])
            rows.append(Row(f"filled_error_from_distance_{low:g}", size, "rad/s", None, of.size, SPLIT))
    show(
        "filled rates of shanks, by the distance of the nearest history", ["distance", "RMS [rad/s]", "samples"], lines
    )
    return rows


def rows(quick: bool) -> list[Row]:
    """Errors of the angles, the share of them beyond two stated deviations, and errors of filled rates."""
    rows: list[Row] = []
    lines: list[list[str | float]] = []
    filled = []
    for name, walks in _walks(quick).items():
        filled += [_filled(recording, WARM_S[name]) for recording, _ in walks]
        for label, p in (("", DutyCycledParams()), ("_without_tilt", WITHOUT)):
            each = [_joints(p, recording, truth) for recording, truth in walks]
            for joint in each[0]:
                size = float(np.median([np.degrees(np.sqrt(np.mean(one[joint][0] ** 2))) for one in each]))
                beyond = float(np.mean([100.0 * np.mean(np.abs(one[joint][0]) > 2.0 * one[joint][1]) for one in each]))
                lines.append([f"{name}, {joint}{label}", size, beyond])
                metric = f"u_turn_{name}_{joint}{label}"
                row = Row(f"{metric}_deg", size, "°", None, len(each), SPLIT)
                line, part = f"{joint.replace('_', ', ')}, always on, U-turn", "without `turn_tilt`" if label else ""
                rows.append(row.on(line, part, "walk" if len(each) == 1 else "walks", simulated=name == "simulation"))
                rows.append(Row(f"{metric}_beyond_two_pct", beyond, "%", None, len(each), SPLIT))
    show("duty_cycled_gyro, U-turn, always on", ["", "RMS, median of walks [°]", "beyond two deviations [%]"], lines)
    return rows + _by_distance(filled)
