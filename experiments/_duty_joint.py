"""What is left of the errors in the angles behind the filters, and of the knee's angle that `leg_ekf` tells.

Only shin gyroscopes sleep: two strides are measured from the leg's first swing, then units of half a stride, begun at
several places of their period. Errors count from then to the walk's end. Against motion capture or the simulator both
sides are taken relative to standing, so the foot's sensor may be put on at any angle.
"""

import functools
from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import numpy as np
from _duty_legs import RATE_HZ, SWINGING, sagittal, stride_samples
from common import Row, show

from jgait import datasets
from jgait.duty_cycle import power
from jgait.duty_cycle.fillers.base import Thigh, fillers
from jgait.duty_cycle.power_tradeoff import Plan, Shank, masks_of
from jgait.duty_cycle.recording import fill_recording
from jgait.estimators import duty_cycled_gyro, leg_ekf
from jgait.estimators.duty_cycled_gyro import model as duty_model
from jgait.estimators.duty_cycled_gyro import model_params as duty_params
from jgait.estimators.duty_cycled_gyro.model_params import LITERAL, DutyInputs, PlanarSegment
from jgait.estimators.duty_cycled_gyro.params import filter_params, one_side
from jgait.mounting import shank as shank_axes
from jgait.simulate import protocols
from jgait.types import SIDES, Estimate, Recording, as_float, leg_of

DUTIES = (50, 10)
FILLERS = ("replicate", "neighbours", "blend")
QUICK_FILLERS = ("blend",)


class Walked(NamedTuple):
    """A recording whose shins sleep.

    Attributes:
        recording: never asleep.
        truth: angles as another measurement or the simulator has them.
        standing: half-open range of the truth's samples.
        begin: side → sample from which the shin sleeps.
        strides: side → [s].
        end: sample at which the walk ends.
    """

    recording: Recording
    truth: Estimate
    standing: tuple[int, int]
    begin: dict[str, int]
    strides: dict[str, float]
    end: int

    def on(self, duty: int, phase: float = 0.0) -> dict[str, np.ndarray]:
        """Placement → (T,) when its gyroscope is on, under a schedule of half strides begun at a part of its period."""
        found = {}
        for side, begin in self.begin.items():
            schedule = power.schedule_of_duty(duty / 100, 0.5 * self.strides[side])
            samples = len(self.recording.sensors[f"shank_{side}"].time)
            worn = Shank(np.zeros(samples), None, begin, self.strides[side])
            plan = Plan(0.5 * schedule.on, 0.5 * schedule.off)
            found[f"shank_{side}"] = masks_of(plan, worn, self.recording.sampling_rate_hz, phase).usable
        return found


def walked(recording: Recording, truth: Estimate, window: tuple[int, int], standing: tuple[int, int]) -> Walked:
    """Its first swings and strides, told from the gyroscopes while they are on."""
    begin, strides = {}, {}
    rate_hz = recording.sampling_rate_hz
    for side in SIDES:
        if f"shank_{side}" in recording.sensors:
            signals = sagittal(recording, shank_axes.worn_on_shank(recording, side)[0])
            first, last = (round(edge / rate_hz * RATE_HZ) for edge in window)
            rate = signals[first:last, 0]
            stride = stride_samples(rate[20:])
            judged = first + int(np.argmax(np.abs(rate) > SWINGING)) + 2 * stride
            begin[side], strides[side] = round(judged / RATE_HZ * rate_hz), stride / RATE_HZ
    return Walked(recording, truth, standing, begin, strides, window[1])


def neura() -> list[Walked]:
    """`neura_sparse`, both legs."""
    walk = datasets.load("neura_sparse")[0]
    windows = walk.info["windows"]
    return [walked(walk.recording, walk.reference, windows["whole"], windows["standing"])]


def _complete(recording: Recording) -> Recording:
    """The recording with its lost samples, one in a hundred, interpolated, so that only what sleeps is missing."""
    sensors = {
        name: shank_axes.filled(imu)._replace(mask=np.ones(len(imu.time), bool))
        for name, imu in recording.sensors.items()
    }
    return recording._replace(sensors=sensors)


@functools.cache
def people(count: int) -> tuple[Walked, ...]:
    """Simulated people after the paper: thigh and shin of the right leg."""
    found = []
    for one in protocols.udaya_shankar(jax.random.key(9), count):
        truth = one.truth.estimate
        knee = np.abs(np.gradient(as_float(truth.legs.right.knee_angle), as_float(truth.time)))
        moving = np.flatnonzero(knee > SWINGING)
        scale = one.recording.sampling_rate_hz * float(truth.time[1] - truth.time[0])
        window = (max(0, round(moving[0] * scale) - 10), round(moving[-1] * scale))
        found.append(walked(_complete(one.recording), truth, window, (0, max(1, moving[0] - 20))))
    return tuple(found)


