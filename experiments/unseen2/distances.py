"""Distance by the waist and by the legs, each set or person left out of what was learned, with the plain guess beside.

Waist: the pendulum's constant K and the gain of the start are learned on the other sets; K of a person follows from the
start of the walk where there is one. `mobgap_lab` has bouts by motion capture, `ipol_gait` straight strides by the
feet, and `walking5m` a sensor on the back whose clock is its own, so that the speed of its whole strides is compared
with that of the feet. The guess is the mean stride length of all other people. Deviations are those of the defaults.

Legs: nothing is learned; the guess is the median distance of the other people, who walk from a mark to a mark. The
reference, sensors on the feet, has an error of its own of some 2.4 %.
"""

from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from python_calamine import CalamineWorkbook

from experiments.bennett2013.walking5m import leave_one_out
from experiments.common.recordings import attempt, available, names, walks
from experiments.common.row import Row, show
from experiments.kose2011 import distances as kose
from experiments.kose2011.walks import sets as sets_at_waist
from experiments.unseen import legs
from jgait.datasets import registry, walking5m
from jgait.estimators import waist
from jgait.estimators.interface import pad
from jgait.estimators.programs import bucket
from jgait.types import Imu, Recording, Walk, as_float

SET = "walking5m"
BACK = [f"{kind}_read_{axis}_7" for kind in ("Gyro", "Acc") for axis in "xyz"]
KNOWN_SD = 1e3
"""[1] Standard deviation of log K with which K is that of the start alone."""


class Trunk(NamedTuple):
    """A walk with a sensor at the waist or back: the estimator's inputs, padded, and its reference.

    Attributes:
        set, subject: name of the set, and identifier of the person.
        body: measures of the person.
        inputs: of the estimator.
        ends, length: (n, 2) [s] and (n,) [m] of parts whose length is known; empty if only `speed` is.
        speed: of straight walking [m/s].
        stride: mean length of a stride [m].
    """

    set: str
    subject: str
    body: dict[str, float]
    inputs: Any
    ends: np.ndarray
    length: np.ndarray
    speed: float
    stride: float


def back(walk: Walk) -> Recording | None:
    """The back's sensor of a walk of `walking5m` as one at the lower back; None if the file has none."""
    path, _ = registry.file(SET, f"{walking5m.ROOT}/{walk.recording.name}.xlsx")
    header, *lines = CalamineWorkbook.from_path(path).get_sheet_by_index(0).to_python()
    table = pd.DataFrame(lines, columns=[str(cell).strip() for cell in header])
    if not {"Time_7", *BACK}.issubset(table.columns):
        return None
    values = table[["Time_7", *BACK]].apply(pd.to_numeric, errors="coerce").dropna().to_numpy(float)
    values = values[np.concatenate([[True], np.diff(values[:, 0]) > 0.0])] if len(values) else values
    if len(values) < 2:
        return None
    time, gyr, acc = (values[:, 0] - values[0, 0]) / 1000.0, values[:, 1:4], values[:, 4:]
    imu = Imu(time, walking5m.GYR_SCALE * gyr, walking5m.ACC_SCALE * acc, np.ones(len(time), bool))
    return Recording({"lower_back": imu}, walking5m.RATE_HZ, walk.recording.name, walk.recording.subject)


def of_back(walk: Walk) -> Trunk | None:
    """A walk of `walking5m` with its speed by the whole strides of both feet."""
    recording = back(walk)
    if recording is None or walk.reference is None:
        return None
    whole = [(path.length[1:-1], (path.end - path.start)[1:-1]) for path in walk.info["feet"].values()]
    length, samples = (np.concatenate(values) for values in zip(*whole, strict=True))
    inputs = waist.prepared(recording).inputs
    speed = float(length.sum() / samples.sum() * walking5m.RATE_HZ)
    nothing = np.zeros(0)
    padded = pad(inputs, bucket(inputs.time.size, kose.SAMPLES))
    return Trunk(SET, recording.subject, {}, padded, nothing, nothing, speed, float(length.mean()))


