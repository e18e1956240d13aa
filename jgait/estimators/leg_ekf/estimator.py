"""Joint angles, foot positions and distance from prepared inputs."""

from functools import partial, reduce
from typing import NamedTuple

import jax
import numpy as np

from jgait import filtering, quality
from jgait.estimators import ankle_stride
from jgait.estimators.interface import Estimator, Prepared
from jgait.estimators.leg_ekf import inclination
from jgait.estimators.leg_ekf import model as leg_model
from jgait.estimators.leg_ekf import readout as leg_distance
from jgait.estimators.leg_ekf.about import ABOUT
from jgait.estimators.leg_ekf.inputs import LegInputs, LegSignals, Segment
from jgait.estimators.leg_ekf.model import STANDING, LegControl, LegModelParams, LegObservation, LegState
from jgait.estimators.leg_ekf.notes import SHANKS_APART
from jgait.estimators.leg_ekf.params import DEFAULT, LegOptions, LegParams, one_side, with_body
from jgait.estimators.leg_ekf.prepare import SHANKS, long_gaps, prepare
from jgait.estimators.programs import compiled
from jgait.events.rest import BRIDGED_S
from jgait.filtering import Belief, Covariance, Model
from jgait.geometry.arrays import for_each, stacked, xp
from jgait.mounting.leg import Pose, posterior
from jgait.notes import Note
from jgait.quality import SensorQuality, merged
from jgait.quality.evidence import of_stride
from jgait.types import SIDES, Estimate, Flags, Legs, LegTrajectory, Recording, Values, as_float

SPREAD = ("thigh_angle", "knee_angle", "x", "y")
"""Components of the state with a stated deviation."""

DISTANCES = ("strapdown", "stance", "accumulate", "forward")
"""Values of `LegOptions.distance`."""


def model_params(p: LegParams, leg: LegSignals) -> LegModelParams:
    """The model's parameters for one leg, R from its gyroscopes at rest."""
    return LegModelParams(
        thigh_length=p.thigh_length,
        shank_length=p.shank_length,
        position_noise=p.position_noise,
        angle_noise=p.angle_noise,
        bias_noise=p.bias_noise,
        gyro_variance_thigh=p.gyro_noise * leg.thigh.variance,
        gyro_variance_shin=p.gyro_noise * leg.shank.variance,
        closure_noise=p.closure_noise**2,
    )


def observe(
    p: LegParams,
    leg: LegSignals,
    inclinations: tuple[inclination.Inclination, ...] | None,
    inputs: LegInputs,
    options: LegOptions,
) -> tuple[LegObservation, LegControl, LegObservation]:
    """Observation, control and mask of the leg filter, for a whole recording or for one sample. Observations that the
    options turn off have a constant False mask, so that the filter does not compute them.
    """
    there = leg.thigh.measured | (leg.thigh.lost > 0.0)  # all but padding
    hip, knee, gain = p.standing_hip, p.standing_knee, p.thigh_gain
    zero = xp.zeros_like(inputs.dt)
    if inclinations is not None:
        thigh, shank = inclinations
        # Errors of the inclination persist for about 1 s; equivalent white noise has the variance times 1 s / dt.
        spread = 1.0 / xp.maximum(inputs.dt, 1e-3)
        # In a gap the leg follows its inclination; its own prediction is worth nothing.
        lost = xp.maximum(leg.thigh.lost, leg.shank.lost)
        spread = xp.where(lost > BRIDGED_S, 1.0, spread)
        # gain · sensor = thigh + pull · (thigh − shank), all from standing
        share, pulled = gain / (1.0 + p.thigh_pull), p.thigh_pull / (1.0 + p.thigh_pull)
        uncertain = share**2 * thigh.variance + pulled**2 * shank.variance
        unknown = xp.where(lost > BRIDGED_S, inclination.unknown_turn(xp.maximum(lost, inputs.dt), inputs.dt), 0.0)
        control = LegControl(uncertain * spread, shank.variance * spread, unknown)
        angles = (STANDING + hip + share * thigh.angle + pulled * shank.angle, STANDING + hip - knee + shank.angle)
        rates = (share * thigh.rate + pulled * shank.rate, shank.rate)
        # In gaps both inclinations are known too: badly in their middle, well at their ends.
        tilted: Values = there
        # A leg whose inclination is far off moves x and y along a wrong direction, from which the closure would wrongly
        # learn the angles.
        close = xp.maximum(thigh.variance, shank.variance) < 0.09**2  # [rad²] chosen
    else:
        # In each quiet standing the pose is assumed to be the calibration pose, to about three degrees.
        control = LegControl(zero + 2.7e-3, zero + 2.7e-3)
        angles = (zero + STANDING + hip, zero + STANDING + hip - knee)
        rates = (-leg.thigh.gyr[..., 1], -leg.shank.gyr[..., 1])
        tilted = inputs.still & there if options.standing else False
        close = xp.ones_like(there)
    closed = there & close if options.closure else False
    observation = LegObservation(*rates, zero, zero, *angles)
    return observation, control, LegObservation(leg.thigh.measured, leg.shank.measured, closed, closed, tilted, tilted)