def _rms(values: Any) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _rms_deg(values: Any) -> float:
    return float(np.degrees(_rms(values)))


def _true_angle(one: Walked, side: str) -> np.ndarray:
    """The shank's angle from the vertical at the recording's samples, relative to standing [rad]."""
    leg = leg_of(one.truth.legs, side)
    angle = as_float(leg.hip_angle) - as_float(leg.knee_angle)
    time = as_float(one.recording.sensors[f"shank_{side}"].time)
    return np.interp(time, as_float(one.truth.time), angle - angle[slice(*one.standing)].mean())


_RUN = jax.jit(duty_model.run, static_argnames="options")


class _Shin(NamedTuple):
    """Angle [rad] and rate [rad/s] of the shank behind the filters, each (T,), and the standing samples."""

    angle: np.ndarray
    rate: np.ndarray
    standing: tuple[int, int]


def _filtered(one: Walked, filler: str, literal: bool, on: Mapping[str, np.ndarray] | None) -> dict[str, _Shin]:
    """Side → the shin behind the filters; filled rates with their own noise, as `duty_cycled_gyro` has it."""
    usual = duty_cycled_gyro.DutyCycledParams()
    prepared = duty_cycled_gyro.prepared(one.recording)
    inputs, rate_hz = prepared.inputs, one.recording.sampling_rate_hz
    found = {}
    for number, side in enumerate(SIDES):
        leg = getattr(inputs, side)
        if leg is None:
            continue
        thigh, shank = leg
        zero, always = np.zeros_like(inputs.time), np.ones(len(inputs.time), bool)
        rate, excess = shank.gyr - shank.bias, zero
        if on is not None:
            usable = shank.on & on[f"shank_{side}"]
            above = Thigh(thigh.gyr - thigh.bias, thigh.acc)
            way = fillers()[filler]
            told = way.fill(np.where(usable, rate, 0.0), usable, shank.acc, rate_hz, way.params, thigh=above)
            rate, excess = np.asarray(told.rate), np.where(usable, 0.0, usual.filled_noise**2 * rate_hz)
        segments = [
            PlanarSegment(values, part.acc[:, 0], part.acc[:, 1], always, always, more, part.bias, part.variance)
            for part, values, more in ((thigh, thigh.gyr, zero), (shank, rate + shank.bias, excess))
        ]
        told = DutyInputs(*segments, inputs.time, inputs.dt, inputs.still, inputs.valid, inputs.start_variance)
        padded = duty_params.pad(told, 1024 * (1 + len(inputs.time) // 1024))
        p = filter_params(one_side(usual, number))
        got = _RUN(p, padded, options=LITERAL if literal else duty_params.DEFAULT).shank
        part = slice(0, len(inputs.time))
        found[side] = _Shin(np.asarray(got.angle)[part], np.asarray(got.rate)[part], prepared.standing)
    return found


class _Errors(NamedTuple):
    """Angle against always on [°], rate against always on over its size [1], angle against the truth [°]."""

    angle: float
    rate: float
    truth: float


def _errors(one: Walked, found: dict[str, _Shin], always: dict[str, _Shin]) -> list[_Errors]:
    rows = []
    for side, begin in one.begin.items():
        part, own, usual = slice(begin, one.end), found[side], always[side]
        away = (own.angle - own.angle[slice(*own.standing)].mean() - _true_angle(one, side))[part]
        rate_error = _rms((own.rate - usual.rate)[part]) / _rms(usual.rate[part])
        rows.append(_Errors(_rms_deg((own.angle - usual.angle)[part]), rate_error, _rms_deg(away)))
    return rows


def behind(quick: bool) -> list[Row]:
    """Errors behind the corrected filters and behind the printed ones."""
    rows: list[Row] = []
    sets = {"simulation": people(1 if quick else 2)}
    if datasets.available("neura_sparse") and not quick:
        sets["neura_sparse"] = tuple(neura())
    for name, walks in sets.items():
        always = [_filtered(one, "neighbours", False, None) for one in walks]
        literal = always if quick else [_filtered(one, "neighbours", True, None) for one in walks]
        cases: list[tuple[str, str, int | None, bool]] = [("always_on", "neighbours", None, False)]
        used, duties = (QUICK_FILLERS, DUTIES[:1]) if quick else (FILLERS, DUTIES)
        cases += [(f"{filler}_duty{duty}", filler, duty, False) for filler in used for duty in duties]
        if not quick:
            cases += [("literal_always_on", "neighbours", None, True)]
            cases += [("literal_replicate_duty50", "replicate", 50, True)]
        lines = []
        for label, filler, duty, printed in cases:
            found = []
            for one, usual, own in zip(walks, always, literal, strict=True):
                told = own if printed else usual
                if duty is not None:
                    told = _filtered(one, filler, printed, one.on(duty))
                found += _errors(one, told, usual)
            middle = [float(np.median(column)) for column in zip(*found, strict=True)]
            lines.append([label, *middle])
            words = f"{name}, {'printed' if printed else 'corrected'} filters; thigh always on; median of legs"
            ends = (("angle_deg", "°"), ("rate", "ratio"), ("truth_deg", "°"))
            rows += [
                Row(f"filter_{name}_{label}_{end}", value, unit, None, len(found), words)
                for (end, unit), value in zip(ends, middle, strict=True)
                if duty is not None or printed or end == "truth_deg"
            ]
        columns = ["", "angle, to always on [°]", "rate, to always on [1]", "angle, to the truth [°]"]
        show(f"{name}: shin behind the Kalman filters, after two strides", columns, lines)
    return rows


class _Knee(NamedTuple):
    """Root mean square of the knee's angle [°]: to motion capture and to the estimate always on; right, left."""

    truth: np.ndarray
    always: np.ndarray


def _knees(one: Walked, found: Estimate, always: Estimate) -> _Knee:
    def relative(estimate: Estimate, side: str) -> np.ndarray:
        time, knee = as_float(one.truth.time), as_float(leg_of(estimate.legs, side).knee_angle)
        told = np.interp(time, as_float(estimate.time), knee)
        return (told - told[slice(*one.standing)].mean())[one.begin[side] : one.end]

    pairs = [[relative(found, side) - relative(other, side) for side in SIDES] for other in (one.truth, always)]
    return _Knee(*(np.array([_rms_deg(off) for off in pair]) for pair in pairs))


def joint(quick: bool) -> list[Row]:
    """`leg_ekf`'s knee angle on `neura_sparse` with both shin gyroscopes asleep part of the time."""
    if not datasets.available("neura_sparse"):
        return []
    one = neura()[0]
    walk = datasets.load("neura_sparse")[0]
    p = leg_ekf.with_body(leg_ekf.LegParams(), datasets.body(walk))
    always = leg_ekf.estimate(p, one.recording)
    late = one._replace(begin=dict.fromkeys(SIDES, walk.info["windows"]["straight_2"][0]))
    starts = {"": (one, "from two strides on, U-turn included"), "_straight": (late, "from the U-turn's end on")}
    if quick:
        del starts["_straight"]
    rows: list[Row] = []
    lines: list[list[Any]] = []
    phases = (0.0,) if quick else (0.0, 0.5)
    cases = [(duty, "blend") for duty in ((50,) if quick else (50, 20))]
    for end, (part, words) in starts.items():
        before = _knees(part, always, always)
        lines.append([f"always on, {words}", *map(float, np.concatenate(before))])
        split = f"neura_sparse, {words}, untuned; mean of legs and of places where the schedule begins"
        usual = float(before.truth.mean())
        rows.append(Row(f"joint_knee_deg_always_on{end}", usual, "°", None, 2, f"neura_sparse, {words}, untuned"))
        for duty, filler in cases:
            found = []
            for phase in phases:
                asleep = fill_recording(one.recording, gyro_on=part.on(duty, phase), filler=filler)
                found.append(_knees(part, leg_ekf.estimate(p, asleep), always))
            mean = _Knee(*(np.mean(values, axis=0) for values in zip(*found, strict=True)))
            lines.append([f"  duty {duty} %, {filler}", *map(float, np.concatenate(mean))])
            lost, what = mean.truth - before.truth, f"{split}; {filler} with the thigh, causal"
            name = f"{end}{'' if filler == 'blend' else '_' + filler}_duty{duty}"
            count = len(phases)
            rows.append(Row(f"joint_knee_deg_lost{name}", float(lost.mean()), "°", None, count, what))
            rows += [
                Row(f"joint_knee_deg_lost{name}_{side}", float(value), "°", None, count, what)
                for side, value in zip(SIDES, lost, strict=True)
            ]
            apart = float(mean.always.mean())
            rows.append(Row(f"joint_knee_deg_to_always_on{name}", apart, "°", None, count, what))
    columns = ["", *(f"to {other}, {side} [°]" for other in ("motion capture", "always on") for side in SIDES)]
    show("leg_ekf's knee on neura_sparse, both shin gyroscopes asleep part of the time", columns, lines)
    return rows
