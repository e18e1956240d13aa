"""Joint angles from recordings with gaps of the gyroscopes."""

from collections.abc import Mapping
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import PyTree

from jgait.duty_cycle import power
from jgait.duty_cycle.fillers import FILLERS
from jgait.duty_cycle.filling import FILLED, HELD, MEASURED, Filled, Thigh
from jgait.duty_cycle.recording import SEGMENTS, schedule_of
from jgait.estimators.ankle_stride.prepare import STRIDES_QUICK
from jgait.estimators.cycles import swing_cycles
from jgait.estimators.duty_cycled_gyro import model as duty_model
from jgait.estimators.duty_cycled_gyro.about import ABOUT
from jgait.estimators.duty_cycled_gyro.params import (
    DEFAULT,
    DutyCycledInputs,
    DutyCycledOptions,
    DutyCycledParams,
    DutyInputs,
    GapLeg,
    GapSegment,
    PlanarSegment,
    SegmentEstimate,
    params_of,
    with_body,
)
from jgait.estimators.duty_cycled_gyro.prepare import LOST, RATE_HELD, prepare
from jgait.estimators.interface import Estimator, Prepared
from jgait.estimators.leg_ekf.params import one_side
from jgait.estimators.plausible import QUICK_S
from jgait.estimators.programs import compiled
from jgait.geometry.arrays import xp
from jgait.signal.windows import true_runs
from jgait.types import SIDES, Estimate, Flags, Legs, LegTrajectory, Recording, Values

type _Joints = tuple[LegTrajectory, LegTrajectory]
"""Angles of a leg with sensors on both segments, and their standard deviations."""

type _Segments = dict[str, tuple[Filled, SegmentEstimate]]
"""Segment with a sensor → its rate without gaps and bias, and the estimate of the filter."""


def _fill(
    p: DutyCycledParams, segment: GapSegment, thigh: Thigh | None, valid: Values, options: DutyCycledOptions
) -> Filled:
    """The rate of one segment without its bias and without gaps; padding is no gap."""
    rate = jnp.where(valid, jnp.asarray(segment.gyr), 0.0) - segment.bias
    if not options.gaps:
        none = jnp.zeros(rate.shape, jnp.int32)
        return Filled(rate, none + MEASURED, none[0])
    acc = jnp.asarray(segment.acc) if options.accelerometers else None
    return FILLERS[options.filler].fill(
        rate, jnp.asarray(segment.on) | ~jnp.asarray(valid), acc, options.sampling_rate_hz, p.filler, thigh=thigh
    )  # fmt: skip


def _planar(p: DutyCycledParams, segment: GapSegment, filled: Filled, turning: Values, dt: Values) -> PlanarSegment:
    """Inputs of the filter of one segment: filled rates have a larger variance, held rates are masked."""
    acc, measured = jnp.asarray(segment.acc), filled.how != HELD
    more = jnp.where(filled.how == FILLED, p.filled_noise**2 * filled.unlike, 0.0)
    excess = duty_model.excess(p.turn_tilt, turning, dt, more).astype(filled.rate.dtype)
    return PlanarSegment(
        filled.rate + segment.bias, acc[:, 0], acc[:, 2], jnp.asarray(segment.acc_measured), measured, excess,
        segment.bias, segment.variance,
    )  # fmt: skip


def _turning(inputs: DutyCycledInputs) -> Values:
    """(T,) how fast the person turns [rad/s], from all segments."""
    worn = [sensor for leg in (inputs.right, inputs.left) if leg is not None for sensor in leg if sensor is not None]
    rates, on = (
        jnp.stack([jnp.asarray(v) for v in values])
        for values in zip(*((sensor.turn, sensor.on) for sensor in worn), strict=True)
    )
    return duty_model.turning(rates, on, inputs.dt, duty_model.no_turn(rates))[1]


def _leg(
    p: DutyCycledParams, leg: GapLeg, inputs: DutyCycledInputs, turning: Values, options: DutyCycledOptions
) -> tuple[_Segments, _Joints | None]:
    """Fill the gaps and filter one leg, with the parameters of its side."""
    rates, above = dict[str, Filled](), None
    planar: dict[str, PlanarSegment | None] = dict.fromkeys(SEGMENTS)
    for segment, sensor in zip(SEGMENTS, leg, strict=True):
        if sensor is None:
            continue
        rates[segment] = filled = _fill(p, sensor, above, inputs.valid, options)
        planar[segment] = _planar(p, sensor, filled, turning, inputs.dt)
        if segment == "thigh" and options.above and options.accelerometers:
            above = Thigh(filled.rate, jnp.asarray(sensor.acc))
    of_leg = DutyInputs(
        planar["thigh"], planar["shank"], inputs.time, inputs.dt, inputs.still, inputs.valid, inputs.start_variance
    )  # fmt: skip
    result = duty_model.run(p, of_leg, accelerometers=options.accelerometers, method=options.method)
    segments = {name: part for name, part in zip(SEGMENTS, result, strict=True) if part is not None}
    return (
        {name: (rates[name], part) for name, part in segments.items()},
        joints(p, *segments.values()) if len(segments) == 2 else None,
    )


