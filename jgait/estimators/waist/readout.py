r"""Distance over each interval between nodes, by each distance method of the waist's estimator.

"fused": `waist.model`; "update": the paper's method, which restarts every bout with its initial speed, zero from
standing.
"""

from typing import Any, NamedTuple

from jaxtyping import Array, PyTree

from jgait import filtering
from jgait.estimators.notes import LONGEST_LOSS
from jgait.estimators.programs import compiled
from jgait.estimators.waist import model as waist_model
from jgait.estimators.waist import velocity_update
from jgait.estimators.waist.inputs import WaistInputs
from jgait.estimators.waist.model import WaistControl, WaistModelParams, WaistObservation
from jgait.estimators.waist.motion import TrunkMotion
from jgait.estimators.waist.ofdri import Cycles
from jgait.estimators.waist.params import WaistOptions, WaistParams
from jgait.estimators.waist.steps import Intervals
from jgait.geometry.arrays import largest_so_far, put, xp
from jgait.geometry.vectors import root
from jgait.types import AnyArray, Flags, Values

EDGE_STEPS = 2
"""[intervals] Number of intervals after standing that are gait initiation, and before standing or the end of a bout
that are stopping. Beside standing, whose speed is known, no pendulum is observed: on `ipol_gait` it makes the last
steps too long, and integration does not."""


class WaistWalk(NamedTuple):
    """Distance up to each node, and lengths of the step and the stride that end at the node; (K,) each."""

    distance: Values  #: distance walked up to the node [m].
    distance_sd: Values  #: its standard deviation [m].
    step: Values  #: length of the step [m].
    step_sd: Values  #: its standard deviation [m].
    stride: Values  #: length of the stride [m].
    stride_sd: Values  #: its standard deviation [m].
    unsure: Flags  #: bool, integration is unreliable at the node.
    diagnostics: dict[str, Any]  #: name → scalar, diagnostics of the whole recording.


def earlier(values: AnyArray, rows: int) -> Array:
    """(K,) values of a number of rows before; the first rows keep their values."""
    return xp.concatenate([values[:rows], values[:-rows]])


def constant_variance(p: WaistParams) -> Values:
    """Variance among people of the logarithm of their steps over the pendulum's: of the constant and of the sensor's
    height.
    """
    power = 1.0 - 0.5 * (p.excursion_power + p.surge_power)
    return p.pendulum_constant_sd**2 + (power * p.pendulum_length_sd / p.pendulum_length) ** 2


def personal_constant(p: WaistParams, inputs: WaistInputs, intervals: Intervals) -> tuple[Values, Values]:
    """The person's constant K, and the variance of its logarithm, from the prior among people and from every start.

    After standing the speed is known: integrated over the next three intervals, of which the first is gait initiation,
    it has drifted little, and the lengths of the other two over the pendulum's are K times `start_gain`. A start that
    turns, stops again, loses samples or contradicts the prior, as one on a belt, does not count.
    """
    row = xp.arange(inputs.at.shape[0], dtype=xp.int32)
    speed = earlier(intervals.gained, 1)
    steps = intervals.duration * speed + intervals.went
    way = earlier(steps, 1) + steps + intervals.duration * earlier(speed, 1)
    swung = intervals.pendulum + earlier(intervals.pendulum, 1)
    lost = xp.cumsum(xp.where(inputs.measured, 0.0, inputs.dt))[inputs.at]
    starts = earlier(inputs.stands & inputs.fresh, 3) & earlier(inputs.moves, 2) & earlier(inputs.steps, 1)
    starts = starts & inputs.steps & (row > 2) & (row < inputs.count) & (lost == earlier(lost, 3)) & (swung > 0.0)
    starts = starts & ~_turned(inputs, intervals) & ~_beside(_stopping(inputs)) & (way > 0.0)
    prior = constant_variance(p)
    off = xp.log(xp.where(starts, way, 1.0) / xp.where(starts, swung, 1.0) / (p.start_gain * p.pendulum_constant))
    # [sd] as on a belt, where the integrated speed is about zero; no start over ground is that far off
    starts = starts & (off * off < 4.0**2 * (prior + p.start_noise**2))
    count = xp.sum(starts.astype(off.dtype))
    noise = 0.5 * p.start_noise**2 * (1.0 + 1.0 / xp.maximum(count, 1.0))
    share = xp.where(count > 0.0, prior / (prior + noise), 0.0)
    mean = xp.sum(xp.where(starts, off, 0.0)) / xp.maximum(count, 1.0)
    return p.pendulum_constant * xp.exp(share * mean), (1.0 - share) * prior


