"""gaitmap's RtsKalman beside the foot estimator: the same strides by the same times."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from experiments.common import peers
from experiments.common.recordings import attempt
from experiments.common.row import Row, show
from experiments.foot_ins import feet as real
from experiments.foot_ins.feet import Foot, Matched
from experiments.foot_ins.run import Ready, Score, line_of, score
from jgait.events.rest import rest
from jgait.types import as_float

SCRIPT = "gaitmap_rts"
KINDS = ("raw", "unbiased")
TITLES = {"gaitmap": "gaitmap's MAE", "gaitmap_unbiased": "gaitmap's MAE, gyroscope bias taken off"}


def job(foot: Foot, unbiased: bool) -> dict[str, Any]:
    """What gaitmap is given: the sensor as it is, or without the bias that our own estimator takes off."""
    (imu,) = foot.recording.sensors.values()
    gyr, acc = as_float(imu.gyr), as_float(imu.acc)
    hz = 1.0 / float(np.median(np.diff(imu.time)))
    given = {"gyr": gyr, "acc": acc, "sampling_rate_hz": hz}
    return given | ({"bias": rest(gyr, acc, np.asarray(imu.mask), hz).gyr_bias} if unbiased else {})


def at_times(foot: Foot, time: np.ndarray, position: np.ndarray, rows: np.ndarray) -> Matched:
    """A trajectory beside the reference: horizontal way between the times of its strides; no standard deviations."""
    ends = foot.strides[rows]
    at = np.stack([np.interp(ends, time, position[:, axis]) for axis in (0, 1)], axis=-1)
    error = np.linalg.norm(at[:, 1] - at[:, 0], axis=1) - foot.length[rows]
    return Matched(
        error, foot.length[rows], np.full(len(rows), np.nan), len(foot.strides) - len(rows),
        real.position_rmse(foot, time, position), rows,
    )  # fmt: skip


def compared(sets: Mapping[str, Sequence[tuple[Ready, Matched, np.ndarray]]]) -> list[Row]:
    """Rows of gaitmap and of the ratio ours over theirs.

    Args:
        sets: name → feet, our own comparison, and our position (T, 3).
    """
    if not peers.available("gaitmap"):
        print(f"left out: {peers.unavailable_reason('gaitmap')}")
        return []
    jobs = {_name(item.foot, kind): job(item.foot, kind == "unbiased")
            for items in sets.values() for item, _, _ in items for kind in KINDS}  # fmt: skip
    answers = answered(jobs)
    rows, lines = [], []
    for name, items in sets.items():
        known = [one for one in items if all(_name(one[0].foot, kind) in answers for kind in KINDS)]
        if known:
            more, line = _set(name, known, answers)
            rows += more
            lines += line
    columns = ["", "strides", "MAE cm", "bias cm", "worst cm", "position RMSE m"]
    show("beside gaitmap's RtsKalman, on the strides that ours found", columns, lines)
    return rows


def answered(jobs: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, np.ndarray]]:
    """All answers from one process, for it compiles for a minute; one by one if that fails, without those that do."""
    if not jobs:
        return {}
    whole = attempt("gaitmap on all recordings at once", lambda: peers.run(SCRIPT, jobs))
    if whole is not None:
        return dict(whole)
    found: dict[str, dict[str, np.ndarray]] = {}
    for name, one in jobs.items():
        found |= attempt(f"gaitmap on {name}", lambda n=name, j=one: peers.run(SCRIPT, {n: j})) or {}
    return found


def _name(foot: Foot, kind: str) -> str:
    """Of a job."""
    return f"{foot.set} {foot.name} {kind}"


def _set(
    name: str, items: Sequence[tuple[Ready, Matched, np.ndarray]], answers: Mapping[str, Mapping[str, np.ndarray]]
) -> tuple[list[Row], list[list[Any]]]:
    """Rows and lines of the table for one set."""

    def theirs(kind: str) -> Score:
        return score([
            at_times(item.foot, item.inputs.time, answers[_name(item.foot, kind)]["position"], ours.rows)
            for item, ours, _ in items
        ])  # fmt: skip

    ours = score([one for _, one, _ in items])
    same = score([at_times(item.foot, item.inputs.time, position, one.rows) for item, one, position in items])
    raw, unbiased = theirs("raw"), theirs("unbiased")
    lines = [
        [f"{name}: {label}", one.n, one.mae, one.bias, one.worst, one.rmse]
        for label, one in (("ours", ours), ("ours, at the reference's times", same), ("gaitmap", raw),
                           ("gaitmap, bias taken off", unbiased))
    ]  # fmt: skip
    split, over = f"{name}, untuned", f"{name}, untuned; ours/theirs"
    rows = [Row(f"foot_at_times_stride_mae_cm_{name}", same.mae, "cm", n=same.n, split=split)]
    for prefix, one in (("gaitmap", raw), ("gaitmap_unbiased", unbiased)):
        rows += [
            Row(f"{prefix}_stride_mae_cm_{name}", one.mae, "cm", n=one.n, split=split).on(
                line_of(name), TITLES[prefix], "strides"
            ),
            Row(f"{prefix}_stride_bias_cm_{name}", one.bias, "cm", n=one.n, split=split),
            Row(f"{prefix}_position_rmse_m_{name}", one.rmse, "m", n=len(items), split=split),
            Row(f"ratio_{prefix}_stride_mae_{name}", ours.mae / one.mae, "ratio", n=one.n, split=over),
            Row(f"ratio_{prefix}_position_rmse_{name}", ours.rmse / one.rmse, "ratio", n=len(items),
                split=over),
        ]  # fmt: skip
    return rows, lines


def seconds(gyr: np.ndarray, acc: np.ndarray, rate_hz: float) -> float | None:
    """How long gaitmap takes for one sensor, its compilation not counted; None where it is not there."""
    if not peers.available("gaitmap"):
        print(f"left out: {peers.unavailable_reason('gaitmap')}")
        return None
    answer = attempt(
        "gaitmap's time",
        lambda: peers.run(SCRIPT, {"hour": {"gyr": gyr, "acc": acc, "sampling_rate_hz": rate_hz, "repeats": 1}}),
    )
    return None if answer is None else float(np.min(answer["hour"]["seconds"]))
