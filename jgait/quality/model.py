"""The model of doubt: from the evidence of a stride, how much larger its error is than the method states, and how
probably the stride is wrong. Estimates judged by it: deviations, doubt, notes on sensors in doubt, and trust.

The error of the length L of a stride, whose method states the deviation σ, has with evidence φ ≥ 0 the density
(1 − p) N(0, s²) + p N(0, λ²s²), with s² = k²σ² + (L Σ r φ)², log k = a + Σ b φ and logit p = c + Σ d φ. The sum with r
is over errors of a sensor that change all lengths alike (`SHARES`). No weight is negative: more evidence never means
less doubt. The numbers are learned by likelihood from strides beside a reference, in `experiments/quality/learn.py`;
`learned.json` has those of each estimator, and says from which recordings they were learned.
"""

import json
import math
from collections.abc import Callable, Mapping
from functools import cache
from importlib.resources import files
from typing import Annotated, Any, NamedTuple

import jax
import numpy as np

from jgait.geometry.arrays import xp
from jgait.notes import Kind, Note, record
from jgait.params import Param, Parameter, Prior, documented, fixed, interval, positive, real
from jgait.quality.evidence import EVIDENCE, SensorQuality, StrideQuality, merged
from jgait.types import Estimate, Strides, Values, as_float

LESS = Prior("exponential(1)", lambda weight: weight, lambda _: 1.0)
"""Prior of each weight: evidence that does not make errors more likely gets none."""

WRONG = 3.0
"""[1] Stated deviations by which the length of a wrong stride is off: the definition of a gross error."""

SHARES = ("scale", "rates", "lever", "outside")
"""Evidence that makes an error of the same share of all lengths. Their numbers are not learned: lengths grow with the
square of the interval between samples, so that of `rates` is 2; those of `scale` and `lever` were chosen on simulated
feet and shanks with scales of 0.9 to 1.1, and with seated movements and cycling between walks."""

DOUBTFUL_FROM = 0.1
"""[1] Probability of a wrong stride above which a stride is in doubt; chosen by hand, judged by the experiment
`quality`."""


@documented
@record
class QualityParams(NamedTuple):
    """Numbers of the model for one estimator, by default those at which a fit starts; the arrays have a weight for each
    name of `EVIDENCE`.
    """

    shift: Annotated[Param, Parameter(real, "1", "a, logarithm of the factor without evidence")] = 0.0
    spread: Annotated[Param, Parameter(positive, "1", "b, weights of the factor", LESS)] = np.full(len(EVIDENCE), 0.1)
    odds: Annotated[Param, Parameter(real, "1", "c, log odds of a wrong stride without evidence")] = -5.0
    wrong: Annotated[Param, Parameter(positive, "1", "d, weights of the log odds", LESS)] = np.full(len(EVIDENCE), 0.1)
    tail: Annotated[Param, Parameter(interval(2.0, 30.0), "1", "λ, deviation of wrong strides over others")] = 6.0
    scale: Annotated[Param, Parameter(fixed, "1", "r of `scale`")] = 0.65
    rates: Annotated[Param, Parameter(fixed, "1", "r of `rates`")] = 2.0
    lever: Annotated[Param, Parameter(fixed, "1/m", "r of `lever`")] = 0.7
    outside: Annotated[Param, Parameter(fixed, "1", "r of `outside`")] = 1.0
    within95: Annotated[Param, Parameter(fixed, "1", "deviations that contain 95 % of errors")] = 2.0


def weighted(weights: Values, evidence: Mapping[str, Values]) -> Values:
    """The sum of the evidence, each times its weight of (F,) in the order of `EVIDENCE`; what is not given counts 0."""
    return sum((weights[EVIDENCE.index(name)] * values for name, values in evidence.items()), start=0.0)


def factor(p: QualityParams, evidence: Mapping[str, Values], stated: Values, length: Values) -> Values:
    """The deviation s of the error over the stated one σ [1], for evidence (n,) by name, deviations that the method
    states (n,) [m] and lengths of the strides (n,) [m].
    """
    share = sum((getattr(p, name) * evidence[name] for name in SHARES if name in evidence), start=0.0)
    relative = share * xp.abs(length) / xp.maximum(stated, 1e-6)
    return xp.sqrt(xp.exp(2.0 * (p.shift + weighted(p.spread, evidence))) + relative * relative)


def doubt(p: QualityParams, evidence: Mapping[str, Values]) -> Values:
    """The probability that the error is larger than `WRONG` times s [1], for evidence (n,) by name."""
    share = 1.0 / (1.0 + xp.exp(-(p.odds + weighted(p.wrong, evidence))))
    return _beyond(1.0) + share * (_beyond(p.tail) - _beyond(1.0))


def _beyond(deviation: Values) -> Values:
    """The probability that a normal variable of this deviation is beyond `WRONG`."""
    at = WRONG / math.sqrt(2.0) / deviation
    return jax.scipy.special.erfc(at) if isinstance(at, jax.Array) else math.erfc(at)


