"""The paper's two tables for simulated people: heel strikes, and 75 m at three speeds.

For every person these values are learned on the other people: the offset of contacts, the pendulum's constant, and ε,
the change of speed over a cycle that counts as one. To show integration without errors of sensors and
orientation, the paper's way also runs on the true forward acceleration, from true right heel strike to heel strike.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import numpy as np

from experiments.common import protocols
from experiments.common.row import Row, show
from experiments.kose2011 import contacts, distances
from experiments.kose2011.contacts import Found
from experiments.kose2011.walks import Pieces, Walk, Windows
from experiments.kose2011.ways import WAYS
from jgait.estimators.waist import WaistParams, velocity_update
from jgait.estimators.waist.params import VelocityUpdateParams
from jgait.estimators.waist.velocity_update import Cycles
from jgait.geometry.segments import in_world
from jgait.simulate.worn import mount
from jgait.types import as_float

PEOPLE, QUICK = 9, 2
PIECE, QUICK_PIECE = 25.0, 5.0
"""[m] How far before the speed rises; the quick form keeps the protocol, and walks a fifth of it."""

THRESHOLDS = (0.3, 0.2, 0.15, 0.1, 0.07, 0.05, 0.03, 0.02, 0.01)
"""[m/s] Values of ε among which one is learned; the first is the paper's."""

SAMPLES = 8192
PAPER = {"update": 0.8, "learned": 0.8, "frozen": 25.0, "integrated": 150.0}
"""[%] The paper's errors of nine people."""

TITLES = {
    "integrated": "OFI", "frozen": "OFDRI", "update": "+ update", "learned": "+ update, ε learned",
}  # fmt: skip


TITLES_OF = {"learned": "ε learned on other people"}

SUFFIX = {"update": "_printed", "learned": "", "frozen": "_frozen", "integrated": "_integrated"}
"""In names of rows; "printed" is the update with ε as the paper prints it."""


class Simulated(NamedTuple):
    """One person.

    Attributes:
        walk: as a real one, its one piece the whole way.
        acc: (T,) true forward acceleration of the sensor [m/s²].
        dt: sample time [s].
    """

    walk: Walk
    acc: np.ndarray
    dt: float


def people(quick: bool, number: int = PEOPLE) -> list[Simulated]:
    """The paper's dataset B, simulated."""
    speeds = {"piece": QUICK_PIECE if quick else PIECE}
    return [simulated_one(one) for one in protocols.kose(jax.random.key(17), QUICK if quick else number, **speeds)]


def simulated_one(walked: protocols.Walked) -> Simulated:
    """One walk of the protocol."""
    recording, body, strides = walked.recording, walked.extra["person"].body, walked.truth.strides
    there = np.asarray(strides.valid)
    order = np.argsort(as_float(strides.end)[there], kind="stable")
    end, side = as_float(strides.end)[there][order], np.asarray(strides.side)[there][order]
    time = as_float(recording.sensors["waist"].time)
    all_of_it = np.array([[0.0, time[-1]]])
    windows = Windows(all_of_it, all_of_it)
    far, lengths = float(walked.extra["distance"]), {"sensor_height": float(body.sensor_height)}
    walk = Walk(
        "simulated", recording.name, recording.subject, recording, lengths, end, side, windows,
        windows, Pieces(all_of_it, np.array([far])), far,
    )  # fmt: skip
    acc = in_world(walked.truth.motion.acceleration.pelvis, mount(body, "waist")).x
    return Simulated(walk, as_float(acc), 1.0 / recording.sampling_rate_hz)


def of_right(walk: Walk, found: Found) -> tuple[Walk, Found]:
    """The part that the paper judges: heel strikes of the right foot, and detections labelled right."""
    mine = walk.sides == 0
    right = walk._replace(contacts=walk.contacts[mine], sides=walk.sides[mine])
    return right, Found(found.time[found.side == 0], found.side[found.side == 0])


def table_one(persons: Sequence[Simulated], quick: bool) -> list[Row]:
    """Table I: right heel strikes."""
    rows: list[Row] = []
    lines: list[list[Any]] = []
    walks = [one.walk for one in persons]
    for detector in contacts.DETECTORS[:1] if quick else contacts.DETECTORS:
        found = [contacts.detected(walk, detector) for walk in walks]
        right = [of_right(*one) for one in zip(walks, found, strict=True)]
        s = contacts.score([walk for walk, _ in right], [told for _, told in right])
        both = contacts.score(walks, found)
        share = 100.0 * (s.n - s.missed) / s.n
        seconds = [f"{v / 1000.0:.3f}" for v in (s.mae, s.sd, s.plain, s.offset)]
        lines.append([detector, f"{share:.1f}", s.extra, *seconds, f"{both.f1:.3f}", f"{both.sides:.0f}"])
        rows += _contact_rows("" if detector == distances.DEFAULT.detector else f"_{detector}", s, both, share)
    columns = ["", "found [%]", "false", "|error| [s]", "SD [s]", "with its own offset", "offset", "F1, both feet",
               "sides [%]"]  # fmt: skip
    show("Table I in simulation: right heel strikes (paper: 96 %, 0.03 s, 0.04 s)", columns, lines)
    return rows