def calibrated(p: LegParams, pose: Pose | None) -> LegParams:
    """The parameters of one leg with hip and knee of the pose that calibrates, and their deviations, from standing and
    walking; without a pose those of standing.
    """
    if pose is None:
        return p
    (hip, knee), (hips, _, knees) = posterior(
        pose, (p.standing_hip, p.standing_knee), (p.standing_hip_sd, p.standing_knee_sd)
    )
    return p._replace(
        standing_hip=hip, standing_knee=knee, standing_hip_sd=xp.sqrt(hips), standing_knee_sd=xp.sqrt(knees)
    )


def trajectory_of(state: LegState) -> LegTrajectory:
    """The filter's state as hip angle from the vertical and knee flexion angle, flexion positive."""
    return LegTrajectory(state.thigh_angle - STANDING, -state.knee_angle, state.x, state.y)


def deviation_of(p: LegParams, state: LegState, cov: Covariance) -> LegTrajectory:
    """Standard deviations of the leg: the filter's, with those of the standing pose, which is unknown by a constant,
    and of soft tissue, by a share of the angle from standing and by itself. Both pass to x and y through the
    kinematics.
    """
    from_standing = state.thigh_angle - STANDING - p.standing_hip
    thigh = p.soft_tissue_thigh**2 + (p.thigh_gain_sd * from_standing) ** 2
    from_standing = from_standing + state.knee_angle + p.standing_knee
    shank = p.soft_tissue_shank**2 + (p.shank_gain_sd * from_standing) ** 2
    shin = state.thigh_angle + state.knee_angle
    x1, y1 = p.thigh_length * xp.sin(state.thigh_angle), p.thigh_length * xp.cos(state.thigh_angle)
    x2, y2 = p.shank_length * xp.sin(shin), p.shank_length * xp.cos(shin)
    hip, knee = p.standing_hip_sd**2, p.standing_knee_sd**2
    # an error of the standing hip turns the whole leg, one of the standing knee the shank
    along = x1**2 * thigh + x2**2 * shank + (x1 + x2) ** 2 * hip + x2**2 * knee
    upward = y1**2 * thigh + y2**2 * shank + (y1 + y2) ** 2 * hip + y2**2 * knee
    more = {"thigh_angle": thigh + hip, "knee_angle": thigh + shank + knee, "x": along, "y": upward}
    # in single precision a smoothed variance can be negative by rounding
    return LegTrajectory(*(xp.sqrt(xp.maximum(cov[name, name], 0.0) + v) for name, v in more.items()))


def walked(p: LegParams, legs: Legs, inputs: LegInputs, options: LegOptions) -> tuple[Values, dict[str, Values]]:
    """Distance walked (T,) [m], see `LegOptions.distance` and `leg_ekf.readout`, and its diagnostics: its standard
    deviation (T,) [m], and by strapdown the sum of the strides of each shank [m].
    """
    diagnostics = {}
    if options.distance not in DISTANCES:
        raise ValueError(f"distance must be one of {', '.join(DISTANCES)}; got {options.distance!r}")
    if options.distance in ("strapdown", "stance"):
        way = leg_distance.stance_carried(legs, p.rollover_radius, inputs.still)
    else:
        vertical = options.distance == "accumulate"
        ways = [leg_distance.accumulated(leg, vertical=vertical) for leg in legs if leg is not None]
        way = sum(ways[1:], ways[0]) / len(ways)
    spread = p.kinematic_noise * way
    if options.distance == "strapdown" and inputs.shanks is not None:
        shank_params = ankle_stride.AnkleParams(lever_shank=p.lever_shank, distance_noise=p.distance_noise)
        shanks = ankle_stride.run(shank_params, inputs.shanks, SHANKS._replace(smooth=options.smooth), levers=False)
        worn = [leg for leg in inputs.shanks[1:] if leg is not None]
        strides = reduce(xp.logical_and, [leg.count > 0 for leg in worn])
        way = xp.where(strides, leg_distance.rescaled(way, inputs.still & inputs.valid, worn, shanks.distance[-1]), way)
        spread = xp.where(strides, shanks.diagnostics["distance_stddev"], spread)
        spreads = shanks.strides_stddev
        nis, each = shanks.diagnostics["stride_nis"], shanks.strides
        evidence = of_stride(nis, each.height, spreads.height)
        doubtful = quality.doubt(quality.learned("ankle_stride"), evidence) > quality.DOUBTFUL_FROM
        for side, name in enumerate(SIDES):
            of_side = shanks.strides.valid & (shanks.strides.side == side)
            diagnostics[f"shank_distance_{name}"] = xp.sum(xp.where(of_side, shanks.strides.length, 0.0))
            if f"nis_{name}" in shanks.diagnostics:
                useless = of_side & (spreads.length > quality.UNCERTAIN)
                diagnostics[f"shank_uncertain_{name}"] = xp.sum(useless)
                diagnostics[f"shank_doubtful_{name}"] = xp.sum(of_side & doubtful)
    return p.distance_scale * way, {"distance_stddev": p.distance_scale * spread, **diagnostics}