def with_doubt(estimate: Estimate, p: QualityParams, evidence: Mapping[str, np.ndarray]) -> Estimate:
    """The estimate with deviations of strides and of the distance by the model, from evidence (n,) by name.

    `diagnostics["quality"]` is a `StrideQuality`, `diagnostics["doubtful"]` (n,) bool is True where the doubt is above
    `DOUBTFUL_FROM`.
    """
    strides, deviations, diagnostics = estimate.strides, estimate.strides_stddev, dict(estimate.diagnostics)
    times = as_float(factor(p, evidence, as_float(deviations.length), as_float(strides.length)))
    times = np.broadcast_to(times, np.shape(strides.side))
    probability = np.broadcast_to(as_float(doubt(p, evidence)), times.shape)
    diagnostics |= {
        "quality": StrideQuality(probability, times, np.full(times.shape, float(p.within95)), dict(evidence)),
        "doubtful": probability > DOUBTFUL_FROM,
    }
    if "distance_stddev" in diagnostics and times.size:
        lengths = _lengths(strides)
        mean = np.cumsum(times * lengths) / np.maximum(np.cumsum(lengths), 1e-9)
        so_far = np.interp(as_float(estimate.time), as_float(strides.end), mean)
        diagnostics["distance_stddev"] = as_float(diagnostics["distance_stddev"]) * so_far
    deviations = _along(deviations, lambda _, spread: times * spread)
    return estimate._replace(strides_stddev=deviations, diagnostics=diagnostics)


@cache
def learned(estimator: str) -> QualityParams:
    """The numbers that were learned for an estimator. Raises KeyError for an estimator without."""
    stored = json.loads(files("jgait.quality").joinpath("learned.json").read_text(encoding="utf-8"))["estimators"]
    return from_dict(stored[estimator])


NUMBERS = ("shift", "odds", "tail", *SHARES, "within95")
"""Fields of one number."""


def from_dict(stored: Mapping[str, Any]) -> QualityParams:
    """The numbers from JSON: weights by the name of their evidence, which are 0 if they are absent."""
    arrays = {name: np.array([float(stored[name].get(kind, 0.0)) for kind in EVIDENCE]) for name in ("spread", "wrong")}
    return QualityParams(**{name: float(stored[name]) for name in NUMBERS}, **arrays)


def _lengths(strides: Strides) -> np.ndarray:
    """(n,) lengths [m], 0 for strides that are not valid."""
    return np.where(np.asarray(strides.valid, bool), np.nan_to_num(as_float(strides.length)), 0.0)


def widened(estimate: Estimate, share: np.ndarray | float) -> Estimate:
    """The estimate with an additional relative deviation of strides (n,), or of all lengths [1], and of the distance.

    Errors are taken to have one cause, so that they add up in the distance.
    """
    if not np.any(share):
        return estimate
    strides, deviations, diagnostics = estimate.strides, estimate.strides_stddev, dict(estimate.diagnostics)
    if "distance_stddev" in diagnostics:
        if np.ndim(share) == 0:
            more = share * np.abs(as_float(estimate.distance))
        else:
            lengths = _lengths(strides)
            errors = np.cumsum(share * lengths) / max(float(lengths.sum()), 1e-9)
            so_far = np.interp(as_float(estimate.time), as_float(strides.end), errors, left=0.0)
            more = so_far * abs(float(estimate.distance[-1]))
        diagnostics["distance_stddev"] = np.hypot(as_float(diagnostics["distance_stddev"]), more)
    if deviations is not None:
        deviations = with_share(deviations, strides, share)
    return estimate._replace(strides_stddev=deviations, diagnostics=diagnostics)


def with_share(deviations: Strides, strides: Strides, share: np.ndarray | float) -> Strides:
    """Standard deviations of strides with an additional relative deviation (n,) or of all [1] of their lengths."""
    return _along(deviations, lambda name, spread: np.hypot(spread, share * np.abs(as_float(getattr(strides, name)))))


def _along(deviations: Strides, change: Callable[[str, np.ndarray], np.ndarray]) -> Strides:
    """Deviations of strides with a change of those along the way, from their names and values."""
    known = {name: getattr(deviations, name) for name in ("length", "speed", "step_length")}
    return deviations._replace(**{n: change(n, as_float(v)) for n, v in known.items() if v is not None})


LENGTH_BY_TIME = 2.3
"""[1] Relative error of lengths per relative error of the interval between samples. Lengths grow with its square, and a
segment that is taken to turn further leans otherwise: measured 2.3 at feet, shanks and legs, and 1.7 at the waist."""


def length_share(quality: Mapping[str, SensorQuality]) -> float:
    """Relative deviation of all lengths [1] that follows from that of the interval between samples."""
    return LENGTH_BY_TIME * max((facts.time_spread for facts in quality.values()), default=0.0)


def with_time_spread(estimate: Estimate, quality: Mapping[str, SensorQuality]) -> Estimate:
    """The estimate of one recording with the deviation of lengths by `length_share`."""
    return widened(estimate, length_share(quality))


# --- estimates judged ---

UNCERTAIN = 0.25
"""[m] Standard deviation of a stride's length above which it is useless, as after seconds without a rest of the foot;
chosen by hand."""

DOUBTED_SHARE = 0.2
"""[1] Share of a sensor's strides in doubt, or useless, above which a note names them; chosen by hand."""

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
    "Where little holds the integrated motion, it drifts by metres: where samples are lost, where a foot or shank does "
    "not rest, as one that kneels or is carried, and where a sensor on the trunk sees a few steps beside standing. Do "
    "not use positions and lengths of this sensor.",
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
