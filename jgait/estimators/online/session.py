"""A person's sensors, sample by sample: what each new block of samples tells."""

from collections.abc import Mapping, Sequence
from types import ModuleType
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import PyTree

from jgait.estimators import get
from jgait.estimators.ankle_stride import online as ankle_online
from jgait.estimators.combined.sources import MEASURES
from jgait.estimators.foot_ins import online as foot_online
from jgait.estimators.lagged import LaggedNow
from jgait.estimators.notes import LONGEST_LOSS
from jgait.estimators.online import duty, legs
from jgait.estimators.online.device import Device, Readings, Runner
from jgait.estimators.online.export import ExportedStep, exported
from jgait.estimators.online.samples import Block, Pushes
from jgait.estimators.proportions import gives
from jgait.estimators.walking import of_turns
from jgait.geometry.arrays import stacked
from jgait.notes import Note, record
from jgait.params import check_params
from jgait.types import SIDES, AnyArray, Counts, Legs, LegTrajectory, Recording, RecordingError, Strides

CAUSAL: dict[str, dict[str, tuple[str, ...]]] = {
    "foot_ins": {"feet": ("foot",)},
    "ankle_stride": {"ankles": ("ankle",), "shanks": ("shank",)},
    "leg_ekf": {"legs": ("thigh", "shank")},
    "duty_cycled_gyro": {"legs": ()},
}
"""Estimators with a form sample by sample, their sources, and the segments that one side needs."""

OFFLINE = {
    "waist": "its contacts come from wavelets over the whole walk",
    "waist_ofdri": "it integrates each step forward and backward",
    "stride_width_ekf": "it needs the smoothed paths of both feet",
}
"""Estimators without such a form, and why."""

PREFERRED = ("feet", "ankles", "shanks")
"""Sources of strides, in the order in which their contacts are preferred."""


@record
class NewStrides(NamedTuple):
    """Strides (n,) that have become known, in order; times are those of the samples that were pushed [s]."""

    strides: Strides
    stddev: Strides  #: their standard deviations.
    flags: dict[str, np.ndarray]  #: name → (n,) bool, as of the estimator offline.


@record
class NewContacts(NamedTuple):
    """Contacts that have become known, in order."""

    time: np.ndarray  #: (n,) [s].
    side: np.ndarray  #: (n,) 0 right, 1 left.
    initial: np.ndarray  #: (n,) bool, True for an initial, False for a final contact.


@record
class News(NamedTuple):
    """What a block of n samples tells."""

    time: np.ndarray  #: (n,) of the samples [s].
    legs: Legs | None  #: joint angles and foot positions (n,), or None without sensors on thigh and shank.
    stddev: Legs | None  #: their standard deviations, or None.
    #: placement → (n,) angle of the segment from the vertical [rad]; of duty_cycled_gyro alone.
    angles: dict[str, np.ndarray]
    #: (n,) bool; False where angles are not usable: before the person has stood or walked for some seconds, since the
    #: start of the stream or a long gap.
    valid: np.ndarray
    stands: np.ndarray  #: (n,) bool, the person stands still.
    strides: dict[str, NewStrides]  #: source → strides that have become known.
    contacts: NewContacts  #: their contacts, from the first of `PREFERRED` that has sensors.
    distance: dict[str, float]  #: source → distance since the start [m].
    #: source → time since the start, in long gaps, in which samples of all its sensors were lost, of the legs those of
    #: any sensor [s]: the distance misses what was walked then, and that of the legs is a guess there.
    lost: dict[str, float]