def _contact_rows(suffix: str, s: contacts.Score, both: contacts.Score, share: float) -> list[Row]:
    split, own = "right foot, offset of the other simulated people", "right foot, as the detector comes"
    hits = s.n - s.missed
    rows = [
        Row(f"sim_hs_detected_pct{suffix}", share, "%", 96.0, s.n, "right foot"),
        Row(f"sim_hs_error_mean_s{suffix}", s.mae / 1e3, "s", 0.03, hits, split),
        Row(f"sim_hs_error_sd_s{suffix}", s.sd / 1e3, "s", 0.04, hits, split),
        Row(f"sim_hs_error_no_offset_s{suffix}", s.plain / 1e3, "s", 0.03, hits, own),
        Row(f"sim_ic_f1{suffix}", both.f1, "F1", n=both.n, split="both feet"),
        Row(f"sim_ic_side_pct{suffix}", both.sides, "%", n=both.n - both.missed, split="both feet"),
    ]
    timing = "time of right heel strikes, offset learned on other people: error"
    lines = {
        "sim_hs_detected_pct": ("right heel strikes: detected", "", "contacts"),
        "sim_hs_error_mean_s": (timing, "mean", "contacts"),
        "sim_hs_error_sd_s": (timing, "SD", "contacts"),
        "sim_ic_f1": ("initial contacts on 75 m at three speeds: F1", "", "contacts"),
    }
    return [row.on(*lines[row.metric], simulated=True) if row.metric in lines else row for row in rows]


@partial(jax.jit, static_argnames="kind")
def _true(p: VelocityUpdateParams, acc: Any, cycles: Cycles, dt: Any, kind: str) -> Any:
    """Displacement at the last sample, by integration of the true acceleration."""
    ways: dict[str, Callable[..., Any]] = {"update": velocity_update.updated, **WAYS}
    return ways[kind](p, acc, cycles, dt).displacement[-1]


def true_error(one: Simulated, kind: str, threshold: float) -> float:
    """Error of the distance from the true acceleration [%]."""
    rights = np.rint(one.walk.contacts[one.walk.sides == 0] / one.dt).astype(int)
    room = SAMPLES // 50
    begin, end = np.zeros(room, int), np.zeros(room, int)
    begin[: len(rights) - 1], end[: len(rights) - 1] = rights[:-1], rights[1:]
    acc = np.zeros(SAMPLES)
    acc[: len(one.acc)] = one.acc
    # behind the walk nothing is added: the person stands, and the speed left over is the method's error
    dt = np.where(np.arange(SAMPLES) < len(one.acc), one.dt, 0.0)
    cycles = Cycles(begin, end, len(rights) - 1)
    way = float(_true(VelocityUpdateParams(threshold=threshold), acc, cycles, dt, kind))
    return 100.0 * (way / one.walk.total - 1.0)


def estimated_error(item: distances.Item, kind: str, threshold: float) -> float:
    """Error of the distance by the whole estimator with one of the paper's ways [%]."""
    p = WaistParams(update=VelocityUpdateParams(threshold=threshold))
    options = kind if kind in WAYS else distances.DEFAULT._replace(distance=kind)
    return 100.0 * (distances.measured(p, item, options).whole - 1.0)


def learned_threshold(errors: np.ndarray) -> np.ndarray:
    """(n,) row of `THRESHOLDS` that serves the others best, from errors (thresholds, n)."""
    size = np.abs(errors)
    return np.array([int(np.argmin(np.delete(size, i, axis=1).mean(axis=1))) for i in range(size.shape[1])])


def by_integration(error: Callable[[int, str, float], float], count: int, quick: bool) -> dict[str, np.ndarray]:
    """Way → errors (n,) [%], and the ε that each person was given as "epsilon"."""
    thresholds = (THRESHOLDS[0], THRESHOLDS[3]) if quick else THRESHOLDS
    scan = np.array([[error(i, "update", eps) for i in range(count)] for eps in thresholds])
    row = learned_threshold(scan)
    found = {kind: np.array([error(i, kind, thresholds[0]) for i in range(count)]) for kind in ("integrated", "frozen")}
    return {**found, "update": scan[0], "learned": scan[row, np.arange(count)], "epsilon": np.array(thresholds)[row]}