def joints(p: DutyCycledParams, thigh: SegmentEstimate, shank: SegmentEstimate) -> _Joints:
    """Hip and knee angle and ankle position, with standard deviations for independent errors of both segments and the
    unknown pose in standing.
    """
    sin1, cos1, sin2, cos2 = jnp.sin(thigh.angle), jnp.cos(thigh.angle), jnp.sin(shank.angle), jnp.cos(shank.angle)
    a1, a2 = p.thigh_length, p.shank_length
    var1, var2 = thigh.angle_stddev**2, shank.angle_stddev**2
    hip, knee = p.standing_hip_sd**2, p.standing_knee_sd**2
    place = LegTrajectory(thigh.angle, thigh.angle - shank.angle, a1 * sin1 + a2 * sin2, -a1 * cos1 - a2 * cos2)
    return place, LegTrajectory(
        jnp.sqrt(var1 + hip),
        jnp.sqrt(var1 + var2 + knee),
        # an error of the standing hip turns the whole leg, one of the standing knee the shank
        jnp.sqrt((a1 * cos1) ** 2 * var1 + (a2 * cos2) ** 2 * (var2 + knee) + (a1 * cos1 + a2 * cos2) ** 2 * hip),
        jnp.sqrt((a1 * sin1) ** 2 * var1 + (a2 * sin2) ** 2 * (var2 + knee) + (a1 * sin1 + a2 * sin2) ** 2 * hip),
    )


def _legs(p: DutyCycledParams, inputs: DutyCycledInputs, options: DutyCycledOptions) -> list[PyTree]:
    """Results of both legs; one program if both legs have the same sensors."""
    both = [None if leg is None else (one_side(p, side), leg) for side, leg in enumerate((inputs.right, inputs.left))]
    worn = [None if leg is None else [signals is None for signals in leg] for leg in (inputs.right, inputs.left)]
    turning = _turning(inputs)
    if None in worn or worn[0] != worn[1]:
        return [({}, None) if pair is None else _leg(*pair, inputs, turning, options) for pair in both]
    stacked = jax.tree.map(lambda *v: jnp.stack([jnp.asarray(x) for x in v]), *both)
    # one after the other: a leg without gaps at a sample does not compute what would fill them
    result = lax.map(lambda pair: _leg(pair[0], pair[1], inputs, turning, options), stacked)
    return [jax.tree.map(lambda v, side=side: v[side], result) for side in range(2)]


def run(p: DutyCycledParams, inputs: DutyCycledInputs, options: DutyCycledOptions = DEFAULT) -> Estimate:
    """Estimate from prepared inputs: pure, for jit, vmap and grad; options, from `prepared`, are static.

    Returns:
        Angles with standard deviations; `diagnostics`: see the package; also the log-likelihood of the innovations
        and their mean normalised square for every sensor, and the filler's latency [s].
    """
    results = compiled(_legs)(p, inputs, options=options)
    valid: Flags = inputs.valid
    diagnostics: dict[str, Any] = {}
    angles: list[tuple[LegTrajectory | None, LegTrajectory | None]] = []
    for side, (segments, leg) in zip(SIDES, results, strict=True):
        angles.append(leg or (None, None))
        for segment, (filled, segment_estimate) in segments.items():
            name = f"{segment}_{side}"
            diagnostics |= {
                f"angle_{name}": segment_estimate.angle,
                f"angle_stddev_{name}": segment_estimate.angle_stddev,
                f"rate_{name}": segment_estimate.rate,
                f"gyro_{name}": filled.rate,
                f"how_{name}": filled.how,
                f"log_likelihood_{name}": xp.sum(segment_estimate.log_likelihood),
                f"nis_{name}": xp.sum(segment_estimate.nis) / xp.maximum(xp.sum(segment_estimate.count), 1.0),
                "latency": filled.latency.astype(segment_estimate.angle.dtype) / options.sampling_rate_hz,
            }
            valid = valid & segment_estimate.valid
    legs, spread = (Legs(*both) for both in zip(*angles, strict=True))
    return Estimate(inputs.time, legs, None if spread == (None, None) else spread, None, valid, diagnostics)


