"""The height of the pivot learned by gradient on other walks of the same shoe, judged on the walk that was left out.

On at most four other walks of the set, the mean absolute error of stride length is minimised. Where there is
only one walk, it is learned on its first half and judged on the second.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax

from experiments.common.matching import overlapping
from experiments.common.recordings import attempt
from experiments.common.row import Row, show
from experiments.foot_ins import feet as real
from experiments.foot_ins.run import QUICK, Ready, rows_of, score, sets, solved
from jgait import params, tune
from jgait.estimators import foot_ins
from jgait.estimators.foot_ins import DEFAULT, FootParams
from jgait.estimators.foot_ins.prepare import FOOTHOLDS
from jgait.estimators.interface import pad

FREE = params.freed(params.ranges(FootParams()), "pivot_height")
PIECE, MOST = 16384, 4
"""[samples] From the start of each walk that are learned from, and of how many walks."""

ROUND = 0.5
"""[cm] Smaller errors count by their square, larger ones by their size: single strides go wrong by centimetres."""


class Lesson(NamedTuple):
    """Strides of one walk whose length is known; leaves stack.

    Attributes:
        inputs: of `foot_ins.run`.
        row: (K,) rows of the estimate's table.
        length: (K,) [m].
        weight: (K,) 1 for a stride, 0 for padding.
    """

    inputs: Any
    row: Any
    length: Any
    weight: Any


def lesson(item: Ready, samples: int) -> Lesson:
    """What the first samples of a walk teach."""
    foot = real.cut(item.foot, samples)
    inputs = pad(foot_ins.prepared(foot.recording).inputs, samples)
    signals = getattr(inputs, foot.side)
    # the table's rows, not yet in order: from one foothold to the next
    count, time = int(signals.count), inputs.time
    found = np.stack([time[signals.leaves[: count - 1]], time[signals.arrives[1:count]]], axis=1)
    pairs = overlapping(foot.strides, found)
    size = FOOTHOLDS.length(samples)
    row, length, weight = np.zeros(size, np.int32), np.zeros(size), np.zeros(size)
    row[: len(pairs)], length[: len(pairs)], weight[: len(pairs)] = pairs[:, 1], foot.length[pairs[:, 0]], 1.0
    return Lesson(inputs, row, length, weight)


class Loss(NamedTuple):
    """(parameters, lesson) → mean size of the error of stride length, rounded off at 0 [cm]."""

    options: foot_ins.FootOptions

    def __call__(self, p: FootParams, item: Lesson) -> Any:
        length = foot_ins.run(p, item.inputs, self.options).strides.length[item.row]
        size = item.weight * jnp.sqrt((100.0 * (length - item.length)) ** 2 + ROUND**2)
        return jnp.sum(size) / jnp.maximum(jnp.sum(item.weight), 1.0)


def learned(items: Sequence[Ready], quick: bool, samples: int | None = None) -> float:
    """The pivot's height [m] that suits some walks best."""
    size = QUICK if quick else PIECE
    lessons = [lesson(item, samples or size) for item in items]
    if samples is not None:
        lessons = [one._replace(inputs=pad(one.inputs, size)) for one in lessons]
    data = _stacked(lessons)
    # the filter compiles sooner than the smoother, and the pivot is nearly the same
    options = DEFAULT._replace(smooth=not quick)
    steps = 3 if quick else 12
    rate = optax.cosine_decay_schedule(0.3, steps, alpha=0.05)
    fit = tune.fit(Loss(options), FootParams(), FREE, data, optax.adam(rate), steps=steps, chunk=steps)
    return float(fit.params.pivot_height)


def _stacked(lessons: Sequence[Lesson]) -> Lesson:
    return jax.tree.map(lambda *leaves: np.stack([np.asarray(leaf) for leaf in leaves]), *lessons)


def rows(quick: bool) -> list[Row]:
    """On `footprints`, whose walks share a shoe."""
    chosen = sets(quick)
    return calibrated("footprints", chosen["footprints"], quick) if "footprints" in chosen else []


def calibrated(name: str, items: Sequence[Ready], quick: bool) -> list[Row]:
    """Rows `foot_…_NAME_calibrated`."""
    found, lines = [], []
    split = "pivot height learned on the set's other walks"
    cases = [(item, [other for other in items if other.foot.name != item.foot.name]) for item in items]
    if len(items) == 1:
        split = "one walk only: pivot height learned on its first half, judged on the second"
    for item, others in cases:
        outcome = attempt(f"{name}: pivot of {item.foot.name}", lambda i=item, o=others: judged(i, o, quick))
        if outcome is None:
            continue
        height, before, after = outcome
        found.append(after)
        pair = [100.0 * float(np.mean(np.abs(one.error))) for one in (before, after)]
        lines.append([item.foot.name, height, *pair, 100.0 * float(np.mean(after.error)), after.error.size])
    if not found:
        return []
    columns = ["judged on", "pivot height m", "MAE cm, default", "MAE cm, learned", "bias cm", "strides"]
    show(f"{name}: {split}", columns, lines)
    total = score(found)
    heights = [line[1] for line in lines]
    return [
        *rows_of(f"{name}_calibrated", total, split),
        Row(f"foot_pivot_height_m_{name}", float(np.mean(heights)), "m", n=len(heights), split=split),
    ]


def judged(item: Ready, others: Sequence[Ready], quick: bool) -> tuple[float, real.Matched, real.Matched]:
    """The height that was learned, and the walk that was left out without and with it."""
    if others:
        height = learned(others[:: -(-len(others) // MOST)], quick)
        seen = item
    else:
        half = item.foot.strides[len(item.foot.strides) // 2, 0]
        size = QUICK if quick else PIECE
        height = learned([item], quick, min(int(np.searchsorted(item.inputs.time, half)), size))
        later = item.foot.strides[:, 0] >= half
        seen = item._replace(foot=item.foot._replace(strides=item.foot.strides[later], length=item.foot.length[later]))
    before = solved(FootParams(), seen)
    after = solved(FootParams(pivot_height=height), seen)
    if before is None or after is None:
        raise ValueError("the walk left out could not be estimated")
    return height, before, after