def run(p: LegParams, inputs: LegInputs, options: LegOptions = DEFAULT, model: Model = leg_model.MODEL) -> Estimate:
    """Estimate from prepared inputs: pure, for jit, vmap and grad, with static options; `model` replaces that of one
    leg.

    Returns:
        Angles, foot position and distance with standard deviations; `diagnostics` holds the distance's, (T,)
        `distance_stddev` [m], of each leg the log-likelihood, the mean normalised innovation squared, and the standard
        deviations (2,) of the zeros of hip and knee, `zero_stddev_<side>` [rad], and of each shank's strapdown the sum
        of its strides [m] and the number of those that are uncertain or in doubt.
    """
    worn = [(side, leg) for side, leg in enumerate((inputs.right, inputs.left)) if leg is not None]
    params, signals = stacked(*((calibrated(one_side(p, side), leg.pose), leg) for side, leg in worn))
    run_legs = compiled(_one_leg, over=(0, 0, None))
    states = run_legs(params, signals, inputs._replace(shanks=None), options=options, model=model)
    results = for_each(_read_out, params, states)
    trajectories: list[LegTrajectory | None] = [None, None]
    deviations: list[LegTrajectory | None] = [None, None]
    diagnostics: dict[str, Values] = {}
    for number, (side, _) in enumerate(worn):
        trajectories[side], deviations[side], log_likelihood, nis, _ = jax.tree.map(lambda v, k=number: v[k], results)
        diagnostics |= {f"log_likelihood_{SIDES[side]}": log_likelihood, f"nis_{SIDES[side]}": nis}
        zero = (xp.asarray(sd)[number] for sd in (params.standing_hip_sd, params.standing_knee_sd))
        diagnostics[f"zero_stddev_{SIDES[side]}"] = xp.stack([*zero])
    legs = Legs(*trajectories)
    valid = inputs.valid & xp.all(results[-1], axis=0)
    distance, more = walked(p, legs, inputs, options)
    diagnostics |= more
    return Estimate(inputs.time, legs, Legs(*deviations), distance, valid, diagnostics)


class LegBeliefs(NamedTuple):
    """What is known of a leg before a sample."""

    segments: Belief  #: beliefs about the inclinations of thigh and shank, leaves (2, …).
    leg: Belief  #: belief about the leg.
    rates: Values  #: (2, 3) the last rates of both sensors, for the mean over the interval [rad/s].


def start(p: LegParams, leg: LegSignals, start_variance: Values, options: LegOptions) -> LegBeliefs:
    """The beliefs before the first sample of signals (T, …), in the standing pose or the inclination that they state,
    with a variance [rad²]. With `options.gravity` the inclination filter has removed the gyroscopes' biases at rest.
    """
    both = stacked(leg.thigh, leg.shank)
    segments = jax.vmap(lambda bias, unrest, angle: inclination.prior(bias, start_variance, unrest, angle))
    zero = xp.zeros_like(start_variance)
    biases = (zero, zero) if options.gravity else (-leg.thigh.bias[1], -leg.shank.bias[1])
    thigh, shank = (0.0 if segment.start is None else segment.start for segment in (leg.thigh, leg.shank))
    angles = STANDING + p.standing_hip + thigh, shank - thigh - p.standing_knee
    standing = leg_model.standing_belief(model_params(p, leg), *angles, *biases, start_variance)
    return LegBeliefs(segments(both.bias, both.unrest, both.start), standing, both.gyr[:, 0])


