r"""Heel strikes and walked distance from one inertial sensor at the waist.

The sensor tells which way it is worn; a gravity filter takes gravity off; contacts of both feet are read off the
forward and upward accelerations. The distance is that of a state-space model over speed, the accelerometer's bias and
the pendulum's constant (`waist_model`), a row a step, with the steps of an inverted pendulum as observations and zero
speed while standing. The paper's own way is an option: direct and reverse integration of every cycle with a velocity
update (`velocity_update`).

Source: A. Köse, A. Cereatti, U. Della Croce, "Estimation of traversed distance in level walking using a single inertial
measurement unit attached to the waist", 2011.

Sensors:
    `waist`, `lower_back` or `pelvis`, gyroscope and accelerometer [m/s²], 25 to 400 Hz, mounted in any way. Two seconds
    of quiet standing give the gyroscope's bias; a start from standing gives the speed.

Outputs:
    Contacts, strides with length and standard deviation, the distance, and in `diagnostics` its standard deviation, the
    pendulum's constant, and for every stride whether it is one of a turn, and whether integration can be relied on. No
    walking is an empty table.

Deviations from the paper; effects by `experiments/waist_ofdri.py`:
    1. `distance="fused"` instead of the velocity update, which needs a forward acceleration without bias: 0.003 m/s²
       for its 0.8 %, or 0.02° of tilt. `distance="update"` is the paper.
    2. Contacts by a soft argmax; `detector="paper"` is the paper's midpoint rule, "literal" by the letter.
    3. The paper's orientation filter is cited, not printed: here a filter on the direction of gravity.

Parameters whose gradient is zero by construction:
    what a way of measuring does not use (`UNUSED`); what decides (axes, standing, contacts, bouts) has none.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jgait import filtering, params, velocity_update
from jgait.direct_reverse import Cycles
from jgait.estimators import waist_model, waist_motion, waist_steps
from jgait.estimators.foot_strides import root
from jgait.estimators.interface import Estimator, Prepared, bucket
from jgait.estimators.waist_calibration import Preparation, prepare
from jgait.estimators.waist_inputs import WaistInputs, pad
from jgait.estimators.waist_model import WaistControl, WaistModelParams, WaistObservation
from jgait.estimators.waist_params import (
    DEFAULT,
    PAPER,
    TRANSFORMS,
    WaistOptions,
    WaistParams,
    check_options,
    with_body,
)
from jgait.estimators.waist_steps import Intervals
from jgait.types import Estimate, Legs, Recording, Strides

BUCKET = 1024
"""Recordings are padded to this many samples times a power of two, so that few programs are compiled."""

TURNING = 0.35
"""[rad] A stride over which the walk turns by more (20°) is flagged as part of a turn."""

TURNED = 1.0
"""[rad] After a turn by more, a bias of the accelerometer has turned round, and integration is not to be relied on."""

EDGE_STEPS = 2
"""So many intervals after standing, and before it, are of setting off and of stopping."""

FLAGS = ("turning", "unsure")
"""What `diagnostics` says of every stride, by name, in the order of the strides; (n,) bool."""

_PENDULUM = ("pendulum_constant", "pendulum_constant_sd", "step_noise", "turn_noise", "edge_noise")
_EXCURSION = ("excursion_hz", "pendulum_length", "excursion_power", "surge_power", "turn_shortening")
_SPEED = ("acc_bias", "acc_bias_unknown", "acc_bias_turn", "start_speed", "start_speed_sd")
_FUSION = ("speed_noise", "acc_bias_walk", "standing_speed")
_ALONE = (*_PENDULUM, *_EXCURSION, *_FUSION, "update_noise")
UNUSED = {
    "fused": ("update_noise", "update"),
    "pendulum": (*_SPEED, *_FUSION, "update_noise", "update"),
    "update": _ALONE,
    "frozen": _ALONE,
    "integrated": _ALONE,
}
"""Way of measuring → parameters on which neither distance nor its deviation depends, so that their gradient is zero."""

__all__ = [
    "DEFAULT",
    "FLAGS",
    "PAPER",
    "TRANSFORMS",
    "UNUSED",
    "WaistOptions",
    "WaistParams",
    "estimate",
    "estimator",
    "prepared",
    "run",
    "with_body",
]


class Walked(NamedTuple):
    """What was walked up to each node, and over the step and the stride that end there; (K,) each.

    Attributes:
        distance: [m].
        distance_sd: [m].
        step: [m].
        stride: [m].
        stride_sd: [m].
        unsure: bool, integration is not to be relied on there.
        told: name → scalar, of the whole recording.
    """

    distance: Any
    distance_sd: Any
    step: Any
    stride: Any
    stride_sd: Any
    unsure: Any
    told: dict[str, Any]


def earlier(values: Any, rows: int) -> Any:
    """(K,) what was some rows before; the first rows are their own."""
    return jnp.concatenate([values[:rows], values[:-rows]])


def model_params(p: WaistParams, stood: Any) -> WaistModelParams:
    """The model's parameters; `stood` says whether any rest told the accelerometer's bias."""
    known = jnp.where(stood, p.acc_bias, p.acc_bias_unknown)
    return WaistModelParams(
        p.speed_noise**2, known**2, p.acc_bias_walk**2, p.acc_bias_turn**2, p.start_speed,
        p.start_speed_sd**2, p.standing_speed**2, jnp.log(p.pendulum_constant), p.pendulum_constant_sd**2,
    )  # fmt: skip


def _update_speed(p: WaistParams, inputs: WaistInputs, seen: Any, found: Intervals, kind: str) -> tuple[Any, Any]:
    """Mean speed over each interval by integration (K,) [m/s], and whether OFDRI was kept there."""
    begun = inputs.at[0]
    index = jnp.arange(seen.forward.shape[0], dtype=jnp.int32)
    forward = jnp.where((index > begun) & inputs.valid, seen.forward, 0.0)
    start = jnp.where(inputs.stands[0], 0.0, p.start_speed)
    cycles = Cycles(inputs.cycle_begin, inputs.cycle_end, inputs.cycles)
    way = {
        "update": velocity_update.updated, "frozen": velocity_update.frozen, "integrated": velocity_update.integrated
    }[kind]  # fmt: skip
    told = way(p.update, forward, cycles, inputs.dt, start, mask=inputs.valid)
    here = told.displacement[inputs.at]
    duration = jnp.where(found.duration > 0.0, found.duration, 1.0)
    corrected = told.kept > 0.5
    ends = jnp.zeros_like(inputs.valid, dtype=jnp.int32)
    ends = ends.at[inputs.cycle_end].max(corrected.astype(jnp.int32))
    ended = ends[inputs.at] > 0
    held = ended | jnp.concatenate([ended[1:], jnp.zeros_like(ended[:1])])
    return (here - earlier(here, 1)) / duration, held & inputs.steps


def _turned(inputs: WaistInputs, found: Intervals) -> Any:
    """(K,) bool: the walk has turned round since the bout began."""
    heading = jnp.cumsum(found.turn)

    def one(begun: Any, row: Any) -> Any:
        fresh, now = row
        begun = jnp.where(fresh, now, begun)
        return begun, jnp.abs(now - begun) > TURNED

    _, away = jax.lax.scan(one, heading[0], (inputs.fresh, heading))

    def keep(before: Any, row: Any) -> Any:
        fresh, now = row
        after = jnp.where(fresh, False, before) | now
        return after, after

    return jax.lax.scan(keep, jnp.zeros((), bool), (inputs.fresh, away))[1]


def _step_variance(p: WaistParams, inputs: WaistInputs, found: Intervals) -> Any:
    """(K,) of the pendulum's steps [m²]: in turns, and in setting off and stopping, it says less."""
    edge = inputs.stands
    for _ in range(EDGE_STEPS):
        none = jnp.zeros_like(edge[:1])
        edge = edge | jnp.concatenate([none, edge[:-1]]) | jnp.concatenate([edge[1:], none])
    turned = (p.turn_noise * found.turn) ** 2
    return p.step_noise**2 + turned + jnp.where(edge, p.edge_noise**2, 0.0)


