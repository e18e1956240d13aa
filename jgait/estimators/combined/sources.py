"""The estimators that the sensors of a recording allow, each run once: the sources of a combined estimate."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import PyTree

from jgait import params
from jgait.estimators import get, leg_ekf
from jgait.estimators.ankle_stride import AnkleOptions
from jgait.estimators.checks import sensors_of
from jgait.estimators.interface import Estimator
from jgait.estimators.proportions import gives, height_notes, outside
from jgait.estimators.stride_flags import DOUBTFUL, LARGEST_TURN
from jgait.estimators.waist.params import SITES
from jgait.notes import LEFT_OUT, Kind, Note, meant, record
from jgait.quality import SensorQuality, widened
from jgait.quality.model import LENGTH_BY_TIME
from jgait.types import SIDES, Estimate, Imu, Recording, RecordingError, as_float

NOT_USED = Kind(
    "source_not_used", "check", "{source}: no estimate, because {reason}",
    "These sensors could not be used. What the other sensors measure does not depend on them.",
)  # fmt: skip

RANGE_OFFSET_ABSENT = Kind(
    "range_offset_absent", "check", "the offset of the range between the feet is not given: {offset:g} m is taken, and "
    "widths are off by its error",
    "All stride widths of the recording are too large or too small by the same amount. Measure on the person how much "
    "farther apart the sensors of the feet are than the range says, and compute the result again.",
)  # fmt: skip

SIDES_UNLIKE = Kind(
    "lengths_of_sides_apart", "check", "stride length by {source}: {right:.2f} m on the right, {left:.2f} m on the "
    "left (medians of {strides} pairs of strides at the same time)",
    "Both feet of a person who walks straight go as far. At least one side is measured wrongly, as of a stiff leg "
    "whose shank hardly swings, a sensor of another scale, or one that moves on the leg. Which one is not known: the "
    "deviations of stride lengths and of the distance contain half of the difference. Do not read it as asymmetry.",
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


class SourceKind(NamedTuple):
    """A source that sensors can make."""

    name: str
    estimator: str
    segments: tuple[str, ...] = ()  #: those of each leg that need a sensor; none: the trunk.
    options: PyTree = None  #: options of the estimator; None: the default ones.

    def make(self) -> Estimator[PyTree, PyTree]:
        """Its estimator."""
        return get(self.estimator) if self.options is None else get(self.estimator, self.options)

    def uses(self, recording: Recording) -> tuple[str, ...]:
        """The sensors of a recording that it uses; none if it has too few."""
        worn = set(recording.sensors)
        if not self.segments:
            return tuple(name for name in SITES if name in worn)[:1]
        legs = [[f"{segment}_{side}" for segment in self.segments] for side in SIDES]
        names = tuple(name for leg in legs if set(leg) <= worn for name in leg)
        return names if self.name != "width" or (len(names) == 2 and recording.feet_range is not None) else ()


WAYS = (
    SourceKind("feet", "foot_ins", ("foot",)),
    SourceKind("ankles", "ankle_stride", ("ankle",), AnkleOptions(site="ankle")),
    SourceKind("shanks", "ankle_stride", ("shank",), AnkleOptions(site="shank")),
    SourceKind("waist", "waist"),
    # their distance is independent of that of the shanks, which are a source of their own
    SourceKind("legs", "leg_ekf", ("thigh", "shank"), leg_ekf.DEFAULT._replace(distance="stance")),
    SourceKind("width", "stride_width_ekf", ("foot",)),
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
        hint = meant(unknown[0], known)
        if tuned:
            hint = f", a parameter of {tuned[0]}, which {tuned[0]}.estimate(params, recording) takes"
        raise ValueError(f"a person has {', '.join(sorted(known))}; got {unknown[0]!r}{hint}")
    if person:  # else no estimator is imported for its ranges
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
            reason = f"{next(name for name in SITES if name in recording.sensors)} serves as well"
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
        name: LENGTH_BY_TIME * facts.rates_error
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


def _sides_of(source: SourceEstimate) -> tuple[float, float, int, float]:
    """Median lengths of right and left strides at the same time [m], neither in a turn or in doubt, the number of such
    pairs, and the median difference over the mean length [1], NaN for few pairs.
    """
    strides = source.estimate.strides
    if strides is None or source.name == "width":
        return np.nan, np.nan, 0, np.nan
    side, start, end, length = (as_float(getattr(strides, name)) for name in ("side", "start", "end", "length"))
    straight = np.asarray(strides.valid, bool)
    if strides.turn is not None:
        straight = straight & (np.abs(as_float(strides.turn)) <= LARGEST_TURN)
    if (doubted := DOUBTFUL.read(source.estimate)) is not None:
        straight = straight & ~doubted
    right, left = (np.flatnonzero(straight & (side == number)) for number in range(len(SIDES)))
    if not (len(left) and len(right)):
        return np.nan, np.nan, 0, np.nan
    middle = 0.5 * (start + end)
    near = left[np.argmin(np.abs(middle[right, None] - middle[left]), axis=1)]
    at_once = (start[right] < end[near]) & (start[near] < end[right])
    of_right, of_left = length[right][at_once], length[near][at_once]
    if len(of_right) < 6:
        return np.nan, np.nan, len(of_right), np.nan
    medians = float(np.median(of_right)), float(np.median(of_left))
    return *medians, len(of_right), abs(float(np.median(of_right - of_left))) / float(np.mean(medians))


def alike(sources: Sequence[SourceEstimate], placements: frozenset[str]) -> bool:
    """Whether a source with these two sensors measures strides of the same length on both sides, as of a stiff leg."""
    return any(_sides_of(source)[3] < 0.05 for source in sources if placements.issubset(source.placements))


def with_sides_unlike(
    sources: Sequence[SourceEstimate], wrong: frozenset[str]
) -> tuple[list[SourceEstimate], list[Note]]:
    """The sources, with larger deviations where both sides' strides differ in length, and a note for each such source;
    sources with a sensor in `wrong`, which another note explains, do not change.
    """
    changed, notes = list(sources), []
    for number, source in enumerate(sources):
        if len(source.placements) != len(SIDES) or wrong.intersection(source.placements):
            continue
        right, left, strides, differs = _sides_of(source)
        # between walks of public sets, and simulated hemiparetic walks whose distance is wrong
        if differs > 0.1:
            share = np.full(np.shape(source.estimate.strides.side), 0.5 * differs)
            changed[number] = source._replace(estimate=widened(source.estimate, share))
            notes.append(SIDES_UNLIKE(source=source.name, right=right, left=left, strides=strides))
    return changed, notes
