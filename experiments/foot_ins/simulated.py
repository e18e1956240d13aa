"""The foot estimator on simulated people, whose truth is known: lengths, heights, contacts, stated deviations."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from experiments.common import consistency
from experiments.common.matching import overlapping
from experiments.common.recordings import attempt
from experiments.common.row import Row, show
from experiments.foot_ins import feet as real
from experiments.foot_ins.run import estimated
from jgait import simulate
from jgait.estimators import foot_ins
from jgait.estimators.foot_ins import FootParams
from jgait.simulate import Route, sensors
from jgait.types import SIDES

FEET = ("foot_right", "foot_left")
RATE = 128.0
"""[Hz] Of the Opal sensors that the paper's subjects wore."""

ROUTES: dict[str, Route] = {
    "straight": simulate.straight(30.0),
    "u_turn": simulate.u_turn(15.0),
    "slope": simulate.route({"length": 5.0}, {"length": 15.0, "slope": 0.08}, {"length": 5.0}),
    "stairs": simulate.route({"length": 3.0}, {"length": 6.0, "riser": 0.16, "speed": 0.5}, {"length": 3.0}),
}


class Compared(NamedTuple):
    """Strides of one foot beside the truth; all (n,).

    Attributes:
        length: error [m].
        length_stddev: stated [m].
        height: error [m].
        height_stddev: stated [m].
        final_contact: error [s].
        initial_contact: error of the contact that ends the stride [s].
        lost: strides that were not found.
    """

    length: Any
    length_stddev: Any
    height: Any
    height_stddev: Any
    final_contact: Any
    initial_contact: Any
    lost: int


def compared(recording: Any, truth: Any, side: int) -> Compared:
    """One foot of one simulated walk."""
    name = FEET[side]
    alone = recording._replace(sensors={name: recording.sensors[name]})
    found = estimated(FootParams(), foot_ins.prepared(alone).inputs)
    true = truth.strides
    rows = np.flatnonzero(
        np.asarray(true.valid) & (np.asarray(true.side) == side) & (np.asarray(true.length) > real.SHORT)
    )
    known = jax.tree.map(lambda column: np.asarray(column)[rows], true)
    s, certain = found.strides, found.strides_stddev
    a, b = overlapping(stands(known), np.stack([s.standing, s.standing_end], axis=1)).T
    return Compared(
        s.length[b] - known.length[a], certain.length[b], s.height[b] - known.height[a], certain.height[b],
        s.final_contact[b] - known.final_contact[a], s.end[b] - known.end[a], len(rows) - len(a),
    )  # fmt: skip


def stands(strides: Any) -> np.ndarray:
    """(n, 2) the middle of the stance before and after each true stride of a foot [s]; 0.3 s away at both ends."""
    before = np.concatenate([strides.final_contact[:1] - 0.6, strides.end[:-1]])
    after = np.concatenate([strides.final_contact[1:], strides.end[-1:] + 0.6])
    return np.stack([0.5 * (before + strides.final_contact), 0.5 * (strides.end + after)], axis=1)


def pooled(found: Sequence[Compared]) -> Compared:
    """Strides of all feet."""
    arrays = [np.concatenate(column) for column in list(zip(*found, strict=True))[:-1]]
    return Compared(*arrays, sum(one.lost for one in found))


def feet_of(key: Any, people: int, along: Route, errors: Any, what: str) -> list[Compared]:
    """Both feet of people on one route; a person who cannot walk it is left out, and printed."""
    found = []
    for i in range(people):
        own = jax.random.fold_in(key, i)
        person = simulate.person_of(simulate.population(key, people, recorded=False), i)

        def one(own: Any = own, person: Any = person) -> list[Compared]:
            fit = simulate.covering(own, person, along)
            walk = simulate.recording(own, fit, along, errors, RATE, placements=FEET)
            return [compared(*walk, side) for side in range(len(SIDES))]

        found += attempt(f"simulated person {i + 1}, {what}", one) or []
    return found