class Online:
    """Estimators that run while a person walks, in constant memory; made by `jgait.online`.

    Attributes:
        placements: placements of the sensors whose samples it takes.
        sampling_rate_hz: rate of the samples [Hz].
        sources: names of its sources, "feet", "ankles", "shanks" and "legs".
        notes: notes about how the sensors are worn.
    """

    def __init__(self, devices: Sequence[Device], sampling_rate_hz: float, notes: tuple[Note, ...]) -> None:
        self.placements = tuple(sorted({name for device in devices for name in device.placements}))
        self.sampling_rate_hz = sampling_rate_hz
        self.sources = tuple(device.source for device in devices)
        self.notes = notes
        self._clock = Pushes(self.placements, sampling_rate_hz)
        self._runs = [_Run(device, self.placements) for device in devices]

    @property
    def state_bytes(self) -> int:
        """Memory of all states between two samples [bytes]; it does not grow."""
        return sum(run.runner.state_bytes for run in self._runs)

    def export(self) -> dict[str, ExportedStep]:
        """Source → the step of its estimator as a program that runs without jgait, see `online.export`."""
        return {run.source: exported(run.runner.device, self.sampling_rate_hz) for run in self._runs}

    def push(self, time: AnyArray | float, signals: Mapping[str, tuple[AnyArray, AnyArray | None]]) -> News:
        """What one sample or a block of n samples tells.

        Args:
            time: (n,) or one number [s]; must increase from sample to sample and from block to block. Where samples
                are missing, the filters bridge the gap by their predictions; of a gap of more than
                `samples.LONGEST_GAP_S` only that time is bridged.
            signals: placement → (gyr, acc) in the sensor's axes, (n, 3) or (3,) [rad/s], [m/s²]; exactly the
                placements of `placements`. A sample with NaN is lost. acc is None for a sensor without accelerometer.

        Returns:
            What is new, see `News`. Angles are those of the newest sample; strides become known at the next stance.

        Raises:
            ValueError: wrong sensors, wrong shapes, times that do not increase, another sampling rate; or, after the
                first second, other units. The state is then as before the call.
        """
        block = self._clock.block(time, signals)
        results = [run.runner.push(block.rows[:, run.columns]) for run in self._runs]
        self._clock.accept(block)
        every = np.ones(block.time.size, bool)
        news = News(block.time, None, None, {}, every, every, {}, _contacts({}), {}, {})
        for run, now in zip(self._runs, results, strict=True):
            news.lost[run.source] = run.lost(block)
            if run.source != "legs":
                news.strides[run.source] = new = run.strides(now, block.offset)
                news.distance[run.source] = run.walked.add(new.strides)
                continue
            kept, sides = block.kept, run.runner.device.sides
            if now.legs is not None:
                news = news._replace(legs=_legs(now.legs, sides, kept), stddev=_legs(now.stddev, sides, kept))
            news = news._replace(valid=now.valid[kept], stands=now.stands[kept])
            if now.angle is not None:
                news.angles.update({name: now.angle[kept, k] for k, name in enumerate(run.runner.device.placements)})
            if now.distance is not None:
                news.distance["legs"] = float(now.distance[-1])
        return news._replace(contacts=_contacts(news.strides))


class _Run:
    """A source of a session: its estimator, its columns of a block, its strides so far, and the time it lost."""

    def __init__(self, device: Device, placements: tuple[str, ...]) -> None:
        self.source, self.runner, self.walked = device.source, Runner(device), StridesWay(len(device.sides))
        rows = [1 + 8 * placements.index(name) for name in device.placements]
        self.columns = np.concatenate([[0], *(np.arange(row, row + 8) for row in rows)])
        self._seen: float | None = None  # time of the last measured sample [s]
        self._gaps = 0.0  # time in gaps before it [s]
        self._nothing: NewStrides | None = None

    def strides(self, now: LaggedNow, offset: float) -> NewStrides:
        """The strides in the results of n samples of k sensors, in the order in which they became known."""
        at = np.nonzero(now.stride)
        if not at[0].size and self._nothing is not None:
            return self._nothing
        strides, stddev, flags = jax.tree.map(lambda column: column[at], (now.strides, now.stddev, now.flags))
        times = ("start", "final_contact", "end", "standing", "standing_end")
        moved = {name: getattr(strides, name) + offset for name in times if getattr(strides, name) is not None}
        new = NewStrides(strides._replace(**moved), stddev, flags)
        self._nothing = self._nothing or jax.tree.map(lambda column: column[:0], new)
        return new

    def lost(self, block: Block) -> float:
        """Time in gaps longer than a stride may have [s], see `News.lost`, up to the end of a block."""
        time, rates = block.time, self.columns[7::8]  # columns that say whether rates were measured; forces follow
        rows = block.rows[block.kept]
        measured, forces = rows[:, rates] > 0.0, rows[:, rates + 1] > 0.0
        there = measured.all(axis=1) if self.source == "legs" else (measured & forces).any(axis=1)
        known, self._seen = time[there], float(time[0]) if self._seen is None else self._seen
        if known.size:
            gaps = known - np.append(self._seen, known[:-1])
            self._gaps += float(gaps[gaps > LONGEST_LOSS].sum())
            self._seen = float(known[-1])
        gap = float(time[-1]) - self._seen
        return self._gaps + (gap if gap > LONGEST_LOSS else 0.0)