def _fused(p: WaistParams, inputs: WaistInputs, seen: Any, found: Intervals, options: WaistOptions) -> Walked:
    """The state-space model over a walk."""
    row = jnp.arange(inputs.at.shape[0], dtype=jnp.int32)
    there = row < inputs.count
    unsure = ~inputs.stood | _turned(inputs, found)
    dtype = found.gained.dtype
    zero = jnp.zeros_like(found.gained)
    speed, spread, heard = zero, zero + 1.0, jnp.zeros_like(there)
    if options.updated:
        speed, _ = _update_speed(p, inputs, seen, found, "update")
        spread = p.update_noise**2 * jnp.maximum(inputs.alone, 1.0)
        heard = inputs.steps & ~unsure & there
    controls = WaistControl(
        gained=found.gained,
        went=found.went,
        walks=(inputs.moves & there).astype(dtype),
        turn=found.turn,
        pendulum=found.pendulum,
        pendulum_variance=_step_variance(p, inputs, found),
        update=speed,
        update_variance=spread,
        duration=found.duration,
    )
    stepped = inputs.steps & there & (found.pendulum > 0.0)
    mask = WaistObservation(stepped, heard, inputs.stands & there)
    observed = WaistObservation(zero, zero, zero)
    known = model_params(p, jnp.any(inputs.still))
    settings: dict[str, Any] = {
        "controls": controls, "dt": found.duration, "mask": mask, "initial": waist_model.initial(known),
        "execution": options.execution,
    }  # fmt: skip
    if options.smooth:
        smooth = filtering.kalman_smoother(
            waist_model.MODEL, known, observed, keep=("log_likelihood", "nis", "count", "valid"), **settings
        )
        mean, cov, posterior = smooth.mean, smooth.cov, smooth.filtered
    else:
        posterior = filtering.kalman_filter(waist_model.MODEL, known, observed, **settings)
        mean, cov = posterior.mean, posterior.cov
    spread = cov.stddev()
    last = jnp.maximum(inputs.count - 1, 0)
    nis = jnp.sum(posterior.nis) / jnp.maximum(jnp.sum(posterior.count), 1.0)
    told = {
        "pendulum_constant": jnp.exp(mean.log_constant[last]),
        "pendulum_constant_stddev": jnp.exp(mean.log_constant[last]) * spread.log_constant[last],
        "acc_bias": mean.bias[last],
        "log_likelihood": jnp.sum(posterior.log_likelihood),
        "nis": nis,
    }
    return Walked(mean.distance, spread.distance, mean.step, mean.stride, spread.stride, unsure, told)


