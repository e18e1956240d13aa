"""How often errors lie within two stated standard deviations: strides of ankle and shank, angles of the legs.

Simulated people with the sensors of three presets walk forth and back. A share is that of a person, averaged over the
people, so that the standing pose of one person counts once. Beside it stand the error without the angle's error in
standing, and what is stated for it. Parameters were chosen on people of other random numbers.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import jax
import numpy as np

from experiments.common import recordings
from experiments.common.row import Row, show
from jgait import simulate
from jgait.estimators import ankle_stride, leg_ekf
from jgait.evaluate.scores import within_two_sd
from jgait.simulate.sensors import IDG300, MPU6000, OPAL, ImuErrors
from jgait.types import SIDES, Estimate, as_float

PRESETS: dict[str, tuple[ImuErrors, float]] = {
    "MPU-6000": (MPU6000, 100.0), "Opal": (OPAL, 128.0), "IDG-300": (IDG300, 50.0),
}  # fmt: skip
"""Errors of the sensors, and sampling rate [Hz]."""

PLACEMENTS = ("thigh_right", "shank_right", "ankle_right", "thigh_left", "shank_left", "ankle_left")
PEOPLE, SEED = 24, 900
ROUTE_M = 8.0
JOINTS = {"hip": "hip_angle", "knee": "knee_angle"}
LINE = "errors within two stated standard deviations"
NAMES = {"hip": "hip angle", "knee": "knee angle", "ankle": "stride length at the ankle", "shank": "at the shank"}
QUIET_S = 2.0
"""[s] Time from the start in which everyone stands."""


class Covered(NamedTuple):
    """One person.

    Attributes:
        inside: quantity → share of the errors within two stated standard deviations [%].
        moving: joint → rms error after standing, without the error in standing [deg].
        stated: joint → what is stated of it: root mean variance without the standing pose's [deg].
    """

    inside: dict[str, float]
    moving: dict[str, float]
    stated: dict[str, float]


def legs(p: leg_ekf.LegParams, estimate: Estimate, truth: Estimate) -> Covered:
    """Coverage of hip and knee angles, both legs together."""
    walking = as_float(estimate.time) - as_float(estimate.time)[0] > QUIET_S
    zeros = np.rad2deg([as_float(estimate.diagnostics[f"zero_stddev_{side}"]) for side in SIDES])
    pose = dict(zip(JOINTS, np.sqrt(np.mean(zeros**2, axis=0)), strict=True))
    inside, moving, stated = {}, {}, {}
    for joint, field in JOINTS.items():
        ours, theirs, spread = (
            np.rad2deg([as_float(getattr(getattr(record, side), field)) for side in SIDES])
            for record in (estimate.legs, truth.legs, estimate.stddev)
        )
        error = ours - theirs
        inside[joint] = 100.0 * float(np.mean(np.abs(error) <= 2.0 * spread))
        rest = (error - error[:, ~walking].mean(axis=1, keepdims=True))[:, walking]
        moving[joint] = float(np.sqrt(np.mean(rest**2)))
        stated[joint] = float(np.sqrt(np.mean(spread[:, walking] ** 2 - pose[joint] ** 2)))
    return Covered(inside, moving, stated)


def people(errors: ImuErrors, rate: float, seed: int, count: int) -> Iterator[Covered]:
    """Coverage of each of some people."""
    p = leg_ekf.LegParams()
    drawn = simulate.cohort(
        jax.random.key(seed), count, simulate.u_turn(ROUTE_M), errors, rate, PLACEMENTS, recorded=False
    )
    for recording, truth in drawn:
        found = legs(p, leg_ekf.estimate(p, recording), truth.estimate)
        for site in ("ankle", "shank"):
            options = ankle_stride.DEFAULT._replace(site=site)
            strides = ankle_stride.estimate(ankle_stride.AnkleParams(), recording, options)
            found.inside[site] = within_two_sd(strides, truth.estimate)["stride_length_within_2sd_percent"][0]
        yield found


def recorded() -> list[Row]:
    """Coverage of the angles of a recorded walk, whose errors after standing exceed those of simulated ones."""
    walk = next(iter(recordings.walks("neura_sparse")))
    estimate = leg_ekf.estimate(leg_ekf.LegParams(), walk.recording)
    time, known = as_float(estimate.time), as_float(walk.reference.time)
    made = []
    for joint, field in JOINTS.items():
        inside = []
        for side in SIDES:
            ours, theirs, spread = (
                as_float(getattr(getattr(legs, side), field))
                for legs in (estimate.legs, walk.reference.legs, estimate.stddev)
            )
            error = ours - np.interp(time, known, theirs)
            used = np.asarray(estimate.valid, bool) & np.isfinite(error)
            inside.append(100.0 * float(np.mean(np.abs(error[used]) <= 2.0 * spread[used])))
        row = Row(f"coverage_{joint}_neura_sparse_pct", float(np.mean(inside)), "%", n=2, split="untuned")
        made.append(row.on(LINE, NAMES[joint], "legs"))
    return made


def rows(quick: bool) -> list[Row]:
    """The mean share of each preset, the lowest of which is judged, and the worst person."""
    shares: dict[str, dict[str, np.ndarray]] = {}
    ratios: dict[str, list[float]] = {joint: [] for joint in JOINTS}
    lines: list[list[Any]] = []
    count = 2 if quick else PEOPLE
    for number, (name, (errors, rate)) in enumerate(PRESETS.items()):
        found = list(people(errors, rate, SEED + number, count))
        shares[name] = {key: np.array([one.inside[key] for one in found]) for key in found[0].inside}
        for key, each in shares[name].items():
            line = [name, key, float(each.mean()), float(each.min())]
            if key in JOINTS:
                rms = [float(np.sqrt(np.mean([getattr(one, part)[key] ** 2 for one in found])))
                       for part in ("moving", "stated")]  # fmt: skip
                ratios[key].append(rms[1] / rms[0])
                line += rms
            lines.append(line)
    columns = ["preset", "quantity", "mean [%]", "worst person [%]", "rms after standing [°]", "stated for it [°]"]
    show(f"errors within two stated standard deviations, {count} people each", columns,
         [[*line, *[""] * (len(columns) - len(line))] for line in lines])  # fmt: skip
    split = "mean over people, worst of three presets; parameters chosen on other people"
    n = count * len(PRESETS)
    made = recorded() if recordings.available("neura_sparse") else []
    for key in next(iter(shares.values())):
        means = [float(of[key].mean()) for of in shares.values()]
        made += [
            Row(f"coverage_{key}_pct", min(means), "%", n=n, split=split).on(
                LINE, f"{NAMES[key]}, lowest preset", "people", simulated=True
            ),
            Row(f"coverage_{key}_highest_pct", max(means), "%", n=n, split=split.replace("worst", "highest")).on(
                LINE, f"{NAMES[key]}, highest", "people", simulated=True
            ),
        ]
    return [*made, *(Row(f"stated_over_error_{key}", max(of), "1", n=n, split="highest of three presets, without the "
                         "standing pose") for key, of in ratios.items())]  # fmt: skip
