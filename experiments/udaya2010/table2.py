"""Table 2 and Figure 7: the energy that schedules save, and the error of each filler.

The error is the root mean square of the filled rate's difference to the rate that is always measured, over the root
mean square of the latter, measured samples included. The paper takes it behind its Kalman filter; here the filling
alone is judged, before any filter.
"""

import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from experiments.common.recordings import available, names
from experiments.common.row import Row, show
from experiments.udaya2010.fillers import fillers
from experiments.udaya2010.legs import RATE_HZ, Case, Leg, legs, overground_case, papers_case, simulated, warm_case
from jgait.duty_cycle import power
from jgait.duty_cycle.filling import Filler, Thigh

SAVINGS = {90: 8.57, 80: 17.14, 70: 28.57, 60: 37.14, 50: 42.86, 40: 57.14, 30: 68.57, 20: 77.14, 10: 88.57}
"""Table 2: duty cycle [%] → energy saving [%]."""

ERRORS = {90: 0.1259, 80: 0.1871, 70: 0.2195, 60: 0.2266, 50: 0.2509, 40: 0.2667, 30: 0.2570, 20: 0.2804, 10: 0.3022}
"""Table 2: duty cycle [%] → RMS error [1]."""

QUICK_DUTIES = (50, 40, 10)
QUICK_FILLERS = ("replicate", "neighbours", "blend")
WITH_THIGH = ("ridge", "ridge_later", "blend", "neighbours")
PAPERS = ("tripod", "simulation")
"""What follows the paper's protocol."""

HEADLINES = {
    "tripod": ("neighbours", (40, 10)),
    "tripod_warm": ("neighbours", (40, 10)),
    "walking5m": ("blend", (50, 10)),
}
SHOWN = {("simulation", "neighbours"): (40, 10), ("neura_sparse", "blend"): (50, 10)}
"""Further numbers of the table of all experiments: (protocol, filler) → duty cycles [%]."""

TITLES = {
    "tripod": "tripod, first 14 s in units of 1.4 s",
    "tripod_warm": "tripod, 84 s (quick: 28 s) in units of a stride, 5 s of warm-up",
    "walking5m": "walking5m, after two strides, units of half a stride, with the thigh",
    "walking5m_alone": "walking5m, after two strides, units of half a stride, shank alone",
    "neura_sparse": "neura_sparse, sensors at shanks and ankles, after two strides, with the thigh",
    "neura_sparse_alone": "neura_sparse, the same without the thigh",
    "simulation": "simulated people, first 14 s in units of 1.4 s",
}


def rows(quick: bool) -> list[Row]:
    """The energy column, then the error column."""
    return energy() + fillings(quick)


def line_of(protocol: str, duty: int) -> str:
    """The line of a protocol in the table of all experiments."""
    return f"filled rate, {TITLES[protocol]}, gyroscope on for {duty} %: error over the signal"


def energy() -> list[Row]:
    """The energy column, from the power model."""
    told = {duty: 100.0 * power.saving(power.schedule_of_duty(duty / 100)) for duty in SAVINGS}
    split = "power model, nothing measured"
    rows = [Row(f"energy_saving_duty{d}", told[d], "%", SAVINGS[d], 1, split) for d in SAVINGS]
    worst = max(abs(told[d] - SAVINGS[d]) for d in SAVINGS)
    row = Row("energy_column_max_error", worst, "%", None, len(SAVINGS), split)
    return [
        *rows,
        row.on("energy saved at the schedules of Table 2: largest difference", of="schedules", simulated=True),
    ]


@functools.cache
def _compiled(fill: Callable[..., Any], thigh: bool) -> Callable[..., Any]:
    def one(rate: Any, usable: Any, acc: Any, above: Any, params: Any) -> Any:
        worn = Thigh(above[:, 0], above[:, 1:]) if thigh else None
        return fill(rate, usable, acc, RATE_HZ, params, thigh=worn).rate

    return jax.jit(jax.vmap(one, in_axes=(0, 0, 0, 0 if thigh else None, None)))


def _params(filler: Filler, least_strides: float) -> Any:
    """The usual parameters, and how many strides must have been measured before a filler is trusted."""
    p = filler.params
    if hasattr(p, "least_strides"):
        return p._replace(least_strides=least_strides)
    inner = {k: v._replace(least_strides=least_strides) for k, v in p._asdict().items() if hasattr(v, "least_strides")}
    return p._replace(**inner)


def relative_errors(filler: Filler, cases: list[Case], *, least_strides: float, thigh: bool) -> list[float]:
    """Each case's error [1].

    Args:
        filler: that is judged; where the gyroscope is off it is given zero.
        cases: of one or many legs.
        least_strides: measured before the filler is trusted.
        thigh: whether fillers see the thigh's signals.
    """
    longest = max(len(case.usable) for case in cases)

    def stacked(parts: list[np.ndarray]) -> Any:
        return jnp.stack(
            [jnp.asarray(np.pad(p, [(0, longest - len(p))] + [(0, 0)] * (p.ndim - 1), "edge")) for p in parts]
        )

    rate = stacked([np.where(c.usable, c.leg.rate, 0.0) for c in cases])
    usable, acc = stacked([c.usable for c in cases]), stacked([c.leg.acc for c in cases])
    above = stacked([c.leg.thigh for c in cases if c.leg.thigh is not None]) if thigh else None
    told = _compiled(filler.fill, thigh)(rate, usable, acc, above, _params(filler, least_strides))
    found = []
    for filled, case in zip(np.asarray(told), cases, strict=True):
        true = case.leg.rate[case.judged :]
        off = filled[case.judged : len(case.usable)] - true
        found.append(float(np.sqrt(np.mean(off**2) / np.mean(true**2))))
    return found


