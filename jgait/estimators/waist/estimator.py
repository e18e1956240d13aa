"""Contacts, strides and distance of the waist from prepared inputs."""

import itertools
from functools import partial

import numpy as np
from jaxtyping import PyTree

from jgait import quality
from jgait.estimators.checks import check_options
from jgait.estimators.interface import Estimator, Prepared
from jgait.estimators.programs import compiled
from jgait.estimators.stride_flags import LARGEST_TURN
from jgait.estimators.waist import model as waist_model
from jgait.estimators.waist.about import ABOUT, SIDE_KNOWN
from jgait.estimators.waist.inputs import WaistInputs
from jgait.estimators.waist.model import EDGE_STEPS, Intervals, WaistWalk, closing, earlier
from jgait.estimators.waist.motion import TrunkMotion, motion
from jgait.estimators.waist.notes import DISTANCE_DOUBTFUL, NOT_LEARNED, WALKING_MISSED
from jgait.estimators.waist.params import DEFAULT, KNOWN, PAPER, WaistOptions, WaistParams, with_body
from jgait.estimators.waist.prepare import prepare
from jgait.geometry.arrays import interpolated, xp
from jgait.geometry.vectors import GRAVITY
from jgait.mounting.trunk import FREE, OVER_S, moved_between, step_frequency
from jgait.notes import Note
from jgait.quality import SensorQuality, merged
from jgait.quality.evidence import among, of_sensors
from jgait.types import Estimate, Legs, Recording, Strides, Values, as_float

FLAGS = ("turning", "half", "unsure", "side_unknown")
"""Names of the flags in `diagnostics`, each (n,) bool in the order of the strides."""

UNUSED = {
    "fused": ("update",),
    "update": (
        "pendulum_constant", "pendulum_constant_sd", "start_gain", "start_noise", "step_noise", "turn_noise",
        "edge_noise", "excursion_hz", "pendulum_length", "pendulum_length_sd", "excursion_power", "surge_power",
        "turn_shortening", "speed_noise", "acc_bias_walk", "standing_speed", "update.threshold",
    ),
}  # fmt: skip
"""Distance method → parameters without effect on the distance and its standard deviation: their gradient is zero."""


def run(p: WaistParams, inputs: WaistInputs, options: WaistOptions = DEFAULT) -> Estimate:
    """Estimate from prepared inputs: pure, for jit, vmap and grad, with static options.

    Returns:
        `strides`, `strides_stddev` and `distance`; `diagnostics` holds `distance_stddev` (T,) [m], `trunk_acceleration`
        (T, 3) forward, to the left and up without gravity [m/s²], `FLAGS` for each stride, contacts `initial_contact`
        (K,) [s] with `_side`, `_side_probability` and `_valid`, and, if "fused", the accelerometer's bias,
        log-likelihood and mean normalised innovation.

    Raises:
        ValueError: an unknown option.
    """
    check_options(options, KNOWN)
    trunk = motion(p, inputs, smooth=options.smooth, method=options.method)
    intervals = waist_model.intervals(p, inputs, trunk)
    if options.distance == "fused":
        walked = waist_model.fused(p, inputs, intervals, options)
    else:
        from jgait.estimators.waist import velocity_update  # the paper's method alone needs it

        speed, held = compiled(velocity_update.integrated_speed)(p, inputs, trunk, intervals)
        start_sd = p.start_speed_sd * xp.where(inputs.stood, 0.0, 1.0)
        walked = velocity_update.by_integration(p, inputs, intervals, speed, held, start_sd)
    return stated(inputs, trunk, intervals, walked)