class StridesWay:
    """Distance along strides: the mean over the sides, or that of one where the strides of the other are missing.

    A side is missing whose sensor is stuck or lost for `alone` strides of the other; with a pause or a missed stride
    there are two. Then each stride of the side that is left counts as one of both; of the strides in a row, the first
    has its partner before them.
    """

    def __init__(self, sides: int, alone: int = 3) -> None:
        self._alone = alone
        self._share = 1.0 / sides
        self._side, self._number, self._uncounted = -1, 0, 0.0
        self.total = 0.0  #: [m]

    def add(self, strides: Strides) -> float:
        """The distance after strides (n,) that have become known, in order [m]."""
        ways = of_turns(strides.length, strides.turn)[0] if strides.length.size else ()
        for side, way in zip(strides.side, map(float, ways), strict=True):
            if side != self._side:
                # before the first stride of all, the other side has not had one either
                self._side, self._number, self._uncounted = int(side), int(self._side < 0), 0.0
            self._number += 1
            self.total += self._share * way
            self._uncounted += (1.0 - self._share) * way * (self._number > 1)
            if self._number >= self._alone:
                self.total, self._uncounted = self.total + self._uncounted, 0.0
        return self.total


def _legs(part: LegTrajectory, sides: tuple[int, ...], kept: np.ndarray | slice) -> Legs:
    """Trajectories (n, legs) as both legs, at the samples that were pushed."""
    both: list[LegTrajectory | None] = [None, None]
    for number, side in enumerate(sides):
        both[side] = LegTrajectory(*(values[kept, number] for values in part))
    return Legs(*both)


def _contacts(strides: Mapping[str, NewStrides]) -> NewContacts:
    """Contacts of the strides of the preferred source."""
    table = next((strides[name].strides for name in PREFERRED if name in strides), None)
    if table is None or not table.end.size:
        return NewContacts(np.zeros(0), np.zeros(0, np.int32), np.zeros(0, bool))
    time = np.concatenate([table.final_contact, table.end])
    initial = np.arange(time.size) >= len(table.end)
    order = np.argsort(time, kind="stable")
    return NewContacts(time[order], np.concatenate([table.side, table.side])[order], initial[order])


def _chosen(names: str | Sequence[str] | None, recording: Recording) -> list[tuple[str, str]]:
    """Estimator and source of each device; every one that has its sensors, or those that are asked for."""
    worn, usual = set(recording.sensors), ("foot_ins", "ankle_stride", "leg_ekf")
    asked = usual if names is None else (names,) if isinstance(names, str) else tuple(names)
    chosen: list[tuple[str, str]] = []
    for name in asked:
        if name in OFFLINE:
            raise ValueError(f"{name} has no form sample by sample: {OFFLINE[name]}; there is {', '.join(CAUSAL)}")
        if name not in CAUSAL:
            raise ValueError(f"estimators online are {', '.join(CAUSAL)}; got {name!r}")
        sources = [
            source for source, parts in CAUSAL[name].items()
            if any({f"{part}_{side}" for part in parts} <= worn for side in SIDES)
        ]  # fmt: skip
        if names is not None and not sources:
            raise RecordingError(f"{name} has no sensors; the recording has {sorted(worn)}")
        chosen += [(name, source) for source in sources]
    if {"leg_ekf", "duty_cycled_gyro"} <= set(asked):
        raise ValueError("leg_ekf and duty_cycled_gyro give the same angles: take one of them")
    if not chosen:
        raise RecordingError(
            f"online there are feet, ankles, shanks, and thighs with shanks; the recording has {sorted(worn)}"
        )
    return chosen


