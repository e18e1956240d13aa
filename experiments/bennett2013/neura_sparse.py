"""`neura_sparse`: the paper's pipeline, the default, each improvement alone, and parameters judged on another walk."""

from typing import Any

import jax
import numpy as np
import optax

from experiments.bennett2013 import literal
from experiments.common.recordings import available, walks
from experiments.common.row import Row, show
from experiments.common.sets import datasets
from experiments.common.windows import Judged, judge, named_windows
from jgait import params, tune
from jgait.estimators import leg_ekf
from jgait.estimators.leg_ekf import DEFAULT, PAPER, BySide, LegOptions, LegParams
from jgait.evaluate import FIELDS
from jgait.types import SIDES, as_float

IMPROVEMENTS: dict[str, dict[str, Any]] = {
    "gravity inclination": {"gravity": True},
    "kinematic closure": {"closure": True},
    "standing": {"standing": True},
    "smoothing": {"smooth": True},
    "full rate, no median filter": {"rate_hz": None, "median": 1},
}
"""What the default does beyond the paper, one argument each; the axis and the distance are measured apart."""


TITLES = {
    "paper": "paper's pipeline",
    "default": "default",
    "known_pose": "default, standing pose known",
}
SECTIONS = {"straight": "straight part", "whole": "with the U-turn"}
WHAT = {"hip": "hip", "knee": "knee", "x": "foot forward", "y": "foot up"}
"""Words of the table of all experiments."""


def errors_of(judged: Judged) -> list[float]:
    """Hip, knee, x and y of the right leg, then of the left."""
    return [judged.rmse[side][column] for side in SIDES for column in FIELDS]


def person(walk: datasets.Walk) -> LegParams:
    """Default parameters with the person's own leg lengths."""
    return leg_ekf.with_body(LegParams(), datasets.body(walk))


def known_pose(p: LegParams, walk: datasets.Walk) -> LegParams:
    """The same with the true standing pose, from motion capture."""
    start, stop = walk.info["windows"]["standing"]
    legs = walk.reference.legs

    def mean(field: str) -> BySide:
        return BySide(*(float(np.mean(as_float(getattr(getattr(legs, s), field))[start:stop])) for s in SIDES))

    return p._replace(standing_hip=mean("hip_angle"), standing_knee=mean("knee_angle"))


def rows(quick: bool) -> list[Row]:
    """The reproduction, the default, each improvement alone, and the held-out walk."""
    if not available("neura_sparse"):
        return []
    walk = walks("neura_sparse")[0]
    p, windows = person(walk), walk.info["windows"]
    standing = windows["standing"]

    def judged(q: LegParams, options: LegOptions | None, window: str) -> Judged:
        """Errors with some options; None: the paper's, with its model as printed."""
        one = leg_ekf.estimator(options or PAPER)
        one = one if options is not None else one._replace(run=literal.run)
        return judge(one.estimate(q, walk.recording), walk.reference, windows[window], standing)

    rows: list[Row] = []

    def record(prefix: str, line: str, result: Judged, split: str) -> None:
        for column in FIELDS:
            for side in SIDES:
                name, unit = column.rsplit("_", 1)
                row = Row(f"{prefix}_{name}_{unit}_{side}", result.rmse[side][column], unit, n=1, split=split)
                rows.append(row.on(f"{line}: {WHAT[name]}", side, "walk"))

    untuned = "neura_sparse, untuned"
    cases = [("paper", PAPER, p), ("default", DEFAULT, p)]
    if not quick:
        cases.append(("known_pose", DEFAULT, known_pose(p, walk)))
    for name, options, q in cases:
        for part, window in (("straight", "straight_1"), ("whole", "whole")):
            result = judged(q, options, window)
            record(f"{name}_{part}", f"{TITLES[name]}, {SECTIONS[part]}", result, f"{untuned}, {part}")
            rows.append(Row(f"{name}_{part}_distance_error_pct", result.distance_error_pct or 0.0, "%", split=untuned))
            if result.within_two_sigma is not None:
                share = 100.0 * result.within_two_sigma
                rows.append(Row(f"{name}_{part}_within_two_sigma_pct", share, "%", split=untuned))
    if quick:
        return rows
    improvements(judged, p)
    return rows + held_out(walk, p)


def improvements(judged: Any, p: LegParams) -> None:
    """Print the effect of every improvement: added alone to the paper's pipeline, and taken alone from the default."""
    lines = []
    paper, best = PAPER, DEFAULT
    variants: list[tuple[str, LegOptions | None]] = [("the paper's pipeline", paper)]
    variants += [(f"  + {name}", paper._replace(**change)) for name, change in IMPROVEMENTS.items()]
    variants += [
        ("  literal F and Q (misprints), σ_θ = 0.01", None),
        ("the default", best),
    ]
    variants += [
        (f"  − {name}", best._replace(**{field: getattr(paper, field) for field in change}))
        for name, change in IMPROVEMENTS.items()
    ]
    for name, options in variants:
        # The printed Q holds powers of σ_θ, and is of use only where these are small.
        q = p._replace(angle_noise=0.01) if options is None else p
        straight, whole = (judged(q, options, part) for part in ("straight_1", "whole"))
        lines.append([name, *errors_of(straight), *errors_of(whole), whole.distance_error_pct])
    columns = [f"{column} {side[0]}" for side in SIDES for column in ("hip°", "knee°", "x cm", "y cm")]
    show("neura_sparse, straight part, by improvement", ["", *columns], [line[:9] for line in lines])
    show(
        "neura_sparse, whole walk with the U-turn, by improvement",
        ["", *columns, "distance %"],
        [[line[0], *line[9:]] for line in lines],
    )


def held_out(walk: datasets.Walk, p: LegParams) -> list[Row]:
    """Tune on the walk out (S1), judge on the walk back (S2)."""
    options = DEFAULT._replace(rate_hz=50.0)
    item, unseen = (
        tune.lessons(leg_ekf.estimator(options), [walk], body=datasets.body, windows=named_windows(look)).lesson(0)
        for look in ("straight_1", "straight_2")
    )
    loss = tune.Objective(leg_ekf.run, leg_ekf.with_body, options, (("trajectory", 1.0), ("distance", 1.0)))
    fit = tune.fit(
        loss, p,
        params.freed(leg_ekf.estimator().transforms, "standing_hip", "standing_knee", "thigh_gain", "distance_scale"),
        item, optax.adam(0.03), steps=80, batched=False,
    )  # fmt: skip
    inputs = jax.tree.map(jax.numpy.asarray, unseen.inputs)
    before, after = (
        judge(leg_ekf.run(q, inputs, options), unseen.reference, unseen.look, unseen.standing) for q in (p, fit.params)
    )
    distance = [abs(j.distance_error_pct or 0.0) for j in (before, after)]
    pairs = list(zip([*errors_of(before), distance[0]], [*errors_of(after), distance[1]], strict=True))
    names = [f"{side} {column}" for side in SIDES for column in FIELDS] + ["distance_pct"]
    show(
        "neura_sparse: tuned on the walk out, judged on the walk back",
        ["error", "untuned", "tuned"],
        [[name, *pair] for name, pair in zip(names, pairs, strict=True)],
    )
    split = "tuned on S1, judged on S2"
    return [
        Row("heldout_distance_error_pct", distance[1], "%", split=split).on(
            "default, tuned on the walk out, judged on the walk back: distance error", of="walk"
        ),
        Row("heldout_worst_metric_ratio", max(b / a for a, b in pairs), "ratio", n=len(pairs), split=split),
    ]