def filtered(
    p: LegParams, leg: LegSignals, inputs: LegInputs, options: LegOptions, before: LegBeliefs,
    keep: tuple[str, ...] = filtering.SUMMARY, model: Model = leg_model.MODEL,
) -> tuple[filtering.Inferred | None, filtering.Inferred]:  # fmt: skip
    """The states of both segments' inclinations, None without gravity, and of the leg, at the samples that follow.

    `inputs` are of all legs: dt [s], still and valid; `keep` names fields of the leg's posterior.
    """

    def incline(belief: Belief, rate: Values, segment: Segment) -> tuple[filtering.Inferred, inclination.Inclination]:
        observed, controls, mask = inclination.observed(segment, rate, inputs, options.standing)
        states = filtering.infer(
            inclination.MODEL, p.inclination, observed, smooth=options.smooth, controls=controls, dt=inputs.dt,
            mask=mask, initial=belief, keep=(), covariance=inclination.NEEDED,
            method=filtering.EKF(derivative=options.method.derivative),
        )  # fmt: skip
        return states, inclination.read_out(states.mean, states.cov, observed.gyr)

    segments = angles = None
    if options.gravity:
        segments, both = jax.vmap(incline)(before.segments, before.rates, stacked(leg.thigh, leg.shank))
        angles = tuple(jax.tree.map(lambda v, k=k: v[k], both) for k in range(2))
    observations, controls, mask = observe(p, leg, angles, inputs, options)
    return segments, filtering.infer(
        model, model_params(p, leg), observations, smooth=options.smooth, controls=controls, dt=inputs.dt, mask=mask,
        method=options.method, initial=before.leg, keep=keep, covariance=SPREAD,
    )  # fmt: skip


def _one_leg(p: LegParams, leg: LegSignals, inputs: LegInputs, options: LegOptions, model: Model) -> filtering.Inferred:
    return filtered(p, leg, inputs, options, start(p, leg, inputs.start_variance, options), model=model)[1]


def _read_out(p: LegParams, states: filtering.Inferred) -> tuple[LegTrajectory, LegTrajectory, Values, Values, Flags]:
    """Trajectory and deviations of one leg, log-likelihood, mean NIS, and (T,) bool of valid samples."""
    deviation = deviation_of(p, states.mean, states.cov)
    return trajectory_of(states.mean), deviation, states.log_likelihood, states.nis, states.filtered.valid


def _finished(result: Estimate, made: Prepared[LegInputs]) -> Estimate:
    """The estimate with `stated_<side>` (T,), False in long gaps of that leg's sensors, `slipped_<side>` (T,) if one of
    them slipped, True after it, and notes if strides of a shank are in doubt, or distances of both differ too much.
    """
    diagnostics, shanks = dict(result.diagnostics), made.inputs.shanks
    notes: list[Note] = []
    for side in SIDES:
        if (leg := getattr(made.inputs, side)) is not None:
            # where only the other leg lacks samples, `valid` is False, and this leg is known
            diagnostics[f"stated_{side}"] = np.asarray(result.valid | ~made.inputs.valid)
            for start, stop in long_gaps(leg, made.inputs.time):
                diagnostics[f"stated_{side}"][start:stop] = False
            slips_at = min((f.slips_at for name, f in made.quality.items() if name.endswith(side)), default=np.inf)
            if (after := as_float(made.inputs.time) - made.inputs.time[0] >= slips_at).any():
                diagnostics[f"slipped_{side}"] = after
    for side in SIDES:
        if shanks is not None and f"shank_doubtful_{side}" in diagnostics:
            uncertain, many = (round(float(diagnostics[f"shank_{key}_{side}"])) for key in ("uncertain", "doubtful"))
            total = int(getattr(shanks, side).count)
            rare = SensorQuality(unusable=uncertain > quality.DOUBTED_SHARE * total)
            diagnostics["sensors"] = merged(diagnostics["sensors"], {f"shank_{side}": rare})
            notes += quality.doubts_of(f"shank_{side}", uncertain, many, total)
    if made.inputs.right is not None and made.inputs.left is not None and "shank_distance_right" in diagnostics:
        right, left = (float(diagnostics[f"shank_distance_{side}"]) for side in SIDES)
        if abs(right - left) > max(1.6, 0.1 * max(right, left)):  # a long stride [m], a share
            notes.append(SHANKS_APART(right=right, left=left))
    return result._replace(diagnostics={**diagnostics, "notes": (*diagnostics.get("notes", ()), *notes)})


def estimator(options: LegOptions = DEFAULT) -> Estimator[LegParams, LegInputs]:
    """This estimator as a record of functions; without accelerometers it does not use gravity."""
    ready = partial(prepare, options=options)
    return Estimator("leg_ekf", LegParams(), ready, run, with_body, ABOUT, finish=_finished)


def estimate(p: LegParams, recording: Recording, options: LegOptions = DEFAULT) -> Estimate:
    """Hip and knee angles, foot position and distance of one recording, with thigh and shank sensors of one or both
    legs.

    At least the leg lengths of the parameters should be measured on the person. Without accelerometers the inclination
    filter is not used, and a note states it; `diagnostics["notes"]` lists the decisions made in `prepare`.

    Raises:
        RecordingError: missing placement, clocks that differ, no standing, no walking.
        ValueError: a parameter outside its range.
    """
    return estimator(options).estimate(p, recording)
