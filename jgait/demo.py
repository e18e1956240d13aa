"""The demonstration: estimate, compare with a reference, tune by gradient, judge on what the tuning never saw."""

from collections.abc import Callable
from pathlib import Path
from threading import Lock
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax

from jgait import datasets, params, plot, protocols, tune
from jgait.estimators import leg_ekf
from jgait.estimators.leg_ekf import BySide, LegOptions, LegParams
from jgait.estimators.leg_inputs import pad
from jgait.judge import FIELDS, Judged, Lesson, judge, leg_loss, lesson, with_lengths
from jgait.types import SIDES, Estimate

RATE_HZ = 50.0
_DRAWING = Lock()  # matplotlib draws one figure at a time
OPTIONS = leg_ekf.DEFAULT._replace(rate_hz=RATE_HZ)

Report = Callable[[str, int, int], None]
"""Called with what is being done, and how much of how much."""


class Line(NamedTuple):
    """One line of the demonstration's table.

    Attributes:
        walk: what was judged.
        seen: whether the tuning saw it.
        leg: "right" or "left"; "both" for the distance.
        what: the quantity, with its unit.
        paper: error of the paper's pipeline; None where it was not run.
        before: error with the default parameters.
        after: error with the tuned parameters.
    """

    walk: str
    seen: bool
    leg: str
    what: str
    paper: float | None
    before: float
    after: float


class Demo(NamedTuple):
    """What a demonstration found.

    Attributes:
        title: what was walked, by whom.
        lines: the table.
        tuned: name of a parameter → default and tuned value.
        figures: files written.
        losses: of the fit, step by step.
    """

    title: str
    lines: list[Line]
    tuned: dict[str, tuple[float, float]]
    figures: list[Path]
    losses: list[float]


def freed(*names: str) -> LegParams:
    """Transforms that let only the named parameters move."""
    held = jax.tree.map(
        lambda _: params.fixed, leg_ekf.TRANSFORMS, is_leaf=lambda node: isinstance(node, params.Transform)
    )
    return held._replace(**{name: getattr(leg_ekf.TRANSFORMS, name) for name in names})


def _estimate(p: LegParams, item: Lesson, options: LegOptions = OPTIONS) -> Estimate:
    return _run(p, jax.tree.map(jnp.asarray, item.inputs), options)


_run = jax.jit(leg_ekf.run, static_argnames=("options",))


def _values(p: LegParams, names: tuple[str, ...]) -> dict[str, float]:
    out: dict[str, float] = {}
    for name in names:
        value = getattr(p, name)
        if isinstance(value, BySide):
            out |= {f"{name}, {side}": float(v) for side, v in zip(SIDES, value, strict=True)}
        else:
            out[name] = float(value)
    return out


def _lines(walk: str, seen: bool, paper: Judged | None, before: Judged, after: Judged) -> list[Line]:
    units = {"hip_deg": "hip, °", "knee_deg": "knee, °", "x_cm": "foot x, cm", "y_cm": "foot y, cm"}
    rows = [
        Line(
            walk, seen, side, units[column], None if paper is None else paper.rmse[side][column],
            before.rmse[side][column], after.rmse[side][column],
        )
        for side in before.rmse
        for column in FIELDS
    ]  # fmt: skip
    if before.distance_error_pct is not None and after.distance_error_pct is not None:
        theirs = None if paper is None else paper.distance_error_pct
        rows.append(
            Line(walk, seen, "both", "distance, %", theirs, before.distance_error_pct, after.distance_error_pct)
        )
    return rows


def simulated(out: Path, report: Report, *, subjects: int = 6, steps: int = 15, seed: int = 0) -> Demo:
    """A simulated cohort: tune distance scale and standing pose on half of the people, judge on the other half.

    Args:
        out: folder for figures; made if it is not there.
        report: told how far it is.
        subjects: people, half of them to tune on.
        steps: of the optimiser.
        seed: of the cohort.

    Returns:
        Table lines of the people that the tuning never saw (medians over them), and figures of one of them.
    """
    report("simulating people", 0, 1)
    drawn = protocols.bennett(jax.random.key(seed), subjects, rate=RATE_HZ)
    walks = [(walked.recording, walked.truth.estimate) for walked in drawn]
    start = leg_ekf.LegParams()
    names = ("standing_hip", "standing_knee", "distance_scale")
    lessons: list[Lesson] = []
    longest = max(reference.time.size for _, reference in walks)
    for recording, reference in walks:
        preparation = leg_ekf.prepared(recording, OPTIONS)
        own = reference.diagnostics
        p = start._replace(
            thigh_length=BySide(*(float(own["thigh_length"]),) * 2),
            shank_length=BySide(*(float(own["shank_length"]),) * 2),
        )
        moving = np.flatnonzero(~preparation.inputs.still)
        window = (int(moving[0]), int(moving[-1]) + 1)
        one = lesson(preparation.inputs, reference, window, preparation.standing, p)
        lessons.append(_padded(one, longest))
    half = subjects // 2
    data = jax.tree.map(lambda *v: jnp.stack([jnp.asarray(x) for x in v]), *lessons[:half])
    fit = tune.fit(
        # The start is within a few percent already: longer steps would go past the least loss and find nothing.
        _simulated_loss, start, freed(*names), data, optax.adam(0.01), steps=steps,
        progress=lambda p: report(f"tuning on {half} simulated people, loss {p.loss:.1f}", p.done, p.total),
    )  # fmt: skip
    judged = []
    for number in range(half, subjects):
        _, reference = walks[number]
        item = lessons[number]
        window = (int(np.argmax(item.look)), int(item.last) + 1)
        standing = (int(np.argmax(item.standing)), int(np.sum(item.standing)))
        pair = []
        for p in (start, fit.params):
            estimate = _estimate(with_lengths(p, item.lengths), item)
            pair.append((judge(estimate, reference, window, standing), estimate))
        judged.append((pair, reference, window))
    lines = _medians(
        [_lines(f"median of {subjects - half} people", False, None, a[0], b[0]) for (a, b), _, _ in judged]
    )
    (_, (_, estimate)), reference, _ = judged[0]
    figures = _figures(out, "simulated", estimate, reference, "a simulated walk the tuning never saw", None, None)
    tuned = _compare(_values(start, names), _values(fit.params, names))
    return Demo(f"Simulated: {subjects} people, tuned on {half}", lines, tuned, figures, [float(v) for v in fit.losses])


