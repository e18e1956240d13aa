"""Strides of the shanks from prepared inputs."""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from jgait import filtering, quality
from jgait.estimators.ankle_stride import model as ankle_model
from jgait.estimators.ankle_stride import readout as ankle_strides
from jgait.estimators.ankle_stride.about import ABOUT
from jgait.estimators.ankle_stride.model import AnkleControl, AnkleError, AnkleObservation
from jgait.estimators.ankle_stride.params import DEFAULT, KNOWN, AnkleOptions, AnkleParams, with_body
from jgait.estimators.ankle_stride.prepare import AnkleInputs, AnkleSignals, prepare
from jgait.estimators.ankle_stride.readout import FLAGS
from jgait.estimators.checks import check_options, mean_over_interval
from jgait.estimators.foot_ins.model import AGAIN, FootControl, FootModelParams
from jgait.estimators.interface import Estimator, Prepared, pad
from jgait.estimators.notes import LEVER_IMPLAUSIBLE, RATES_OFF
from jgait.estimators.programs import bucket, compiled
from jgait.estimators.walking import along, cut_notes, cut_off, of_turns
from jgait.filtering import Belief
from jgait.geometry.arrays import for_each, stacked, xp
from jgait.geometry.rotation import quaternion, rotated
from jgait.geometry.vectors import as_array, cross, dot, root, subtract, vector
from jgait.quality import SensorQuality, merged
from jgait.quality.evidence import nis_between, of_estimate
from jgait.signal import butterworth
from jgait.types import SIDES, Counts, Estimate, Flags, Legs, Recording, Strides, Values

PER_STRIDE = (*FLAGS, "stride_nis")
"""Diagnostics with an entry for each stride."""

_LEVER = ("lever_ankle", "lever_shank", "lever_forward", "lever_left")
_PENDULUM = ("leg_length", "angle_gain", "time_gain")
_STATED = ("stride_noise", "lever_turn_sd", "distance_noise")
_FILTER = tuple(n for n in AnkleParams._fields if n not in (*_LEVER, *_PENDULUM, *_STATED, "cutoff_hz"))
UNUSED = {
    "filter": _PENDULUM,
    "3d": (*_FILTER, *_PENDULUM, *_STATED),
    "sl1": (*_FILTER, *_STATED, "angle_gain", "time_gain"),
    "sl2": (*_FILTER, *_STATED),
}
"""Method → parameters on which no number of the estimate depends, so that their gradient is zero."""


def filtered(
    p: AnkleParams, leg: PyTree, readings: tuple[Values, Values, Values], stands: Flags, initial: Belief,
    options: AnkleOptions, keep: tuple[str, ...] = filtering.SUMMARY,
    covariance: tuple[str, ...] = ("position", "attitude", "lever"),
) -> filtering.Inferred:  # fmt: skip
    """The states of one leg whose ankle has zero velocity at the samples `stands`; the same offline and online.

    `leg` has the jumps, doubts, dt, restart, rate_hz and gyr_bias of `AnkleSignals`; `readings` are the angular rate at
    each sample, the mean rate over the interval before it [rad/s] and the mean specific force over it [m/s²]. An error
    that is white over an interval h has the density σ² h. Zero velocities within 0.06 s count as one, whatever the
    sampling rate.
    """
    h, (rate, gyr, acc) = leg.dt, readings
    free = subtract(vector(rate), vector(leg.gyr_bias))
    over = FootControl(
        gyr=gyr,
        acc=acc,
        gyr_density=p.gyr_noise**2 + ((p.gyr_jump_noise * leg.gyr_jump) ** 2 + leg.gyr_doubt**2) * h,
        acc_density=p.acc_noise**2 + ((p.acc_jump_noise * leg.acc_jump) ** 2 + leg.acc_doubt**2) * h,
        velocity_variance=xp.maximum(0.06 * leg.rate_hz, 1.0)
        * (p.velocity_noise**2 + p.rate_noise**2 * dot(free, free)),
        restart=leg.restart,
    )
    # the foot's pivot is zero, because the lever is a state, and no height is observed
    model_params = FootModelParams(0.0, p.gyr_bias_walk**2, p.acc_bias_walk**2, 0.0)
    return filtering.infer(
        ankle_model.MODEL, model_params, AnkleObservation(xp.zeros_like(gyr)), smooth=options.smooth,
        controls=AnkleControl(over, rate), dt=h, mask=AnkleObservation(stands), method=options.method, initial=initial,
        keep=keep, covariance=covariance,
    )  # fmt: skip


