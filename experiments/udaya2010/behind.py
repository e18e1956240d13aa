"""Errors of the shin's angle behind the Kalman filters when its gyroscope is off part of the time.

Only shin gyroscopes are switched off: two strides are measured from the leg's first swing, then units of half a stride,
begun at several places of their period. Errors count from then to the walk's end. Against motion capture or the
simulator both sides are taken relative to standing, so the foot's sensor may be put on at any angle.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from experiments.common.recordings import available
from experiments.common.row import Row, show
from experiments.udaya2010 import literal as printed_filters
from experiments.udaya2010.fillers import fillers
from experiments.udaya2010.walked import Walked, neura, people
from jgait.duty_cycle.filling import HELD, Thigh
from jgait.estimators import duty_cycled_gyro
from jgait.estimators.duty_cycled_gyro import model as duty_model
from jgait.estimators.duty_cycled_gyro.params import DutyInputs, PlanarSegment
from jgait.estimators.interface import pad
from jgait.estimators.leg_ekf import one_side
from jgait.types import SIDES, as_float, leg_of

DUTIES = (50, 10)
FILLERS = ("replicate", "neighbours", "blend")
QUICK_FILLERS = ("blend",)


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


_RUN = jax.jit(duty_model.run)
_PRINTED = jax.jit(printed_filters.run)


class _Shin(NamedTuple):
    """Angle [rad] and rate [rad/s] of the shank behind the filters, each (T,), and the standing samples."""

    angle: np.ndarray
    rate: np.ndarray
    standing: tuple[int, int]


def _filtered(one: Walked, filler: str, literal: bool, on: Mapping[str, np.ndarray] | None) -> dict[str, _Shin]:
    """Side → the shin behind the filters; filled rates with the noise that `duty_cycled_gyro` gives them."""
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
        measured = always if on is None else np.asarray(shank.on & on[f"shank_{side}"])
        known, rates = jnp.stack([always, measured]), jnp.stack([thigh.turn, shank.turn])
        turning = duty_model.turning(rates, known, inputs.dt, duty_model.no_turn(rates))[1]
        rate, filled, seen = shank.gyr - shank.bias, zero, always
        if on is not None:
            above = Thigh(thigh.gyr - thigh.bias, thigh.acc)
            way = fillers()[filler]
            told = way.fill(np.where(measured, rate, 0.0), measured, shank.acc, rate_hz, way.params, thigh=above)
            rate, seen = np.asarray(told.rate), np.asarray(told.how) != HELD
            filled = np.where(measured, 0.0, usual.filled_noise**2 * np.asarray(told.unlike))
        segments = [
            PlanarSegment(
                values, part.acc[:, 0], part.acc[:, 2], always, there,
                duty_model.excess(usual.turn_tilt, turning, inputs.dt, more), part.bias, part.variance,
            )
            for part, values, there, more in (
                (thigh, thigh.gyr, always, zero), (shank, rate + shank.bias, seen, filled)
            )
        ]  # fmt: skip
        told = DutyInputs(*segments, inputs.time, inputs.dt, inputs.still, inputs.valid, inputs.start_variance)
        padded = pad(told, 1024 * (1 + len(inputs.time) // 1024))
        p = one_side(usual, number)
        got = (_PRINTED if literal else _RUN)(p, padded).shank
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


def rows(quick: bool) -> list[Row]:
    """Errors behind the corrected filters and behind the printed ones."""
    rows: list[Row] = []
    sets = {"simulation": people(1 if quick else 2)}
    if not quick and available("neura_sparse"):
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
