"""The effect of each part of the foot estimator: left out of it, or added to the textbook filter."""

from collections.abc import Mapping, Sequence

import numpy as np

from experiments.common.row import Row, show
from experiments.foot_ins.run import Ready, Score, scored, sets
from experiments.foot_ins.zero_velocity import DETECTORS, zero_velocity
from jgait.estimators.foot_ins import DEFAULT, TEXTBOOK, FootOptions, FootParams

BEST = FootParams()
JUMP = {"acc_jump_noise": BEST.acc_jump_noise, "gyr_jump_noise": BEST.gyr_jump_noise}
PIVOT = {"pivot_height": BEST.pivot_height, "rate_noise": BEST.rate_noise}

PARTS: dict[str, tuple[FootParams, FootOptions]] = {
    "textbook": (TEXTBOOK, DEFAULT),
    "textbook_jump": (TEXTBOOK._replace(**JUMP), DEFAULT),
    "textbook_pivot": (TEXTBOOK._replace(**PIVOT), DEFAULT),
    "default": (BEST, DEFAULT),
    "filter": (BEST, DEFAULT._replace(smooth=False)),
    "level": (BEST, DEFAULT._replace(level=True)),
    **{f"detector_{name}": (BEST, DEFAULT) for name in DETECTORS},
}
"""Name → parameters and options; `default` is what the estimator does untold: jump noise and pivot, smoothed."""


def rows(quick: bool) -> list[Row]:
    """Of all sets."""
    chosen = sets(quick)
    return of_sets(chosen, quick) if chosen else []


def of_sets(sets: Mapping[str, Sequence[Ready]], quick: bool) -> list[Row]:
    """Stride length of every variant on every set."""
    rows, lines, stances = [], [], []
    # the quick form takes those that compile no other program
    chosen = [name for name in PARTS if not quick or name in ("textbook", "default", "detector_shoe")]
    for name in chosen:
        p, options = PARTS[name]
        cells: list[str] = []
        for set_name, usual in sets.items():
            fixed = name.startswith("detector_")
            pairs = flagged(usual, name.removeprefix("detector_")) if fixed else [(item, item) for item in usual]
            found = scored(p, [item for _, item in pairs], options)
            cells.append("–" if found is None else cell(found))
            if found is None:
                continue
            metric, split = f"ablation_{name}_stride_mae_cm_{set_name}", f"{set_name}, untuned"
            rows.append(Row(metric, found.mae, "cm", n=found.n, split=split))
            if fixed:
                missed, swings, footholds = np.sum([overlooked(*pair) for pair in pairs], axis=0)
                stances.append([name, set_name, int(footholds), int(missed), int(swings)])
                metric = f"ablation_{name}_stances_missed_{set_name}"
                rows.append(Row(metric, float(missed), "stances", n=int(footholds), split=split))
        lines.append([name, *cells])
    show("stride length by part: MAE (bias) cm, position RMSE m", ["", *sets], lines)
    if stances:
        columns = ["", "set", "stances", "no sample flagged", "swings with a flagged sample"]
        show("fixed thresholds: a stance without a flag has no zero velocity, a swing with one has a wrong one",
             columns, stances)  # fmt: skip
    return rows


def cell(found: Score) -> str:
    """A cell of the table."""
    lost = f", {found.lost} lost" if found.lost else ""
    return f"{found.mae:.2f} ({found.bias:+.2f}) {found.rmse:.3f}{lost}"


def flagged(items: Sequence[Ready], detector: str) -> list[tuple[Ready, Ready]]:
    """Each foot, and the same with the zero velocity of another detector."""
    found = []
    for item in items:
        ((_, imu),) = item.foot.recording.sensors.items()
        foot = getattr(item.inputs, item.foot.side)
        hz = 1.0 / float(np.median(np.diff(imu.time)))
        stands = zero_velocity(imu.gyr - foot.gyr_bias, imu.acc, hz, imu.mask, detector)
        other = item.inputs._replace(**{item.foot.side: foot._replace(stands=stands)})
        found.append((item, Ready(item.foot, other)))
    return found


def overlooked(usual: Ready, other: Ready) -> tuple[int, int, int]:
    """Stances of which a detector flags nothing, swings of which it flags something, and how many stances there are."""
    ours, theirs = (item.inputs.right or item.inputs.left for item in (usual, other))
    stands, swing = np.asarray(theirs.stands), ~np.asarray(ours.stands)
    hz = 1.0 / float(np.median(np.diff(usual.inputs.time)))
    count = int(ours.count)
    reach = int(0.3 * hz)
    missed = 0
    for at in ours.foothold[:count]:
        near = slice(max(0, at - reach), at + reach)
        missed += not np.any(stands[near] & ~swing[near])
    # the middle half of each swing
    swings = 0
    for a, b in zip(ours.final_contact[: count - 1], ours.initial_contact[: count - 1], strict=True):
        quarter = (b - a) // 4
        swings += bool(np.any((stands & swing)[a + quarter : b - quarter]))
    return missed, swings, count