def trunks() -> list[Trunk]:
    """Every walk with a sensor at the waist or back, of the sets that are here."""
    found = []
    for item in kose.ready([walk for of_set in sets_at_waist(False).values() for walk in of_set]):
        (ends, length), who = item.walk.pieces, item.walk
        steps = [np.sum((who.contacts > begin + 0.1) & (who.contacts < end + 0.1)) for begin, end in ends]
        stride = float(2.0 * length.sum() / np.sum(steps))
        speed = float(length.sum() / np.diff(ends, axis=1).sum())
        found.append(Trunk(who.set, who.subject, who.body, item.inputs, ends, length, speed, stride))
    for walk in walks(SET) if available(SET) else []:
        one = attempt(walk.recording.name, lambda walk=walk: of_back(walk))
        found += [] if one is None else [one]
    return found


def measured(p: waist.WaistParams, trunk: Trunk, options: waist.WaistOptions) -> tuple[float, float, float]:
    """Estimated over true length of a walk, its stated relative deviation, and K; NaN if no whole stride was found."""
    result = kose.run(waist.with_body(p, trunk.body), trunk.inputs, options)
    strides, spread, diagnostics = result.strides, result.strides_stddev, result.diagnostics
    constant = float(diagnostics["pendulum_constant"])
    if trunk.length.size:
        time, way, sd = (as_float(v) for v in (result.time, result.distance, diagnostics["distance_stddev"]))
        first, last = np.searchsorted(time, [trunk.ends.min(), trunk.ends.max()])
        ratio = np.diff(np.interp(trunk.ends, time, way), axis=1).sum() / trunk.length.sum()
        return float(ratio), float((sd[last] - sd[first]) / (way[last] - way[first])), constant
    whole = np.flatnonzero(np.asarray(strides.valid) & ~np.asarray(diagnostics["half"]))[2:-2]
    if not whole.size:
        return np.nan, np.nan, constant
    length, seconds = as_float(strides.length)[whole], (as_float(strides.end) - as_float(strides.start))[whole]
    deviation = float(np.mean(as_float(spread.length)[whole] / length))
    return float(length.sum() / seconds.sum() / trunk.speed), deviation, constant


def by_person(values: np.ndarray, who: np.ndarray) -> float:
    """Mean over people of the mean over their walks."""
    return float(np.mean([np.nanmean(values[who == one]) for one in sorted(set(who[np.isfinite(values)]))]))


