"""Strides judged: deviations and doubt by the model, notes on sensors whose strides are in doubt, and trust."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from jgait.notes import Kind, Note, record
from jgait.quality.model import QualityParams, learned, with_doubt
from jgait.quality.sensor import SensorQuality, merged
from jgait.quality.stride import EVIDENCE, StrideQuality
from jgait.types import Estimate, as_float

UNCERTAIN = 0.25
"""[m] Standard deviation of a stride's length above which it is useless: seconds without a rest of the foot."""

DOUBTED_SHARE = 0.2
"""[1] Share of a sensor's strides in doubt, or useless, above which a note names them."""

REASONS = {
    "innovation": "the foot does not seem to stand still before or after",
    "sensor_innovation": "the foot does not seem to stand still between its swings",
    "rise": "their rises do not fit the motion between stances",
    "apart": "both sides differ",
    "scale": "the force at rest is not that of gravity",
    "rates": "angular rates do not fit gravity",
    "lever": "the sensor does not seem to be where it is said to be",
    "cramped": "they are short for their duration",
    "rows": "rows of the file are missing or written twice",
    "contradicts": "the signals contradict each other",
    "outside": "they are unlike those from which the method was learned",
}  # fmt: skip
"""Evidence → what it means, in words."""

STRIDES_DOUBTFUL = Kind(
    "strides_doubtful", "check", "{placement}: {strides} of {total} strides {strides:is|are} in doubt: {reason}",
    "A stride is in doubt if its length is probably off by more than three stated deviations, as learned from strides "
    "of many people beside a reference. Sliding, kneeling, running, a loose or wrong sensor do this. Fasten the sensor "
    "and record the walk again, or use the strides that are not in doubt.",
)  # fmt: skip
STANCES_RARE = Kind(
    "stances_rare", "stop",
    "{placement}: lengths of {uncertain} of {total} strides are uncertain by more than {limit_m:g} m",
    "Motion is integrated from one rest of the foot to the next, and drifts by metres without them. Do not use "
    "positions and lengths. Rests are missing where samples are lost; a kneeling or carried foot does not stand.",
)  # fmt: skip


@record
class Trust(NamedTuple):
    """Whether the stated deviations of an estimate can be trusted."""

    #: (n,) bool, in the order of `Estimate.strides`; None if the estimator does not judge strides.
    strides: np.ndarray | None
    recording: bool  #: False if the strides of a side, or the numbers of a sensor, are in doubt as a whole.


def trust(estimate: Estimate) -> Trust:
    """The trust in an estimate, per stride and for the recording, from the doubt and the facts about its sensors."""
    doubted = estimate.diagnostics.get("doubtful")
    sound = not any(facts.unusable for facts in estimate.diagnostics.get("sensors", {}).values())
    if doubted is None:
        return Trust(None, sound)
    side, doubted = np.asarray(estimate.strides.side), np.asarray(doubted, bool)
    shares = [float(np.mean(doubted[side == number])) for number in sorted(set(side.tolist()))]
    return Trust(~doubted, sound and all(share <= DOUBTED_SHARE for share in shares))


def _reason(p: QualityParams, quality: StrideQuality, rows: np.ndarray) -> str:
    """What puts some strides in doubt, in words: the evidence with the largest part in it."""
    weights = dict(zip(EVIDENCE, np.asarray(p.wrong), strict=True))
    size = quality.doubt.shape
    parts = {n: weights[n] * float(np.broadcast_to(v, size)[rows].mean()) for n, v in quality.evidence.items()}
    return REASONS[max(parts, key=lambda name: parts[name])]


def judged(
    estimate: Estimate, estimator: str, evidence: Mapping[str, np.ndarray], placements: Mapping[int, str]
) -> Estimate:
    """The estimate with deviations and doubt of its strides, see `with_doubt`, and notes on sensors whose strides are
    in doubt.

    Args:
        estimate: with strides and their deviations as the method states them, and facts about sensors.
        estimator: name of the estimator, whose learned numbers are used.
        evidence: name → (n,), in the order of the strides.
        placements: side (0 right, 1 left) → sensor that measures its strides.
    """
    p = learned(estimator)
    estimate = with_doubt(estimate, p, evidence)
    diagnostics = estimate.diagnostics
    quality, doubtful = diagnostics["quality"], diagnostics["doubtful"]
    side, deviations = np.asarray(estimate.strides.side), as_float(estimate.strides_stddev.length) / quality.factor
    notes: list[Note] = []
    rare: dict[str, SensorQuality] = {}
    for name in dict.fromkeys(placements.values()):
        rows = np.isin(side, [number for number, placement in placements.items() if placement == name])
        uncertain, many, total = (int(part.sum()) for part in (rows & (deviations > UNCERTAIN), rows & doubtful, rows))
        rare[name] = SensorQuality(unusable=uncertain > DOUBTED_SHARE * total)
        notes += doubts_of(name, uncertain, many, total, _reason(p, quality, rows & doubtful) if many else "")
    more = {"notes": (*diagnostics["notes"], *notes), "sensors": merged(diagnostics["sensors"], rare)}
    return estimate._replace(diagnostics={**diagnostics, **more})


def doubts_of(placement: str, uncertain: int, many: int, total: int, why: str = REASONS["innovation"]) -> list[Note]:
    """Notes on a sensor, from how many of its strides are uncertain by more than `UNCERTAIN`, how many are in doubt,
    how many there are, and what puts them in doubt.
    """
    notes = []
    if uncertain > DOUBTED_SHARE * total:
        notes.append(STANCES_RARE(placement=placement, uncertain=uncertain, total=total, limit_m=UNCERTAIN))
    if many > DOUBTED_SHARE * total:
        notes.append(STRIDES_DOUBTFUL(placement=placement, strides=many, total=total, reason=why))
    return notes