def table_two(persons: Sequence[Simulated], quick: bool) -> list[Row]:
    """Table II: distances."""
    count = len(persons)
    items = distances.ready([one.walk for one in persons])
    told = {"_true_acc": by_integration(lambda i, kind, eps: true_error(persons[i], kind, eps), count, quick)}
    if quick:
        print("left out of the quick form: the paper's ways by the whole estimator, a program each")
    else:
        told[""] = by_integration(lambda i, kind, eps: estimated_error(items[i], kind, eps), count, quick)
    ways = {way.key: way for way in distances.WAYS}
    modelled = {}
    for key in ("",) if quick else ("", "_pendulum", "_zijlstra"):
        found = distances.held_out(ways[key], items, same_set=True)
        assert found is not None
        modelled[key] = found
    off = {key: 100.0 * (np.array([one.ratio for one in found]) - 1.0) for key, found in modelled.items()}
    _print_two(persons, told, off[""])
    rows: list[Row] = []
    people_ = f"{count} simulated people"
    for source, found in told.items():
        for kind, paper in PAPER.items():
            name = f"sim_distance{source}{SUFFIX[kind]}_error_pct"
            split = f"{people_}{', ε of the others' if kind == 'learned' else ''}"
            size = float(np.mean(np.abs(found[kind])))
            row = Row(name, size, "%", paper, count, split + (", true acceleration" if source else ""))
            words = ("from true accelerations" if source else "", TITLES_OF.get(kind, ""))
            part = ", ".join(filter(None, words)) or "mean"
            key = "_update" if kind == "learned" else f"_{kind}"
            rows.append(row.on(distances.line_of(ways[key], "simulation"), part, "people", simulated=True))
        epsilon = float(np.median(found["epsilon"]))
        rows.append(Row(f"sim_threshold{source}_learned", epsilon, "m/s", 0.3, count, "median over people"))
    for key, errors in off.items():
        name, split = key or "_fused", f"{people_}, K of the others"
        line = distances.line_of(ways[key], "simulation")
        figures = {"": (np.mean, 0.8, "mean"), "_max": (np.max, 1.12, "worst")}
        rows += [
            Row(f"sim{name}_distance_error_pct{end}", float(of(np.abs(errors))), "%", paper, count, split).on(
                line, part, "people", simulated=True
            )
            for end, (of, paper, part) in figures.items()
        ]
    good = distances.within(modelled[""], items)["_straight"]
    share = 100.0 * float(np.mean(good))
    return [*rows, Row("sim_distance_two_sigma_pct", share, "%", n=good.size, split=f"{people_}, K of the others")]


def _print_two(persons: Sequence[Simulated], told: dict[str, dict[str, np.ndarray]], fused: np.ndarray) -> None:
    lines: list[list[Any]] = []
    columns = [(source, kind) for source in told for kind in TITLES]
    for i, one in enumerate(persons):
        cells = [f"{told[source][kind][i]:+.1f}" for source, kind in columns]
        lines.append([one.walk.name, *cells, f"{fused[i]:+.1f}"])
    means = [float(np.mean(np.abs(told[source][kind]))) for source, kind in columns]
    lines.append(["mean |error|", *(f"{v:.1f}" for v in means), f"{np.mean(np.abs(fused)):.1f}"])
    heads = [f"{TITLES[kind]}{', true acc.' if source else ''}" for source, kind in columns]
    show("Table II in simulation: error of the distance [%] (paper: OFI 150, OFDRI 25, with the update 0.8)",
         ["", *heads, "one model, K of others"], lines)  # fmt: skip
    rises = [rise for one in persons for rise in speed_changes(one)]
    print(
        f"from right heel strike to right heel strike the true speed changes by {np.median(rises):.2f} m/s (median of "
        f"{len(rises)}), at most by {np.max(rises):.2f} m/s; ε is {THRESHOLDS[0]} m/s as printed"
    )


def speed_changes(one: Simulated) -> np.ndarray:
    """|Change| of the true speed over each right cycle but two of setting off and two of stopping [m/s]."""
    rights = np.rint(one.walk.contacts[one.walk.sides == 0] / one.dt).astype(int)
    speed = np.concatenate([[0.0], np.cumsum(0.5 * one.dt * (one.acc[1:] + one.acc[:-1]))])
    return np.abs(np.diff(speed[rights]))[2:-2]


def rows(quick: bool) -> list[Row]:
    """Both tables."""
    persons = people(quick)
    return table_one(persons, quick) + table_two(persons, quick)