def stated(inputs: WaistInputs, motion: TrunkMotion, intervals: Intervals, walked: WaistWalk) -> Estimate:
    """The estimate that `run` returns: motion of the trunk, intervals between nodes and distances over them."""
    row = xp.arange(inputs.at.shape[0], dtype=xp.int32)
    there = row < inputs.count
    way = walked.distance - xp.cumsum(xp.minimum(walked.step, 0.0))  # a sway back is no way
    # linear in time between nodes; after the last node the distance is that of the last
    values = xp.stack([way, walked.distance_sd], axis=1)
    final = xp.where(inputs.count > 0, values[xp.maximum(inputs.count - 1, 0)], 0.0)
    when = xp.where(there, inputs.time[inputs.at], inputs.time[-1] + 1.0 + row.astype(values.dtype))
    distance, spread = interpolated(inputs.time, when, xp.where(there[:, None], values, final)).T
    strides, deviations, flags = _strides(inputs, intervals, walked, there)
    diagnostics = {
        **walked.diagnostics,
        **flags,
        "distance_stddev": spread,
        "trunk_acceleration": xp.stack([motion.forward, motion.left, motion.upward], axis=1),
        "initial_contact": inputs.contact,
        "initial_contact_side": inputs.side,
        "initial_contact_side_probability": inputs.likely,
        "initial_contact_valid": inputs.contacts & there,
    }
    return Estimate(
        inputs.time, Legs(None, None), None, distance, inputs.valid, diagnostics, strides,
        strides_stddev=deviations,
    )  # fmt: skip


def _strides(
    inputs: WaistInputs, intervals: Intervals, walked: WaistWalk, there: PyTree
) -> tuple[Strides, Strides, Values]:
    """Strides of both feet, their standard deviations and flags; one row per node. Where the trunk does not go forward
    there is no stride.
    """
    valid = inputs.stride & there & (walked.stride > 0.0)
    start, end = earlier(inputs.contact, 2), inputs.contact
    duration = xp.maximum(end - start, 1e-3)
    turn = intervals.turn + earlier(intervals.turn, 1)
    nothing = xp.full_like(end, xp.nan)
    strides = Strides(
        side=inputs.side, start=start, final_contact=nothing, end=end, length=walked.stride, width=nothing,
        height=nothing, valid=valid, speed=walked.stride / duration, turn=turn, step_length=earlier(walked.step, 1),
    )  # fmt: skip
    deviations = strides._replace(
        start=None, final_contact=None, end=None, length=walked.stride_sd, speed=walked.stride_sd / duration, turn=None,
        step_length=earlier(walked.step_sd, 1),
    )  # fmt: skip
    flags = {
        "turning": valid & (xp.abs(turn) > LARGEST_TURN),
        "half": valid & closing(inputs),
        "unsure": valid & walked.unsure,
        "side_unknown": valid & (inputs.likely < SIDE_KNOWN),
    }
    return strides, deviations, flags


def estimator(options: WaistOptions = DEFAULT) -> Estimator[WaistParams, WaistInputs]:
    """This estimator as a record of functions."""
    return Estimator(
        "waist", WaistParams(), partial(prepare, options=options), run, with_body, ABOUT, FLAGS, _finished,
        unused=UNUSED.get(options.distance, ()),
    )  # fmt: skip


def papers_estimator(options: WaistOptions = PAPER) -> Estimator[WaistParams, WaistInputs]:
    """The paper's pipeline as a separate estimator, `waist_ofdri`."""
    losses = tuple(name for name in ABOUT.losses or () if name != "likelihood")
    about = ABOUT._replace(title=f"{ABOUT.title}, by the paper's pipeline", default=PAPER, losses=losses)
    return estimator(options)._replace(name="waist_ofdri", about=about)


def estimate(p: WaistParams, recording: Recording, options: WaistOptions = DEFAULT) -> Estimate:
    """Contacts, strides and distance of one recording with a sensor at the waist, on the lower back or on the pelvis.

    `diagnostics["notes"]` lists notes about the recording, `initial_contact` and `initial_contact_side` (0 right, 1
    left) are the contacts in order [s]; below `SIDE_KNOWN` of `initial_contact_side_probability` a side is not known.

    Raises:
        RecordingError: see `prepare`.
        ValueError: a parameter outside its range, or an unknown option.
    """
    return estimator(options).estimate(p, recording)


SHORTEST_LEARNED_M, SLOWEST = 1.05, 0.85
"""[m], [m/s] Limits below the strides from which the pendulum was learned: the medians of 36 walks of `ipol_gait`, as
this estimator gives them, are 1.06 to 1.59 m and 0.87 to 1.57 m/s."""

FEW = 4
"""[1] Number of strides unlike those that were learned that is not noted. Chosen by hand."""

