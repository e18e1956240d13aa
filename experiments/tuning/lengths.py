"""Everybody's own leg lengths from the path of their feet, all people in one fit."""

from typing import Any, NamedTuple

import jax
import numpy as np
import optax

from experiments.common.row import Row, show
from experiments.tuning.problems import GYROSCOPES, absolute, walks
from jgait import params, tune
from jgait.estimators import leg_ekf
from jgait.tune import Lesson


class Leg(NamedTuple):
    """What is each person's own: lengths [m], and the pose in which they stand [rad]."""

    thigh_length: Any
    shank_length: Any
    standing_hip: Any
    standing_knee: Any


def rows(quick: bool) -> list[Row]:
    """Everybody's own leg lengths from the path of their feet, all people in one fit."""
    people = 4 if quick else 32
    data = walks(jax.random.key(3), people, np.float64).data
    length, angle = (params.per_subject(params.interval(*ends)) for ends in ((0.2, 0.7), (-0.6, 0.6)))

    def loss(p: Leg, lesson: Lesson) -> Any:
        side = leg_ekf.BySide
        q = leg_ekf.with_body(leg_ekf.LegParams(), {"thigh_length": p.thigh_length, "shank_length": p.shank_length})
        q = q._replace(
            standing_hip=side(p.standing_hip, p.standing_hip), standing_knee=side(p.standing_knee, p.standing_knee)
        )
        return absolute(leg_ekf.run(q, lesson.inputs, GYROSCOPES), lesson)

    fit = tune.fit(
        loss, Leg(0.43, 0.43, 0.0, 0.0), Leg(length, length, angle, angle), data, optax.lbfgs(),
        steps=10 if quick else 30, subjects=range(people),
    )  # fmt: skip
    true = [data.body[name][:, 0] for name in ("thigh_length", "shank_length")]
    errors = 100.0 * np.abs(np.stack([np.asarray(fit.params[k]) - true[k] for k in range(2)]))
    total = 100.0 * np.abs(sum(np.asarray(fit.params[k]) - true[k] for k in range(2)))
    show(
        f"leg lengths of {people} people from the path of the foot, {fit.losses[0]:.1f} → {fit.best_loss:.1f} cm²",
        ["", "median error [cm]", "worst [cm]"],
        [["thigh", float(np.median(errors[0])), float(errors[0].max())],
         ["shank", float(np.median(errors[1])), float(errors[1].max())],
         ["both together", float(np.median(total)), float(total.max())]],
    )  # fmt: skip
    line = "thigh and shank length of each person from the path of the foot: error"
    split = "walks of the leg protocol, own lengths of each person in one fit"
    return [
        Row("recover_leg_length_cm_median", float(np.median(errors)), "cm", n=2 * people, split=split).on(
            line, "median", "lengths", simulated=True
        ),
        Row("recover_leg_length_cm_worst", float(errors.max()), "cm", n=2 * people, split=split).on(
            line, "worst", "lengths", simulated=True
        ),
        Row("recover_leg_length_whole_cm_median", float(np.median(total)), "cm", n=people, split=split),
    ]