def standing_prior(p: AnkleParams, leg: PyTree, attitude: Values, rate: Values) -> Belief:
    """The belief at a stance, without any information from before it, for an attitude from gravity and a rate [rad/s]:
    the ankle at rest, the lever of the sensor's placement.

    `leg` has the gyr_bias, still_time and mid_shank of `AnkleSignals`.
    """
    dtype = rate.dtype
    lever = xp.stack([xp.asarray(v, dtype) for v in ankle_strides.lever_of(p, leg)])
    velocity = rotated(quaternion(attitude), cross(vector(rate - leg.gyr_bias), vector(lever)))
    stood = leg.still_time > 0.0
    rested = p.gyr_bias**2 + (p.sway / xp.where(stood, leg.still_time, 1.0)) ** 2
    along, across, tilt = (xp.asarray(v, dtype) ** 2 for v in (p.lever_along_sd, p.lever_across_sd, p.tilt))
    zero = xp.zeros_like(lever)
    variances = AnkleError(
        position=zero + AGAIN,
        velocity=zero + 0.04,
        attitude=xp.stack([tilt, tilt, xp.asarray(1e-8, dtype)]),
        gyr_bias=zero + xp.where(stood, rested, p.gyr_bias_unknown**2),
        acc_bias=zero + p.acc_bias**2,
        lever=xp.stack([across, across, along]),
    )
    return ankle_model.standing_belief(attitude, as_array(velocity), leg.gyr_bias, lever, variances)


def _low_passed(p: AnkleParams, leg: AnkleSignals) -> tuple[Values, Values]:
    """Angular rate and force (T, 3) of a leg, low-passed."""
    raw = jnp.concatenate([leg.gyr, leg.acc], axis=1)
    both = butterworth.low_pass_until(raw, p.cutoff_hz, leg.rate_hz, leg.last)
    return both[:, :3], both[:, 3:]


def _states(p: AnkleParams, legs: AnkleSignals, options: AnkleOptions, levers: bool) -> filtering.Inferred:
    """The states of legs along a first axis."""

    def states_of(leg: AnkleSignals) -> filtering.Inferred:
        gyr, acc = _low_passed(p, leg)
        prior = standing_prior(p, leg, leg.attitude, gyr[xp.argmax(leg.valid)])
        readings = (gyr, mean_over_interval(gyr), mean_over_interval(acc))
        covariance = ("position", "attitude", *(("lever",) if levers else ()))
        return filtered(p, leg, readings, leg.stands & leg.valid, prior, options, covariance=covariance)

    return jax.vmap(states_of)(legs)


def _worn(inputs: AnkleInputs) -> dict[int, AnkleSignals]:
    """Side (0 right, 1 left) → signals of each leg with a sensor."""
    return {side: leg for side, leg in enumerate((inputs.right, inputs.left)) if leg is not None}


class _Walked(NamedTuple):
    """Strides of one leg, their standard deviations, flags, diagnostics, and the samples (T,) with valid results.

    `ways` is the distance along the strides (T, 1) [m], or with its variance and the deviation by turns (T, 3); they
    grow evenly over the swing of each stride.
    """

    strides: Strides
    deviations: Strides | None
    flags: dict[str, Values]
    diagnostics: dict[str, Values]
    valid: Flags
    ways: Values


