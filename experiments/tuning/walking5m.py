"""Distance scale and roll-over radius tuned on `walking5m`, judged on people that the tuning did not use."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax

from experiments.bennett2013.neura_sparse import person
from experiments.common.recordings import available, names, walks
from experiments.common.row import Row, show
from jgait import evaluate, params, tune
from jgait.estimators import leg_ekf
from jgait.estimators.leg_ekf import readout as leg_distance
from jgait.types import Legs, RecordingError, as_float


class ReadOut(NamedTuple):
    """How joint angles become a distance, see `leg_ekf.LegParams`."""

    distance_scale: Any
    rollover_radius: Any


class Walked(NamedTuple):
    """One recording: what the filter found, and the distance by the sensors on the feet [m]."""

    legs: Legs
    still: Any
    true: Any


KINEMATICS = leg_ekf.DEFAULT._replace(distance="stance")
DEFAULTS = ReadOut(1.0, 0.07)
RANGES = ReadOut(params.positive, params.interval(0.0, 0.3))
PRIORS = ReadOut(params.lognormal(1.0, 1.2), params.normal(0.07, 0.03))


def percent(p: ReadOut, item: Walked) -> Any:
    """Error of the distance walked [%]."""
    carried = p.distance_scale * leg_distance.stance_carried(item.legs, p.rollover_radius, item.still)
    return 100.0 * (carried[-1] / item.true - 1.0)


def robust(p: ReadOut, item: Walked) -> Any:
    """Minus the log-likelihood of the error under Student's t with 4 degrees of freedom and a scale of 5 % [nat]."""
    return 2.5 * jnp.log1p((percent(p, item) / 5.0) ** 2 / 4.0)


def absolute(p: ReadOut, item: Walked) -> Any:
    return jnp.abs(percent(p, item))


def filtered_walks(some: list[str]) -> tuple[Walked, list[str], list[str]]:
    """`walking5m` as far as it can be used, the subject of each recording, and why others cannot."""
    loaded = walks("walking5m", some)
    reasons = [f"{failure.name}: {failure.reason}" for failure in loaded.failures]
    found, subjects = [], []
    for walk in loaded:
        if walk.reference is None:
            reasons.append(f"{walk.recording.name}: no reference: {walk.info['no_reference']}")
            continue
        try:
            ours = leg_ekf.estimate(person(walk), walk.recording, KINEMATICS)
            still = leg_ekf.prepared(walk.recording, KINEMATICS).inputs.still
        except RecordingError as error:
            reasons.append(f"{walk.recording.name}: {error}")
            continue
        found.append((ours.legs, still, float(as_float(walk.reference.distance)[-1])))
        subjects.append(walk.recording.subject)
    longest = max(still.size for _, still, _ in found)

    def padded(values: Any, more: int) -> np.ndarray:
        return np.pad(np.asarray(values), (0, more), mode="edge")

    items = [
        Walked(
            Legs(
                *(None if leg is None else type(leg)(*(padded(v, longest - still.size) for v in leg)) for leg in legs)
            ),
            np.pad(np.asarray(still), (0, longest - still.size), constant_values=True),
            np.asarray(true),
        )
        for legs, still, true in found
    ]
    return jax.tree.map(lambda *v: np.stack(v), *items), subjects, reasons


def rows(quick: bool) -> list[Row]:
    """Scale and roll-over radius from the other people's distances."""
    if not available("walking5m"):
        return []
    every = names("walking5m")
    data, subjects, reasons = filtered_walks(every[:4] if quick else every)
    found = tune.cross_validate(
        robust, DEFAULTS, RANGES, data, optax.adam(0.05), subjects=subjects, error=absolute, priors=PRIORS, steps=200,
    )  # fmt: skip
    table = found.table
    gain = evaluate.paired_difference(table["error_before"], table["error_after"], table.index, seed=0)
    show(
        "walking5m: distance error [%] with scale and roll-over radius learned on the other people",
        ["subject", "recordings", "default", "tuned"],
        [
            [name, int(row["n"]), float(row["error_before"]), float(row["error_after"])]
            for name, row in table.iterrows()
        ],
    )
    fit = tune.fit(robust, DEFAULTS, RANGES, data, optax.adam(0.05), steps=200, priors=PRIORS)
    said = tune.identifiability(robust, fit.params, RANGES, data, information="sandwich")
    print("\n".join(f"  {sentence}" for sentence in said.sentences))
    for reason in reasons:
        print(f"  not used: {reason}")
    print(f"  better for {gain.better} of {gain.n} people; after − before {gain.estimate:.2f} %, "
          f"95 % interval {gain.low:.2f} to {gain.high:.2f} (paired bootstrap)")  # fmt: skip
    n, split = len(table), "walking5m, leave one subject out"
    line = "kinematics, scale and roll-over radius tuned on other people: distance error"
    return [
        Row("walking5m_distance_error_before_median", float(table["error_before"].median()), "%", n=n, split=split).on(
            line, "untuned, median", "people"
        ),
        Row("walking5m_distance_error_after_median", float(table["error_after"].median()), "%", n=n, split=split).on(
            line, "median", "people"
        ),
        Row("walking5m_distance_error_before_worst", float(table["error_before"].max()), "%", n=n, split=split).on(
            line, "untuned, worst", "people"
        ),
        Row("walking5m_distance_error_after_worst", float(table["error_after"].max()), "%", n=n, split=split).on(
            line, "worst", "people"
        ),
        Row("walking5m_worse_beyond_noise", float(gain.worse_beyond_noise), "bool", n=n, split="paired bootstrap"),
        Row("walking5m_people_better", gain.better / gain.n, "ratio", n=n, split=split),
    ]