def protocols(quick: bool) -> dict[str, tuple[list[Leg], Callable[[Leg, int], Case]]]:
    """Protocol → legs, and how each is scheduled; of the sets that are here."""
    found: dict[str, tuple[list[Leg], Callable[[Leg, int], Case]]] = {}
    people = simulated(2 if quick else 4)
    for name in ("tripod", "walking5m", "neura_sparse"):
        if not available(name):
            continue
        every = names(name)
        short = every[:1] if name == "tripod" else [every[0], every[-1]]
        here = legs(name, short if quick else every)
        if name == "tripod":
            warm = functools.partial(warm_case, seconds=28.0) if quick else warm_case
            found |= {"tripod": (here, papers_case), "tripod_warm": (here, warm)}
        else:
            here = [leg for leg in here if leg.thigh is not None]
            found |= {name: (here, overground_case), f"{name}_alone": (here, overground_case)}
    return found | {"simulation": (list(people), papers_case)}


def split_of(protocol: str, quick: bool = False) -> str:
    """What was judged, and what the tuning saw, in words."""
    seen = {"tripod": "tuned on PWS of it", "walking5m": "tuned on Young of it"}.get(protocol.split("_")[0], "untuned")
    return f"every leg, {seen}" + ("; a small part, quick" if quick else "")


def _headlines(protocol: str, filler: str, duty: int, cases: list[Case], errors: list[float], split: str) -> list[Row]:
    """The numbers with names of their own: all legs, the worst one, and those that the tuning did not see."""
    if filler != HEADLINES.get(protocol, ("",))[0] or duty not in HEADLINES[protocol][1]:
        return []
    middle = "median_err" if protocol == "walking5m" else "err"
    paper = ERRORS[duty] if protocol == "tripod" else None
    rows = []
    unseen = [e for e, case in zip(errors, cases, strict=True) if not case.leg.tuned]
    what = "not tuned on: " + ("PWS+20" if protocol.startswith("tripod") else "Elderly")
    for some, end, words in ((errors, "", split), (unseen, "_untuned", what)):
        if some:
            at = f"duty{duty}{end}"
            of = f"{filler}, {words}"
            row = Row(f"{protocol}_{middle}_{at}", float(np.median(some)), "ratio", paper, len(some), of)
            worst = Row(f"{protocol}_worst_err_{at}", max(some), "ratio", None, len(some), of)
            unseen_only = "not tuned on, " if end else ""
            rows += [row.on(line_of(protocol, duty), f"{unseen_only}median", "legs"),
                     worst.on(line_of(protocol, duty), f"{unseen_only}worst", "legs")]  # fmt: skip
    return rows


def fillings(quick: bool) -> list[Row]:
    """The error column of every filler: median over the legs; headline numbers first, where there are any."""
    every = fillers()
    used = {name: every[name] for name in QUICK_FILLERS} if quick else every
    duties = QUICK_DUTIES if quick else tuple(SAVINGS)
    first: list[Row] = []
    rows: list[Row] = []
    for protocol, (here, schedule) in protocols(quick).items():
        split = split_of(protocol, quick)
        of = {duty: [schedule(leg, duty) for leg in here] for duty in duties}
        saved = {duty: float(np.mean([100.0 * case.saving for case in of[duty]])) for duty in duties}
        lines: list[list[Any]] = [["energy saved [%]", *(saved[d] for d in duties)]]
        if protocol in ("tripod_warm", "walking5m", "neura_sparse"):
            words = "power model; the units of these walks, in their scheduled part"
            rows += [Row(f"{protocol}_energy_saving_duty{d}", saved[d], "%", None, len(here), words) for d in duties]
        if protocol in PAPERS:
            lines.append(["paper", *(ERRORS[d] for d in duties)])
        for name, filler in used.items():
            if protocol.endswith("_alone") and name not in WITH_THIGH:
                continue  # the others see no thigh anyway
            line: list[Any] = [name]
            spread: list[Any] = ["  ±"]
            for duty in duties:
                # At a duty of 10 % the paper has measured one unit, a stride, before the first gap.
                errors = relative_errors(
                    filler, of[duty], least_strides=1.0 if protocol in PAPERS else 2.0,
                    thigh=protocol in ("walking5m", "neura_sparse"),
                )  # fmt: skip
                paper = ERRORS[duty] if protocol in PAPERS else None
                value = float(np.median(errors))
                line.append(value)
                spread.append(float(np.std(errors)))
                row = Row(f"{protocol}_{name}_duty{duty}", value, "ratio", paper, len(errors), split)
                if (protocol, name) in SHOWN and duty in SHOWN[protocol, name]:
                    row = row.on(line_of(protocol, duty), "median", "legs", simulated=protocol == "simulation")
                rows.append(row)
                first += _headlines(protocol, name, duty, of[duty], errors, split)
            lines += [line, spread]
        show(f"{TITLES[protocol]}: error, median ± SD over {len(here)} legs", ["", *(f"{d} %" for d in duties)], lines)
    return first + rows
