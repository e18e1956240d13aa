"""The waist on `ipol_gait`: contacts, sides and distances of known people and of people left out.

Learned are the delay of contacts, how it grows with the step time, and the pendulum's constant. Filters, thresholds and
cues of a side are the same for known people and for people left out, and were chosen with these people at hand.

The plain guess is the mean stride and the mean distance of the other people; for sides it is one side at random; for
contacts there is none. mobgap's numbers are its best detector's, as they come, from the last full run of `waist_ofdri`.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from experiments.common import summary
from experiments.common.row import Row, show
from experiments.kose2011 import contacts, distances
from experiments.kose2011.contacts import Found
from experiments.kose2011.walks import Walk, of_set

SET = "ipol_gait"
NEAR = 0.1
"""[s] Detections farther from their contact do not teach the delay."""

LINES = {
    "waist_sides_pct": "left and right of contacts, correct where stated, straight walks",
    "waist_answered_pct": "left and right of contacts, stated, straight walks",
    "waist_sides_whole_pct": "left and right of contacts, correct where stated, with the U-turn",
    "waist_answered_whole_pct": "left and right of contacts, stated, with the U-turn",
    "waist_f1": "initial contacts, straight walks: F1",
    "waist_f1_whole": "initial contacts, with the U-turn: F1",
    "waist_ic_mae_ms": "time of initial contacts: MAE",
    "waist_distance_pct": "distance of straight walks: mean error",
    "waist_distance_worst_pct": "distance of straight walks: worst error",
    "waist_distance_whole_pct": "distance with the U-turn: mean error",
    "waist_distance_whole_worst_pct": "distance with the U-turn: worst error",
    "waist_two_sigma_pct": "distances within two stated standard deviations",
}
"""Metric → its line of the table of all experiments, after the sensor."""

PEER = {
    "waist_sides_pct": "ic_side_pct_ipol_gait_mobgap",
    "waist_f1": "ic_f1_ipol_gait_mobgap",
    "waist_ic_mae_ms": "ic_mae_ms_ipol_gait_mobgap",
    "waist_distance_pct": "distance_mae_pct_ipol_straight_mobgap_ms_all",
}
"""Metric → mobgap's in `waist_ofdri`."""


class Pair(NamedTuple):
    """A number of known people and of people left out, and the plain guess's, learned on the others too."""

    known: float
    left_out: float
    guess: float | None = None


def delay(late: np.ndarray, step: np.ndarray) -> np.ndarray:
    """(2,) offset [s] and share of the step time by which detections are late; the offset leaves a median of zero."""
    near = np.abs(late - np.median(late)) < NEAR
    share = float(np.polyfit(step[near], late[near], 1)[0])
    return np.array([np.median(late - share * step), share])


def timing(walks: Sequence[Walk], founds: Sequence[Found]) -> Pair:
    """Mean absolute error of contacts on straight walks [ms], their delay learned on everybody, and on the others."""
    of = []
    for walk, found in zip(walks, founds, strict=True):
        one = contacts.matched(walk, found, walk.straight, 0.0)
        of.append((one.late, np.median(np.diff(found.time)) * np.ones_like(one.late)))
    subjects = np.array([walk.subject for walk in walks])

    def errors(left_out: bool) -> float:
        found = []
        for walk, (late, step) in zip(walks, of, strict=True):
            rows = np.flatnonzero(subjects != walk.subject) if left_out else np.arange(len(walks))
            offset, share = delay(*(np.concatenate([of[row][k] for row in rows]) for k in (0, 1)))
            found.append(np.abs(late - offset - share * step))
        return 1000.0 * float(np.mean(np.concatenate(found)))

    return Pair(errors(False), errors(True))


def guessed(true: np.ndarray, subjects: np.ndarray) -> np.ndarray:
    """(n,) error of the mean of the other people [%]; NaN where the truth is not known."""
    guess = [np.nanmean(true[subjects != one]) for one in subjects]
    return 100.0 * (np.array(guess) / true - 1.0)