OUTSIDE_SD = 0.35
"""[1] Relative standard deviation of lengths of strides outside those from which the pendulum was learned, and of
strides that turn. Chosen by simulated people who shuffle, limp or run (`people.gaits`)."""


def _least_force(result: Estimate, contacts: np.ndarray) -> np.ndarray:
    """(strides,) [1] the least upward specific force in a step over gravity, as the median over the steps of each
    stride and those beside them; contacts [s].
    """
    up, time = as_float(result.diagnostics["trunk_acceleration"])[:, 2], as_float(result.time)
    width = max(1, round(OVER_S / float(np.median(np.diff(time)))))
    mean = np.convolve(np.nan_to_num(up), np.full(width, 1.0 / width), mode="same")
    samples = np.searchsorted(time, contacts)
    least = np.array([mean[a:b].min() if (b - a) > width else 0.0 for a, b in itertools.pairwise(samples)])
    first = np.searchsorted(contacts, as_float(result.strides.start))
    beside = [least[max(i - 1, 0) : i + 3] for i in first]
    return np.array([1.0 + float(np.median(steps)) / GRAVITY if steps.size else 1.0 for steps in beside])


def _slow(result: Estimate, inputs: WaistInputs) -> tuple[np.ndarray, list[Note]]:
    """(strides,) bool, strides that are short or slow beside those that were learned, and the note about them: all, if
    their median is below `SHORTEST_LEARNED_M` or `SLOWEST`, or each for itself. Strides of which both steps are beside
    standing are integrated, and do not count.
    """
    strides = result.strides
    length, speed, turn = (as_float(part) for part in (strides.length, strides.speed, strides.turn))
    kept = np.asarray(strides.valid, bool)
    beside = np.convolve(inputs.stands, np.ones(2 * EDGE_STEPS + 1), mode="same") > 0.0
    contact = as_float(inputs.contact)  # in order; the nearest of each stride's end
    rows = np.searchsorted(0.5 * (contact[1:] + contact[:-1]), as_float(strides.end))
    # [m/s] straight strides of `ipol_gait` are faster, but for the last ones
    noted = slow = kept & (speed < 0.6) & (np.abs(turn) <= LARGEST_TURN) & ~(beside[rows] & beside[rows - 1])
    whole = kept & ~np.asarray(result.diagnostics["half"], bool)
    whole = whole if whole.any() else kept
    if np.median(length[whole]) < SHORTEST_LEARNED_M or np.median(speed[whole]) < SLOWEST:
        noted, slow = whole & ((length < SHORTEST_LEARNED_M) | (speed < SLOWEST)), kept
    elif slow.sum() <= FEW:
        return slow, []
    text = (
        "{strides} of {of} strides, of {length_m:.2f} m at {speed:.2f} m/s in the median, are shorter or slower than "
        f"those from which step lengths were learned, {SHORTEST_LEARNED_M:.2f} m and more at {SLOWEST:.2f} m/s and more"
    )
    middle = {"length_m": np.median(length[noted]), "speed": np.median(speed[noted])}
    return slow, [NOT_LEARNED.note(text, strides=noted.sum(), of=kept.sum(), **middle)]


