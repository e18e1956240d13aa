"""Energy saved by waking the gyroscope when the filler's predicted error is large, against the best fixed schedule.

Both fill with `neighbours`. Two strides are measured first; energy, as a part of always on, and errors count from
then on. A group's error is the root mean square of its legs' relative errors, its energy their mean. A fixed schedule
does not depend on the gait's phase, so each is begun at several places of its period. The best of them is found on the
very legs that are judged, which favours it; the policy's parameters but the threshold were found by some hundreds of
random steps that lowered its energy at errors about the judged one, on Young of `walking5m`. Both curves are
interpolated at one error.
"""

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from experiments.common.recordings import available, names
from experiments.common.row import Row, show
from experiments.udaya2010 import trigger as gap_trigger
from experiments.udaya2010.fillers import fillers
from experiments.udaya2010.legs import RATE_HZ, SWINGING, Case, Leg, legs, stride_samples
from experiments.udaya2010.table2 import relative_errors
from jgait.duty_cycle import power
from jgait.duty_cycle.filling import Thigh

LEVEL = 0.10
BELT_LEVEL = 0.05
"""Where 0.10 is reached without the gyroscope, a level that has to be paid for."""

BELT_S = 42.0
THRESHOLDS = (0.07, 0.09, 0.11, 0.13, 0.15, 0.16, 0.17, 0.175, 0.18, 0.19, 0.21)
PERIODS = (0.5, 1.0, 1.5, 2.0, 3.0, 4.0)
"""Periods of the fixed schedules, in strides: a walk of five metres is over after some four."""

BELT_PERIODS = (1.0, 4.0, 10.0)
DUTIES = (1, 2, 4, 6, 8, 10, 12, 14, 16, 17, 18, 19)  # in twentieths


