"""What `jgait demo` runs: estimate, compare with a reference, tune by gradient, judge on other walks."""

from collections.abc import Callable
from pathlib import Path
from threading import Lock
from typing import NamedTuple

import jax
import numpy as np
import optax
from jaxtyping import PyTree

from jgait import datasets, params, plot, simulate, tune
from jgait import report as reports
from jgait.estimators import Prepared, leg_ekf
from jgait.estimators.combined import analyse
from jgait.estimators.leg_ekf import BySide, LegParams
from jgait.evaluate import FIELDS
from jgait.evaluate.windows import Judged, judge
from jgait.simulate.sensors import IDG300
from jgait.types import SIDES, Estimate, Walk

RATE_HZ = 50.0
_DRAWING = Lock()  # matplotlib draws one figure at a time
OPTIONS = leg_ekf.DEFAULT._replace(rate_hz=RATE_HZ)

Report = Callable[[str, int, int], None]
"""Called with a text, the number of finished parts, and the number of all parts."""


class Line(NamedTuple):
    """One line of the demonstration's table: the error of a quantity with default and with tuned parameters.

    `what` names the quantity with its unit; `leg` is "right", "left", or "both" for the distance;
    `tuned_on`: whether the tuning used this walk.
    """

    walk: str
    tuned_on: bool
    leg: str
    what: str
    before: float
    after: float


class Demo(NamedTuple):
    """The results of a demonstration; `tuned`: parameter → default and tuned value; `losses`: of each step."""

    title: str
    lines: list[Line]
    tuned: dict[str, tuple[float, float]]
    figures: list[Path]
    losses: list[float]


def _estimate(p: LegParams, item: tune.Lesson) -> Estimate:
    own = jax.tree.map(np.asarray, leg_ekf.with_body(p, item.own))
    estimate: Estimate = leg_ekf.run(own, jax.tree.map(np.asarray, item.inputs), OPTIONS)
    return estimate


def _tuned(names: tuple[str, ...], before: LegParams, after: LegParams) -> dict[str, tuple[float, float]]:
    """Parameter, with its side if it has one → default and tuned value."""
    out: dict[str, tuple[float, float]] = {}
    for name in names:
        pair = getattr(before, name), getattr(after, name)
        if isinstance(pair[0], BySide):
            out |= {f"{name}, {side}": (float(a), float(b)) for side, a, b in zip(SIDES, *pair, strict=True)}
        else:
            out[name] = float(pair[0]), float(pair[1])
    return out


def _lines(walk: str, tuned_on: bool, before: Judged, after: Judged) -> list[Line]:
    units = {"hip_deg": "hip, °", "knee_deg": "knee, °", "x_cm": "foot x, cm", "y_cm": "foot y, cm"}
    rows = [
        Line(
            walk, tuned_on, side, units[column], before.rmse[side][column], after.rmse[side][column],
        )
        for side in before.rmse
        for column in FIELDS
    ]  # fmt: skip
    if before.distance_error_pct is not None and after.distance_error_pct is not None:
        rows.append(Line(walk, tuned_on, "both", "distance, %", before.distance_error_pct, after.distance_error_pct))
    return rows


