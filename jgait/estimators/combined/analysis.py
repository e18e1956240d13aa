"""The estimate from all sensors of a recording together."""

import importlib
import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import numpy as np
from jaxtyping import PyTree

from jgait.estimators.checks import check_shapes, sensors_of
from jgait.estimators.combined.crosscheck import crosscheck
from jgait.estimators.combined.distance import WalkedDistance, distances, walked
from jgait.estimators.combined.sources import SourceEstimate, alike, sources, with_sides_unlike, with_time_wrong
from jgait.estimators.combined.strides import JoinedStrides, joined, quality_of, regular, side_notes
from jgait.estimators.notes import NO_STEPS
from jgait.estimators.plausible import knee_notes, knees
from jgait.estimators.proportions import in_metres
from jgait.estimators.stride_flags import stride_notes
from jgait.estimators.totals import median
from jgait.estimators.waist.notes import DISTANCE_DOUBTFUL
from jgait.estimators.walking import inside, walking_alone
from jgait.notes import Kind, Note, as_doubts, gravest_first, without_repeats
from jgait.quality import DOUBTED_SHARE, UNCERTAIN, above, length_share, merged, opposite, with_share
from jgait.quality import notes as writer
from jgait.quality.model import STANCES_RARE
from jgait.types import SIDES, AnyArray, Estimate, Flags, Legs, Recording, RecordingError, as_float, check_recording

if TYPE_CHECKING:
    import pandas as pd

ANGLES_DOUBTFUL = Kind(
    "angles_doubtful",
    "stop",
    "hip and knee angles ({sides}) are not usable, because of doubts about {sensors}",
    "Wrong axes, labels or clocks of a thigh or shank sensor, or one whose numbers are wrong, shift the angles or turn "
    "them upside down, the hip's too. Their stated deviations do not contain that.",
    measure="joint angles",
)
ONE_LEG_SEEN = Kind(
    "one_leg_seen", "info", "strides of the {side} leg alone are measured", "All numbers of strides are of this leg."
)


class Comparison(NamedTuple):
    """One quantity of a walk as one source measures it."""

    quantity: str  #: "stride_length" [m], "distance" [m], "walking_speed" [m/s] or "strides" [1].
    source: str  #: name of the source, or "combined".
    value: float  #: the value; of strides the median over the regular ones, see `regular`.
    stddev: float | None  #: its standard deviation, or None where none is stated.
    strides: int  #: number of strides that the value is from; 0 for a distance.


class Analysis(NamedTuple):
    """Gait from all sensors of a recording together.

    The `estimate` has strides of both sides with standard deviations, distance, joint angles, paths of the feet, as far
    as the sensors measure them. Its `diagnostics` has the flags of strides, contacts of the waist, `sensors`, the
    `SensorQuality` of each placement, `clocks_apart`, True if other sensors show that the clock of a shoe may be off,
    `distance_stddev` [m], `angles_valid_<side>`, False if the side's joint angles are not usable, and `slipped_<side>`
    (T,), True after a thigh's or shank's sensor slipped, so that they are not usable either.
    """

    estimate: Estimate  #: the joined estimate.
    sources: tuple[SourceEstimate, ...]  #: the result of each group of sensors alone, those preferred for times first.
    strides: JoinedStrides | None  #: which sources measured each stride, and which were combined; None without strides.
    comparisons: tuple[Comparison, ...]  #: each quantity as each source measures it, and combined.
    notes: tuple[Note, ...]  #: decisions, problems and contradictions between sensors, gravest first.
    person: dict[str, float]  #: the measures of the person that were given.

    def __repr__(self) -> str:
        parts = [f"{np.ptp(as_float(self.estimate.time)):.1f} s"]
        if self.estimate.distance is not None:
            metres, stddev = self.estimate.distance, self.estimate.diagnostics["distance_stddev"]
            parts.append(f"distance {as_float(metres)[-1]:.2f} ± {as_float(stddev)[-1]:.2f} m")
        parts.append(f"{0 if self.strides is None else len(self.strides.first)} strides")
        parts.append("sources " + ", ".join(source.name for source in self.sources))
        return f"Analysis({'; '.join(parts)}; {len(self.notes)} notes)"

    def to_dataframe(self, table: str = "strides") -> "pd.DataFrame":
        """The strides, a row each; or another table of `jgait.io.analysis_to_dataframes`, by its name."""
        tables: dict[str, pd.DataFrame] = importlib.import_module("jgait.io").analysis_to_dataframes(self)
        if table not in tables:
            raise ValueError(f"tables are {', '.join(tables)}; got {table!r}")
        return tables[table]

    def _repr_html_(self) -> str:
        return str(self.to_dataframe("summary").to_html(index=False, na_rep="–", float_format="{:.4g}".format))