def model_params(p: WaistParams, stood: PyTree, constant: Values) -> WaistModelParams:
    """The model's parameters; `stood`: the person stood still, so that the accelerometer's bias is better known;
    `constant` is the person's.
    """
    known = xp.where(stood, p.acc_bias, p.acc_bias_unknown)
    return WaistModelParams(
        p.speed_noise**2, known**2, p.acc_bias_walk**2, p.acc_bias_turn**2, p.start_speed,
        p.start_speed_sd**2, p.standing_speed**2, constant,
    )  # fmt: skip


def begun(inputs: WaistInputs) -> Values:
    """(K,) the row at which the bout of each node begins."""
    row = xp.arange(inputs.fresh.shape[0], dtype=xp.int32)
    return largest_so_far(xp.where(inputs.fresh, row, 0))


def _turned(inputs: WaistInputs, intervals: Intervals) -> Values:
    """(K,) bool: the walk has turned by more than a radian since the bout began."""
    heading, first = xp.cumsum(intervals.turn), begun(inputs)
    row = xp.arange(first.shape[0], dtype=xp.int32)
    away = xp.abs(heading - heading[first]) > 1.0  # [rad] the bias has turned, and integration is unreliable
    return largest_so_far(xp.where(away, row, -1)) >= first


def bouts_begin(p: WaistParams, inputs: WaistInputs, like: Values) -> tuple[Values, Values]:
    """Samples at which a bout begins (T,) bool, and the initial speed: 0 after standing, else `start_speed` [m/s], in
    the dtype of `like` (T,).
    """
    at = xp.where(inputs.fresh, inputs.at, like.shape[0])
    starts = xp.where(inputs.stands, 0.0, p.start_speed)
    return put(xp.zeros_like(inputs.valid), at, True), put(xp.zeros_like(like), at, starts.astype(like.dtype))


def integrated_speed(
    p: WaistParams, inputs: WaistInputs, motion: TrunkMotion, intervals: Intervals,
    initial: int = velocity_update.INITIAL,
) -> tuple[Values, Values]:  # fmt: skip
    """Mean speed over each interval by integration (K,) [m/s], and whether OFDRI was used over the interval."""
    known, start = bouts_begin(p, inputs, motion.forward)
    cycles = Cycles(inputs.cycle_begin, inputs.cycle_end, inputs.cycles)
    covered = velocity_update.updated(
        p.update, motion.forward, cycles, inputs.dt, start, mask=inputs.valid, known=known, initial=initial
    )
    here = covered.displacement[inputs.at]
    duration = xp.where(intervals.duration > 0.0, intervals.duration, 1.0)
    ends = put(xp.zeros_like(inputs.valid), inputs.cycle_end, covered.kept > 0.5, "max")
    ended = ends[inputs.at]
    held = ended | xp.concatenate([ended[1:], xp.zeros_like(ended[:1])])
    return (here - earlier(here, 1)) / duration, held & inputs.steps


def _beside(flags: Flags) -> Flags:
    """(K,) bool, within `EDGE_STEPS` nodes of one of these."""
    none = xp.zeros_like(flags[:1])
    for _ in range(EDGE_STEPS):
        flags = flags | xp.concatenate([none, flags[:-1]]) | xp.concatenate([flags[1:], none])
    return flags


def _stopping(inputs: WaistInputs) -> Flags:
    """(K,) bool, a bout ends at the node, also where no standing is detected: the person shuffles or sways there."""
    row = xp.arange(inputs.at.shape[0], dtype=xp.int32)
    ends = xp.concatenate([inputs.fresh[1:], xp.zeros_like(inputs.fresh[:1])]) | (row == inputs.count - 1)
    return ends & inputs.moves


def closing(inputs: WaistInputs) -> Flags:
    """(K,) bool: the person stands at the next node, so that the step to this one closes a bout."""
    return xp.concatenate([inputs.stands[1:], xp.zeros_like(inputs.stands[:1])]) & inputs.steps


def step_variance(p: WaistParams, inputs: WaistInputs, intervals: Intervals) -> Values:
    """(K,) variance of the pendulum's steps [m²]; larger in turns, at both ends of a bout, and over lost samples."""
    edge = _beside(inputs.stands | _stopping(inputs))
    lost = xp.cumsum(xp.where(inputs.measured, 0.0, inputs.dt))[inputs.at]
    edge = edge | (lost - earlier(lost, 1) > LONGEST_LOSS)
    turned = (p.turn_noise * intervals.turn) ** 2
    return p.step_noise**2 + turned + xp.where(edge, p.edge_noise**2, 0.0)