def _by_pendulum(p: WaistParams, inputs: WaistInputs, found: Intervals) -> Walked:
    """The pendulum's steps alone; from and to standing half of the step beside it."""
    own = jnp.where(inputs.steps, p.pendulum_constant * found.pendulum, 0.0)
    beside = jnp.maximum(jnp.concatenate([own[1:], own[:1]]), jnp.concatenate([own[:1], own[:-1]]))
    step = jnp.where(inputs.moves & ~inputs.steps, 0.5 * beside, own)
    variance = jnp.where(inputs.moves, _step_variance(p, inputs, found), 0.0)
    distance, share = jnp.cumsum(step), p.pendulum_constant_sd
    stride, white = step + earlier(step, 1), variance + earlier(variance, 1)
    return Walked(
        distance=distance,
        distance_sd=root(jnp.cumsum(variance) + (share * distance) ** 2),
        step=step,
        stride=stride,
        stride_sd=root(white + (share * stride) ** 2),
        unsure=jnp.zeros_like(inputs.steps),
        told={},
    )


def _by_integration(p: WaistParams, inputs: WaistInputs, seen: Any, found: Intervals, kind: str) -> Walked:
    """The paper's way, and how far it can be right.

    A bias b of the forward acceleration makes the speed wrong by b t up to the cycle from which OFDRI holds the speed,
    and no further; in a turn it turns round. A walk that does not begin from standing has a speed that nobody knows.
    """
    speed, held = _update_speed(p, inputs, seen, found, kind)
    held = jnp.ones_like(held) if kind == "frozen" else held & (kind != "integrated")
    step = jnp.where(inputs.moves, found.duration * speed, 0.0)
    distance = jnp.cumsum(step)
    turned = _turned(inputs, found)
    known = jnp.where(jnp.any(inputs.still), p.acc_bias, p.acc_bias_unknown)
    free = jnp.where(inputs.moves & (~held | ~inputs.stood), found.duration, 0.0)
    bias = known + jnp.where(turned, p.acc_bias_turn, 0.0)
    # what is held from the first contact on holds the speed of somebody who is still setting off
    first = p.start_speed_sd if kind == "frozen" else jnp.where(inputs.stands[0], 0.0, p.start_speed_sd)
    wrong = first + jnp.cumsum(bias * free)
    off = jnp.cumsum(jnp.where(inputs.moves, wrong * found.duration, 0.0))
    stride, two = step + earlier(step, 1), found.duration + earlier(found.duration, 1)
    return Walked(distance, off, step, stride, wrong * two, ~inputs.stood | turned, {})


def run(p: WaistParams, inputs: WaistInputs, options: WaistOptions = DEFAULT) -> Estimate:
    """Estimate from prepared inputs: pure, for jit, vmap and grad.

    Args:
        p: parameters.
        inputs: from `prepare`; stacked along a new first axis for `jax.vmap`.
        options: which parts are on; static under jit.

    Returns:
        `strides`, `strides_stddev` and `distance`; `diagnostics` holds `distance_stddev` (T,) [m], `FLAGS` for each
        stride, contacts `initial_contact` (K,) [s] with `initial_contact_side` and `initial_contact_valid`, and of the
        fused way the pendulum's constant, the accelerometer's bias, log-likelihood and mean normalised innovation.

    Raises:
        ValueError: options that are none.
    """
    check_options(options)
    seen = waist_motion.motion(p, inputs, smooth=options.smooth, execution=options.execution)
    found = waist_steps.intervals(p, inputs, seen)
    if options.distance == "fused":
        walked = _fused(p, inputs, seen, found, options)
    elif options.distance == "pendulum":
        walked = _by_pendulum(p, inputs, found)
    else:
        walked = _by_integration(p, inputs, seen, found, options.distance)
    row = jnp.arange(inputs.at.shape[0], dtype=jnp.int32)
    there = row < inputs.count
    distance, spread = (_along(inputs, values, there) for values in (walked.distance, walked.distance_sd))
    strides, deviations, flags = _strides(inputs, found, walked, there)
    diagnostics = {
        **walked.told,
        **flags,
        "distance_stddev": spread,
        "initial_contact": inputs.contact,
        "initial_contact_side": inputs.side,
        "initial_contact_valid": inputs.contacts & there,
    }
    return Estimate(
        inputs.time, Legs(None, None), None, distance, inputs.valid, diagnostics, strides,
        strides_stddev=deviations,
    )  # fmt: skip