def analyse(
    recording: Recording | str | os.PathLike[str], person: Mapping[str, PyTree] | None = None, **reading: Any
) -> Analysis:
    """Everything that the sensors of a recording allow: every estimator that has its sensors, joined and cross-checked.

    Where several groups of sensors measure the same stride, their lengths are combined by their variances if they are
    consistent; otherwise the more certain one is used, and the stride is marked. The sensors are checked against each
    other first (units, sides, segments, clocks, see `combined.crosscheck`): a sensor in a wrong unit is left out,
    strides of sensors on a wrong side or clock are not combined with others, and sensors of two segments of a leg that
    have changed places are taken the other way round. A sensor that is wrong by the reader's `quality` (sign, axes,
    scale, delay) counts only where nothing else measures, and joint angles that need it are said to be not usable.

    Args:
        recording: the signals, placements as in `jgait.PLACEMENTS`; one sensor is enough. Or the path of a file, which
            `jgait.io.read` reads.
        person: measures of the person [m], as far as known, named as here or as the columns of tables ("height_m"):
            "height" gives those that are missing by usual proportions;
            "thigh_length", "shank_length"; "sensor_height" of the waist's sensor over the ground; "lever_ankle" and
            "lever_shank", heights of sensors over the ankle; "pivot_height", of a shoe's sensor over the point about
            which the foot turns on the ground; "range_offset" of the distance between the feet; "pendulum_constant" of
            the waist [1], such as a tuned one. Values are numbers or (right, left).
        **reading: arguments of `jgait.io.read` for the file of a path, such as `placement="waist"`.

    Raises:
        TypeError: arguments of a file for a recording that is read already.
        RecordingError: if no estimator has its sensors, or none can use them, or arrays of a sensor differ in length.
        ValueError: a measure of the person that is unknown or outside its range.
    """
    if isinstance(recording, str | os.PathLike):
        return analyse(importlib.import_module("jgait.io").read(recording, **reading), person)
    if reading:
        raise TypeError(f"{', '.join(reading)}: only for the path of a file; this recording is read already")
    check_recording(recording)
    if not isinstance(person, Mapping | None):
        raise TypeError(f"person must be a dictionary of measures, such as {{'height': 1.75}}; got {person!r}")
    body = in_metres(person or {})
    for name, imu in recording.sensors.items():
        check_shapes(imu, name)
    walking = walking_alone(recording)
    measured, recording = recording.sensors, walking.recording
    findings = crosscheck(recording)
    kept = {name: imu for name, imu in findings.sensors.items() if name not in findings.unusable}
    if not kept:
        reasons = "; ".join(str(note) for note in findings.notes)
        raise RecordingError(reasons or f"no estimator has its sensors; {sensors_of(recording)}")
    timed = {name: facts._replace(time_spread=0.0) for name, facts in recording.quality.items()}  # once, at the end
    usable = recording._replace(sensors=kept, notes=tuple(writer.left_out(recording.quality)), quality=timed)
    through = {name: measured[name] for name, imu in kept.items() if imu is recording.sensors[name]}
    estimates, notes = sources(usable, body, through)
    estimates, share, turned = with_time_wrong(estimates, recording.quality)
    quality = findings.explained(recording.quality)
    # pairs of sensors of which either may be wrong: of both legs that turn otherwise, or step otherwise, as in a limp,
    # and of one leg whose clocks differ, so that the times of strides are wrong, and lengths hold
    sides = [frozenset((name, opposite(name))) for name, facts in quality.items() if facts.faster != 1.0]
    steps = [frozenset((name, opposite(name))) for name, facts in quality.items() if facts.step_share != 0.5]
    late_pairs = [frozenset((name, above(name))) for name, facts in quality.items() if facts.late]
    axes = findings.doubtful | {name for name, facts in quality.items() if facts.wrong}
    wrong = axes.union(*(pair for pair in sides if not alike(estimates, pair)))  # a stiff leg turns less
    estimates, unlike = with_sides_unlike(estimates, wrong)
    clocks = frozenset().union(*steps, *late_pairs)
    strides = joined(estimates, wrong | clocks, wrong)
    worn = [name for source in estimates if source.name == "legs" for name in source.placements]
    late = frozenset().union(*(pair for pair in late_pairs if pair.issubset(worn)))
    ways, one_sided = distances(estimates, usable, wrong, late, share)
    total, apart = walked(ways)
    if total is not None:  # an error of the time is the same in all sources
        spread = max(total.stddev, share * float(total.distance[-1]))
        total = total._replace(stddev=spread)
    crossed = [side for side in SIDES if findings.crossed & {f"thigh_{side}", f"shank_{side}"}]
    bent = {note for source in estimates for side in crossed for note in knee_notes(source.estimate, side)}
    unusable, angle_notes = _angles(estimates, worn, crossed, axes | late | turned)
    differ = [*apart, *angle_notes]
    off = findings.clocks.union(*late_pairs, (name for name, facts in quality.items() if facts.acc_late))
    if strides is not None:
        differ += side_notes(estimates, strides)
        legs = set(np.asarray(strides.strides.side).tolist())
        if len(legs) == 1 and len({name.rpartition("_")[2] for name in worn}) != 1:  # else `leg_ekf` says it
            differ += [ONE_LEG_SEEN(side=SIDES[side]) for side in legs]
    elif any(source.estimate.strides is not None for source in estimates):
        differ = [NO_STEPS.note("no walking was found: no sensor measured a stride"), *differ]
    if strides is not None:
        differ += stride_notes(strides.flags, regular(strides))
    if by_rate := length_share(recording.quality):  # the same for all sources
        if strides is not None:
            strides = strides._replace(stddev=with_share(strides.stddev, strides.strides, by_rate))
        if total is not None:
            total = total._replace(stddev=float(np.hypot(total.stddev, by_rate * total.distance[-1])))
    firm = False
    if strides is not None and len(strides.rows) > 1:
        firm = bool(np.mean(as_float(strides.stddev.length) > UNCERTAIN) <= DOUBTED_SHARE)
    stated = [note for source in estimates for note in _stated(source, firm, total) if note not in bent]
    estimate = _assembled(estimates, strides, total, walking.spans)
    follow = {*writer.contradictions(recording.quality)}.difference(writer.contradictions(quality))
    of_reader = [note for note in recording.notes if note not in follow]
    every = [*walking.notes, *findings.notes, *differ, *of_reader, *notes, *one_sided, *unlike, *stated]
    order = gravest_first(without_repeats(every))
    valid = {f"angles_valid_{side}": side not in unusable for side in SIDES if getattr(estimate.legs, side) is not None}
    sensors = merged(quality, *(source.quality for source in estimates))
    if firm:  # what one sensor cannot say, others do
        sensors = {name: sensor._replace(unusable=False) for name, sensor in sensors.items()}
    facts = {**valid, "clocks_apart": any(name.startswith("foot_") for name in off), "notes": order, "sensors": sensors}
    estimate = estimate._replace(diagnostics={**estimate.diagnostics, **facts})
    rows = _comparisons(estimates, strides, ways, total)
    return Analysis(estimate, tuple(estimates), strides, tuple(rows), order, body)


