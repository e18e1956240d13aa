"""On which segment of which leg each sensor is, and which way is forward, by the likelihood of all sensors together.

A hypothesis puts each sensor on a segment of a leg, with its sagittal axis to the right or to the left. The harmonics
of its rates then have known means and spreads over people, up to the moment at which the stride begins, over which the
likelihood is summed: both legs move alike half a stride apart, mirrored about the sagittal plane, and a thigh, a shank
and a foot each in its own way. `places.json` holds means and spreads, learned by `experiments.unseen2.turned`.
"""

import itertools
import json
from collections.abc import Mapping
from functools import cache
from importlib import resources
from typing import NamedTuple

import numpy as np

from jgait.mounting.cycle import HARMONICS, SEGMENTS, Cycle, cycle_of
from jgait.notes import UNSURE_FORWARD, WRONG_PLACE, Kind, Note, record
from jgait.types import SIDES, AnyArray, Imu, Recording, RecordingError, as_float

SURE = 0.99
"""[1] Probability above which sensors are taken as exchanged, and an axis as the right way round. Chosen by hand."""

PLACES_EXCHANGED = Kind(
    "places_exchanged", "check", "{placements} have changed places, by how they move in walking; taken the other way "
    "round", WRONG_PLACE,
)  # fmt: skip
PLACES_UNSURE = Kind(
    "places_unsure", "check", "{placements}: it is not sure that each is where its name says: some have changed places "
    "(probability {probability:.2f}), or the person limps or walks backwards", WRONG_PLACE,
)  # fmt: skip
FORWARD_UNSURE = Kind(
    "forward_unsure", "check", "{placement}: it is not sure which way is forward", UNSURE_FORWARD,
)  # fmt: skip


class Places(NamedTuple):
    """Where the sensors of a walking person are."""

    worn: dict[str, str]  #: placement → placement that is stated for the sensor that is there.
    #: placement → +1.0 if the axis of the sensor there (`Turning.axis`) is to the right, else −1.0.
    right: dict[str, float]
    certain: dict[str, float]  #: placement → probability of that sign.
    exchanged: float  #: probability that any sensors have changed places.
    doubtful: frozenset[str]  #: placements that have rather changed places than not, but which, is not sure.
    unsure_of: frozenset[str]  #: placements of which it is not sure whether they have changed places.

    @property
    def moved(self) -> tuple[str, ...]:
        """Placements whose sensors have changed places."""
        return tuple(name for name, label in self.worn.items() if name != label)

    def notes(self) -> list[Note]:
        """Notes on sensors that have, or may have, changed places."""
        if self.moved:
            return [PLACES_EXCHANGED(placements=" and ".join(self.moved))]
        if self.unsure_of:
            return [PLACES_UNSURE(placements=", ".join(sorted(self.unsure_of)), probability=self.exchanged)]
        return []

    def unsure(self, placement: str) -> list[Note]:
        """A note if it is not sure which way is forward for a sensor."""
        probability = self.certain.get(placement, 0.5)
        return [] if probability >= SURE else [FORWARD_UNSURE(placement=placement)]