def _doubts(
    result: Estimate, contacts: np.ndarray, made: Prepared[WaistInputs]
) -> tuple[SensorQuality, list[Note], dict[str, np.ndarray]]:
    """Facts and notes if the distance is unreliable by a quarter, strides are slow (see `_slow`), or in some the
    person climbs or runs (see `FREE`); and the evidence about each stride.
    """
    strides, unlike, notes = result.strides, list[Note](), list[Note]()
    kept = np.asarray(strides.valid, bool)
    if not kept.any():
        return SensorQuality(), [], {}
    way, spread = float(result.distance[-1]), float(result.diagnostics["distance_stddev"][-1])
    if useless := not spread <= 0.25 * way:
        notes.append(DISTANCE_DOUBTFUL(distance_m=way, within_m=2.0 * spread))
    outside = np.zeros(len(kept), bool)
    if made.options.distance == "fused":
        slow, unlike = _slow(result, made.inputs)
        beside = np.convolve(slow, np.ones(2 * EDGE_STEPS + 1))[EDGE_STEPS:-EDGE_STEPS] > 0.0  # a person stops
        outside = kept & (beside | (np.abs(as_float(strides.turn)) > LARGEST_TURN))
    time, up = as_float(result.time), as_float(result.diagnostics["trunk_acceleration"])[:, 2:]
    # the rise of the trunk over each stride; 0 where rests are too far away to compute it
    height = moved_between(up, made.inputs.still, (len(time) - 1) / float(np.ptp(time)))[:, 0]
    rise = np.diff(np.interp([as_float(strides.start), as_float(strides.end)], time, height), axis=0)[0]
    force = _least_force(result, contacts)
    climbs, runs = kept & (np.abs(rise) > 0.25), kept & (force < FREE)  # [m] flat stairs rise more, slopes less
    climbs &= climbs.sum() > FEW
    if climbs.any():
        text = "{strides} of {of} strides rise or fall by {rise_m:.2f} m in the median, as on stairs"
        rise_m = np.median(abs(rise[climbs]))
        unlike.append(NOT_LEARNED.note(text, strides=climbs.sum(), of=kept.sum(), rise_m=rise_m))
    if runs.sum() > FEW:
        share = 100.0 * max(float(np.median(force[runs])), 0.0)
        text = (
            "in {strides} of {of} strides {share_pct:.0f} % of gravity or less is felt once in each step: running, or "
            "faster than the walks from which step lengths were learned"
        )
        unlike.append(NOT_LEARNED.note(text, strides=runs.sum(), of=kept.sum(), share_pct=share))
        outside |= runs
    facts = SensorQuality(unusable=useless, unlike=bool(unlike))
    # [1] relative deviation of lengths on stairs, chosen as `OUTSIDE_SD`
    evidence = {**among(strides), "outside": np.where(climbs, 0.6, OUTSIDE_SD * outside)}
    return facts, [*notes, *unlike], evidence


def _steps_missed(result: Estimate, contacts: np.ndarray) -> list[Note]:
    """A note if there are far fewer contacts [s] than the trunk is moved by steps."""
    if len(contacts) < FEW:
        return []
    force = np.add(as_float(result.diagnostics["trunk_acceleration"]), [0.0, 0.0, GRAVITY])
    contact_rate, rate = (1.0 / float(np.median(np.diff(times))) for times in (contacts, as_float(result.time)))
    steps = step_frequency(force, rate)
    if contact_rate >= 0.65 * steps:  # chosen, far below walks of `ipol_gait`, `mobgap_lab` and `tripod`
        return []
    text = (
        "{found:.1f} contacts a second were found, but the trunk moves as in {steps:.1f} steps a second: contacts are "
        "missed, as in limping"
    )
    return [WALKING_MISSED.note(text, found=contact_rate, steps=steps)]


def _finished(result: Estimate, made: Prepared[WaistInputs]) -> Estimate:
    """The estimate with only the valid contacts, with notes and larger deviations if its distance is unreliable."""
    diagnostics = dict(result.diagnostics)
    contacts = np.flatnonzero(diagnostics.pop("initial_contact_valid"))
    for name in ("initial_contact", "initial_contact_side", "initial_contact_side_probability"):
        diagnostics[name] = diagnostics[name][contacts]
    (name,) = made.quality
    result = result._replace(diagnostics=diagnostics)
    facts, doubts, evidence = _doubts(result, diagnostics["initial_contact"], made)
    missed = _steps_missed(result, diagnostics["initial_contact"])
    diagnostics["notes"] = (*diagnostics["notes"], *doubts, *missed)
    diagnostics["sensors"] = merged(diagnostics["sensors"], {name: facts})
    if made.options.distance != "fused":
        return result
    every = np.ones(np.shape(result.strides.side), bool)
    evidence |= of_sensors(result, {0: name, 1: name})
    if missed:  # a stride is two: neither its length nor its time holds
        evidence["outside"] = np.maximum(evidence.get("outside", 0.0), OUTSIDE_SD * every)
    result = quality.judged(result, "waist", evidence, {0: name, 1: name})
    both = {"doubtful": every, "uneven": every} if missed else {}
    return result._replace(diagnostics={**result.diagnostics, **both})
