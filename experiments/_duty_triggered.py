"""What is saved by waking the gyroscope when the filler doubts itself, over the best fixed schedule at equal error.

Both fill with `neighbours`. Two strides are measured first; energy, as a part of always on, and errors count from
then on. A group's error is the root mean square of its legs' relative errors, its energy their mean. A fixed schedule
knows nothing of the gait's phase, so each is begun at several places of its period. The best of them is found on the
very legs that are judged, which favours it; the policy's parameters but the threshold are the settings that were best
on average over some hundreds of random draws, on Young of `walking5m`. Both curves are interpolated at one error.
"""

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from _duty_legs import RATE_HZ, SWINGING, Case, Leg, legs, stride_samples
from _duty_table import relative_errors
from common import Row, show

from jgait import datasets, gap_filling, gap_trigger, power
from jgait.gap_filling import Thigh

LEVEL = 0.10
BELT_LEVEL = 0.05
"""Where 0.10 is reached without the gyroscope, a level that has to be paid for."""

BELT_S = 42.0
THRESHOLDS = (0.08, 0.11, 0.14, 0.17, 0.2, 0.22, 0.24, 0.26, 0.28, 0.3, 0.4)
PERIODS = (0.5, 1.0, 1.5, 2.0, 3.0, 4.0)
"""Periods of the fixed schedules, in strides: a walk of five metres is over after some four."""

BELT_PERIODS = (1.0, 4.0, 10.0)
DUTIES = (1, 2, 4, 6, 8, 10, 12, 14, 16, 17, 18, 19)  # in twentieths


class Curve(NamedTuple):
    """Energy and error of a group of legs as one number of a policy or schedule varies.

    Attributes:
        energy: (n,) part of the energy of always on [1].
        error: (n,) root mean square of the legs' relative errors [1].
        median: (n,) their median [1].
    """

    energy: np.ndarray
    error: np.ndarray
    median: np.ndarray

    def at(self, level: float, *, median: bool = False) -> float:
        """The least energy at which the error reaches a level, between neighbours on the curve; NaN if it does not."""
        error = self.median if median else self.error
        order = np.argsort(self.energy)
        energy, error = self.energy[order], error[order]
        reached = np.flatnonzero(error <= level)
        if not len(reached):
            return float("nan")
        k = reached[0]
        if k == 0:
            return float(energy[0])
        share = (error[k - 1] - level) / (error[k - 1] - error[k])
        return float(energy[k - 1] + share * (energy[k] - energy[k - 1]))


class Group(NamedTuple):
    """Legs, and for each when judging begins [samples] and its stride [samples]."""

    legs: list[Leg]
    judged: list[int]
    strides: list[int]


def grouped(some: list[Leg], standing: int) -> Group:
    """Two strides from the first swing are measured first; the stride is told without so many samples at the start."""
    strides = [stride_samples(leg.rate[standing:]) for leg in some]
    judged = [int(np.argmax(np.abs(g.rate) > SWINGING)) + 2 * s for g, s in zip(some, strides, strict=True)]
    return Group(some, judged, strides)


def _energy(used: power.Masks, judged: int) -> float:
    """Over that of always on, from where it is judged [1]."""
    part = power.Masks(*(np.asarray(m)[judged:] for m in used))
    return float(power.mask_energy(part, RATE_HZ) * RATE_HZ / (power.GYROSCOPE.on * len(part.powered)))


def scheduled(group: Group, period: float, phases: int) -> Curve:
    """Fixed schedules of one period [strides], over the duties that the sensor can follow in every leg."""
    filler = gap_filling.fillers()["neighbours"]
    points = [(1.0, 0.0, 0.0)]
    for on in DUTIES:
        units = [period * stride / RATE_HZ / 20 for stride in group.strides]
        if min(min(on, 20 - on) * unit for unit in units) < power.GYROSCOPE.wake_up:
            continue
        energies: list[float] = []
        errors: list[float] = []
        for phase in range(phases):
            cases = []
            for leg, judged, unit in zip(group.legs, group.judged, units, strict=True):
                schedule = power.Schedule(on, 20 - on, unit)
                late = round(phase / phases * schedule.period * RATE_HZ)
                count = len(leg.rate) - judged
                found = power.masks(schedule, late + count, RATE_HZ)
                used = power.Masks(*(np.concatenate([np.ones(judged, bool), m[late:]]) for m in found))
                cases.append(Case(leg, used.usable, judged, 1.0 - _energy(used, judged)))
            errors += relative_errors(filler, cases, least_strides=1.0, thigh=group.legs[0].thigh is not None)
            energies += [1.0 - case.saving for case in cases]
        points.append((float(np.mean(energies)), float(np.sqrt(np.mean(np.square(errors)))), float(np.median(errors))))
    return Curve(*np.array(points).T)


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
    points = []
    for k in range(len(thresholds)):
        errors, energies = [], []
        for number, (leg, judged) in enumerate(zip(group.legs, group.judged, strict=True)):
            true, filled = leg.rate[judged:], np.asarray(rates[k, number])[judged : len(leg.rate)]
            errors.append(float(np.sqrt(np.mean((filled - true) ** 2) / np.mean(true**2))))
            own = power.Masks(*(np.asarray(m[k, number])[: len(leg.rate)] for m in used))
            energies.append(_energy(own, judged))
        points.append((float(np.mean(energies)), float(np.sqrt(np.mean(np.square(errors)))), float(np.median(errors))))
    return Curve(*np.array(points).T)