def _along(inputs: WaistInputs, values: Any, there: Any) -> Any:
    """(T,) what is known at nodes, evenly between them."""
    row = jnp.arange(values.shape[0], dtype=jnp.int32).astype(values.dtype)
    final = values[jnp.maximum(inputs.count - 1, 0)]
    beyond = inputs.time[-1] + 1.0 + row
    when = jnp.where(there, inputs.time[inputs.at], beyond)
    return jnp.interp(inputs.time, when, jnp.where(there, values, jnp.where(inputs.count > 0, final, 0.0)))


def _strides(inputs: WaistInputs, found: Intervals, walked: Walked, there: Any) -> tuple[Strides, Strides, Any]:
    """Strides of both feet, their standard deviations and flags; a row a node."""
    valid = inputs.stride & there
    start, end = earlier(inputs.contact, 2), inputs.contact
    duration = jnp.maximum(end - start, 1e-3)
    turn = found.turn + earlier(found.turn, 1)
    nothing = jnp.full_like(end, jnp.nan)
    strides = Strides(
        side=inputs.side, start=start, final_contact=nothing, end=end, length=walked.stride, width=nothing,
        height=nothing, valid=valid, speed=walked.stride / duration, turn=turn, step_length=earlier(walked.step, 1),
    )  # fmt: skip
    deviations = strides._replace(
        start=None, final_contact=None, end=None, length=walked.stride_sd, speed=walked.stride_sd / duration, turn=None,
        step_length=None,
    )  # fmt: skip
    flags = {"turning": valid & (jnp.abs(turn) > TURNING), "unsure": valid & walked.unsure}
    return strides, deviations, flags


_run_jit = jax.jit(run, static_argnames=("options",))


def prepared(recording: Recording, options: WaistOptions = DEFAULT) -> Preparation:
    """The inputs of `run` for a recording; raises `RecordingError` as `waist_calibration.prepare`."""
    return prepare(recording, options)


def estimator(options: WaistOptions = DEFAULT) -> Estimator[WaistParams, WaistInputs]:
    """This estimator as a record of functions, for cohorts."""

    def ready(recording: Recording) -> Prepared[WaistInputs]:
        preparation = prepared(recording, options)
        return Prepared(preparation.inputs, options, preparation.notes, preparation.standing)

    return Estimator("waist_ofdri", WaistParams(), TRANSFORMS, ready, pad, run, with_body)


def estimate(p: WaistParams, recording: Recording, options: WaistOptions = DEFAULT) -> Estimate:
    """Contacts, strides and distance of one recording.

    Args:
        p: parameters.
        recording: a sensor at the waist, on the lower back or on the pelvis.
        options: which parts are on.

    Returns:
        An `Estimate`; `diagnostics["notes"]` says in words what was decided on the way, `initial_contact` and
        `initial_contact_side` (0 right, 1 left) are the contacts in order [s].

    Raises:
        RecordingError: see `waist_calibration.prepare`.
        ValueError: a parameter outside its range, an option that is none.
    """
    params.check_params(p, TRANSFORMS)
    preparation = prepared(recording, options)
    samples = preparation.inputs.time.size
    padded = pad(preparation.inputs, bucket(samples, BUCKET))
    result = jax.tree.map(np.asarray, _run_jit(p, padded, options))
    rows = np.flatnonzero(result.strides.valid)
    strides, deviations = jax.tree.map(lambda column: column[rows], (result.strides, result.strides_stddev))
    told = {name: value[rows] if name in FLAGS else value for name, value in result.diagnostics.items()}
    contacts = np.flatnonzero(told.pop("initial_contact_valid"))
    for name in ("initial_contact", "initial_contact_side"):
        told[name] = told[name][contacts]
    told["distance_stddev"] = told["distance_stddev"][:samples]
    told |= {"notes": preparation.notes, "standing": preparation.standing}
    return result._replace(
        time=result.time[:samples], distance=result.distance[:samples], valid=result.valid[:samples], diagnostics=told,
        strides=strides, strides_stddev=deviations,
    )  # fmt: skip
