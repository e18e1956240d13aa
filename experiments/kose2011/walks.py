"""Walks of `mobgap_lab` and `ipol_gait` with one sensor at the lower back, and their references.

`mobgap_lab`: the straight walks (Test5) and their bouts by motion capture: contacts, and the distance from
the first to the last. People walk on before and after the cameras' volume.

`ipol_gait`: contacts of both feet, checked by hand. Distances are those of the sensors on the feet, by `foot_ins`: on
the straight way there, the strides that begin and end with a checked contact (a first stride begins with the foot
leaving the ground, and does not count); of the whole walk with its U-turn, all strides, the mean of the feet none of
whose strides fell into lost samples. The
20 m of the instructions are no reference: no person walked exactly 20 m.

The contacts of `ipol_gait` are not complete: some lack one between two of the other foot, and of the steps that people
take after the trial's end few are listed. Detections there are judged neither right nor wrong; one while both feet rest
is false.
"""

from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np

from experiments.common.matching import nearest
from experiments.common.recordings import attempt, available, names, walks
from jgait.estimators import foot_ins
from jgait.mounting.shank import filled
from jgait.signal.windows import true_runs
from jgait.types import SIDES, Imu, Recording, Strides, as_float

SETS = ("mobgap_lab", "ipol_gait")
NEAR = 0.15
"""[s] Between the beginning or end of a stride of a foot's sensor and a checked contact, at most."""

BESIDE = 0.1
"""[s] A detection nearer than that to a listed contact is judged in any case."""

SWINGS, SETTLED = 1.5, 0.5
"""[rad/s] Rate above which a foot is not at rest; [s] time after that, or after the trial's end, in which its contact
may come."""

QUICK = ("HA/001/Test5/Trial2", "HA/002/Test5/Trial2")
"""Short walks of two people, of `mobgap_lab`."""


class Windows(NamedTuple):
    """Where contacts are judged.

    Attributes:
        looked: (p, 2) [s] contacts of the reference in there have to be found.
        judged: (p, 2) [s] detections in there are false if nothing in the reference goes with them.
    """

    looked: np.ndarray
    judged: np.ndarray


class Pieces(NamedTuple):
    """Parts of a walk whose length is known.

    Attributes:
        ends: (n, 2) [s] when each begins and ends.
        length: (n,) [m].
    """

    ends: np.ndarray
    length: np.ndarray


class Walk(NamedTuple):
    """One walk.

    Attributes:
        set: name of the data set.
        name: of the recording.
        subject: identifier of the person.
        recording: with the sensor at the lower back only.
        body: the person's measures that the estimator takes.
        contacts: (n,) [s] initial contacts in order.
        sides: (n,) 0 right, 1 left.
        straight: where contacts of straight walking are judged.
        whole: the same with turns.
        pieces: strides of straight walking, or the bout.
        total: of the whole walk [m], by the feet that have every stride; NaN where none has.
        until: [s] when the whole walk is over; infinite: at the end of the recording.
        landed: (n,) [s] of each contact, by the sensors on the feet; NaN where they have none; None without them.
    """

    set: str
    name: str
    subject: str
    recording: Recording
    body: dict[str, float]
    contacts: np.ndarray
    sides: np.ndarray
    straight: Windows
    whole: Windows
    pieces: Pieces
    total: float
    until: float = np.inf
    landed: np.ndarray | None = None


def of_set(name: str, quick: bool = False) -> list[Walk]:
    """The walks of a set with a reference, or a few short ones; prints what is left out."""
    if not available(name):
        return []
    wanted = [one for one in names(name) if name != "mobgap_lab" or "Test5" in one]
    if quick:
        wanted = [one for one in wanted if one in QUICK] or wanted[:2]
    found = []
    for walk in walks(name, wanted):
        if walk.reference is None or not len(walk.info["initial_contacts"]):
            print(f"{name}: {walk.recording.name} left out: {walk.info['no_reference']}")
            continue
        read = _lab if name == "mobgap_lab" else there_and_back
        one = attempt(f"{name}: {walk.recording.name}", partial(read, walk))
        found += [] if one is None else [one]
    return found


@cache
def sets(quick: bool) -> dict[str, list[Walk]]:
    """Set → its walks, of the sets that are here; read once for all parts of the experiment."""
    return {name: found for name in (SETS[:1] if quick else SETS) if (found := of_set(name, quick))}


def body(info: dict[str, Any]) -> dict[str, float]:
    """What the estimator takes of a person: how high the sensor is, or how tall the person."""
    known = [name for name in ("sensor_height", "height") if info.get(name)]
    return {name: float(info[name]) for name in known[:1]}


def _alone(recording: Recording) -> Recording:
    return recording._replace(sensors={"lower_back": recording.sensors["lower_back"]})