def _of_leg(p: AnkleParams, leg: AnkleSignals, side: Counts, states: filtering.Inferred, time: Values) -> _Walked:
    """Strides of one leg, from the states of its filter."""
    strides, deviations, flags = ankle_strides.from_filter(p, leg, states.mean, states.cov, side)
    flags["stride_nis"] = nis_between(states.filtered.nis, states.filtered.count, leg.begin, leg.end)
    last = leg.last
    off = ankle_strides.off(vector(states.mean.lever), ankle_strides.lever_of(p, leg))[last]
    diagnostics = {
        "log_likelihood": states.log_likelihood, "nis": states.nis, "lever": states.mean.lever[last], "lever_off": off,
        "gyr_bias": states.mean.gyr_bias[last],
    }  # fmt: skip
    spread = states.cov.stddev().lever
    if spread is not None:
        diagnostics["lever_stddev"] = spread[last]
    way, turned = of_turns(strides.length, strides.turn)
    ways = _along(time, strides, [way, deviations.length**2, turned])
    return _Walked(strides, deviations, flags, diagnostics, leg.valid & states.filtered.valid, ways)


def _by_method(p: AnkleParams, legs: AnkleSignals, sides: Counts, time: Values, method: str) -> _Walked:
    """Strides of legs along a first axis, by a method of `ankle_stride.length`."""

    def strides_of_leg(leg: AnkleSignals, side: Counts) -> _Walked:
        strides, flags = ankle_strides.by_method(p, leg, *_low_passed(p, leg), side, method)
        return _Walked(strides, None, flags, {}, leg.valid, _along(time, strides, [strides.length]))

    return jax.vmap(strides_of_leg)(legs, sides)


def _along(time: Values, strides: Strides, added: list[Values]) -> Values:
    lengths = xp.where(strides.valid[:, None], xp.stack(added, axis=1), 0.0)
    return along(time, strides.final_contact, strides.end, strides.final_contact < strides.end, lengths)


def run(p: AnkleParams, inputs: AnkleInputs, options: AnkleOptions = DEFAULT, *, levers: bool = True) -> Estimate:
    """Estimate from prepared inputs: pure, for jit, vmap and grad, with static options; without `levers`, also static,
    the deviations of the estimated levers are not computed.

    Returns:
        `strides`, with the filter `strides_stddev`; `distance` is the mean over the legs with a sensor; `diagnostics`
        holds `FLAGS` for each stride, with the filter `distance_stddev` (T,) [m], and for each leg log-likelihood, mean
        normalised innovation squared, the estimated lever [m] and gyroscope's bias [rad/s] (forward, left, up), and its
        distance from the lever of the parameters, `lever_off` [m].

    Raises:
        ValueError: an unknown option.
    """
    check_options(options, KNOWN)
    worn = _worn(inputs)
    legs, sides, time = stacked(*worn.values()), np.asarray(list(worn), np.int32), inputs.time
    if options.length == "filter":
        states = compiled(_states)(p, legs, options=options, levers=levers)
        walked = for_each(lambda leg, side, leg_states: _of_leg(p, leg, side, leg_states, time), legs, sides, states)
    else:
        walked = compiled(_by_method)(p, legs, sides, time, method=options.length)
    strides, deviations, flags = jax.tree.map(lambda leaf: leaf.reshape(-1), walked[:3])
    diagnostics: dict[str, Any] = {
        f"{name}_{SIDES[side]}": value[number]
        for number, side in enumerate(worn)
        for name, value in walked.diagnostics.items()
    }
    ways = walked.ways
    distance = xp.mean(ways[..., 0], axis=0)
    if deviations is not None:
        each, turned = xp.sum(ways[..., 1], axis=0) / len(worn) ** 2, xp.mean(ways[..., 2], axis=0)
        diagnostics["distance_stddev"] = root(each + turned**2 + (p.distance_noise * distance) ** 2)
    return Estimate(
        inputs.time, Legs(None, None), None, distance, xp.any(walked.valid, axis=0),
        {**diagnostics, **flags}, strides, strides_stddev=deviations,
    )  # fmt: skip


def estimator(options: AnkleOptions = DEFAULT) -> Estimator[AnkleParams, AnkleInputs]:
    """This estimator as a record of functions."""
    return Estimator(
        "ankle_stride", AnkleParams(), partial(prepare, options=options), run, with_body, ABOUT, PER_STRIDE,
        _finished, unused=UNUSED.get(options.length, ()),
    )  # fmt: skip