def _stated(source: SourceEstimate, firm: bool, total: WalkedDistance | None) -> list[Note]:
    """The notes of a source; one that forbids its strides or its distance is a doubt where other sources give them:
    strides of all sources that are `firm`.
    """
    notes = list(source.estimate.diagnostics["notes"])
    if firm:
        notes = as_doubts(notes, STANCES_RARE)
    if total is not None and source.name not in total.source.split("+"):
        notes = as_doubts(notes, DISTANCE_DOUBTFUL, source.name)
    return notes


def _angles(
    estimates: list[SourceEstimate], worn: list[str], crossed: list[str], wrong: frozenset[str]
) -> tuple[list[str], list[Note]]:
    """The sides whose joint angles are not usable, and a note on them, if one of their sensors (`worn`) is in doubt, or
    if no knee bends as the angles say, although the sensors of this side are not `crossed`.
    """
    beyond = tuple(
        side for source in estimates for side, knee in knees(source.estimate).items()
        if knee.lost or (knee.implausible and side not in crossed)
    )  # fmt: skip
    names = [name for name in worn if name in wrong or name.endswith(beyond)]
    sides = [side for side in SIDES if any(name.endswith(side) for name in names)]
    return sides, [ANGLES_DOUBTFUL(sides=" and ".join(sides), sensors=", ".join(names))] if names else []


