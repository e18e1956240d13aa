"""A person's sensors, sample by sample: what each new block of samples tells."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import PyTree

from jgait.estimators import get
from jgait.estimators.combined.sources import MEASURES
from jgait.estimators.lagged import LaggedNow
from jgait.estimators.online import duty, legs, strides
from jgait.estimators.online.device import Device, Runner
from jgait.estimators.online.distance import LostTime, StridesWay
from jgait.estimators.online.export import ExportedStep, exported
from jgait.estimators.online.samples import Pushes
from jgait.estimators.proportions import gives
from jgait.notes import Note, record
from jgait.params import check_params
from jgait.types import SIDES, AnyArray, Legs, LegTrajectory, Recording, RecordingError, Strides

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
        self._runners = [Runner(device) for device in devices]
        self.placements = tuple(sorted({name for device in devices for name in device.placements}))
        self.sampling_rate_hz = sampling_rate_hz
        self.sources = tuple(device.source for device in devices)
        self.notes = notes
        self._clock = Pushes(self.placements, sampling_rate_hz)
        self._walked = {device.source: StridesWay(len(device.sides)) for device in devices}
        self._lost = {device.source: LostTime() for device in devices}
        rows = {name: 1 + 8 * number for number, name in enumerate(self.placements)}
        self._columns = [
            np.concatenate([[0], *(np.arange(rows[name], rows[name] + 8) for name in device.placements)])
            for device in devices
        ]

    @property
    def state_bytes(self) -> int:
        """Memory of all states between two samples [bytes]; it does not grow."""
        return sum(runner.state_bytes for runner in self._runners)

    def export(self) -> dict[str, ExportedStep]:
        """Source → the step of its estimator as a program that runs without jgait, see `online.export`."""
        return {runner.device.source: exported(runner.device, self.sampling_rate_hz) for runner in self._runners}

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
        results = [
            runner.push(block.rows[:, columns]) for runner, columns in zip(self._runners, self._columns, strict=True)
        ]
        self._clock.accept(block)
        samples, kept = block.time.size, block.kept
        news = News(
            block.time, None, None, {}, np.ones(samples, bool), np.ones(samples, bool), {}, _contacts({}), {}, {}
        )
        for runner, columns, now in zip(self._runners, self._columns, results, strict=True):
            source, placements, sides = runner.device.source, runner.device.placements, runner.device.sides
            measured = block.rows[kept][:, columns[1:]].reshape(samples, -1, 8)[:, :, 6:] > 0.0
            there = measured[:, :, 0].all(axis=1) if source == "legs" else measured.all(axis=2).any(axis=1)
            news.lost[source] = self._lost[source].after(block.time, there)
            if source != "legs":
                new = news.strides[source] = _strides(now, block.offset)
                news.distance[source] = self._walked[source].add(new.strides)
                continue
            if now.legs is not None:
                news = news._replace(legs=_legs(now.legs, sides, kept), stddev=_legs(now.stddev, sides, kept))
            news = news._replace(valid=now.valid[kept], stands=now.stands[kept])
            if now.angle is not None:
                news.angles.update({name: now.angle[kept, k] for k, name in enumerate(placements)})
            if now.distance is not None:
                news.distance["legs"] = float(now.distance[-1])
        return news._replace(contacts=_contacts(news.strides))


def _legs(part: LegTrajectory, sides: tuple[int, ...], kept: np.ndarray | slice) -> Legs:
    """Trajectories (n, legs) as both legs, at the samples that were pushed."""
    both: list[LegTrajectory | None] = [None, None]
    for number, side in enumerate(sides):
        both[side] = LegTrajectory(*(values[kept, number] for values in part))
    return Legs(*both)


def _strides(now: LaggedNow, offset: float) -> NewStrides:
    """The strides in the results of n samples of k sensors, in the order in which they became known."""
    at = np.nonzero(now.stride)
    strides, stddev, flags = jax.tree.map(lambda column: column[at], (now.strides, now.stddev, now.flags))
    times = ("start", "final_contact", "end", "standing", "standing_end")
    moved = {name: getattr(strides, name) + offset for name in times if getattr(strides, name) is not None}
    return NewStrides(strides._replace(**moved), stddev, flags)


def _contacts(strides: Mapping[str, NewStrides]) -> NewContacts:
    """Contacts of the strides of the preferred source."""
    table = next((strides[name].strides for name in PREFERRED if name in strides), None)
    if table is None:
        return NewContacts(np.zeros(0), np.zeros(0, np.int32), np.zeros(0, bool))
    time = np.concatenate([table.final_contact, table.end])
    initial = np.arange(time.size) >= len(table.end)
    order = np.argsort(time, kind="stable")
    return NewContacts(time[order], np.concatenate([table.side, table.side])[order], initial[order])


def _chosen(names: str | Sequence[str] | None, recording: Recording) -> list[tuple[str, str]]:
    """Estimator and source of each device; every one that has its sensors, or those that are asked for."""
    worn = set(recording.sensors)
    there = {
        name: [
            source for source, parts in every.items() if any({f"{part}_{s}" for part in parts} <= worn for s in SIDES)
        ]
        for name, every in CAUSAL.items()
    }
    asked = (names,) if isinstance(names, str) else names
    for name in asked or ():
        if name in OFFLINE:
            raise ValueError(f"{name} has no form sample by sample: {OFFLINE[name]}; there is {', '.join(CAUSAL)}")
        if name not in CAUSAL:
            raise ValueError(f"estimators online are {', '.join(CAUSAL)}; got {name!r}")
        if not there[name]:
            raise RecordingError(f"{name} has no sensors; the recording has {sorted(recording.sensors)}")
    if asked is not None and {"leg_ekf", "duty_cycled_gyro"} <= set(asked):
        raise ValueError("leg_ekf and duty_cycled_gyro give the same angles: take one of them")
    usual = ("foot_ins", "ankle_stride", "leg_ekf")
    chosen = [(name, source) for name in (usual if asked is None else asked) for source in there[name]]
    if not chosen:
        raise RecordingError(
            "online there are feet, ankles, shanks, and thighs with shanks; the recording has "
            f"{sorted(recording.sensors)}"
        )
    return chosen


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
            device = strides.device(source, p, calibration)
        devices.append(device)
    return Online(devices, calibration.sampling_rate_hz, tuple(dict.fromkeys(notes)))
