"""For every registered estimator two short walks, prepared and padded to one length, for the laws that all keep."""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np
from made import footsteps, trunk
from made.foot import foot
from made.shank import shank

from experiments.common import protocols
from jgait import estimators, simulate
from jgait.duty_cycle.power import Schedule
from jgait.estimators import duty_cycled_gyro, leg_ekf, stride_width_ekf
from jgait.estimators.ankle_stride import AnkleOptions
from jgait.estimators.interface import pad
from jgait.simulate.sensors import IDG300
from jgait.types import Imu, Recording


class Case(NamedTuple):
    """Two walks as an estimator takes them.

    Attributes:
        params: of the estimator.
        inputs: of two walks, padded to one length; both share the options.
        samples: of each walk without padding.
        options: of the compiled program.
        light: the same options, as far as derivatives are computed within seconds.
        idle: beginnings of names of the parameters that these walks do not reach.
        rounding: how far single precision may be from double [m or rad].
        recording: the first walk as a recording, or None where the inputs are not made of one.
        prepare: a recording → what the estimator prepares.
        prepared: what the estimator prepared of both walks.
    """

    params: Any
    inputs: tuple[Any, ...]
    samples: tuple[int, ...]
    options: Any
    light: Any
    idle: tuple[str, ...] = ()
    rounding: float = 2e-3
    recording: Recording | None = None
    prepare: Callable[[Recording], Any] | None = None
    prepared: tuple[Any, ...] = ()


def _case(
    name: str, recordings: tuple[Recording, ...], samples: int, idle: tuple[str, ...] = (), rounding: float = 2e-3,
    light: bool = False, **settings: Any,
) -> Case:  # fmt: skip
    record = estimators.get(name, **settings)
    ready = [record.prepare(recording) for recording in recordings]
    assert len({made.options for made in ready}) == 1
    lengths = tuple(len(made.inputs.time) for made in ready)
    inputs = tuple(pad(made.inputs, samples) for made in ready)
    options = ready[0].options
    return Case(
        record.params, inputs, lengths, options, options._replace(smooth=False) if light else options, idle, rounding,
        recordings[0], record.prepare, tuple(ready),
    )  # fmt: skip


@functools.cache
def leg_walks() -> tuple[Recording, ...]:
    """Two people with sensors on both thighs and shanks, five seconds of walking."""
    walks = protocols.udaya_shankar(jax.random.key(0), 2, 5.0, placements=simulate.FOUR, errors=IDG300)
    return tuple(walk.recording for walk in walks)


def only(recording: Recording, *placements: str) -> Recording:
    """The recording with some of its sensors."""
    return recording._replace(sensors={name: recording.sensors[name] for name in placements})


def changed(recording: Recording, **sensors: Any) -> Recording:
    """The recording with other sensors at some places."""
    return recording._replace(sensors={**recording.sensors, **sensors})


def exchanged(recording: Recording, one: str, other: str) -> Recording:
    """The recording with two sensors that have changed places."""
    return changed(recording, **{one: recording.sensors[other], other: recording.sensors[one]})


def in_a_row(*recordings: Recording) -> Recording:
    """One recording behind the other, with all sensors of the first."""
    sensors = {}
    for place in recordings[0].sensors:
        _, *parts = zip(*(recording.sensors[place] for recording in recordings), strict=True)
        gyr, acc, mask = (np.concatenate(part) for part in parts)
        sensors[place] = Imu(np.arange(len(mask)) / recordings[0].sampling_rate_hz, gyr, acc, mask)
    return recordings[0]._replace(sensors=sensors)


def _leg_ekf() -> Case:
    """By kinematics: the strapdown of the shanks is `ankle_stride`, which keeps these laws itself."""
    options = leg_ekf.DEFAULT._replace(distance="stance")
    return _case("leg_ekf", leg_walks(), 640, idle=("lever_shank", "distance_noise"), light=True, options=options)


def _duty_cycled_gyro() -> Case:
    options = duty_cycled_gyro.DutyCycledOptions(schedule=Schedule(2, 2, 0.25), warm_up=6.0)
    walks = tuple(only(walk, "shank_right") for walk in leg_walks())
    return _case(
        "duty_cycled_gyro",
        walks,
        640,
        options=options,
        idle=(
            "thigh_length",
            "thigh_place",
            "shank_length.left",
            "standing_hip_sd",
            "standing_knee_sd",
            "filler.thigh",
        ),
        rounding=9e-3,
    )


def _foot_ins() -> Case:
    made = (foot(strides=3, roll=0.03, seed=1), foot(strides=3, length=0.9, rest=1.4, seed=2))
    return _case("foot_ins", tuple(one.recording for one in made), 700, rounding=5e-4, light=True)


def _ankle_stride(**settings: Any) -> Case:
    made = (shank(seed=4, turns=0.1), shank(strides=3, length=0.9))
    idle = ("lever_ankle", "gyr_bias_unknown")
    return _case("ankle_stride", tuple(one.recording for one in made), 700, idle=idle, light=True, **settings)


@functools.cache
def _trunks() -> tuple[Recording, ...]:
    bent = trunk.walk(np.pi).recording
    return bent, trunk.cut(bent, 5.0, 11.0)