def simulated(out: Path, report: Report, *, subjects: int = 6, steps: int = 15, seed: int = 0) -> Demo:
    """A simulated cohort: tune distance scale and standing pose on half of the people, judge on the other half.

    Figures are written to the folder `out`, which is made. Returns table lines of the people left out of the tuning
    (medians over them), and figures of one person.
    """
    report("simulating people", 0, 1)
    ways = [simulate.straight(3.1 + 0.9 * number / subjects) for number in range(subjects)]
    drawn = simulate.cohort(jax.random.key(seed), subjects, ways, IDG300, RATE_HZ, simulate.FOUR)
    walks = [Walk(recording, truth.estimate, {}) for recording, truth in drawn]
    made = tune.lessons(leg_ekf.estimator(OPTIONS), walks, own=datasets.body, windows=_walking)
    start = leg_ekf.LegParams()
    names = ("standing_hip", "standing_knee", "distance_scale")
    half = subjects // 2
    data = jax.tree.map(lambda leaf: leaf[:half], made.data)
    fit = tune.fit(
        # The start is within a few percent of the optimum: larger steps would go past the minimum of the loss.
        _loss, start, params.freed(leg_ekf.estimator().transforms, *names), data, optax.adam(0.01), steps=steps,
        progress=lambda p: report(f"tuning on {half} simulated people, loss {p.loss:.1f}", p.done, p.total),
    )  # fmt: skip
    tables = []
    for number in range(half, subjects):
        item = made.one(number)
        estimates = [_estimate(p, item) for p in (start, fit.params)]
        errors = (judge(one, item.reference, item.look, item.standing) for one in estimates)
        tables.append(_lines(f"median of {subjects - half} people", False, *errors))
    title = "a simulated walk left out of the tuning"
    figures = _figures(out, "simulated", estimates[1], drawn[-1][1].estimate, title, None, None)
    tuned = _tuned(names, start, fit.params)
    losses = [float(v) for v in fit.losses]
    return Demo(f"Simulated: {subjects} people, tuned on {half}", _medians(tables), tuned, figures, losses)


_loss = tune.Objective(leg_ekf.run, leg_ekf.with_body, OPTIONS, (("trajectory", 1.0), ("distance", 1.0)))
"""The trajectory's error in squared degrees and centimetres, plus the squared percent error of the distance."""


def _walking(walk: Walk, prepared: Prepared[PyTree]) -> tune.Windows:
    """The window from the first movement to the last."""
    del walk
    moving = np.flatnonzero(~prepared.inputs.still)
    return tune.Windows((int(moving[0]), int(moving[-1]) + 1), prepared.standing)


def _medians(tables: list[list[Line]]) -> list[Line]:
    return [
        rows[0]._replace(
            before=float(np.median([abs(r.before) for r in rows])), after=float(np.median([abs(r.after) for r in rows]))
        )
        for rows in zip(*tables, strict=True)
    ]


class RealWalk(NamedTuple):
    """A real walk by one call, beside its reference.

    `lines` are (quantity, all sensors, each alone, motion capture) in words; `numbers`: quantity → (all sensors, motion
    capture), in metres or degrees.
    """

    title: str
    lines: list[tuple[str, str, str, str]]
    figures: list[Path]
    numbers: dict[str, tuple[float, float]]


def real_walk(out: Path, report: Report) -> RealWalk:
    """All sensors of a person with motion capture together, by `jgait.analyse`.

    Writes a figure and the page of the report into the folder `out`, which is made.

    Raises:
        DatasetUnavailable: the message states how to get the set.
    """
    report("a real walk: every estimator on nine sensors", 0, 1)
    walk = datasets.load("neura_sparse")[0]
    if walk.reference is None:
        raise datasets.DatasetUnavailable("the recording of neura_sparse lacks its reference")
    analysis = analyse(walk.recording, datasets.body(walk))
    windows, reference = walk.info["windows"], walk.reference
    way = reference.distance[slice(*windows["whole"])]
    # a person who stands sways, which is no way walked
    reference = reference._replace(distance=np.clip(reference.distance, way[0], way[-1]) - way[0])
    strides = np.concatenate([walk.info["ankle_strides"][side] for side in SIDES])
    true = {"distance": float(way[-1] - way[0]), "stride_length": float(np.median(strides[strides[:, 2] > WHOLE, 2]))}
    lines, numbers = [], {}
    for quantity, value in true.items():
        by_source = {c.source: c for c in analysis.comparisons if c.quantity == quantity}
        alone = ", ".join(f"{name} {c.value:.2f}" for name, c in by_source.items() if name != "combined")
        all_of_them = by_source["combined"]
        lines.append((
            f"{quantity.replace('_', ' ')} [m]", f"{all_of_them.value:.2f} ± {all_of_them.stddev:.2f}", alone,
            f"{value:.2f}",
        ))  # fmt: skip
        numbers[quantity] = (all_of_them.value, value)
    spread = _joint_ranges(analysis.estimate, reference, windows["whole"])
    for joint, (ours, theirs) in spread.items():
        lines.append((f"{joint}, range [°]", f"{ours:.0f}", "", f"{theirs:.0f}"))
        numbers[joint] = (ours, theirs)
    seconds = tuple(float(reference.time[row]) for row in (windows["whole"][0], windows["whole"][1] - 1))
    title = "a real walk: angles by one call, motion capture dashed (their zero angles differ)"
    with _DRAWING:
        out.mkdir(parents=True, exist_ok=True)
        angles = plot.joint_angles(analysis.estimate, reference, seconds=(seconds[0], seconds[1]), title=title)
        figures = [plot.save(angles, out / "real_walk_angles.png")]
        made = reports.Made("all sensors together", file="neura_sparse")
        page = reports.of_analysis(analysis, walk.recording, reference=reference, made=made)
        figures.append(page.save(out / "real_walk.html"))
    return RealWalk("neura_sparse: one person, nine sensors, one call", lines, figures, numbers)


