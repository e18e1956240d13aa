"""Distances from the lower back, the pendulum's constant K always learned on other people.

K of a walk is that at which the pendulum alone gives the reference's length of its straight parts; of a person, the
geometric mean over walks; of people, that over persons. It is learned on the other people of the same set, or on the
other set, whose people, sensor, reference and walks are all different.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import numpy as np

from experiments.common.row import Row, show
from experiments.kose2011 import ways
from experiments.kose2011.walks import Walk, sets
from jgait.estimators import waist as waist_ofdri
from jgait.estimators.interface import pad
from jgait.estimators.programs import bucket
from jgait.estimators.waist import DEFAULT, WaistOptions, WaistParams
from jgait.types import Estimate

SAMPLES = 4096
"""All walks of the sets are padded to this many, so that one program serves them."""

PENDULUM = "pendulum"
ALONE = 1e3
"""[1] `start_noise` with which the start of a walk does not change the pendulum's constant."""
ZIJLSTRA = {"excursion_power": 1.0, "surge_power": 0.0}


class Way(NamedTuple):
    """One way of measuring.

    Attributes:
        key: in names of rows.
        title: in tables.
        options: of the estimator, or one of `kose2011.ways`.
        settings: parameters that differ from the defaults.
    """

    key: str
    title: str
    options: WaistOptions | str
    settings: dict[str, Any]

    @property
    def learns(self) -> bool:
        """Whether the pendulum's constant enters the distance, so that it is learned on other people."""
        return self.options in (DEFAULT, PENDULUM)


WAYS = (
    Way("", "one model (default)", DEFAULT, {}),
    Way("_pendulum", "pendulum alone", PENDULUM, {}),
    Way("_zijlstra", "pendulum by Zijlstra's letter", PENDULUM, ZIJLSTRA),
    Way("_update", "OFDRI with velocity update", DEFAULT._replace(distance="update"), {}),
    Way("_frozen", "OFDRI without", "frozen", {}),
    Way("_integrated", "OFI", "integrated", {}),
)


SHOWN = ("", "_update", "_frozen", "_integrated")
WHERE = {
    "ipol_straight": "straight walks of `ipol_gait`",
    "ipol_whole": "`ipol_gait` with the U-turn",
    "mobgap_lab": "`mobgap_lab`",
    "simulation": "75 m at three speeds",
}


def line_of(way: Way, name: str) -> str:
    """The line of a way of measuring in the table of all experiments."""
    learned = ", constant learned on other people" if way.learns else ""
    return f"distance, {way.title}{learned}, {WHERE[name]}: error"


class Item(NamedTuple):
    """A walk with the estimator's inputs, padded."""

    walk: Walk
    inputs: Any


class Measured(NamedTuple):
    """What was made of one walk.

    Attributes:
        ratio: estimated over true length of its straight parts [1].
        strides: (n,) error of each of those parts [m].
        deviation: stated standard deviation over true length of the straight part [1]; see `measured`.
        whole: estimated over true length of the whole walk [1]; NaN where it is not known.
        whole_deviation: stated standard deviation over true length of the whole walk [1].
    """

    ratio: float
    strides: np.ndarray
    deviation: float
    whole: float
    whole_deviation: float


@partial(jax.jit, static_argnames="options")
def run(p: WaistParams, inputs: Any, options: WaistOptions | str) -> Estimate:
    """`waist_ofdri.run`, or that of `kose2011.ways`, compiled."""
    if isinstance(options, str):
        return ways.run(p, inputs, options)
    return waist_ofdri.run(p, inputs, options)


def ready(walks: Sequence[Walk]) -> list[Item]:
    """Walks of which a distance is known, prepared."""
    found = []
    for walk in walks:
        if len(walk.pieces.length):
            inputs = waist_ofdri.prepared(walk.recording).inputs
            found.append(Item(walk, pad(inputs, bucket(inputs.time.size, SAMPLES))))
    return found


def measured(p: WaistParams, item: Item, options: WaistOptions | str) -> Measured:
    """One walk measured.

    The deviation of a way is stated from the start of the recording on. Over a part it is taken to be the difference
    of that at its end and at its start: the least it can be, so that intervals are not wider than stated.
    """
    walk = item.walk
    told = run(waist_ofdri.with_body(p, walk.body), item.inputs, options)
    time, way, spread = (np.asarray(v) for v in (told.time, told.distance, told.diagnostics["distance_stddev"]))
    ends, length = walk.pieces
    each = np.diff(np.interp(ends, time, way), axis=1)[:, 0]
    first, last = (float(np.interp(when, time, spread)) for when in (ends.min(), ends.max()))
    # pieces of both feet overlap: the deviation belongs to the way from the first to the last
    far = float(np.ptp(np.interp([ends.min(), ends.max()], time, way)))
    whole, deviation = (float(np.interp(walk.until, time, values)) / walk.total for values in (way, spread))
    return Measured(
        float(each.sum() / length.sum()), each - length, (last - first) / max(far, 1e-9), whole, deviation
    )  # fmt: skip


def constants(p: WaistParams, items: Sequence[Item]) -> np.ndarray:
    """(n,) K of each walk; without the start of the walk, the pendulum's way is proportional to it."""
    alone = p._replace(start_noise=ALONE)
    return np.array([p.pendulum_constant / measured(alone, item, PENDULUM).ratio for item in items])