def _assembled(
    estimates: list[SourceEstimate],
    strides: JoinedStrides | None,
    total: WalkedDistance | None,
    moves: tuple[tuple[float, float], ...],
) -> Estimate:
    """The joined estimate, at the times of the first source; parts at other times are only in their source. Nothing is
    valid where the person moves without walking (`moves`).
    """
    by_name = {source.name: source.estimate for source in estimates}
    base = estimates[0].estimate
    time = as_float(base.time)

    def at_times(estimate: Estimate | None) -> Estimate | None:
        if estimate is None or np.shape(estimate.time) != time.shape:
            return None
        return estimate if np.max(np.abs(as_float(estimate.time) - time)) < 1e-3 else None

    legs, feet, waist = (at_times(by_name.get(name)) for name in ("legs", "feet", "waist"))
    diagnostics: dict[str, PyTree] = {"standing": base.diagnostics.get("standing")}
    for source in estimates:
        diagnostics |= {k: v for k, v in source.estimate.diagnostics.items() if k.startswith("initial_contact")}
    if legs is not None:
        diagnostics |= {k: v for k, v in legs.diagnostics.items() if k.startswith("slipped_")}
    if strides is not None:
        diagnostics |= {**strides.flags, "contradicts": strides.contradicts, "quality": quality_of(strides, estimates)}
    if total is not None:
        diagnostics["distance_stddev"] = np.asarray([total.stddev])
    walks = ~inside(time, moves)
    of_legs = {side: legs.diagnostics[f"stated_{side}"] & walks for side in SIDES if legs and getattr(legs.legs, side)}
    valid = np.zeros(time.shape, bool)
    for there in (*(part.valid for part in (base, feet, waist) if part is not None), *of_legs.values()):
        valid |= np.asarray(there, bool)

    def stated(values: PyTree, there: Flags) -> PyTree:
        """Values over time, NaN where their source states nothing."""

        def gapped(leaf: AnyArray) -> np.ndarray:
            known = np.asarray(there, bool).reshape(-1, *(1,) * (np.ndim(leaf) - 1))
            return np.where(known, as_float(leaf), np.nan)

        return jax.tree.map(gapped, values)

    def sides_of(values: Legs) -> Legs:
        return Legs(*(stated(getattr(values, side), of_legs[side]) if side in of_legs else None for side in SIDES))

    return Estimate(
        time=time,
        legs=Legs(None, None) if legs is None else sides_of(legs.legs),
        stddev=None if legs is None or legs.stddev is None else sides_of(legs.stddev),
        distance=None if total is None else np.interp(time, total.time, total.distance),
        valid=valid,
        diagnostics=diagnostics,
        strides=None if strides is None else strides.strides,
        feet=None if feet is None else stated(feet.feet, feet.valid),
        feet_stddev=None if feet is None else stated(feet.feet_stddev, feet.valid),
        strides_stddev=None if strides is None else strides.stddev,
    )


def _comparisons(
    sources: Sequence[SourceEstimate], strides: JoinedStrides | None, walked: Sequence[WalkedDistance],
    total: WalkedDistance | None,
) -> list[Comparison]:  # fmt: skip
    """Every quantity that a source measures, and the combined value."""
    rows: list[Comparison] = []
    if strides is not None:
        usual = regular(strides)
        tables = {
            source.name: (strides.rows[source.name], source.estimate.strides, source.estimate.strides_stddev)
            for source in sources if source.name in strides.rows
        }  # fmt: skip
        tables["combined"] = np.arange(len(usual)), strides.strides, strides.stddev
        for quantity, field in (("stride_length", "length"), ("walking_speed", "speed")):
            for name, (at, values, spread) in tables.items():
                if (column := getattr(values, field)) is not None:
                    known = at[(at >= 0) & usual]
                    known = known[np.isfinite(as_float(column)[known])]
                    middle, sd = median(column, known), median(getattr(spread, field, None), known)
                    rows += [] if middle is None else [Comparison(quantity, name, middle, sd or None, len(known))]
        counts = {name: int((at >= 0).sum()) for name, (at, *_) in tables.items()}
        rows += [Comparison("strides", name, float(count), None, count) for name, count in counts.items()]
    every = [*walked, *([] if total is None else [total._replace(source="combined")])]
    return rows + [Comparison("distance", each.source, float(each.distance[-1]), each.stddev, 0) for each in every]
