"""The paper's routes with simulated people: Tables I and II.

One ankle sensor with the paper's errors; three routes at two paces. Strides are counted by the default estimator, by
the detectors alone, and by the paper's two baselines; distance as the sum of all strides, half-steps included. The
sensor's height over the ankle is known (4 cm, a tape's) to all methods that take one; nothing is tuned on these people.
"""

from typing import Any, NamedTuple

import jax
import numpy as np

from experiments.common import protocols
from experiments.common.row import Row, show
from experiments.common.shanks import Leg, Reference, rested
from experiments.silva2017.detect import DETECTORS, strides_of
from experiments.silva2017.lengths import CUTOFF_HZ, lengths, signals, stacked, with_lever
from experiments.silva2017.lever import prepared, run, together
from jgait.geometry.vectors import GRAVITY
from jgait.mounting import shank as shank_axes
from jgait.simulate.sensors import MPU6000
from jgait.types import as_float

ROUTES, PACES = ("A", "B", "C"), ("normal", "fast")
PEOPLE, QUICK = 50, 2
LEGS = {"A": 0.82, "B": 0.86}
"""[m] of the paper's two subjects; here the two of the cohort whose hip is as high over their ankle."""

HEIGHT = 0.04  # [m] of the simulator's ankle sensor over the ankle
OURS_HZ = 8.0
"""With the true lever, the paper's 4 Hz make a stride 1.7 (normal) to 3.5 cm (fast) too long, 8 Hz 0.1 to 0.5 cm."""

SENSOR = MPU6000._replace(acc_range=16.0 * GRAVITY)
"""The paper saw no saturation at ±4 g; a simulated heel strike at the fast pace passes that, and a stride whose strike
is clipped comes out 13 cm short. So the range is the sensor's widest."""

STRIDES = 160
"""Room for the strides of the longest walk, so that programs are shared."""


class Way(NamedTuple):
    """One way of counting or measuring.

    Attributes:
        title: in tables.
        key: in names of rows.
        paper: its error in the paper, mean of both subjects [%], or None.
    """

    title: str
    key: str
    paper: float | None


COUNTS = (
    Way("ours", "", 0.45),
    Way("swings", "_swings", None),
    Way("machine", "_machine", None),
    Way("paper's machine", "_paper", 0.45),
    Way("Jiménez", "_jimenez", 2.75),
    Way("Feliz", "_feliz", 6.05),
)
DISTANCES = (
    Way("filter", "_filter", None),
    Way("3-D level", "", 2.45),
    Way("3-D as printed", "_printed", 2.45),
    Way("Li 2-D", "_li", 8.4),
    Way("SL2", "_sl2", 7.2),
    Way("SL1", "_sl1", None),
)


class Measured(NamedTuple):
    """What was made of some walks of one route and pace.

    Attributes:
        route: and pace, in words.
        true: (n,) strides of the right leg.
        far: (n,) distance [m].
        counts: way of counting → (n,) strides.
        distances: method → (n,) [m].
        lever: (n,) height over the ankle that the filter ended with [m].
    """

    route: str
    true: np.ndarray
    far: np.ndarray
    counts: dict[str, np.ndarray]
    distances: dict[str, np.ndarray]
    lever: np.ndarray


def leg_of(walked: protocols.Walked) -> Leg:
    """The right ankle of a simulated walk, the truth as its reference."""
    recording, strides = walked.recording, walked.truth.strides
    mine = np.asarray(strides.valid) & (np.asarray(strides.side) == 0)
    start, end, length = (as_float(v)[mine] for v in (strides.start, strides.end, strides.length))
    imu = rested(recording.sensors["ankle_right"], recording.sampling_rate_hz)
    axes = shank_axes.functional_axes(imu)
    if axes is None:
        raise ValueError(f"{recording.name} does not walk")
    body = walked.extra["person"].body
    tall = float(body.thigh_length) + float(body.shank_length)
    truth = Reference(end, length, start, None, (0.0, float(as_float(imu.time)[-1])))
    return Leg("simulated", recording.name, recording.subject, "right", imu, axes, recording.sampling_rate_hz, tall,
               truth, ())  # fmt: skip