def ways(walks: Sequence[Walk]) -> tuple[dict[str, Pair], int]:
    """Distances: mean and worst error of straight parts and of whole walks [%], and how many are within two stated
    standard deviations; and the number of whole walks whose distance is known."""
    items = distances.ready(walks)
    constant = distances.constants(distances.WaistParams(), items)
    every = distances.WaistParams(pendulum_constant=distances.learned(constant, items, np.ones(len(items), bool)))
    known = [distances.measured(every, item, distances.DEFAULT) for item in items]
    left = distances.held_out(distances.WAYS[0], items, same_set=True)
    if left is None:
        raise ValueError("people can only be left out where there are two or more")
    subjects = np.array([item.walk.subject for item in items])
    strides = np.array([item.walk.pieces.length.mean() for item in items])
    total = np.array([item.walk.total for item in items])
    plain = {"ipol_straight": guessed(strides, subjects), "ipol_whole": guessed(total, subjects)}
    found = {}
    for name, key in (("ipol_straight", "waist_distance"), ("ipol_whole", "waist_distance_whole")):
        sizes = [np.abs(one[name]) for one in (distances.errors(known, items), distances.errors(left, items), plain)]
        found[f"{key}_pct"] = Pair(*(float(np.nanmean(size)) for size in sizes))
        found[f"{key}_worst_pct"] = Pair(*(float(np.nanmax(size)) for size in sizes))
    inside = [100.0 * float(np.mean(distances.within(one, items)[""])) for one in (known, left)]
    found["waist_two_sigma_pct"] = Pair(*inside)
    return found, int(np.isfinite(total).sum())


def rows(quick: bool) -> list[Row]:
    """The waist on the people that are here; nothing without them, or in the quick form."""
    if quick:
        print("left out of the quick form: ipol_gait, whose feet compile a program of their own")
        return []
    walks = of_set(SET)
    return of_walks(walks) if walks else []


def of_walks(walks: Sequence[Walk]) -> list[Row]:
    """Every number, of known people and of people left out."""
    founds = [contacts.detected(walk) for walk in walks]
    s, whole = (contacts.score(walks, founds, turns) for turns in (False, True))
    told = {
        "waist_sides_pct": Pair(s.sides, s.sides, 50.0),
        "waist_answered_pct": Pair(s.answered, s.answered),
        "waist_sides_whole_pct": Pair(whole.sides, whole.sides, 50.0),
        "waist_answered_whole_pct": Pair(whole.answered, whole.answered),
        "waist_f1": Pair(s.f1, s.f1),
        "waist_f1_whole": Pair(whole.f1, whole.f1),
        "waist_ic_mae_ms": timing(walks, founds),
    }
    distance, measured = ways(walks)
    told |= distance
    peers = {row["metric"]: row["value"] for one in summary.load().values() for row in one["rows"]}
    hits = s.n - s.missed
    count = {"waist_f1": s.n, "waist_f1_whole": whole.n, "waist_sides_whole_pct": whole.n - whole.missed,
             "waist_answered_whole_pct": whole.n - whole.missed}  # fmt: skip
    found, lines = [], []
    people = len({walk.subject for walk in walks})
    for name, pair in told.items():
        of = "walks" if "distance" in name or "sigma" in name else "contacts"
        n = len(walks) if of == "walks" else count.get(name, hits)
        n = measured if "distance_whole" in name else n
        unit = "F1" if "f1" in name else "ms" if name.endswith("_ms") else "%"
        for end, part, value in (("", "left out", pair.left_out), ("_known", "known", pair.known),
                                 ("_guess", "plain guess", pair.guess)):  # fmt: skip
            if value is not None:
                row = Row(name + end, value, unit, n=n, split=f"{part}, {people} people")
                found.append(row.on(f"waist, `{SET}`, {LINES[name]}", part, of))
        peer = peers.get(PEER.get(name, ""))
        beaten = "" if pair.guess is None or "sides" in name or pair.left_out < pair.guess else "no better than a guess"
        cells = [f"{v:.4g}" if v is not None else "–" for v in (pair.known, pair.left_out, pair.guess, peer)]
        lines.append([f"{name} [{unit}]", *cells, n, beaten])
    show(f"The waist on {people} people of ipol_gait", ["", "known", "left out", "guess", "mobgap", "n", ""], lines)
    return found