def of_waist(found: list[Trunk]) -> list[Row]:
    """Lengths of straight walking, K and the gain of the start learned on the other sets."""
    p = waist.WaistParams()
    sets, who = (np.array([getattr(trunk, name) for trunk in found]) for name in ("set", "subject"))
    alone, started = p._replace(start_noise=kose.ALONE), p._replace(pendulum_constant_sd=KNOWN_SD, start_gain=1.0)
    ratio = np.array([measured(alone, trunk, kose.PENDULUM)[0] for trunk in found])
    constant = np.log(p.pendulum_constant / ratio)
    start = np.log([measured(started, trunk, kose.PENDULUM)[2] for trunk in found])
    start[start == np.log(p.pendulum_constant)] = np.nan  # no start from standing
    seen = np.isfinite(constant)
    rows, lines, over, inside = [], [], [], []
    for name in sorted(set(sets)):
        here, others = (sets == name) & seen, (sets != name) & seen
        if not others.any():
            continue
        gain = start - constant
        learned = p._replace(
            pendulum_constant=np.exp(by_person(constant[others], who[others])),
            start_gain=np.exp(by_person(gain[others], who[others])),
        )
        told = np.array([measured(learned, found[row], waist.DEFAULT) for row in np.flatnonzero(here)])
        size, sd = 100.0 * np.abs(told[:, 0] - 1.0), told[:, 1]
        stride = np.array([trunk.stride for trunk in found])
        guess = [by_person(stride[who != who[row]], who[who != who[row]]) / stride[row] for row in np.flatnonzero(here)]
        plain = 100.0 * np.abs(np.array(guess) - 1.0)
        within = 100.0 * float(np.mean(size <= 200.0 * sd))
        over.append(float(size.mean() / plain.mean()))
        inside.append(within)
        n, line = size.size, f"waist, `{name}`, length of straight walking, set left out: error"
        end = name.removesuffix("_gait")
        numbers = {"mean": size.mean(), "median": np.median(size), "worst": size.max(), "plain guess": plain.mean()}
        for part, value in numbers.items():
            key = f"waist_{end}_{part.replace('plain ', '')}_pct"
            rows.append(Row(key, float(value), "%", n=n, split="set left out").on(line, part, "walks"))
        rows.append(
            Row(f"waist_{end}_two_sigma_pct", within, "%", n=n, split="set left out").on(
                f"waist, `{name}`: within two stated standard deviations, set left out", "", "walks"
            )
        )
        bias = 100.0 * float(np.mean(told[:, 0] - 1.0))
        lines.append(
            [name, n, *numbers.values(), bias, 100.0 * float(sd.mean()), within, float(learned.pendulum_constant)]
        )
        if name == "mobgap_lab":
            rows.append(Row("waist_lab_pct", float(size.mean()), "%", n=n, split="set left out"))
    columns = ["", "n", "mean |error| [%]", "median", "worst", "guess", "bias", "stated sd [%]", "in 2 sd [%]", "K"]
    show("Length of straight walking at the waist, K learned on the other sets", columns, lines)
    if over:
        split = f"worst of {len(over)} sets, each left out"
        rows.append(Row("waist_over_guess_worst", max(over), "1", n=int(seen.sum()), split=split))
        rows.append(Row("waist_two_sigma_pct", min(inside), "%", n=int(seen.sum()), split=split))
    return rows


def of_legs(found: list[legs.Distances]) -> list[Row]:
    """Distances by thighs and shanks, nothing learned."""
    subjects, true = (np.array(values) for values in list(zip(*found, strict=True))[:2])
    distance, sd = np.array([one.leg for one in found]).T
    size, n = 100.0 * np.abs(distance / true - 1.0), len(found)
    plain = 100.0 * np.abs(leave_one_out(subjects, true, np.ones_like(true)) / true - 1.0)
    inside = 100.0 * float(np.mean(np.abs(distance - true) <= 2.0 * np.hypot(sd, legs.REFERENCE_SD * true)))
    split, line = "people left out", f"leg_ekf, `{SET}`, distance by legs: error"
    alike = float(np.corrcoef(true, distance)[0, 1])
    numbers = {"mean": size.mean(), "median": np.median(size), "worst": size.max(), "plain guess": plain.mean()}
    keys = ("leg_distance_pct", "leg_distance_median_pct", "leg_distance_worst_pct", "leg_distance_guess_pct")
    rows = [
        Row(key, float(value), "%", n=n, split=split).on(line, part, "people")
        for key, (part, value) in zip(keys, numbers.items(), strict=True)
    ]
    more = {"leg_distance_correlation": (alike, "1"), "leg_distance_two_sigma_pct": (inside, "%"),
            "leg_distance_over_guess": (float(size.mean() / plain.mean()), "1")}  # fmt: skip
    rows += [Row(key, value, unit, n=n, split=split) for key, (value, unit) in more.items()]
    show(f"Distance by legs on {n} people of {SET}", ["", *numbers, *more],
         [["leg_ekf", *(float(v) for v in numbers.values()), *(value for value, _ in more.values())]])  # fmt: skip
    return rows


def rows(quick: bool) -> list[Row]:
    """Legs and waist on the sets that are here; in the quick form three people's legs alone."""
    made = []
    if available(SET):
        every = [one for one in walks(SET, names(SET)[:3] if quick else None) if one.reference is not None]
        found = [attempt(one.recording.name, lambda one=one: legs.measured(one)) for one in every]
        made += of_legs([one for one in found if one is not None])
    return made if quick else made + of_waist(trunks())