def filtered(legs: list[Leg]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(n,) strides that the filter counts, their sum [m], and the lever that it found [m].

    Only what it measures as a stride counts: a leg that is shifted, or swings back as the walk ends, does not.
    """
    inputs = together([prepared(leg, np.zeros(3), np.eye(3)) for leg in legs])
    told = run("simulated", np.full(len(legs), HEIGHT), inputs)
    return told["valid"].sum(axis=1), np.where(told["valid"], told["length"], 0.0).sum(axis=1), told["lever"]


def distances(legs: list[Leg], strides: int = STRIDES) -> dict[str, np.ndarray]:
    """Method → sum of all strides of each leg [m]."""
    parts = [signals(leg) for leg in legs]
    there = np.arange(strides)[None, :] < np.array([len(s.end) for s in parts])[:, None]
    s, out = stacked(parts, strides), {}
    for name in (way.title for way in DISTANCES if way.title != "filter"):
        level = name == "3-D level"
        p = with_lever(HEIGHT if level else 0.0)._replace(leg_length=1.0)
        told = np.asarray(lengths(name, p, OURS_HZ if level else CUTOFF_HZ, s))
        scale = np.array([leg.leg_length if name.startswith("SL") else 1.0 for leg in legs])
        out[name] = scale * np.where(there, told, 0.0).sum(axis=1)
    return out


def measured(route: str, legs: list[Leg], far: np.ndarray) -> Measured:
    """Every count and every distance of some walks."""
    counts = {name: np.array([len(strides_of(leg, name).end) for leg in legs]) for name in DETECTORS}
    counted, summed, lever = filtered(legs)
    true = np.array([len(leg.reference.contact) for leg in legs])
    return Measured(route, true, far, {"ours": counted, **counts}, {"filter": summed, **distances(legs)}, lever)


def alike(legs: list[Leg]) -> list[int]:
    """Which two of a cohort have legs as long as the paper's subjects A and B."""
    tall = np.array([leg.leg_length for leg in legs])
    first = int(np.argmin(np.abs(tall - LEGS["A"])))
    apart = np.abs(tall - LEGS["B"])
    apart[first] = np.inf
    return [first, int(np.argmin(apart))]


def table_one(found: list[Measured], two: list[int]) -> list[Row]:
    """Table I: strides of both subjects by the paper's four counts."""
    ways = [way for way in COUNTS if way.title in ("ours", "paper's machine", "Jiménez", "Feliz")]
    lines: list[list[Any]] = []
    for m in found:
        cells = [" ".join(f"{m.counts[way.title][i] - m.true[i]:+d}" for i in two) for way in ways]
        lines.append([m.route, *(int(m.true[i]) for i in two), *cells])
    true = sum(m.true[two] for m in found)
    off = {way.title: sum(np.abs(m.counts[way.title][two] - m.true[two]) for m in found) for way in ways}
    share = {name: 100.0 * value / true for name, value in off.items()}
    lines.append(["Σ |error| [%]", "", "", *(" ".join(f"{v:.1f}" for v in share[way.title]) for way in ways)])
    columns = ["", *(f"true, {name}" for name in LEGS), *(f"{way.title}: A B" for way in ways)]
    show("Table I in simulation: strides counted too many or too few", columns, lines)
    return _two("sim_two_count", ways, share, len(found))


def table_two(found: list[Measured], two: list[int]) -> list[Row]:
    """Table II: error of the distance of both subjects, in metres and percent."""
    lines: list[list[Any]] = []
    for m in found:
        off = {way.title: (m.distances[way.title] - m.far)[two] for way in DISTANCES}
        far = float(m.far[0])
        cells = ("\n".join(f"{v:+.2f} {100 * v / far:+.1f}%" for v in off[way.title]) for way in DISTANCES)
        lines.append([f"{m.route}, A\nB", *cells])
    far = sum(float(m.far[0]) for m in found)
    share = {
        way.title: 100.0 * sum(np.abs(m.distances[way.title] - m.far)[two] for m in found) / far for way in DISTANCES
    }
    lines.append(["Σ |error| [%], A\nB", *("\n".join(f"{v:.1f}" for v in share[way.title]) for way in DISTANCES)])
    show(
        "Table II in simulation: error of the distance in metres and %", ["", *(way.title for way in DISTANCES)], lines
    )
    return _two("sim_two_distance", list(DISTANCES), share, len(found))


def _two(name: str, ways: list[Way], share: dict[str, np.ndarray], walks: int) -> list[Row]:
    split = "sum of |errors|, two simulated people with the legs of the paper's"
    return [
        Row(f"{name}{way.key}_error_pct", float(np.mean(share[way.title])), "%", way.paper, 2 * walks, split)
        for way in ways
    ]


def cohort_table(found: list[Measured]) -> list[Row]:
    """Mean and worst over everybody, of every count and every distance."""
    errors = []
    for m in found:
        counted = {way: 100.0 * np.abs(m.counts[way.title] / m.true - 1.0) for way in COUNTS}
        walked = {way: 100.0 * np.abs(m.distances[way.title] / m.far - 1.0) for way in DISTANCES}
        errors.append(counted | walked)
    people = len(found[0].true)
    for what, ways in (("count", COUNTS), ("distance", DISTANCES)):
        lines = [[m.route, *(f"{of[way].mean():.2g} / {of[way].max():.2g}" for way in ways)]
                 for m, of in zip(found, errors, strict=True)]  # fmt: skip
        show(f"{people} simulated people, |error| of the {what} [%]: mean / worst",
             ["", *(way.title for way in ways)], lines)  # fmt: skip
    levers = np.concatenate([m.lever for m in found])
    print(f"the filter took {HEIGHT} m for the lever, and ended with {levers.min():.3f} to {levers.max():.3f} m")
    rows, n, split = [], len(found) * people, f"{people} simulated people, untuned"
    for way in errors[0]:
        every = np.concatenate([of[way] for of in errors])
        name = f"sim_{'count' if way in COUNTS else 'distance'}{way.key}_error_pct"
        line = f"{'strides counted' if way in COUNTS else 'distance'}, {way.title}: error"
        some = [Row(name, float(np.mean(every)), "%", way.paper, n, split),
                Row(f"{name}_max", float(np.max(every)), "%", n=n, split=split)]  # fmt: skip
        rows += [row.on(line, part, "walks", simulated=True) for row, part in zip(some, ("mean", "worst"), strict=True)]
    return rows


def rows(quick: bool, people: int = PEOPLE) -> list[Row]:
    """Errors of counts and distances over all routes and paces."""
    found, two, number = [], [0, 1], QUICK if quick else people
    for route in ROUTES[1:2] if quick else ROUTES:
        for pace in PACES[:1] if quick else PACES:
            walks = protocols.silva(jax.random.key(17), number, route, pace, errors=SENSOR)
            legs = [leg_of(walked) for walked in walks]
            far = np.array([walked.extra["distance"] for walked in walks])
            del walks  # the truth of fifty people on such a walk is a gigabyte
            two = alike(legs)
            found.append(measured(f"route {route}, {pace}", legs, far))
    return table_one(found, two) + table_two(found, two) + cohort_table(found)