def _simulated_loss(p: LegParams, item: Lesson) -> Any:
    return leg_loss(p, item, OPTIONS)


def _padded(item: Lesson, samples: int) -> Lesson:
    """A lesson with invalid samples behind it."""
    more = samples - item.inputs.time.size

    def longer(values: Any) -> np.ndarray:
        values = np.asarray(values)
        return values if values.ndim == 0 else np.pad(values, (0, more), mode="edge")

    reference = jax.tree.map(longer, item.reference)._replace(valid=np.pad(np.asarray(item.reference.valid), (0, more)))
    return item._replace(
        inputs=pad(item.inputs, samples),
        reference=reference,
        look=np.pad(item.look, (0, more)),
        standing=np.pad(item.standing, (0, more)),
    )


def _medians(tables: list[list[Line]]) -> list[Line]:
    return [
        rows[0]._replace(
            before=float(np.median([abs(r.before) for r in rows])), after=float(np.median([abs(r.after) for r in rows]))
        )
        for rows in zip(*tables, strict=True)
    ]


def _compare(before: dict[str, float], after: dict[str, float]) -> dict[str, tuple[float, float]]:
    return {name: (before[name], after[name]) for name in before}


def neura_sparse(out: Path, report: Report, *, steps: int = 15) -> Demo:
    """One person, motion capture: tune on the walk out, judge on the walk back.

    Args:
        out: folder for figures; made if it is not there.
        report: told how far it is.
        steps: of the optimiser.

    Returns:
        Table lines for both walks, and figures of the walk back.

    Raises:
        DatasetUnavailable: the message says how to get the set.
    """
    report("reading neura_sparse", 0, 1)
    walk = datasets.load("neura_sparse")[0]
    windows = {name: (span[0], span[1]) for name, span in walk.info["windows"].items()}
    lengths = walk.info["lengths"]
    start = leg_ekf.LegParams(
        thigh_length=BySide(*(lengths[side][0] for side in SIDES)),
        shank_length=BySide(*(lengths[side][1] for side in SIDES)),
    )
    names = ("standing_hip", "standing_knee", "thigh_gain", "distance_scale")
    if walk.reference is None:
        raise datasets.DatasetUnavailable("the recording of neura_sparse lacks its reference")
    preparation = leg_ekf.prepared(walk.recording, OPTIONS)
    every = round(walk.recording.sampling_rate_hz / RATE_HZ)
    reference = jax.tree.map(lambda v: np.asarray(v)[::every], walk.reference._replace(diagnostics={}))
    windows = {name: (a // every, b // every) for name, (a, b) in windows.items()}
    out_walk, back, standing = windows["straight_1"], windows["straight_2"], windows["standing"]
    item = lesson(preparation.inputs, reference, out_walk, standing, start)
    fit = tune.fit(
        _simulated_loss, start, freed(*names), item, optax.adam(0.1), steps=steps, batched=False,
        progress=lambda p: report(f"tuning on the walk out, loss {p.loss:.1f}", p.done, p.total),
    )  # fmt: skip
    report("judging on the walk back", 0, 1)
    paper = leg_ekf.estimate(start, walk.recording, leg_ekf.PAPER)
    before, after = _estimate(start, item), _estimate(fit.params, item)
    lines = []
    for name, seen, window in (("out", True, out_walk), ("back", False, back)):
        lines += _lines(name, seen, *(judge(one, reference, window, standing) for one in (paper, before, after)))
    time = np.asarray(reference.time)
    seconds = (float(time[back[0]]), float(time[min(back[1], time.size - 1)]))
    figures = _figures(
        out, "neura_sparse", after, reference, "walk back, never seen by the tuning", seconds,
        {"default parameters": before, "paper's pipeline": paper},
    )  # fmt: skip
    tuned = _compare(_values(start, names), _values(fit.params, names))
    title = "neura_sparse: one person, motion capture; tuned on the walk out, judged on the walk back"
    return Demo(title, lines, tuned, figures, [float(v) for v in fit.losses])


def _figures(
    out: Path, stem: str, estimate: Estimate, reference: Estimate, title: str,
    seconds: tuple[float, float] | None, others: dict[str, Estimate] | None,
) -> list[Path]:  # fmt: skip
    out.mkdir(parents=True, exist_ok=True)
    with _DRAWING:
        angles = plot.joint_angles(estimate, reference, seconds=seconds, title=title)
        path = plot.foot_path(estimate, reference, seconds=seconds, title=title)
        way = plot.distance(estimate, reference, seconds=seconds, title=title, others=others)
        figures = {"angles": angles, "foot_path": path, "distance": way}
        return [plot.save(figure, out / f"{stem}_{name}.png") for name, figure in figures.items()]