def fused(p: WaistParams, inputs: WaistInputs, intervals: Intervals, options: WaistOptions) -> WaistWalk:
    """Distance by the state-space model.

    The pendulum's constant has one error for all steps. It is no state: integrated accelerations of a whole walk are
    too small, the more the longer it is, and would lower it with every bout. The foot of a stride that ends in standing
    comes to rest beside the other: it moves as far as the step before is long, while the trunk goes farther. The
    deviation of an integrated stride contains its difference from the pendulum's.
    """
    row = xp.arange(inputs.at.shape[0], dtype=xp.int32)
    there = row < inputs.count
    unsure = ~inputs.stood | _turned(inputs, intervals)
    dtype = intervals.gained.dtype
    zero = xp.zeros_like(intervals.gained)
    controls = WaistControl(
        gained=intervals.gained,
        went=intervals.went,
        walks=(inputs.moves & there).astype(dtype),
        turn=intervals.turn,
        pendulum=intervals.pendulum,
        pendulum_variance=step_variance(p, inputs, intervals),
    )
    integrated = _beside(inputs.stands)
    stepped = inputs.steps & (intervals.pendulum > 0.0) & ~integrated & there
    mask = WaistObservation(stepped, inputs.stands & there)
    observed = WaistObservation(zero, zero)
    constant, constant_spread = personal_constant(p, inputs, intervals)
    known = model_params(p, xp.any(inputs.still), constant)
    inferred = compiled(_states)(known, observed, controls, intervals.duration, mask, options=options)
    mean, variance = inferred.mean, inferred.cov.variances()
    last = xp.maximum(inputs.count - 1, 0)
    diagnostics = {"acc_bias": mean.bias[last], "log_likelihood": inferred.log_likelihood, "nis": inferred.nis}
    diagnostics |= {"pendulum_constant": constant, "pendulum_constant_stddev": constant * root(constant_spread)}
    distance_sd, step_sd, stride_sd = (
        root(spread + constant_spread * way**2) for way, spread in zip(mean[:3], variance[:3], strict=True)
    )
    swung = constant * intervals.pendulum
    closes = closing(inputs)
    stride = xp.where(closes, earlier(mean.step, 1), mean.stride)
    apart = stride - xp.where(closes, 0.0, swung) - earlier(swung, 1)
    stride_sd = root(stride_sd**2 + xp.where(integrated | earlier(integrated, 1), apart, 0.0) ** 2)
    return WaistWalk(mean.distance, distance_sd, mean.step, step_sd, stride, stride_sd, unsure, diagnostics)


def _states(
    known: WaistModelParams, observed: WaistObservation, controls: WaistControl, dt: Values, mask: WaistObservation,
    options: WaistOptions,
) -> filtering.Inferred:  # fmt: skip
    return filtering.infer(
        waist_model.MODEL, known, observed, smooth=options.smooth, controls=controls, dt=dt, mask=mask,
        initial=waist_model.initial(known), method=options.method,
    )  # fmt: skip


def by_integration(
    p: WaistParams, inputs: WaistInputs, intervals: Intervals, speed: Values, held: Flags, start_sd: Values
) -> WaistWalk:
    """Distance by the paper's method, and its standard deviation.

    A bias b of the forward acceleration causes an error b t of the speed, which grows up to the cycle from which OFDRI
    holds the speed (`held`); a turn of the walk reverses the bias. The initial speed of a bout that does not begin from
    standing has the deviation `start_sd` (K,) [m/s]. Errors of bouts add up, because all have the same bias. `speed`
    (K,) is the mean over each interval [m/s].
    """
    step = xp.where(inputs.moves, intervals.duration * speed, 0.0)
    distance = xp.cumsum(step)
    turned = _turned(inputs, intervals)
    known = xp.where(xp.any(inputs.still), p.acc_bias, p.acc_bias_unknown)
    free = xp.where(inputs.moves & (~held | ~inputs.stood), intervals.duration, 0.0)
    bias = known + xp.where(turned, p.acc_bias_turn, 0.0)
    drifted = xp.cumsum(bias * free)
    wrong = start_sd + drifted - drifted[begun(inputs)]
    off = xp.cumsum(xp.where(inputs.moves, wrong * intervals.duration, 0.0))
    stride, two = step + earlier(step, 1), intervals.duration + earlier(intervals.duration, 1)
    spread = wrong * intervals.duration
    return WaistWalk(distance, off, step, spread, stride, wrong * two, ~inputs.stood | turned, {})