class Curve(NamedTuple):
    """Energy and error of a group of legs as one number of a policy or schedule varies; begun at some places each.

    Attributes:
        energy: (n, legs, places) part of the energy of always on [1].
        square: (n, legs, places) squares of the relative errors [1].
    """

    energy: np.ndarray
    square: np.ndarray

    def mean(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(n,) mean energies, root mean square errors and median errors."""
        flat = self.square.reshape(len(self.square), -1)
        return self.energy.mean(axis=(1, 2)), np.sqrt(flat.mean(axis=1)), np.median(np.sqrt(flat), axis=1)

    def at(self, level: float, *, median: bool = False) -> float:
        """The least energy at which the error reaches a level, between neighbours on the curve; NaN if it does not."""
        energy, error = self.mean()[0], self.mean()[2 if median else 1]
        order = np.argsort(energy)
        energy, error = energy[order], error[order]
        reached = np.flatnonzero(error <= level)
        if not len(reached):
            return float("nan")
        k = reached[0]
        if k == 0:
            return float(energy[0])
        share = (error[k - 1] - level) / (error[k - 1] - error[k])
        return float(energy[k - 1] + share * (energy[k] - energy[k - 1]))

    def leg(self, number: int) -> "Curve":
        """Of one leg."""
        return Curve(*(part[:, number : number + 1] for part in self))

    def worst(self, level: float) -> float:
        """The largest error of a leg where the group's error is the highest that is not over the level."""
        error = self.mean()[1]
        at = int(np.argmax(np.where(error <= level, error, -1.0)))
        return float(np.sqrt(self.square[at].mean(axis=1).max()))


class Group(NamedTuple):
    """Legs, and for each when judging begins [samples] and its stride [samples]."""

    legs: list[Leg]
    judged: list[int]
    strides: list[int]


def grouped(some: list[Leg], standing: int) -> Group:
    """Two strides are measured first; the stride period is computed without `standing` samples at the start."""
    strides = [stride_samples(leg.rate[standing:]) for leg in some]
    judged = [int(np.argmax(np.abs(g.rate) > SWINGING)) + 2 * s for g, s in zip(some, strides, strict=True)]
    return Group(some, judged, strides)


def _energy(used: power.Masks, judged: int) -> float:
    """Over that of always on, from where it is judged [1]."""
    part = power.Masks(*(np.asarray(m)[judged:] for m in used))
    return float(power.mask_energy(part, RATE_HZ) * RATE_HZ / (power.GYROSCOPE.on * len(part.powered)))


def scheduled(group: Group, period: float, places: int, name: str = "neighbours") -> Curve:
    """Fixed schedules of one period [strides], over the duties that the sensor can follow in every leg."""
    filler = fillers()[name]
    shape = (len(group.legs), places)
    points = [(np.ones(shape), np.zeros(shape))]
    for on in DUTIES:
        units = [period * stride / RATE_HZ / 20 for stride in group.strides]
        if min(min(on, 20 - on) * unit for unit in units) < power.GYROSCOPE.wake_up:
            continue
        cases = []
        for leg, judged, unit in zip(group.legs, group.judged, units, strict=True):
            schedule = power.Schedule(on, 20 - on, unit)
            for place in range(places):
                late = round(place / places * schedule.period * RATE_HZ)
                count = len(leg.rate) - judged
                found = power.masks(schedule, late + count, RATE_HZ)
                used = power.Masks(*(np.concatenate([np.ones(judged, bool), m[late:]]) for m in found))
                cases.append(Case(leg, used.usable, judged, 1.0 - _energy(used, judged)))
        errors = relative_errors(filler, cases, least_strides=1.0, thigh=group.legs[0].thigh is not None)
        points.append((np.reshape([1.0 - case.saving for case in cases], shape), np.reshape(errors, shape) ** 2))
    return Curve(*(np.stack(part) for part in zip(*points, strict=True)))


@functools.cache
def _compiled(thigh: bool) -> Any:
    def one(rate: Any, acc: Any, above: Any, must: Any, wake: Any) -> Any:
        worn = Thigh(above[:, 0], above[:, 1:]) if thigh else None
        params = gap_trigger.TRIGGER._replace(wake=wake)
        told = gap_trigger.triggered(rate, acc, RATE_HZ, params, must=must, thigh=worn)
        return told.filled.rate, told.used

    of_legs = jax.vmap(one, in_axes=(0, 0, 0 if thigh else None, 0, None))
    return jax.jit(jax.vmap(of_legs, in_axes=(None, None, None, None, 0)))


def woken(group: Group, thresholds: tuple[float, ...]) -> Curve:
    """The policy over its thresholds."""
    longest = max(len(leg.rate) for leg in group.legs)

    def stacked(parts: list[np.ndarray]) -> Any:
        return jnp.stack([jnp.asarray(np.pad(p, [(0, longest - len(p))] + [(0, 0)] * (p.ndim - 1))) for p in parts])

    thighs = [leg.thigh for leg in group.legs if leg.thigh is not None]
    must = jnp.stack([jnp.arange(longest) < judged for judged in group.judged])
    signals = (stacked([leg.rate for leg in group.legs]), stacked([leg.acc for leg in group.legs]))
    rates, used = _compiled(bool(thighs))(*signals, stacked(thighs) if thighs else None, must, jnp.asarray(thresholds))
    energy, square = (
        np.ones((len(thresholds) + 1, len(group.legs), 1)),
        np.zeros((len(thresholds) + 1, len(group.legs), 1)),
    )
    for k in range(len(thresholds)):
        for number, (leg, judged) in enumerate(zip(group.legs, group.judged, strict=True)):
            true, filled = leg.rate[judged:], np.asarray(rates[k, number])[judged : len(leg.rate)]
            square[k + 1, number] = np.mean((filled - true) ** 2) / np.mean(true**2)
            own = power.Masks(*(np.asarray(m[k, number])[: len(leg.rate)] for m in used))
            energy[k + 1, number] = _energy(own, judged)
    return Curve(energy, square)


def _saved(names: tuple[str, str], best: float, own: float, count: int, split: str) -> list[Row]:
    """The saving and what it is of, each by a name's two parts; nothing where a curve does not reach the level."""
    if not (np.isfinite(best) and np.isfinite(own) and best > 0.0):
        return []
    values = {"saving": 1.0 - own / best, "fixed": best, "policy": own}
    before, after = names
    rows = {
        what: Row(f"{before}_energy_{what}_pct{after}", 100.0 * value, "%", None, count, split)
        for what, value in values.items()
    }
    if not after:
        line = f"gyroscope woken where the filler is in doubt, {split}: energy saved against the best schedule"
        rows["saving"] = rows["saving"].on(line, of="legs")
    return list(rows.values())


def _by_leg(name: str, policy: Curve, fixed: list[Curve], level: float, split: str) -> list[Row]:
    """Each leg for itself, with the schedule that was best for it: how many are better off, median and worst."""
    count = policy.energy.shape[1]
    best = np.array([min(curve.leg(k).at(level) for curve in fixed) for k in range(count)])
    own = np.array([policy.leg(k).at(level) for k in range(count)])
    kept = best > 0.0  # the others need no gyroscope
    saving = 100.0 * (1.0 - own[kept] / best[kept])
    words = f"{split}; every leg with its own threshold and its own best schedule"
    return [
        Row(f"{name}_legs_saving", float((saving > 0.0).sum()), "legs", None, len(saving), words),
        Row(f"{name}_leg_saving_pct_median", float(np.median(saving)), "%", None, len(saving), words),
        Row(f"{name}_leg_saving_pct_worst", float(saving.min()), "%", None, len(saving), words),
    ]


def _compared(name: str, group: Group, level: float, periods: tuple[float, ...], quick: bool, what: str) -> list[Row]:
    """Rows of one group."""
    places, count, end = 1 if quick else 4, len(group.legs), "; quick" if quick else ""
    fixed = {period: scheduled(group, period, places) for period in periods}
    policy = woken(group, THRESHOLDS)
    lines: list[list[Any]] = [
        [f"policy, threshold {t:g}", *map(float, p)] for t, *p in zip((0.0, *THRESHOLDS), *policy.mean(), strict=True)
    ]
    for period, curve in fixed.items():
        lines += [[f"schedule of {period:g} strides", *map(float, p)] for p in zip(*curve.mean(), strict=True)]
    columns = ["", "energy over always on", "error, root mean square", "error, median"]
    show(f"{what}: policy and fixed schedules from two strides on", columns, lines)

    split = f"{what}; at rms error {level:g}{end}"
    every = {period: curve.at(level) for period, curve in fixed.items()}
    rows = _saved((name, ""), min(every.values()), policy.at(level), count, split)
    middle = min(curve.at(level, median=True) for curve in fixed.values())
    words = f"{what}; at median error {level:g}{end}"
    rows += _saved((name, "_of_median"), middle, policy.at(level, median=True), count, words)
    rows += _by_leg(name, policy, list(fixed.values()), level, split)
    best = fixed[min(every, key=lambda period: every[period])]
    return [
        *rows,
        Row(f"{name}_worst_err_policy", policy.worst(level), "ratio", None, count, split),
        Row(f"{name}_worst_err_fixed", best.worst(level), "ratio", None, count, split),
    ]


def rows(quick: bool) -> list[Row]:
    """The policy against fixed schedules: overground on legs not tuned on, on those tuned on, and on the belt."""
    rows: list[Row] = []
    if available("walking5m"):
        every = names("walking5m")
        some = legs("walking5m", (every[0], every[-1]) if quick else every)
        some = [leg for leg in some if leg.thigh is not None]
        for name, tuned, what in (
            ("triggered", False, "walking5m Elderly, not tuned on"),
            ("triggered_young", True, "walking5m Young, tuned on it"),
        ):
            group = grouped([leg for leg in some if leg.tuned == tuned], 20)
            rows += _compared(name, group, LEVEL, PERIODS[:2] if quick else PERIODS, quick, what)
    if available("tripod"):
        rows += _belt(quick)
    return rows


def _belt(quick: bool) -> list[Row]:
    """On the belt: what is erred without the gyroscope after two strides, and the comparison at a lower error."""
    fast = [name for name in names("tripod") if name.endswith("PWS+20")]
    some = [leg.part(0, round((14.0 if quick else BELT_S) * RATE_HZ)) for leg in legs("tripod", tuple(fast))]
    group, what = grouped(some, 0), "tripod PWS+20, not tuned on"
    cases = [
        Case(g, np.arange(len(g.rate)) < judged, judged, 1.0) for g, judged in zip(some, group.judged, strict=True)
    ]
    filler = fillers()["neighbours"]
    error = relative_errors(filler, cases, least_strides=1.0, thigh=False)
    alone = Row("triggered_tripod_err_never_on", max(error), "ratio", None, len(some), f"{what}; two strides, then off")
    periods = BELT_PERIODS[:1] if quick else BELT_PERIODS
    return [alone, *_compared("triggered_tripod", group, BELT_LEVEL, periods, quick, what)]