def _lab(walk: Any) -> Walk:
    info, bouts = walk.info, walk.info["bouts"]
    known = np.isfinite(bouts["distance"])
    ends = np.stack([bouts["start"], bouts["end"]], axis=1)
    windows = Windows(ends, ends)
    return Walk(
        "mobgap_lab", walk.recording.name, walk.recording.subject, _alone(walk.recording), body(info),
        as_float(info["initial_contacts"]), np.asarray(info["initial_contact_sides"]), windows, windows,
        Pieces(ends[known], bouts["distance"][known]), np.nan,
    )  # fmt: skip


def there_and_back(walk: Any) -> Walk:
    """A walk with a U-turn, its straight parts and contacts in `info`, its distances by the feet."""
    info = walk.info
    contacts, sides = as_float(info["initial_contacts"]), np.asarray(info["initial_contact_sides"])
    parts = as_float(info["straight_parts"])
    whole = np.stack([info["bouts"]["start"], info["bouts"]["end"]], axis=1)
    end = float(whole[-1, 1])
    feet = {name: imu for name, imu in walk.recording.sensors.items() if name.startswith("foot")}
    time = as_float(walk.recording.sensors["lower_back"].time)
    known = listed(time, feet, contacts, sides, end)
    turning = inside(time, np.stack([info["turns"]["start"], info["turns"]["end"]], axis=1))
    strides = foot_ins.estimate(foot_ins.FootParams(), walk.recording._replace(sensors=feet)).strides
    assert strides is not None
    leaves, lands = as_float(info["final_contacts"]), as_float(contacts)
    totals, landed = [], np.full(lands.size, np.nan)
    for number in range(len(SIDES)):
        own = (strides.side == number) & np.asarray(strides.valid)
        for i, j in nearest(as_float(strides.end)[own], np.where(sides == number, lands, np.inf), NEAR):
            landed[j] = strides.end[own][i]
        middle = 0.5 * (leaves[info["final_contact_sides"] == number] + lands[sides == number])
        own = (strides.side == number) & (strides.start < end)
        found = inside(middle[middle < end], np.stack([strides.start, strides.end], axis=1)[own])
        totals += [float(strides.length[own].sum())] if found.all() else []
    return Walk(
        "ipol_gait", walk.recording.name, walk.recording.subject, _alone(walk.recording), body(info), contacts, sides,
        Windows(parts, runs(time, known & ~turning)), Windows(whole, runs(time, known)),
        between_contacts(strides, contacts, sides, parts[0]), float(np.mean(totals)) if totals else np.nan,
        end + SETTLED, landed,
    )  # fmt: skip


def inside(time: np.ndarray, windows: np.ndarray) -> np.ndarray:
    """(n,) bool: within any window, its ends included."""
    return np.any((time[:, None] >= windows[:, 0] - 1e-9) & (time[:, None] <= windows[:, 1] + 1e-9), axis=1)


def runs(time: np.ndarray, flags: np.ndarray) -> np.ndarray:
    """(n, 2) [s] the stretches of time in which (T,) flags hold."""
    return np.array([(time[a], time[b - 1]) for a, b in true_runs(flags)]).reshape(-1, 2)


def listed(
    time: np.ndarray, feet: dict[str, Imu], contacts: np.ndarray, sides: np.ndarray, end: float
) -> np.ndarray:  # fmt: skip
    """(T,) bool: the reference lists every contact at that time; see above. `end` is that of the trial [s]."""
    again = np.flatnonzero((sides[1:] == sides[:-1]) & (contacts[1:] <= end))
    known = ~inside(time, np.stack([contacts[again] + BESIDE, contacts[again + 1] - BESIDE], axis=1))
    fast = np.max([np.linalg.norm(as_float(filled(imu).gyr), axis=1) for imu in feet.values()], axis=0) > SWINGS
    since = time - np.maximum.accumulate(np.where(fast, time, -np.inf))
    return known & ~((time > end + SETTLED) & (since < SETTLED))


def between_contacts(strides: Strides, contacts: np.ndarray, sides: np.ndarray, part: np.ndarray) -> Pieces:
    """Strides of a part of a walk that begin and end with a known contact of their foot."""
    good = np.asarray(strides.valid, bool).copy()
    good &= (strides.start >= part[0] - NEAR) & (strides.end <= part[1] + NEAR)
    for number, side in enumerate(strides.side):
        own = contacts[sides == side]
        for when in (strides.start[number], strides.end[number]):
            good[number] &= bool(len(own)) and np.min(np.abs(own - when)) < NEAR
    return Pieces(np.stack([strides.start, strides.end], axis=1)[good], as_float(strides.length)[good])
