"""Strides of simulated people beside those of recorded ones: spectra of the signals, and a classifier.

A stride's features are the shank's sagittal rate and the size of its specific force, which all sets have, averaged over
parts of the stride. The classifier is a logistic regression; all recordings of a person and the simulated ones at this
person's strides are left out together. Spectra do not depend on how a sensor is turned: they are sums over its axes.
Simulated sensors have no noise; recorded ones have.
"""

import itertools
import zlib
from collections.abc import Iterator
from typing import Any, NamedTuple

import jax
import numpy as np
from scipy.signal import welch

from experiments.common.row import Row, show
from experiments.simulator import real
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
from jgait import datasets, simulate
from jgait.simulate import Person
from jgait.simulate.population import manner
from jgait.types import SIDES, Walk

CURVES, PARTS_OF_CURVE = ("shank", "shank_acc"), 15
"""Curves of a stride that the classifier sees, and the number of parts over which each is averaged."""
BANDS = np.geomspace(0.5, 20.0, 12)
"""[Hz] Borders of bands of half an octave; each holds a frequency of a piece of `WINDOW`."""
WINDOW = 4.0
"""[s] Length of the pieces of a signal whose spectra are averaged."""
FOLDS, RIDGE = 5, 1.0


class Leg(NamedTuple):
    """One leg in a walk: sensors → gyroscope and accelerometer, where it walks evenly [samples], which samples are
    good, and the side."""

    sensors: dict[str, tuple[Any, Any]]
    windows: list[tuple[int, int]]
    trim: int
    good: np.ndarray | None
    side: str


class Pair(NamedTuple):
    """Legs of a recorded person, and of the simulated one; who the person is."""

    person: str
    recorded: list[Leg]
    simulated: list[Leg]


def legs_of(walk: Walk, given: Set) -> Iterator[Leg]:
    """The legs of a recorded walk that can be used."""
    rate_hz, trim = walk.recording.sampling_rate_hz, 0
    if given.name == "neura_sparse":
        named = [w for name, w in walk.info["windows"].items() if name.startswith("straight")]
        windows = [part for w in named for part in real._brisk(walk.reference.distance, w, rate_hz)]
    elif given.name == "tripod":
        windows = [walk.info["windows"]["steady"]]
    else:
        windows, trim = [walk.info["windows"]["whole"]], 1
    crossed = {one for pair in walk.info.get("misplaced", ()) for one in pair}
    for side in SIDES if windows else ():
        if f"shank_{side}" in walk.recording.sensors and f"shank_{side}" not in crossed:
            sensors, good = real._leg(walk, side)
            yield from (Leg(part, windows, trim, good, side) for part in together(sensors, given))


def drawn(name: str, stride_time: float, stride_length: float) -> Person:
    """A person of the population at a recorded stride, or the usual person where the drawn one cannot walk so."""
    body, own = simulate.person_of(simulate.population(jax.random.key(zlib.crc32(name.encode())), 1, recorded=True), 0)
    leg = body.thigh_length + body.shank_length
    follows = {key: float(v) for key, v in manner(stride_length / leg, simulate.RECORDED).items()}
    person = Person(body, own._replace(
        stride_time=stride_time, stride_length=stride_length, steps=float(STEPS), quiet_before=QUIET, quiet_after=QUIET,
        **follows,
    ))  # fmt: skip
    return person if able(person) else person_at(stride_time, stride_length, simulate.RECORDED, soft_tissue=1.0)


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
    made: list[Walked] = []
    for start in range(0, len(people), BATCH):
        part = people[start : start + BATCH]
        made += walks_of([*part, *[part[-1]] * (BATCH - len(part))], given.rate_hz, given.acc_range)[: len(part)]
    found_pairs = []
    for (name, legs), one in zip(recorded, made, strict=True):
        if all(np.isfinite(values).all() for values in one.gyr.values()):
            own = [
                Leg(part, [window(one, given.rate_hz)], 0, None, side)
                for number, side in enumerate(SIDES)
                for part in together(leg_of_simulated(one, given, number)[0], given)
            ]
            found_pairs.append(Pair(name, legs, own))
    return found_pairs


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
    recorded = [spectra(pair.recorded, rate_hz) for pair in own]
    simulated = [spectra(pair.simulated, rate_hz) for pair in own]
    ratios = {}
    for name in dict.fromkeys(name for one in recorded for name in one):
        usual = [[one[name] for one in side if name in one] for side in (recorded, simulated)]
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
        for label, legs in enumerate((pair.recorded, pair.simulated)):
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
        line = "power of simulated signals over that of recorded ones"
        for metric, part, what in (("spectra_db", "worst band", np.max), ("spectra_mean_db", "worst signal", np.mean)):
            value = max(float(what(one)) for one in apart.values())
            found.append(Row(metric, value, "dB", None, count, split).on(line, part, "people"))
        for name, one in apart.items():
            row = Row(f"spectra_db_{name.replace(' ', '_')}", float(one.max()), "dB", None, count, split)
            found.append(row.on(f"{line}, worst band", name, "people"))
    return found
