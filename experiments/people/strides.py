"""Strides of simulated people beside those of recorded ones: spectra of the signals, and a classifier.

Spectra of the lower back are those of the people of `ipol_gait` from whom `pelvis` derived nothing, too. Every recorded
person has several simulated ones; the classifier sees the first.

A stride's features are the shank's sagittal rate and the size of its specific force, which all sets have, averaged over
parts of the stride. The classifier is a logistic regression; all recordings of a person and the simulated ones at this
person's strides are left out together. Spectra do not depend on how a sensor is turned: they are sums over its axes.
Simulated sensors have no noise; recorded ones have.
"""

import itertools
import zlib
from typing import NamedTuple

import jax
import numpy as np
from scipy.signal import welch

from experiments.common.recordings import available
from experiments.common.row import Row, show
from experiments.common.sets import datasets
from experiments.people.legs import Leg, legs_of
from experiments.people.pelvis import known
from experiments.people.shapes import stride_lengths
from experiments.simulator.against_real import BATCH, able, known_spread
from experiments.simulator.gait import Truth, figures
from experiments.simulator.simulated import (
    QUIET,
    SETS,
    STEPS,
    Set,
    Walked,
    curves,
    leg_of_simulated,
    names_of,
    person_at,
    together,
    walks_of,
    window,
)
from jgait import simulate
from jgait.simulate import Person
from jgait.simulate.population import manner
from jgait.types import SIDES

CURVES, PARTS_OF_CURVE = ("shank", "shank_acc"), 15
"""Curves of a stride that the classifier sees, and the number of parts over which each is averaged."""
BANDS = np.geomspace(0.5, 20.0, 12)
"""[Hz] Borders of bands of half an octave; each holds a frequency of a piece of `WINDOW`."""
WINDOW = 4.0
"""[s] Length of the pieces of a signal whose spectra are averaged."""
FOLDS, RIDGE = 5, 1.0
DRAWS = 4
"""[1] Simulated people for each recorded one."""
BACKS = Set("ipol_gait", None, 100.0)
SETTLED, FEWEST = 2, 4
"""[1] Contacts left out at both ends of a straight part, and fewest others."""


class Pair(NamedTuple):
    """Legs of a recorded person, and of each simulated one; who the person is."""

    person: str
    recorded: list[Leg]
    simulated: list[list[Leg]]


def drawn(name: str, stride_time: float, stride_length: float) -> list[Person]:
    """People of the population at a recorded stride; the usual person where one of them cannot walk so."""
    people = simulate.population(jax.random.key(zlib.crc32(name.encode())), DRAWS, recorded=True)
    found = []
    for i in range(DRAWS):
        body, own = simulate.person_of(people, i)
        leg = body.thigh_length + body.shank_length
        follows = {key: float(v) for key, v in manner(stride_length / leg, simulate.RECORDED).items()}
        person = Person(body, own._replace(
            stride_time=stride_time, stride_length=stride_length, steps=float(STEPS), quiet_before=QUIET,
            quiet_after=QUIET, **follows,
        ))  # fmt: skip
        usual = person_at(stride_time, stride_length, simulate.RECORDED, soft_tissue=1.0)
        found.append(person if able(person) else usual)
    return found


def pairs(given: Set, most: int | None) -> list[Pair]:
    """Every recorded walk of a set with a simulated one at the same stride."""
    usual = known_spread(given)
    if usual is None or given.name == "gaitmap_example":  # the feet alone
        return []
    recorded, people = [], []
    for walk in datasets.load(given.name, names_of(given)[:most]):
        legs = list(legs_of(walk, given)) if walk.reference is not None else []
        truth = Truth(None if walk.reference is None else walk.reference.distance)
        found = [figures(leg.sensors, given.rate_hz, leg.windows, truth, trim=leg.trim, good=leg.good) for leg in legs]
        times = np.concatenate([one.stride_time for one in found] or [np.zeros(0)])
        lengths = np.concatenate([one.stride_length for one in found] or [np.zeros(0)])
        if len(times) > 1 and np.isfinite(lengths).any():
            recorded.append((f"{given.name} {walk.recording.subject}", legs))
            people.append(drawn(walk.recording.name, float(np.median(times)), float(np.nanmedian(lengths))))
    return [Pair(name, legs, own) for (name, legs), own in zip(recorded, simulated(people, given), strict=True)]