WHOLE = 1.3
"""[m] Shorter strides of that walk are steps from and to standing, and those of the turn."""


def _joint_ranges(estimate: Estimate, reference: Estimate, window: tuple[int, int]) -> dict[str, tuple[float, float]]:
    """Joint and side → range of the flexion in a window of samples [°], of an estimate and of its reference."""
    ranges = {}
    for side, ours, theirs in zip(SIDES, estimate.legs, reference.legs, strict=True):
        for joint in ("hip", "knee"):
            pair = [np.rad2deg(getattr(leg, f"{joint}_angle")[slice(*window)]) for leg in (ours, theirs)]
            ranges[f"{joint} {side}"] = (float(np.ptp(pair[0])), float(np.ptp(pair[1])))
    return ranges


def neura_sparse(out: Path, report: Report, *, steps: int = 30) -> Demo:
    """One person with motion capture: tune on the walk out, compute errors on the walk back.

    Figures are written to the folder `out`, which is made. Returns table lines for both walks, and figures of the walk
    back.

    Raises:
        DatasetUnavailable: the message states how to get the set.
    """
    report("reading neura_sparse", 0, 1)
    walk = datasets.load("neura_sparse")[0]
    start = leg_ekf.with_body(leg_ekf.LegParams(), datasets.body(walk))
    names = ("standing_hip", "standing_knee", "thigh_gain", "thigh_pull", "distance_scale")
    item, unseen = (
        tune.lessons(leg_ekf.estimator(OPTIONS), [walk], own=datasets.body, windows=tune.named_windows(look)).one(0)
        for look in ("straight_1", "straight_2")
    )
    reference = item.reference
    fit = tune.fit(
        _loss, start, params.freed(leg_ekf.estimator().transforms, *names), item, optax.adam(0.1), steps=steps,
        batched=False, progress=lambda p: report(f"tuning on the walk out, loss {p.loss:.1f}", p.done, p.total),
    )  # fmt: skip
    report("judging on the walk back", 0, 1)
    before, after = _estimate(start, item), _estimate(fit.params, item)
    lines = []
    for name, tuned_on, part in (("out", True, item), ("back", False, unseen)):
        errors = (judge(one, reference, part.look, part.standing) for one in (before, after))
        lines += _lines(name, tuned_on, *errors)
    seconds = (float(reference.time[unseen.first]), float(reference.time[unseen.last]))
    figures = _figures(
        out, "neura_sparse", after, reference, "walk back, left out of the tuning", seconds,
        {"default parameters": before},
    )  # fmt: skip
    tuned = _tuned(names, start, fit.params)
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
