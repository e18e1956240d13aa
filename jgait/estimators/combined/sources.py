"""The estimators that the sensors of a recording allow, each run once: the sources of a combined estimate."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import PyTree

from jgait import params
from jgait.estimators import ankle_stride, foot_ins, leg_ekf, stride_width_ekf, waist
from jgait.estimators.ankle_stride import AnkleOptions
from jgait.estimators.checks import sensors_of
from jgait.estimators.interface import Estimator
from jgait.estimators.proportions import gives, height_notes, outside
from jgait.estimators.stride_width_ekf.notes import RANGE_OFFSET_ABSENT
from jgait.estimators.waist.params import SITES
from jgait.notes import LEFT_OUT, Kind, Note, record
from jgait.quality import SensorQuality, widened
from jgait.quality.evidence import LEAST_FACTOR
from jgait.quality.model import LENGTH_BY_TIME
from jgait.types import SIDES, Estimate, Imu, Recording, RecordingError

NOT_USED = Kind(
    "source_not_used", "check", "{source}: no estimate, because {reason}",
    "These sensors could not be used. What the other sensors measure does not depend on them.",
)  # fmt: skip

MEASURES = {
    "leg_ekf": ("thigh_length", "shank_length"),
    "ankle_stride": ("lever_ankle", "lever_shank"),
    "waist": ("height", "sensor_height", "pendulum_constant"),
    "foot_ins": ("pivot_height",),
    "stride_width_ekf": ("range_offset",),
}
"""Estimator → measures of a person that it takes."""


@record
class SourceEstimate(NamedTuple):
    """A group of sensors that measures gait alone, and its estimate."""

    name: str  #: "feet", "ankles", "shanks", "waist", "legs" or "width".
    estimator: str  #: name of the estimator.
    placements: tuple[str, ...]  #: placements of its sensors.
    estimate: Estimate
    params: PyTree  #: parameters of the estimate.

    @property
    def quality(self) -> dict[str, SensorQuality]:
        """Placement → facts about its sensor that the estimator computed."""
        quality: dict[str, SensorQuality] = self.estimate.diagnostics["sensors"]
        return quality


class _Way(NamedTuple):
    """How to make a source: its estimator, and the sensors of a recording that it uses; none if it has too few."""

    name: str
    make: Callable[[], Estimator[PyTree, PyTree]]
    uses: Callable[[Recording], tuple[str, ...]]


def _ankle_stride(site: str) -> Estimator[PyTree, PyTree]:
    """`ankle_stride` for one site; both sites share a compiled program."""
    made = ankle_stride.estimator(AnkleOptions(site=site))
    return made._replace(prepare=lambda recording: made.prepare(recording)._replace(options=ankle_stride.DEFAULT))


def _worn(*segments: str) -> Callable[[Recording], tuple[str, ...]]:
    """The sensors on some segments of each leg that has all of them."""
    legs = [[f"{segment}_{side}" for segment in segments] for side in SIDES]
    return lambda recording: tuple(name for leg in legs if set(leg) <= set(recording.sensors) for name in leg)


def _trunk(recording: Recording) -> tuple[str, ...]:
    return tuple(name for name in SITES if name in recording.sensors)[:1]


def _ranged(recording: Recording) -> tuple[str, ...]:
    feet = _worn("foot")(recording)
    return feet if len(feet) == 2 and recording.feet_range is not None else ()


KINEMATICS = leg_ekf.DEFAULT._replace(distance="stance")
"""Options of the legs: their distance is independent of that of the shanks, which are a source of their own."""

WAYS = (
    _Way("feet", foot_ins.estimator, _worn("foot")),
    _Way("ankles", lambda: _ankle_stride("ankle"), _worn("ankle")),
    _Way("shanks", lambda: _ankle_stride("shank"), _worn("shank")),
    _Way("waist", waist.estimator, _trunk),
    _Way("legs", lambda: leg_ekf.estimator(KINEMATICS), _worn("thigh", "shank")),
    _Way("width", stride_width_ekf.estimator, _ranged),
)
"""All sources; if several measure a stride, its times come from the first."""


def sources(
    recording: Recording, person: Mapping[str, PyTree], measured: Mapping[str, Imu]
) -> tuple[list[SourceEstimate], list[Note]]:
    """Every source that the sensors allow, and notes about measures from the height and sources without an estimate.
    `measured` are sensors as they were, for a source whose path goes on through movements that are no walking.

    Raises:
        ValueError: a measure that no estimator takes, or outside its range.
        RecordingError: no sensors of any estimator, or none of them can be used; the message has each reason.
    """
    known = {name for names in MEASURES.values() for name in names}
    unknown = [name for name in person if name not in known]
    if unknown:
        tuned = [way.make().name for way in WAYS if unknown[0] in params.names(way.make().transforms)]
        hint = f", a parameter of {tuned[0]}, which {tuned[0]}.estimate(params, recording) takes" if tuned else ""
        raise ValueError(f"a person has {', '.join(sorted(known))}; got {unknown[0]!r}{hint}")
    _check_measures(person)
    estimates: list[SourceEstimate] = []
    notes: list[Note] = []
    reasons: list[str] = []
    measures: set[str] = set()
    for way in WAYS:
        placements = way.uses(recording)
        if not placements:
            continue
        estimator = way.make()
        wanted = MEASURES[estimator.name]
        takes = (*wanted, "height") if gives(wanted) else wanted
        body = {name: value for name, value in person.items() if name in takes}
        p = estimator.with_body(estimator.params, body)
        measures |= set(wanted if way.name != "ankles" else ())
        try:
            sensors = {**recording.sensors, **measured} if estimator.through else recording.sensors
            result = estimator.estimate(p, recording._replace(sensors=sensors))
        except RecordingError as error:
            reasons.append(f"{way.name}: {error}")
            notes.append(NOT_USED(source=way.name, reason=str(error)))
            continue
        estimates.append(SourceEstimate(way.name, estimator.name, placements, result, p))
        if "range_offset" in wanted and "range_offset" not in body and result.diagnostics["ranges"]:
            notes.append(RANGE_OFFSET_ABSENT(offset=float(p.range_offset)))
    if not estimates:
        raise RecordingError(
            "; ".join(reasons)
            or "no estimator has its sensors: expected both or one of foot, ankle, shank, thigh with shank, or waist, "
            f"lower_back or pelvis; {sensors_of(recording)}"
        )
    return estimates, [*notes, *_unused(recording, estimates), *height_notes(person, measures)]


def _check_measures(person: Mapping[str, PyTree]) -> None:
    """Refuse a measure of a person that is no number, or outside its range, by its name. Raises ValueError."""
    ranges = {m.name: (m.low, m.high) for way in WAYS for m in way.make().about.measures if m.unit == "m"}
    for name, value in person.items():
        for number in value if isinstance(value, tuple | list) else np.ravel(value).tolist():
            if not isinstance(number, int | float | np.number | jax.Array):
                hint = ": leave out what is unknown" if number is None else ""
                raise ValueError(f"{name} must be a number; got {number!r}{hint}")
            if name in ranges and (wrong := outside(name, float(number), *ranges[name])):
                raise ValueError(wrong)


def _unused(recording: Recording, estimates: list[SourceEstimate]) -> list[Note]:
    """Notes about sensors that no estimator takes, without those that are alone on their leg, which have a note."""
    taken = {name for way in WAYS for name in way.uses(recording)}
    alone = {name for source in estimates for name, facts in source.quality.items() if facts.alone}
    notes = []
    for placement in sorted(set(recording.sensors) - taken - alone):
        if placement.startswith("thigh"):
            reason = "it is worn without the shank of that leg"
        elif placement in SITES:
            reason = f"{_trunk(recording)[0]} serves as well"
        else:
            reason = "no estimator takes a sensor there"
        notes.append(LEFT_OUT.note(f"{placement} is not used: {reason}"))
    return notes


def with_time_wrong(
    estimates: list[SourceEstimate], quality: Mapping[str, SensorQuality]
) -> tuple[list[SourceEstimate], float, frozenset[str]]:
    """The sources, with larger deviations where times between samples, or rates of sensors on the legs, are wrong; the
    relative deviation of lengths [1] that was added, or zero; the placements whose angles are wrong. If the rates of
    every foot, ankle and shank are off, the sampling rate of all sensors may be wrong.
    """
    worn = {
        name for source in estimates if source.estimator in ("foot_ins", "ankle_stride") for name in source.placements
    }
    # lengths grow with the square of the interval between samples
    off = {
        name: LENGTH_BY_TIME * abs(float(np.log(max(facts.rates_factor, LEAST_FACTOR))))
        for source in estimates for name, facts in source.quality.items() if facts.rates_off
    }  # fmt: skip
    # a few places of a joined file change no other stride
    many = any(max(facts.rows_lost, facts.rows_twice) >= 10 for facts in quality.values())
    if not many and (not off or set(off) != worn):
        return estimates, 0.0, frozenset(off)
    # [1] with a fiftieth of the rows, lengths of recorded walks were off by 4 to 13 %
    share = 0.1 if many else float(np.mean(list(off.values())))
    changed = [
        source if source.estimate.strides is None or off.keys() & set(source.placements)
        else source._replace(estimate=widened(source.estimate, np.full(np.shape(source.estimate.strides.side), share)))
        for source in estimates
    ]  # fmt: skip
    return changed, share, frozenset(name for source in estimates for name in source.placements)