def simulated(people: list[list[Person]], given: Set) -> list[list[list[Leg]]]:
    """Legs of simulated people, with the sensors of a set; walks of five metres with their beginning and end."""
    flat = [one for each in people for one in each]
    made: list[Walked] = []
    for start in range(0, len(flat), BATCH):
        part = flat[start : start + BATCH]
        made += walks_of([*part, *[part[-1]] * (BATCH - len(part))], given)[: len(part)]
    whole = given.name == "walking5m"

    def legs(one: Walked) -> list[Leg]:
        return [
            Leg(part, [window(one, given.rate_hz, whole)], 2 * whole, None, side)
            for number, side in enumerate(SIDES)
            for part in together(leg_of_simulated(one, given, number)[0], given)
        ]

    able = [None if any(np.isnan(v).any() for v in one.gyr.values()) else legs(one) for one in made]
    each = [able[i : i + DRAWS] for i in range(0, len(able), DRAWS)]
    return [[one for one in own if one is not None] for own in each]


def backs(most: int | None) -> list[Pair]:
    """Lower backs of `ipol_gait`, without the people from whom the pelvis was derived; none without the set."""
    if not available(BACKS.name):
        return []
    lengths, derived = stride_lengths(), known()
    recorded: dict[str, list[Leg]] = {}
    times: dict[str, list[float]] = {}
    for walk in datasets.load(BACKS.name):
        name = f"{BACKS.name} {walk.recording.subject}"
        if name not in lengths or name in derived:
            continue
        imu, windows = walk.recording.sensors["lower_back"], []
        for first, last in walk.info["straight_parts"]:
            contacts = walk.info["initial_contacts"]
            inside = contacts[(contacts > first - 1e-6) & (contacts < last + 1e-6)][SETTLED:-SETTLED]
            if len(inside) >= FEWEST:
                windows.append(tuple(map(int, np.searchsorted(imu.time, inside[[0, -1]]))))
                times.setdefault(name, []).append(2.0 * float(np.median(np.diff(inside))))
        recorded.setdefault(name, []).append(
            Leg({"pelvis": (imu.gyr, imu.acc)}, windows, 0, np.asarray(imu.mask), "right")
        )
    names = list(times)[:most]
    people = [drawn(name, float(np.median(times[name])), lengths[name]) for name in names]
    own = [[[leg._replace(sensors={"pelvis": leg.sensors["pelvis"]}) for leg in legs[:1]] for legs in each]
           for each in simulated(people, BACKS)]  # fmt: skip
    return [Pair(name, recorded[name], each) for name, each in zip(names, own, strict=True)]


# --- spectra ---


def spectra(legs: list[Leg], rate_hz: float) -> dict[str, np.ndarray]:
    """Signal ("foot gyr") → power in each band, summed over axes and averaged over legs."""
    found: dict[str, list[np.ndarray]] = {}
    for leg in legs:
        for segment, both in leg.sensors.items():
            for kind, signal in zip(("gyr", "acc"), both, strict=True):
                for start, end in leg.windows:
                    samples = np.asarray(signal)[start:end]
                    if end - start < rate_hz * WINDOW or (leg.good is not None and not leg.good[start:end].all()):
                        continue
                    hz, power = welch(samples, rate_hz, nperseg=round(rate_hz * WINDOW), axis=0, detrend="constant")
                    whole = power.sum(axis=1)
                    edges = np.searchsorted(hz, BANDS)
                    bands = [whole[low:high].sum() for low, high in itertools.pairwise(edges)]
                    found.setdefault(f"{segment} {kind}", []).append(np.array(bands))
    return {name: np.mean(values, axis=0) for name, values in found.items()}


def spectral_rows(label: str, own: list[Pair], rate_hz: float) -> dict[str, np.ndarray]:
    """Signal → simulated over recorded power in each band [dB], medians over people; printed."""
    sides = (
        [spectra(pair.recorded, rate_hz) for pair in own],
        [spectra(legs, rate_hz) for pair in own for legs in pair.simulated],
    )
    ratios = {}
    for name in dict.fromkeys(name for one in sides[0] for name in one):
        usual = [[one[name] for one in side if name in one] for side in sides]
        if all(usual):
            real_power, made_power = (np.maximum(np.median(powers, axis=0), 1e-12) for powers in usual)
            ratios[name] = 10.0 * np.log10(made_power / real_power)
    centres = np.sqrt(BANDS[:-1] * BANDS[1:])
    title = f"{label}: simulated over recorded power (dB) by band (Hz)"
    lines = [[name, *(f"{value:.0f}" for value in ratio)] for name, ratio in ratios.items()]
    show(title, ["signal", *(f"{centre:.2g}" for centre in centres)], lines)
    return ratios


# --- classifier ---