def learned(constant: np.ndarray, items: Sequence[Item], among: np.ndarray) -> float:
    """K learned on some people; (n,) bool is True at their walks."""
    subjects = np.array([item.walk.subject for item in items])
    of_person = [np.log(constant[among & (subjects == one)]).mean() for one in sorted(set(subjects[among]))]
    return float(np.exp(np.mean(of_person)))


def held_out(way: Way, items: Sequence[Item], same_set: bool) -> list[Measured] | None:
    """Each walk with K of the other people of its set, or of the other set; None if there are no other people."""
    p = WaistParams(**way.settings)
    if not way.learns:
        return [measured(p, item, way.options) for item in items]
    constant = constants(p, items)
    sets, subjects = (np.array([getattr(item.walk, name) for item in items]) for name in ("set", "subject"))
    found = []
    for item in items:
        others = (sets == item.walk.set) & (subjects != item.walk.subject) if same_set else sets != item.walk.set
        if not others.any():
            return None
        found.append(measured(p._replace(pendulum_constant=learned(constant, items, others)), item, way.options))
    return found


def errors(found: Sequence[Measured], items: Sequence[Item]) -> dict[str, np.ndarray]:
    """What → errors of its walks [%]."""
    sets = np.array([item.walk.set for item in items])
    part, whole = (100.0 * (np.array([getattr(one, name) for one in found]) - 1.0) for name in ("ratio", "whole"))
    told = {"ipol_straight": part[sets == "ipol_gait"], "ipol_whole": whole[sets == "ipol_gait"],
            "mobgap_lab": part[sets == "mobgap_lab"]}  # fmt: skip
    known = {name: values[np.isfinite(values)] for name, values in told.items()}
    return {name: values for name, values in known.items() if values.size}


def within(found: Sequence[Measured], items: Sequence[Item]) -> dict[str, np.ndarray]:
    """What → whether each walk is within two stated standard deviations; a walk's whole where it is known."""
    part = np.array([abs(one.ratio - 1.0) <= 2.0 * one.deviation for one in found])
    whole = np.array([abs(one.whole - 1.0) <= 2.0 * one.whole_deviation for one in found])
    has_whole = np.array([np.isfinite(item.walk.total) for item in items])
    return {"": np.where(has_whole, whole, part), "_straight": part}


def _rows(way: Way, found: Sequence[Measured], items: Sequence[Item], suffix: str, split: str) -> list[Row]:
    rows = []
    for name, off in errors(found, items).items():
        size = np.abs(off)
        figures = {"mae": np.mean(size), "median": np.median(size), "worst": np.max(size), "bias": np.mean(off)}
        end = f"{name}{way.key}{suffix}"
        some = {k: Row(f"distance_{k}_pct_{end}", float(v), "%", n=off.size, split=split) for k, v in figures.items()}
        if way.key in SHOWN and not suffix:
            words = {"mae": "mean", "median": "median", "worst": "worst"}
            some |= {k: some[k].on(line_of(way, name), part, "walks") for k, part in words.items()}
        rows += some.values()
    if way.learns:
        for name, good in within(found, items).items():
            share = 100.0 * float(np.mean(good))
            rows.append(
                Row(f"distance_two_sigma_pct{name}{way.key}{suffix}", share, "%", n=good.size, split=split)
            )  # fmt: skip
    both = zip(found, items, strict=True)
    feet = [one.strides for one, item in both if item.walk.set == "ipol_gait"]
    if feet and not way.key and not suffix:
        off = 100.0 * np.abs(np.concatenate(feet))
        rows.append(Row("stride_mae_cm_ipol_straight", float(np.mean(off)), "cm", n=off.size, split=split))
    return rows


def _line(title: str, found: Sequence[Measured], items: Sequence[Item]) -> list[Any]:
    cells = []
    told = errors(found, items)
    for name in ("ipol_straight", "ipol_whole", "mobgap_lab"):
        off = told.get(name)
        if off is None:
            cells.append("–")
            continue
        size = np.abs(off)
        cells.append(f"{np.mean(size):.1f} / {np.median(size):.1f} / {np.max(size):.0f}  {np.mean(off):+.1f}")
    inside = within(found, items)[""]
    return [title, *cells, f"{int(inside.sum())}/{inside.size}"]


def rows(quick: bool) -> list[Row]:
    """On the sets that are here."""
    chosen = sets(quick)
    return of_sets(chosen, quick) if chosen else []


def of_sets(sets: dict[str, list[Walk]], quick: bool) -> list[Row]:
    """Every way on every set, K learned on others; and the paper's ways, which have none."""
    items = ready([walk for walks in sets.values() for walk in walks])
    rows, lines = [], []
    for way in WAYS[:2] if quick else WAYS:
        free = way.learns
        for same in (True, False) if free else (True,):
            found = held_out(way, items, same)
            if found is None:
                continue
            told = ("K of the other people" if same else "K of the other set") if free else "nothing learned"
            suffix = "" if same else "_other_set"
            rows += _rows(way, found, items, suffix, f"{told}, leave one subject out" if free and same else told)
            lines.append(_line(f"{way.title}: {told}", found, items))
    columns = ["", "ipol_gait, straight leg", "whole, with the U-turn", "mobgap_lab, bouts", "in 2σ"]
    show("Distance, |error| [%]: mean / median / worst, and mean error", columns, lines)
    if items:
        constant = constants(WaistParams(), items)
        said = (f"{item.walk.name} {k:.2f}" for item, k in zip(items, constant, strict=True))
        print(f"K of each walk, {WaistParams().pendulum_constant} by default: {', '.join(said)}")
    return rows
