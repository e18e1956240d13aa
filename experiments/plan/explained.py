"""What moves a number: effects by the gradient beside those of planted errors.

Every assumption is planted in turn, with a hundredth of its deviation, both ways; then all at once, drawn with their
deviations, and the change of the number is compared with the deviation that was predicted.
"""

import math
import time

import jax
import numpy as np

from experiments.common.row import Row
from jgait import estimators, simulate
from jgait.estimators import Estimator
from jgait.estimators.stride_flags import in_order, regular
from jgait.simulate.sensors import MPU6000, ON_SHOE
from jgait.tune import Explanation, explain
from jgait.tune.explain import CALIBRATION, with_error
from jgait.types import Recording

ESTIMATORS = {"foot_ins": ("foot_right", "foot_left"), "waist": ("waist",)}
STEP, DRAWN, WALKS = 1e-2, 40, 4
SMALL_SHARE = 0.01
"""[1] Shares below this one are not compared."""


def length(estimator: Estimator, params: object, walk: Recording) -> float:
    """Mean length of the regular strides [m]."""
    estimate = estimator.estimate(params, walk)
    return float(np.mean(estimate.strides.length[in_order(estimate)[regular(estimate, estimator.about.flags)]]))


def _errors(explained: Explanation) -> list[tuple[str, str, np.ndarray]]:
    """Placement, error, and deviation of each axis [unit of the error]."""
    made = []
    for a in explained.assumptions:
        if a.source == "sensor":
            words, placement = a.name.split(", ")
            error = next(name for name, (text, *_) in CALIBRATION.items() if text == words)
            made.append((placement, error, a.deviation / (math.sqrt(3.0) if error == "mounting" else 1.0)))
    return made


def share_errors(estimator: Estimator, walk: Recording, explained: Explanation) -> list[float]:
    """Relative error of each share above `SMALL_SHARE` against finite differences [%]."""
    by_name: dict[str, float] = {}
    for placement, error, each in _errors(explained):
        axes = [
            [length(estimator, estimator.params, with_error(walk, placement, error, side * STEP * each * axis))
             for side in (1.0, -1.0)]
            for axis in np.eye(3)
        ]  # fmt: skip
        by_name[f"{CALIBRATION[error][0]}, {placement}"] = math.hypot(*((a - b) / (2.0 * STEP) for a, b in axes))
    for a in explained.assumptions:
        if a.source != "sensor" and a.share and "." not in a.name:
            value = getattr(estimator.params, a.name)
            ends = [length(estimator, estimator.params._replace(**{a.name: value + side * STEP * a.deviation}), walk)
                    for side in (1.0, -1.0)]  # fmt: skip
            by_name[a.name] = (ends[0] - ends[1]) / (2.0 * STEP)
    total = sum(value**2 for value in by_name.values())
    rows = ((a.share, by_name[a.name] ** 2 / total) for a in explained.assumptions if a.name in by_name)
    return [100.0 * abs(ours / theirs - 1.0) for ours, theirs in rows if theirs > SMALL_SHARE]


def planted(estimator: Estimator, walk: Recording, explained: Explanation, rng: np.random.Generator) -> list[float]:
    """Changes of the number by errors of all sensors at once, over the deviation predicted for them."""
    spread = math.hypot(*(a.effect for a in explained.assumptions if a.source == "sensor"))
    changes = []
    for _ in range(DRAWN):
        erring = walk
        for placement, error, each in _errors(explained):
            erring = with_error(erring, placement, error, each * rng.standard_normal(3))
        changes.append((length(estimator, estimator.params, erring) - explained.value) / spread)
    return changes


def rows(quick: bool) -> list[Row]:
    """The largest error of a share, the coverage of planted errors, and the time of a warm call."""
    made: list[Row] = []
    worst, compared = 0.0, 0
    rng = np.random.default_rng(0)
    for name, worn in list(ESTIMATORS.items())[-1:] if quick else ESTIMATORS.items():
        estimator = estimators.get(name)
        sensor = (ON_SHOE if name == "foot_ins" else MPU6000)._replace(packet_loss=0.0)
        shares: list[float] = []
        changes: list[float] = []
        seconds = math.inf
        for recording, _ in simulate.cohort(
            jax.random.key(1), 1 if quick else WALKS, simulate.straight(15.0), sensor, 100.0, worn
        ):
            begin = time.perf_counter()
            explained = explain(estimator, estimator.params, recording)
            seconds = min(seconds, time.perf_counter() - begin)
            if not shares:
                shares = share_errors(estimator, recording, explained)
            changes += planted(estimator, recording, explained, rng)[: 5 if quick else DRAWN]
        inside = 100.0 * float(np.mean(np.abs(changes) < 1.96))
        worst, compared = max(worst, *shares), compared + len(shares)
        line = f"What moves the stride length by {name}"
        made += [
            Row(f"{name}_explain_covered_pct", inside, "%", n=len(changes)).on(
                line, "planted errors covered", "draws", simulated=True),
            Row(f"{name}_explain_seconds", seconds, "s").on(line, "warm", simulated=True),
        ]  # fmt: skip
    line = "What moves a stride length: largest error of a share against finite differences"
    return [*made, Row("explain_share_error_pct", worst, "%", n=compared).on(line, of="assumptions", simulated=True)]