def estimator(
    options: DutyCycledOptions = DEFAULT, gyro_on: Mapping[str, Values] | None = None
) -> Estimator[DutyCycledParams, DutyCycledInputs]:
    """This estimator as a record of functions; arguments as of `estimate`. Raises ValueError for an unknown filler."""
    return Estimator(
        "duty_cycled_gyro", params_of(options),
        partial(prepare, options=options, gyro_on=gyro_on), run, with_body, ABOUT, finish=partial(_finished, options),
        unused=("filler.least_strides",),
    )  # fmt: skip


def energy(preparation: Prepared[DutyCycledInputs], options: DutyCycledOptions) -> dict[str, Any]:
    """Power of the sensors over a prepared recording, and battery life, under the options that prepared it.

    `gyro_energy_saved` [1] of the energy of gyroscopes that are always on; `mean_power` [W] of all sensors;
    `battery_life` and `battery_life_always_on` of a watt-hour [s]; `usable_share` [1] of the gyroscopes' samples; and
    `schedule_saving` [1], the share that a schedule saves in the long term.
    """
    used, rate_hz, gyro = preparation.extra, preparation.options.sampling_rate_hz, options.gyroscope
    seconds, battery = len(preparation.inputs.time) / rate_hz, power.Battery.from_watt_hours(1.0)
    drawn = sum(float(power.mask_energy(masks, rate_hz, gyro)) for masks in used.values())
    always = gyro.on * seconds * len(used)
    accelerometer_power = power.ACCELEROMETER.on * len(used) if preparation.options.accelerometers else 0.0
    numbers: dict[str, Any] = {
        "gyro_energy_saved": max(0.0, 1.0 - drawn / always),
        "mean_power": drawn / seconds + accelerometer_power,
        "battery_life": battery.life(drawn / seconds, accelerometer_power),
        "battery_life_always_on": battery.life(always / seconds, accelerometer_power),
        "usable_share": float(np.mean([np.mean(masks.usable) for masks in used.values()])),
    }
    schedule = schedule_of(options.schedule, gyro)
    return numbers if schedule is None else numbers | {"schedule_saving": power.saving(schedule, gyro)}


def estimate(
    p: DutyCycledParams, recording: Recording, options: DutyCycledOptions = DEFAULT, *,
    gyro_on: Mapping[str, Values] | None = None,
) -> Estimate:  # fmt: skip
    """Leg angles of one recording whose gyroscopes are off at times, and the energy saved.

    The parameters of another filler than the default are from `params_of`. `gyro_on` maps a placement to (T,) bool,
    True while its gyroscope was on and awake; default: always. `diagnostics` are those of `run` and `energy`.

    Raises:
        RecordingError: see `duty_cycled_gyro.prepare.prepare`.
        ValueError: a parameter outside its range, parameters of another filler, a duty cycle outside (0, 1], a wake-up
            longer than the on-time, a mask of the wrong shape.
    """
    of_options = estimator(options, gyro_on)
    wanted = type(of_options.params.filler)
    if type(p.filler) is not wanted:
        raise ValueError(
            f"the filler {options.filler!r} takes parameters of type {wanted.__name__}, see params_of; "
            f"got {type(p.filler).__name__}"
        )
    return of_options.estimate(p, recording)


def _finished(options: DutyCycledOptions, result: Estimate, made: Prepared[DutyCycledInputs]) -> Estimate:
    """The estimate with the power of the sensors; invalid where a rate is held for `LOST` or longer; with a note on
    running, from the cycles of the knee, because shanks are not measured all the time.
    """
    ran: DutyCycledOptions = made.options
    notes, valid = list(result.diagnostics["notes"]), np.array(result.valid)
    for name in made.extra if ran.filler != "hold" else ():
        held = result.diagnostics[f"how_{name}"] == HELD
        gone = [run for run in true_runs(held) if run[1] - run[0] >= LOST * ran.sampling_rate_hz]
        for start, stop in gone:
            valid[start:stop] = False
        if gone:
            first, last = float(result.time[gone[0][0]]), float(result.time[gone[-1][1] - 1])
            samples = sum(stop - start for start, stop in gone)
            notes.append(RATE_HELD(placement=name, samples=samples, begin_s=first, end_s=last))
    for side, leg in zip(SIDES, result.legs, strict=True):
        strides = [] if leg is None else swing_cycles(result.time, leg, valid)
        lasting = [result.time[b] - result.time[a] for a, b in strides]
        if lasting and (median := float(np.median(lasting))) < QUICK_S:
            notes.append(STRIDES_QUICK(placement=f"shank_{side}", seconds=median))
    diagnostics = result.diagnostics | energy(made, options) | {"notes": tuple(notes)}
    return result._replace(valid=valid, diagnostics=diagnostics)