def estimate(p: AnkleParams, recording: Recording, options: AnkleOptions = DEFAULT) -> Estimate:
    """Strides of the legs of one recording, with a sensor at one or both ankles, or on one or both shanks.

    Returns:
        An `Estimate`; `diagnostics["notes"]` lists notes about the recording, `instants_right` and `instants_left` are
        the samples (n, 2) at which each stride of the leg begins and ends.

    Raises:
        RecordingError: see `prepare`.
        ValueError: a parameter outside its range, or an unknown option.
    """
    return estimator(options).estimate(p, recording)


def _finished(result: Estimate, made: Prepared[AnkleInputs]) -> Estimate:
    """The estimate with the instants at which strides begin and end, and with doubts about strides and legs."""
    worn = _worn(made.inputs)
    instants = {
        f"instants_{SIDES[side]}": np.stack([leg.begin, leg.end], axis=1)[: int(leg.count)]
        for side, leg in worn.items()
    }
    places = {side: f"{'shank' if leg.mid_shank else 'ankle'}_{SIDES[side]}" for side, leg in worn.items()}
    cut = cut_off(result, {side: (places[side], leg.gyr - leg.gyr_bias) for side, leg in worn.items()})
    notes, doubts, diagnostics = cut_notes(cut), [cut], {**result.diagnostics, **instants}
    if result.strides_stddev is not None:
        nis, away = (
            {side: float(diagnostics[f"{name}_{SIDES[side]}"]) for side in worn} for name in ("nis", "lever_off")
        )
        off = _rates_off(made, nis, places)
        far = {places[side]: SensorQuality(lever_off=metres) for side, metres in away.items()
               if metres > ankle_strides.FARTHEST_OFF}  # fmt: skip
        notes += [RATES_OFF(placement=name, factor=sensor.rates_factor) for name, sensor in off.items()]
        notes += [LEVER_IMPLAUSIBLE(placement=name, off_m=sensor.lever_off) for name, sensor in far.items()]
        doubts += [off, far]
    diagnostics["notes"] = (*diagnostics["notes"], *notes)
    diagnostics["sensors"] = merged(diagnostics["sensors"], *doubts)
    result = result._replace(diagnostics=diagnostics)
    if result.strides_stddev is None:
        return result
    return quality.judged(result, "ankle_stride", of_estimate(result, places), places)


def _rates_off(made: Prepared[AnkleInputs], nis: dict[int, float], places: dict[int, str]) -> dict[str, SensorQuality]:
    """Sensors whose rates have a wrong scale, or whose interval between samples is wrong.

    With such rates the integrated inclination of a standing shank contradicts gravity: the NIS of a leg is nearly a
    parabola of the rates' scale, whose vertex is the scale that fits. `nis` maps a side (0 right, 1 left) to the NIS of
    all observations of the leg [1], `places` to its placement.
    """
    legs, scales, largest = _worn(made.inputs), (0.85, 1.0, 1.18), 1.4
    # most good walks have a smaller NIS, all with rates off by 15 % a larger one
    asked = [side for side, leg in legs.items() if nis[side] > 0.03 and int(leg.count) >= 4]
    if not asked:
        return {}
    each: list[list[float]] = []
    for factor in scales:
        scaled = {
            SIDES[side]: leg._replace(gyr=factor * leg.gyr, gyr_bias=factor * leg.gyr_bias)
            for side, leg in legs.items()
        }
        inputs = pad(made.inputs._replace(**scaled), bucket(len(made.inputs.time)))
        diagnostics = run(AnkleParams(), inputs, made.options).diagnostics
        each.append([float(diagnostics[f"nis_{SIDES[side]}"]) for side in asked])
    off = {}
    for side, values in zip(asked, np.transpose(each), strict=True):
        bend, slope, _ = np.polyfit(scales, values, 2)
        factor = float(np.clip(-0.5 * slope / bend, 1.0 / largest, largest)) if bend > 0.0 else 1.0
        # undamaged shanks, public and simulated, have 0.9 and 0.05; one has 0.15, but hardly a smaller NIS
        if values.min() < 0.6 * values[1] and abs(np.log(factor)) > 0.1:
            off[places[side]] = SensorQuality(rates_factor=factor, rates_off=True)
    return off
