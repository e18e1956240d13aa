"""The foot's trajectory against motion capture, footprints and gaitmap: stride lengths, what each part does, speed.

Real recordings, defaults and no tuning: `gaitmap_example`, `neura_sparse`, `footprints` and `pyshoe_vicon` for stride
lengths, `xio_gait` for a loop that should close. Whichever recordings of them are in the data folder are used.
"""

from collections.abc import Mapping, Sequence
from functools import partial

import _foot_peer
import _foot_pivot
import _foot_real as real
import numpy as np
from _foot_ablation import ablation
from _foot_run import Ready, attempt, estimated, ready, rows_of, score
from _foot_simulated import simulated
from _foot_speed import precision, speed
from common import Row, main, show

from jgait import datasets
from jgait.estimators import foot_ins
from jgait.estimators.foot_ins import FootParams


def real_sets(sets: Mapping[str, Sequence[Ready]], quick: bool = False) -> list[Row]:
    """Stride lengths, positions and stated uncertainty with the defaults; and gaitmap's beside them."""
    rows, lines, every = [], [], []
    beside: dict[str, list[tuple[Ready, real.Matched, np.ndarray]]] = {}
    for name, items in sets.items():
        found = []
        beside[name] = []
        for item in items:
            foot = item.foot
            estimate = attempt(f"{name}: {foot.name}", partial(estimated, FootParams(), item.inputs))
            one = estimate and attempt(f"{name}: {foot.name}", partial(real.matched, foot, estimate))
            if one is None:
                continue
            found.append(one)
            if one.error.size:
                beside[name].append((item, one, getattr(estimate.feet, foot.side).position))
            lines.append([f"{name}: {foot.name}", *score([one])])
        if not found:
            continue
        whole = score(found)
        lines.append([f"{name}: all", *whole])
        rows += rows_of(name, whole, f"{name}, untuned")
        every += found
    columns = ["", "MAE cm", "bias cm", "median cm", "worst cm", "within 2σ %", "position RMSE m", "lost", "strides"]
    show("stride length, defaults", columns, lines)
    if every:
        total = score(every)
        rows += [
            Row("foot_within_two_sigma_pct", total.within, "%", n=total.n, split="all sets, untuned"),
            Row("foot_strides_lost", float(total.lost), "strides", n=total.n + total.lost, split="all sets, untuned"),
        ]
    if quick:
        print("left out of the quick form: gaitmap, which compiles for longer than all the rest")
        return rows
    return rows + _foot_peer.compared(beside)


def closures(quick: bool) -> list[Row]:
    """`xio_gait`: how far from its start the foot is found at the end."""
    if not datasets.available("xio_gait"):
        print(f"left out: {datasets.unavailable_reason('xio_gait')}")
        return []
    walks = datasets.load("xio_gait", datasets.names("xio_gait")[:1] if quick else None)
    for failure in walks.failures:
        print(f"xio_gait: {failure.name} left out: {failure.reason}")
    rows, lines = [], []
    for walk in walks:
        name = walk.recording.name
        if not walk.info["closes"]:
            print(f"xio_gait: {name} left out: it is not known to end where it began")
            continue
        found = attempt(f"xio_gait: {name}", partial(closure, walk))
        if found is None:
            continue
        flat, whole, way = found
        lines.append([name, way, flat, whole, walk.info["publisher_closure"]])
        split = f"xio_gait {name}, {way:.0f} m, untuned"
        rows += [
            Row(f"foot_closure_m_{name}", flat, "m", split=split),
            Row(f"foot_closure_3d_m_{name}", whole, "m", split=split),
        ]
    show("xio_gait: from the end to the start", ["", "way m", "horizontal m", "in 3-D m", "publisher's 3-D m"], lines)
    return rows


def closure(walk: datasets.Walk) -> tuple[float, float, float]:
    """Horizontal and whole distance between both ends, and the way between them [m]."""
    estimate = foot_ins.estimate(FootParams(), walk.recording)
    (foot,) = (one for one in estimate.feet if one is not None)
    where = foot.position[np.asarray(estimate.valid)]
    gap = where[-1] - where[0]
    return float(np.linalg.norm(gap[:2])), float(np.linalg.norm(gap)), float(estimate.distance[-1])


def experiment(quick: bool) -> list[Row]:
    """All parts; what needs recordings or libraries that are not here says so and is left out."""
    names = real.SETS[2:3] if quick else real.SETS
    sets = {name: items for name in names if (items := ready(name, quick))}
    rows = real_sets(sets, quick) if sets else []
    if not quick:
        rows += closures(quick)
    if sets:
        rows += ablation(sets, quick)
    if "footprints" in sets:
        rows += _foot_pivot.calibrated("footprints", sets["footprints"], quick)
    return [*rows, *precision(quick), *speed(quick), *simulated(quick)]


if __name__ == "__main__":
    main("foot_ins", __doc__.splitlines()[0], experiment)