def _stride_width_ekf() -> Case:
    walks = [footsteps.drifting(footsteps.footsteps(seed, before=9, turn=2, after=5), seed) for seed in (3, 4)]
    ready = [stride_width_ekf.prepare_from_feet(w.time, w.feet, w.mids, w.read) for w in walks]
    samples = max(len(made.inputs.time) for made in ready) + 12
    options = stride_width_ekf.DEFAULT
    inputs = tuple(pad(made.inputs, samples) for made in ready)
    lengths = tuple(len(made.inputs.time) for made in ready)
    return Case(
        stride_width_ekf.WidthParams(),
        inputs,
        lengths,
        options,
        options,
        idle=("usual_", "passing_share", "people_noise"),
        prepared=tuple(made._replace(options=options) for made in ready),
    )


CASES: dict[str, Callable[[], Case]] = {
    "leg_ekf": _leg_ekf,
    "foot_ins": _foot_ins,
    "stride_width_ekf": _stride_width_ekf,
    "ankle_stride": _ankle_stride,
    "waist": lambda: _case("waist", _trunks(), 1024),
    # A distance that is integrated twice, of 13 m, keeps half a centimetre of rounding in single precision.
    "waist_ofdri": lambda: _case("waist_ofdri", _trunks(), 1024, idle=("update.highest_hz",), rounding=1e-2),
    "duty_cycled_gyro": _duty_cycled_gyro,
}

OTHER_OPTIONS: dict[str, Callable[[], Case]] = {
    **{
        f"ankle_stride {length}": functools.partial(_ankle_stride, options=AnkleOptions(length=length))
        for length in ("3d", "sl1", "sl2")
    },
}
"""Estimators with other options, for the laws of gradients."""


# --- the same walks with other values where there is no measurement ---


def masked(imu: Imu, mask: np.ndarray) -> Imu:
    """The sensor without the samples where a mask is False, with 0 in their place."""
    gyr, acc = (np.where(mask[:, None], values, 0.0) for values in (imu.gyr, imu.acc))
    return imu._replace(gyr=gyr, acc=acc, mask=mask)


def altered(recording: Recording, *placements: str, **changes: Callable[[Any], Any]) -> Recording:
    """The recording with fields of some sensors, or of all, changed by functions."""
    sensors = {
        name: imu._replace(**{field: change(getattr(imu, field)) for field, change in changes.items()})
        if name in (placements or recording.sensors) else imu
        for name, imu in recording.sensors.items()
    }  # fmt: skip
    return recording._replace(sensors=sensors)


def hidden(recording: Recording, lost: np.ndarray, *placements: str, value: float = 0.0) -> Recording:
    """The recording without some samples (T,) bool of some sensors, or of all, with some value in their place."""

    def gone(values: np.ndarray) -> np.ndarray:
        return np.where(lost[:, None], value, values)

    return altered(recording, *placements, gyr=gone, acc=gone, mask=lambda mask: np.asarray(mask, bool) & ~lost)


def times(recording: Recording) -> np.ndarray:
    """Times of its first sensor's samples [s]."""
    return np.asarray(next(iter(recording.sensors.values())).time)


def lossy(recording: Recording, value: float) -> Recording:
    """The recording without 4 samples in the middle of all signals, with some value in their place."""
    count = len(times(recording))
    return hidden(recording, np.isin(np.arange(count), count // 2 + np.arange(4)), value=value)


def without(recording: Recording, begin: float, seconds: float, *placements: str) -> Recording:
    """The recording without a stretch [s] of some sensors, or of all."""
    time = times(recording)
    return hidden(recording, (time >= begin) & (time < begin + seconds), *placements)


def part(recording: Recording, rows: slice) -> Recording:
    """The recording with some of its samples; the stated rate stays."""
    sensors = {
        name: type(imu)(*(None if field is None else field[rows] for field in imu))
        for name, imu in recording.sensors.items()
    }
    return recording._replace(sensors=sensors)


def behind(samples: int, size: int) -> np.ndarray:
    return np.arange(size) >= samples


HIDDEN = {"measured": ("gyr", "acc"), "range_measured": ("distance",), "on": ("gyr",)}
"""Field of the inputs that is a mask → fields that have no value where the mask is False."""


def bridged(record: Any) -> bool:
    """Whether the inputs have rates that stand for the lost ones, so that only the specific force is hidden."""
    return "lost" in record._fields and "gyr" in record._fields


def with_values(record: Any, where: np.ndarray | None, value: float) -> Any:
    """Inputs with another value of every signal where a flag is True; None: where its own mask hides it."""
    changed = {}
    for mask, hidden in HIDDEN.items():
        if mask in record._fields:
            there = where if where is not None else ~np.asarray(getattr(record, mask))
            for field in hidden[bridged(record) :]:
                values = np.asarray(getattr(record, field))
                changed[field] = np.where(there.reshape(-1, *(1,) * (values.ndim - 1)), value, values)
    if not changed and where is not None and "gyr" in record._fields:
        changed = {
            field: np.where(where[:, None], value, np.asarray(getattr(record, field))) for field in ("gyr", "acc")
        }
    inner = {field: value_ for field, value_ in record._asdict().items() if hasattr(value_, "_fields")}
    return record._replace(**changed, **{field: with_values(part, where, value) for field, part in inner.items()})