def rows(quick: bool) -> list[Row]:
    """Every route with Opal sensors; the straight one also with perfect ones."""
    people = 2 if quick else 12
    cases = [(name, name, along, sensors.OPAL) for name, along in ROUTES.items()]
    cases.insert(1, ("straight_ideal", "straight, perfect sensors", ROUTES["straight"], sensors.IDEAL))
    if quick:
        cases = [("straight", "straight", simulate.straight(12.0), sensors.OPAL)]
    lines, events, rows = [], [], []
    for metric, label, along, errors in cases:
        found = feet_of(jax.random.key(5), people, along, errors, label)
        if not found:
            continue
        all_feet = pooled(found)
        more, line, event = route_rows(metric, label, all_feet)
        rows += more
        lines.append(line)
        events.append(event)
    title = f"{people} simulated people, both feet, Opal sensors at {RATE:g} Hz"
    columns = ["route", "strides", "lost", "MAE cm", "bias cm", "worst cm", "NEES", "from", "to", "in 2σ %"]
    show(f"{title}: length", columns, [line[:10] for line in lines])
    columns = ["route", "strides", "MAE cm", "bias cm", "worst cm", "NEES"]
    show(f"{title}: height", columns, [[*line[:2], *line[10:]] for line in lines])
    columns = ["route", "initial", "sd", "worst", "final", "sd", "worst"]
    show("contacts against truth, ms: mean, standard deviation, worst", columns, events)
    return rows


def route_rows(metric: str, label: str, found: Compared) -> tuple[list[Row], list[Any], list[Any]]:
    """Rows and lines of the tables for one route."""
    nees = consistency.nees_consistency(found.length, stddev=found.length_stddev)
    rise = consistency.nees_consistency(found.height, stddev=found.height_stddev)
    n = found.length.size
    cm, height = 100.0 * found.length, 100.0 * found.height
    mae, worst = float(np.abs(cm).mean()), float(np.abs(cm).max())
    within = 100.0 * float(np.mean(np.abs(found.length) <= 2.0 * found.length_stddev))
    initial, final = 1e3 * found.initial_contact, 1e3 * found.final_contact
    line = [label, n, found.lost, mae, float(cm.mean()), worst, nees.mean, nees.low, nees.high, within,
            float(np.abs(height).mean()), float(height.mean()),
            float(np.abs(height).max()), rise.mean]  # fmt: skip
    event = [label, *(float(v) for one in (initial, final) for v in (one.mean(), one.std(), np.abs(one).max()))]
    split = f"simulated, untuned, {label}"
    each = [
        ("stride_mae_cm", mae, "cm"), ("stride_bias_cm", float(cm.mean()), "cm"), ("stride_worst_cm", worst, "cm"),
        ("strides_lost", float(found.lost), "strides"), ("nees_length", nees.mean, "1"),
        ("nees_length_low", nees.low, "1"), ("nees_length_high", nees.high, "1"),
        ("within_two_sigma_pct", within, "%"), ("height_mae_cm", float(np.abs(height).mean()), "cm"),
        ("height_bias_cm", float(height.mean()), "cm"), ("nees_height", rise.mean, "1"),
        ("initial_contact_ms", float(initial.mean()), "ms"), ("initial_contact_sd_ms", float(initial.std()), "ms"),
        ("final_contact_ms", float(final.mean()), "ms"), ("final_contact_sd_ms", float(final.std()), "ms"),
    ]  # fmt: skip
    rows = [Row(f"sim_{metric}_{name}", value, unit, n=n, split=split) for name, value, unit in each]
    if metric == "straight":
        shown = {"stride_mae_cm": "MAE", "stride_worst_cm": "worst", "stride_bias_cm": "bias"}
        where = "stride length, defaults, 30 m straight ahead: error"
        named = zip(rows, each, strict=True)
        rows = [r.on(where, shown[key], "strides", simulated=True) if key in shown else r for r, (key, *_) in named]
    return rows, line, event
