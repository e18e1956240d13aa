"""Schedules found by gradient that trade energy for error, judged on other legs.

A person: the legs of `tripod` at one speed, judged at the faster one. A cohort: the young of `walking5m`, judged on the
elderly, with the thigh's sensor; there the neighbours' parameters are found too. Two strides are measured first; energy
and errors count from then on. Fixed schedules without any search are judged in the same way.
"""

import functools
from typing import Any, NamedTuple

from experiments.common.recordings import available
from experiments.common.row import Row, show
from experiments.udaya2010 import power_tradeoff
from experiments.udaya2010.legs import RATE_HZ, legs
from experiments.udaya2010.power_tradeoff import Plan, Point, Settings, Shank
from experiments.udaya2010.ridge import BLEND, RIDGE, blend
from experiments.udaya2010.ridge import FILLERS as RIDGE_FILLERS
from experiments.udaya2010.triggered import Group, grouped
from jgait.duty_cycle.fillers import Neighbours
from jgait.duty_cycle.filling import Filler, Thigh

PRICES = {"tripod": (0.02, 0.05, 0.1, 0.2, 0.6), "walking5m": (0.05, 0.12, 0.25, 0.5, 1.2)}
PERIOD = {"tripod": 4.0, "walking5m": 2.0}
"""Of the fixed schedules, in strides: of those tried in the policy's comparison the best on most of the way."""

DUTIES = (0.1, 0.2, 0.3, 0.5, 0.7, 0.85)


class Front(NamedTuple):
    """What was found, and fixed schedules: (saving, error) of each duty."""

    points: list[Point]
    fixed: list[tuple[float, float]]


def shanks(group: Group) -> list[Shank]:
    """The legs of a group, a plan's unit being a stride."""
    worn = zip(group.legs, group.judged, group.strides, strict=True)
    return [
        Shank(leg.rate, leg.acc, judged, stride / RATE_HZ,
              None if leg.thigh is None else Thigh(leg.thigh[:, 0], leg.thigh[:, 1:]))
        for leg, judged, stride in worn
    ]  # fmt: skip


def blended(neighbours: Neighbours) -> Filler:
    """`blend` with these neighbours, trusted from the first stride on."""
    params = BLEND._replace(
        neighbours=neighbours._replace(least_strides=1.0), ridge=RIDGE._replace(least_strides=1.0)
    )  # fmt: skip
    return RIDGE_FILLERS["blend"]._replace(fill=blend, params=params)


def sets(quick: bool) -> dict[str, tuple[list[Shank], list[Shank]]]:
    """Name → walks that plans are found on, and walks that judge them."""
    found = {}
    if available("tripod"):
        some = [leg.part(0, round((7.0 if quick else 14.0) * RATE_HZ)) for leg in legs("tripod")]
        found["tripod"] = _halves(some, 0)
    if not quick and available("walking5m"):
        found["walking5m"] = _halves([leg for leg in legs("walking5m") if leg.thigh is not None], 20)
    return found


def _halves(some: list[Any], standing: int) -> tuple[list[Shank], list[Shank]]:
    seen, unseen = ([leg for leg in some if leg.tuned == tuned] for tuned in (True, False))
    return shanks(grouped(seen, standing)), shanks(grouped(unseen, standing))


def rows(quick: bool) -> list[Row]:
    """Of every set."""
    return tradeoff(quick)[0]


@functools.cache
def tradeoff(quick: bool) -> tuple[list[Row], dict[str, Front]]:
    """Rows, and by set what figures are drawn of."""
    rows: list[Row] = []
    fronts: dict[str, Front] = {}
    for name, (own, other) in sets(quick).items():
        thigh = name == "walking5m"
        settings = Settings(periods=(1.0, 2.4), fit_filler=thigh, every=4, batch=3)
        if quick:
            settings = settings._replace(steps=10, periods=(1.0,))
        filler = blended if thigh else power_tradeoff.alone
        prices = PRICES[name][1:3] if quick else PRICES[name]
        points = power_tradeoff.pareto(own, other, prices, RATE_HZ, filler, settings=settings, phases=2)
        usual, fixed = filler(Neighbours()), []
        for duty in DUTIES[2:4] if quick else DUTIES:
            plan = Plan(PERIOD[name] * duty, PERIOD[name] * (1.0 - duty))
            error, drawn = power_tradeoff.judge(plan, other, RATE_HZ, usual, phases=2)
            fixed.append((1.0 - drawn / power_tradeoff.GYROSCOPE.on, error))
        fronts[name] = Front(points, fixed)
        where = "found on PWS, judged on PWS+20" if not thigh else "found on Young, judged on Elderly"
        split = f"{name}, {where}; root mean square over legs" + ("; quick" if quick else "")
        lines = [
            [f"price {p.price:g}", *p.plan, 100.0 * p.duty, 1e3 * p.power, 100.0 * p.saving, p.error, p.seen]
            for p in points
        ]  # fmt: skip
        lines += [["fixed", PERIOD[name] * d, PERIOD[name] * (1.0 - d), 100.0 * d, 30.0 * (1.0 - s), 100.0 * s, e, "–"]
                  for d, (s, e) in zip(DUTIES[2:4] if quick else DUTIES, fixed, strict=True)]  # fmt: skip
        columns = ["", "on [strides]", "off [strides]", "duty [%]", "power [mW]", "saved [%]", "error", "where found"]
        show(f"{name}: schedules found by gradient ({where}), and fixed ones", columns, lines)
        for p in points:
            at = f"front_{name}_price{f'{p.price:g}'.replace('.', '_')}"
            rows += [
                Row(f"{at}_saving_pct", 100.0 * p.saving, "%", None, len(other), split),
                Row(f"{at}_power_mw", 1e3 * p.power, "mW", None, len(other), split),
                Row(f"{at}_error", p.error, "ratio", None, len(other), split).on(
                    f"schedules found by gradient, `{name}`, {where}: error of the filled rate",
                    f"{100.0 * p.saving:.0f} % of the energy saved",
                    "legs",
                ),
            ]
    return rows, fronts