def features(legs: list[Leg], rate_hz: float) -> np.ndarray:
    """(strides, features): means over parts of the stride, of every curve."""
    found = [np.zeros((0, PARTS_OF_CURVE * len(CURVES)))]
    for leg in legs:
        if "shank" in leg.sensors:
            own = curves(leg.sensors, rate_hz, leg.windows, Truth(), trim=leg.trim, good=leg.good)
            means = [
                np.stack([part.mean(axis=1) for part in np.array_split(own[name], PARTS_OF_CURVE, axis=1)], axis=1)
                for name in CURVES
            ]
            found.append(np.concatenate(means, axis=1))
    return np.concatenate(found)


def table(own: list[tuple[Pair, float]]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Features (n, …) of strides, 1 for simulated ones (n,), and the person's number (n,); of pairs at rates [Hz]."""
    numbers = {person: number for number, person in enumerate(dict.fromkeys(pair.person for pair, _ in own))}
    values, labels, people = [], [], []
    for pair, rate_hz in own:
        for label, legs in enumerate((pair.recorded, *pair.simulated[:1])):
            values.append(features(legs, rate_hz))
            labels.append(np.full(len(values[-1]), float(label)))
            people.append(np.full(len(values[-1]), numbers[pair.person]))
    return np.concatenate(values), np.concatenate(labels), np.concatenate(people)


def fitted(values: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """Weights of a logistic regression with a small ridge, by Newton's method; the last is the constant."""
    wide = np.column_stack([values, np.ones(len(values))])
    ridge = RIDGE * np.eye(wide.shape[1])
    weights = np.zeros(wide.shape[1])
    for _ in range(30):
        chance = 1.0 / (1.0 + np.exp(-np.clip(wide @ weights, -30.0, 30.0)))
        curvature = (wide * (chance * (1.0 - chance))[:, None]).T @ wide + ridge
        weights += np.linalg.solve(curvature, wide.T @ (labels - chance) - ridge @ weights)
    return weights


def area(scores: np.ndarray, labels: np.ndarray) -> float:
    """Area under the curve: how often a simulated stride has a higher score than a recorded one; ties count half."""
    negative = np.sort(scores[labels == 0.0])
    below = np.searchsorted(negative, scores[labels == 1.0], side="left")
    upto = np.searchsorted(negative, scores[labels == 1.0], side="right")
    return float(np.mean(0.5 * (below + upto)) / len(negative))


def left_out_area(values: np.ndarray, labels: np.ndarray, people: np.ndarray) -> float:
    """Area under the curve of strides of people that the classifier did not learn from."""
    scores = np.zeros(len(values))
    for fold in range(FOLDS):
        out = people % FOLDS == fold
        mean, spread = values[~out].mean(axis=0), values[~out].std(axis=0) + 1e-9
        weights = fitted((values[~out] - mean) / spread, labels[~out])
        scores[out] = ((values[out] - mean) / spread) @ weights[:-1] + weights[-1]
    return area(scores, labels)


def rows(quick: bool) -> list[Row]:
    """Of every set with shanks."""
    ratios: dict[str, list[np.ndarray]] = {}
    every: list[tuple[Pair, float]] = []
    for given in SETS[2:3] if quick else SETS:
        own = pairs(given, 6 if quick else None)
        every += [(pair, given.rate_hz) for pair in own]
        if own:
            for name, ratio in spectral_rows(given.label, own, given.rate_hz).items():
                ratios.setdefault(name, []).append(ratio)
    found, count = [], len({pair.person for pair, _ in every})
    lower = backs(2 if quick else None)
    if lower:
        for name, ratio in spectral_rows(BACKS.label, lower, BACKS.rate_hz).items():
            ratios.setdefault(name, []).append(ratio)
    if count >= FOLDS:
        values, labels, people = table(every)
        split = f"logistic regression on {values.shape[1]} features of a stride, {count} people left out in fifths"
        row = Row("auc_simulated_real", left_out_area(values, labels, people), "1", None, len(values), split)
        found.append(row.on("simulated strides told from recorded ones: area under the curve", of="strides"))
    if ratios:
        apart = {name: np.abs(np.mean(each, axis=0)) for name, each in ratios.items()}
        title, columns = "simulated over recorded power, dB without sign", ["signal", "largest band", "mean"]
        show(title, columns, [[name, float(one.max()), float(one.mean())] for name, one in apart.items()])
        split = "half octaves from 0.5 to 20 Hz, medians over people, mean over sets"
        count += len(lower)
        line = "power of simulated signals over that of recorded ones"
        for metric, part, what in (("spectra_db", "worst band", np.max), ("spectra_mean_db", "worst signal", np.mean)):
            value = max(float(what(one)) for one in apart.values())
            found.append(Row(metric, value, "dB", None, count, split).on(line, part, "people"))
        for name, one in apart.items():
            row = Row(f"spectra_db_{name.replace(' ', '_')}", float(one.max()), "dB", None, count, split)
            found.append(row.on(f"{line}, worst band", name, "people"))
    return found