def _strides_device(source: str, p: PyTree, recording: Recording) -> Device:
    """The device for a source, "feet", "ankles" or "shanks", of a person who walks in a recording.

    Its constants are the parameters, and the mountings of n sensors, leaves (n, …).

    Raises:
        RecordingError: as `worn` of `foot_ins.online` or `ankle_stride.online`.
    """
    of, site = (foot_online, "foot") if source == "feet" else (ankle_online, source.removesuffix("s"))
    sides = tuple(number for number, side in enumerate(SIDES) if f"{site}_{side}" in recording.sensors)
    names = tuple(f"{site}_{SIDES[number]}" for number in sides)
    alone = recording._replace(sensors={name: recording.sensors[name] for name in names})
    mountings = stacked(*(of.worn(p, alone, SIDES[number]) for number in sides))
    return Device(source, names, (p, mountings), _begin, _advance, of, sides)


def _begin(constants: PyTree, sample: Readings, of: ModuleType) -> PyTree:
    """The state before the first sample, see `Device`; `of` is the estimator's module."""
    p, mountings = constants
    return jax.vmap(lambda worn, gyr, acc: of.begin(p, worn, gyr, acc))(mountings, sample.gyr, sample.acc)


def _advance(
    constants: PyTree, state: PyTree, samples: Readings, count: Counts, of: ModuleType
) -> tuple[PyTree, PyTree]:
    """A block of samples, see `Device`."""
    p, mountings = constants
    return jax.vmap(
        lambda worn, before, gyr, acc, there: of.over(p, worn, before, gyr, acc, there, count),
        in_axes=(0, 0, 1, 1, 1), out_axes=(0, 1),
    )(mountings, state, samples.gyr, samples.acc, samples.turned & samples.acc_measured)  # fmt: skip


def online(
    calibration: Recording,
    person: Mapping[str, PyTree] | None = None,
    estimators: str | Sequence[str] | None = None,
    params: Mapping[str, PyTree] | None = None,
) -> Online:
    """The estimators of a person's sensors, sample by sample: push a sample or a block, get what is new.

    Each is the filter of its estimator without smoothing; events are detected causally. Axes, signs and errors of the
    sensors come from a recording of the same person with the same sensors, in which they stand still for a second and
    then walk a few strides. Sensors that are worn otherwise afterwards are not noticed, and make angles wrong: record a
    new calibration. The filters are compiled here, which takes seconds, so that the first `push` does not wait.

    Args:
        calibration: that recording; estimators whose sensors it has are run, at its sampling rate.
        person: measures of the person, as of `jgait.analyse`.
        estimators: names of estimators, of "foot_ins", "ankle_stride", "leg_ekf" (every one that has its sensors by
            default) and "duty_cycled_gyro" (instead of "leg_ekf", for gyroscopes that are off at times: push NaN).
        params: name of an estimator → its parameters, for example tuned ones; default: the usual ones.

    Raises:
        RecordingError: no sensors of these estimators, or a recording that does not show how they are worn.
        ValueError: an estimator without such a form, or a parameter outside its range.
    """
    body, settings = dict(person or {}), dict(params or {})
    devices: list[Device] = []
    notes: list[Note] = []
    for name, source in _chosen(estimators, calibration):
        record = get(name)
        wanted = MEASURES.get(name, ("thigh_length", "shank_length"))
        takes = (*wanted, "height") if gives(wanted) else wanted
        p = record.with_body(settings.get(name, record.params), {k: value for k, value in body.items() if k in takes})
        check_params(p, record.transforms)
        if source == "legs":
            device, more = (legs if name == "leg_ekf" else duty).device(p, calibration)
            notes += more
        else:
            device = _strides_device(source, p, calibration)
        devices.append(device)
    return Online(devices, calibration.sampling_rate_hz, tuple(dict.fromkeys(notes)))