@cache
def _tables() -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Segment → mean (2, HARMONICS) complex and standard deviations, of real and imaginary parts as one number."""
    text = (resources.files("jgait.mounting") / "places.json").read_text("utf-8")
    tables = {}
    for segment, parts in json.loads(text)["segments"].items():
        mean, spread = (np.asarray(parts[name])[..., 0] + 1j * np.asarray(parts[name])[..., 1]
                        for name in ("mean", "spread"))  # fmt: skip
        tables[segment] = mean, spread
    return tables


def _log_likelihood(waves: np.ndarray, segment: str) -> np.ndarray:
    """(2, 2, 48) log-likelihood of a sensor's harmonics (2, HARMONICS) on a segment of the right and the left leg, with
    its axis to the right and to the left, for 48 moments at which the stride begins.
    """
    mean, spread = _tables()[segment]
    orders = np.arange(1, HARMONICS + 1)
    begins = np.exp(-2j * np.pi * np.outer(np.arange(48) / 48, orders))[:, None, :]
    half, mirrored = (-1.0) ** orders, np.array([[1.0], [-1.0]])
    sides = np.stack([waves, waves * half * mirrored])
    parts = (np.stack([sides, -sides], axis=1)[:, :, None] * begins) - mean
    known = np.isfinite(waves.real).all(axis=1)
    parts, spread = parts[..., known, :], spread[known]
    size, dof = 2 * spread.size, 4.0  # of Student's t; chosen, so that limping people do not contradict
    square = np.sum((parts.real / spread.real) ** 2 + (parts.imag / spread.imag) ** 2, axis=(-2, -1))
    scale = float(np.sum(np.log(spread.real) + np.log(spread.imag)))
    # The normal density of any movement, with a prior probability of 0.02 and a variance of 1, beside Student's t of
    # walking, without the constants that both share.
    constant = sum(np.log(0.5 * (dof + 2.0 * i)) for i in range(size // 2)) - 0.5 * size * np.log(0.5 * dof)
    walks = constant - scale - 0.5 * (dof + size) * np.log1p(square / dof)
    other = -0.5 * float(np.nansum(np.abs(waves) ** 2))
    return np.asarray(np.logaddexp(np.log(0.98) + walks, np.log(0.02) + other))


def _transpositions(order: tuple[int, ...]) -> int:
    """Least number of exchanges of two that make an order."""
    visited, cycles = set[int](), 0
    for start in range(len(order)):
        cycles += start not in visited
        while start not in visited:
            visited.add(start)
            start = order[start]
    return len(order) - cycles


@cache
def _orders(names: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """(n, sensors) orders of the sensors, and (n,) the logarithms of their prior probabilities, not normalised."""
    orders = list(itertools.permutations(range(len(names))))
    other = [name.replace("right", "*").replace("left", "right").replace("*", "left") for name in names]
    mirror = [names.index(name) for name in other] if set(other) == set(names) else None
    steps = []
    for order in orders:
        each = [_transpositions(order)]
        if mirror is not None:
            each.append(1 + _transpositions(tuple(order[i] for i in mirror)))
        steps.append(min(each))
    return np.array(orders), np.array(steps) * np.log(0.01)  # of a pair, or of all of both legs; chosen by hand


def places_of(cycle: Cycle) -> Places:
    """Where the sensors of a walking person are, and which way their axes point.

    Sensors are taken as exchanged only if the probability that each is in its new place is `SURE` or more.
    """
    names = tuple(cycle.turning)
    parts = [name.partition("_") for name in names]
    table = np.array([
        [_log_likelihood(cycle.turning[label].waves, segment)[SIDES.index(side)] for segment, _, side in parts]
        for label in names
    ])  # sensor, place, sign, moment  # fmt: skip
    either = np.logaddexp(table[:, :, 0], table[:, :, 1])
    orders, prior = _orders(names)
    at = np.arange(len(names))
    # The harmonics of one person are unusual together: with half their weight simulated limping and hemiparetic people
    # keep their sensors. An order is place → sensor.
    scores = prior[:, None] + 0.5 * either[orders, at].sum(axis=1)
    scores = np.exp(scores - scores.max())
    weights = scores.sum(axis=1) / scores.sum()
    best, here = int(np.argmax(weights)), int(np.flatnonzero((orders == at).all(axis=1))[0])
    chosen = best if weights[best] >= SURE else here
    unsure: frozenset[str] = frozenset()
    if weights[chosen] < SURE:
        likely = orders[weights > 1.0 - SURE]
        unsure = frozenset(name for place, name in enumerate(names) if (likely[:, place] != place).any())
    order = orders[chosen]
    moments = scores[chosen] / scores[chosen].sum()
    right, certain = {}, {}
    for place, name in enumerate(names):
        signs = table[order[place], place]
        share = float(moments @ (1.0 / (1.0 + np.exp(np.clip(signs[1] - signs[0], -700.0, 700.0)))))
        right[name], certain[name] = (1.0, share) if share >= 0.5 else (-1.0, 1.0 - share)
    worn = {name: names[order[place]] for place, name in enumerate(names)}
    rather = unsure if weights[here] < 0.5 else frozenset[str]()
    return Places(worn, right, certain, float(1.0 - weights[here]), rather, unsure)


def places_in(sensors: Mapping[str, Imu]) -> Places | None:
    """Where the sensors on thighs, shanks (or ankles) and feet of a recording are, each with times of its own; None if
    it does not show, as with one sensor, with feet alone, or without a whole stride.
    """
    shanks = any(name.startswith("shank") for name in sensors)
    # an ankle's sensor turns with the shank
    labels = {name if shanks else name.replace("ankle", "shank"): name for name in sensors}
    legs = {name: sensors[label] for name, label in labels.items() if name.partition("_")[0] in SEGMENTS}
    legs = {name: imu for name, imu in legs.items() if len(imu.time) > 2}
    whole = [name for name in legs if not name.startswith("foot")]
    if len(legs) < 2 or not whole:
        return None
    time = as_float(legs[whole[0]].time)
    cycle = cycle_of({name: at_times(imu, time) for name, imu in legs.items()})
    if cycle is None or len(cycle.turning) < 2:
        return None
    placed = places_of(cycle)
    right, certain = ({labels[name]: value for name, value in each.items()} for each in (placed.right, placed.certain))
    doubtful, unsure = (frozenset(labels[name] for name in each) for each in (placed.doubtful, placed.unsure_of))
    worn = {labels[name]: labels[label] for name, label in placed.worn.items()}
    return Places(worn, right, certain, placed.exchanged, doubtful, unsure)


def at_times(imu: Imu, time: np.ndarray) -> Imu:
    """A sensor at other times (T,) [s]; what it did not measure is lost."""
    if np.array_equal(as_float(imu.time), time):
        return imu
    times, mask = as_float(imu.time), np.asarray(imu.mask, bool)
    near = np.clip(np.searchsorted(times, time), 0, len(times) - 1)

    def moved(part: AnyArray) -> np.ndarray:
        return np.stack([np.interp(time, times, column) for column in as_float(part).T], axis=1)

    acc = None if imu.acc is None else moved(imu.acc)
    return Imu(time, moved(imu.gyr), acc, mask[near] & (time >= times[0]) & (time <= times[-1]))


@record
class SagittalRate(NamedTuple):
    """How fast a segment of the leg turns in the sagittal plane."""

    time: np.ndarray  #: (T,) [s].
    rate: np.ndarray  #: (T,) [rad/s], positive when the lower end swings forward; 0 where the mask is False.
    mask: np.ndarray  #: (T,) bool; False where the sample was lost.


def sagittal_rate(recording: Recording, placement: str) -> SagittalRate:
    """The rate of a thigh, shank or ankle about its sagittal axis, without the gyroscope's bias.

    The axis is the axis of most rotation in the walk, perpendicular to gravity. Its sign follows from how the segment
    turns over a stride; that of a thigh from the shank of the same side, so both sensors are needed. `placement` is
    `thigh_SIDE`, `shank_SIDE` or `ankle_SIDE`.

    Raises:
        RecordingError: if there is no such sensor, the segment does not walk, or the sign is not certain.
    """
    segment, _, side = placement.partition("_")
    if segment not in ("thigh", "shank", "ankle"):
        raise RecordingError(f"the sagittal rate is that of a thigh, shank or ankle; got {placement!r}")
    if placement not in recording.sensors:
        raise RecordingError(f"there is no sensor {placement}; the recording has {', '.join(recording.sensors)}")
    imu = recording.sensors[placement]
    time, mask = as_float(imu.time), np.asarray(imu.mask, bool)
    name = placement.replace("ankle", "shank")  # which turn together
    leg = {f"{other}_{side}": recording.sensors.get(f"{other}_{side}") for other in ("thigh", "shank")} | {name: imu}
    cycle = cycle_of({key: each for key, each in leg.items() if each and np.array_equal(as_float(each.time), time)})
    if cycle is None or name not in cycle.turning:
        raise RecordingError(f"{placement} does not walk")
    places, turning = places_of(cycle), cycle.turning[name]
    if segment == "thigh" and len(cycle.turning) < 2:
        raise RecordingError(f"which way a thigh faces follows from the shank; there is no sensor shank_{side}")
    if places.moved or places.doubtful or places.unsure(name):
        raise RecordingError(f"{placement} does not swing as a {segment} in walking: its front is not certain")
    rate = (as_float(imu.gyr) - turning.bias) @ (places.right[name] * turning.axis)
    return SagittalRate(time, np.where(mask, rate, 0.0), mask)