def _compared(name: str, group: Group, level: float, periods: tuple[float, ...], quick: bool, what: str) -> list[Row]:
    """Rows of one group; the saving is left out where a curve does not reach the level."""
    fixed = {period: scheduled(group, period, 1 if quick else 4) for period in periods}
    policy = woken(group, THRESHOLDS)
    lines = [[f"policy, threshold {t:g}", *map(float, p)] for t, *p in zip(THRESHOLDS, *policy, strict=True)]
    lines += [
        [f"schedule of {c:g} strides", *map(float, p)] for c, curve in fixed.items() for p in zip(*curve, strict=True)
    ]
    columns = ["", "energy over always on", "error, root mean square", "error, median"]
    show(f"{what}: policy and fixed schedules from two strides on", columns, lines)
    rows: list[Row] = []
    for end, median in (("", False), ("_of_median", True)):
        best = min(curve.at(level, median=median) for curve in fixed.values())
        own = policy.at(level, median=median)
        split = f"{what}; at {'median' if median else 'rms'} error {level:g}" + ("; quick" if quick else "")
        if np.isfinite(best) and np.isfinite(own) and best > 0.0:
            rows += [
                Row(f"{name}_energy_saving_pct{end}", 100.0 * (1.0 - own / best), "%", None, len(group.legs), split),
                Row(f"{name}_energy_fixed_pct{end}", 100.0 * best, "%", None, len(group.legs), split),
                Row(f"{name}_energy_policy_pct{end}", 100.0 * own, "%", None, len(group.legs), split),
            ]
    return rows


def triggered(quick: bool) -> list[Row]:
    """The policy against fixed schedules: overground on legs not tuned on, on those tuned on, and on the belt."""
    rows: list[Row] = []
    if datasets.available("walking5m"):
        names = datasets.names("walking5m")
        some = legs("walking5m", (names[0], names[-1]) if quick else names)
        some = [leg for leg in some if leg.thigh is not None]
        for name, tuned, what in (
            ("triggered", False, "walking5m Elderly, not tuned on"),
            ("triggered_young", True, "walking5m Young, tuned on it"),
        ):
            group = grouped([leg for leg in some if leg.tuned == tuned], 20)
            rows += _compared(name, group, LEVEL, PERIODS[:2] if quick else PERIODS, quick, what)
    if datasets.available("tripod"):
        rows += _belt(quick)
    return rows


def _belt(quick: bool) -> list[Row]:
    """On the belt: what is erred without the gyroscope after two strides, and the comparison at a lower error."""
    fast = [name for name in datasets.names("tripod") if name.endswith("PWS+20")]
    some = [leg.part(0, round((14.0 if quick else BELT_S) * RATE_HZ)) for leg in legs("tripod", tuple(fast))]
    group, what = grouped(some, 0), "tripod PWS+20, not tuned on"
    cases = [
        Case(g, np.arange(len(g.rate)) < judged, judged, 1.0) for g, judged in zip(some, group.judged, strict=True)
    ]
    filler = gap_filling.fillers()["neighbours"]
    error = relative_errors(filler, cases, least_strides=1.0, thigh=False)
    alone = Row("triggered_tripod_err_never_on", max(error), "ratio", None, len(some), f"{what}; two strides, then off")
    periods = BELT_PERIODS[:1] if quick else BELT_PERIODS
    return [alone, *_compared("triggered_tripod", group, BELT_LEVEL, periods, quick, what)]
