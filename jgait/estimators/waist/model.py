r"""Distance of each step: the inverted pendulum, and a state-space model of speed and accelerometer bias.

Over a step the trunk rises and falls by h like an inverted pendulum of length ℓ, whose chord is 2√(2ℓh − h²)
(Zijlstra and Hof), and its speed changes by V. Both grow with the step length; their errors vary between people, so

    λ = ℓ · (2√(2h/ℓ − (h/ℓ)²))^α · (V/√(gℓ))^β,        α = 1, β = 0: Zijlstra and Hof.

h is the range of the trunk's height: the upward acceleration, integrated twice, with a high-pass before and after each
integral. V is the range of the forward speed, computed likewise.

State at an initial contact: the distance walked D, the last step's length d and the last stride's length e, the forward
speed v, and the bias b of the forward acceleration (from accelerometer and tilt). With the integral J of the forward
acceleration over the step, the integral I of J, and the step's duration T,

    d' = v T + I − b T² / 2,    v' = v + J − b T,    D' = D + d',    e' = d + d'.

Two observations are zero: d − K λ, where λ is the inverted pendulum's step length and K its constant; and v while the
person stands. Steps beside standing are not those of a pendulum, and only integrated. Over a pause between bouts the
distance and the bias are kept, and the speed restarts from its prior.

Source: inverted pendulum after W. Zijlstra, A. L. Hof, "Assessment of spatio-temporal gait parameters from trunk
accelerations during human walking", Gait and Posture 18, 2003. Joining it and the integrated acceleration in one model
is this library's own.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, PyTree

from jgait import filtering
from jgait.estimators.notes import LONGEST_LOSS
from jgait.estimators.programs import compiled
from jgait.estimators.waist.inputs import WaistInputs
from jgait.estimators.waist.motion import TrunkMotion
from jgait.estimators.waist.params import WaistOptions, WaistParams
from jgait.filtering import Belief, Covariance, Model
from jgait.geometry.arrays import largest_so_far, put, xp
from jgait.geometry.vectors import GRAVITY, root
from jgait.signal import butterworth
from jgait.types import AnyArray, Flags, Values

EDGE_STEPS = 2
"""[intervals] Number of intervals after standing that are gait initiation, and before standing or the end of a bout
that are stopping. Beside standing, whose speed is known, no pendulum is observed: on `ipol_gait` it makes the last
steps too long, and integration does not."""


class WaistState(NamedTuple):
    """Distance [m], last step [m], last stride [m], speed [m/s], bias [m/s²]."""

    distance: Values
    step: Values
    stride: Values
    speed: Values
    bias: Values


class WaistControl(NamedTuple):
    """Inputs of the model for one interval between nodes."""

    gained: Values  #: J, change of speed from the accelerometer [m/s].
    went: Values  #: I, distance from the accelerometer, without the speed at the start [m].
    walks: Values  #: 1 where the person walks over the interval, 0 in a pause, at the start and in padding.
    turn: Values  #: turn of the walk over the interval [rad].
    pendulum: Values  #: λ, the inverted pendulum's step length for a constant of 1 [m].
    pendulum_variance: Values  #: variance of the pendulum's step length [m²].


class WaistObservation(NamedTuple):
    """Observations at a node, all zero: step minus the pendulum's [m], speed [m/s]."""

    pendulum: Values
    speed: Values


_STILL = 1e-10
"""[m²] Process noise that keeps the covariance at full rank: the square of ten micrometres. Chosen by hand."""


def transition(p: WaistParams, s: WaistState, u: WaistControl, dt: Values) -> WaistState:
    """The state after one step or one pause."""
    step = u.walks * (dt * s.speed + u.went - 0.5 * dt * dt * s.bias)
    speed = u.walks * (s.speed + u.gained - dt * s.bias) + (1.0 - u.walks) * p.start_speed
    return WaistState(s.distance + step, step, u.walks * (s.step + step), speed, s.bias)


def transition_noise(p: WaistParams, s: WaistState, u: WaistControl, dt: Values) -> WaistState:
    """Process noise variances of speed and bias; a turn of the walk changes a bias that is fixed in the world."""
    del s
    turned = 0.5 - 0.5 * jnp.cos(u.turn)
    speed = u.walks * p.speed_noise**2 * dt + (1.0 - u.walks) * p.start_speed_sd**2
    bias = p.acc_bias_walk**2 * dt + p.acc_bias_turn**2 * turned + _STILL
    return WaistState(_STILL, _STILL, _STILL, speed + _STILL, bias)


def observation(p: WaistParams, s: WaistState, u: WaistControl) -> WaistObservation:
    """The step minus the pendulum's step, and the speed."""
    return WaistObservation(s.step - p.pendulum_constant * u.pendulum, s.speed)


def observation_noise(p: WaistParams, s: WaistState, u: WaistControl) -> WaistObservation:
    """Variances of the observations, whose errors are white from step to step."""
    del s
    return WaistObservation(u.pendulum_variance, p.standing_speed**2)


def initial(p: WaistParams) -> Belief:
    """The belief before the first node: distance zero, speed and bias uncertain."""
    zero = 0.0 * p.start_speed
    mean = WaistState(zero, zero, zero, p.start_speed, zero)
    variances = WaistState(_STILL, _STILL, _STILL, p.start_speed_sd**2, p.acc_bias**2)
    return Belief(mean, Covariance.from_variances(variances))


MODEL = Model(initial, transition, transition_noise, observation, observation_noise)
"""The model of one walk, one time step per step."""


class Intervals(NamedTuple):
    """Values over the interval that ends at each node; (K,) each, 0 at the first node and in padding."""

    duration: Values  #: duration of the interval [s].
    gained: Values  #: integral of the forward acceleration [m/s].
    went: Values  #: integral of `gained` over the interval [m].
    pendulum: Values  #: λ, step length of the pendulum, shorter in turns [m].
    turn: Values  #: turn of the walk [rad].


def intervals(p: WaistParams, inputs: WaistInputs, motion: TrunkMotion) -> Intervals:
    """Values over each interval, from the accelerometer, for the motion of the trunk."""
    rate, last = inputs.rate_hz, inputs.last
    steps = inputs.dt

    def fast(x: Values) -> Values:
        return x - butterworth.low_pass_until(x, p.excursion_hz, rate, last)

    def integral(x: Values) -> Values:
        return xp.cumsum(0.5 * steps[:, None] * (x + xp.concatenate([x[:1], x[:-1]])), axis=0)

    upward = xp.where(inputs.valid, motion.upward, 0.0)
    forward = xp.where(inputs.valid, motion.forward, 0.0)
    gentle = butterworth.low_pass_until(forward, 6.0, rate, last)  # [Hz] removes impacts at contacts from the speed
    velocity = fast(integral(fast(xp.stack([upward, gentle], axis=1))))
    height, speed = fast(integral(velocity[:, :1]))[:, 0], velocity[:, 1]
    node = put(xp.zeros_like(inputs.valid), inputs.at, True)
    after = xp.concatenate([xp.ones_like(node[:1]), node[:-1]])

    ranges_of = compiled(_ranges)(after, steps, forward, height, speed)
    row = xp.arange(inputs.at.shape[0], dtype=xp.int32)
    there = (row > 0) & (row < inputs.count)
    before = inputs.at[xp.maximum(row - 1, 0)]
    gained, went, excursion, surge = (xp.where(there, values[inputs.at], 0.0) for values in ranges_of)
    duration = xp.where(there, (inputs.at - before).astype(forward.dtype) / rate, 0.0)
    turn = xp.where(there, motion.heading[inputs.at] - motion.heading[before], 0.0)
    steps_of = xp.exp(-p.turn_shortening * xp.abs(turn)) * pendulum(p, excursion, surge)
    return Intervals(duration, gained, went, steps_of, turn)


def _ranges(after: Flags, steps: Values, forward: Values, height: Values, speed: Values) -> tuple[Values, ...]:
    """(T,) each: forward acceleration integrated since the last node, once and twice; ranges of height and speed.
    `after` (T,) is True where a node was the sample before.
    """

    def accumulate(carry: PyTree, sample: PyTree) -> PyTree:
        change, way, top, bottom, fastest, slowest, before = carry
        restart, dt, a, z, v = sample
        a_before, z_before, v_before = before
        here = jnp.where(restart, 0.0, change)
        now = here + 0.5 * dt * (a + a_before)
        went = jnp.where(restart, 0.0, way) + 0.5 * dt * (here + now)
        ranges = (
            jnp.maximum(jnp.where(restart, z_before, top), z),
            jnp.minimum(jnp.where(restart, z_before, bottom), z),
            jnp.maximum(jnp.where(restart, v_before, fastest), v),
            jnp.minimum(jnp.where(restart, v_before, slowest), v),
        )
        return (now, went, *ranges, (a, z, v)), (now, went, ranges[0] - ranges[1], ranges[2] - ranges[3])

    zero = jnp.zeros_like(forward[0])
    first = (zero, zero, height[0], height[0], speed[0], speed[0], (forward[0], height[0], speed[0]))
    return lax.scan(accumulate, first, (after, steps, forward, height, speed))[1]


def pendulum(p: WaistParams, excursion: Values, surge: Values) -> Values:
    """λ of steps [m] from the ranges of the trunk's height and forward speed [m, m/s]; 0 where one is almost zero."""
    high = xp.minimum(excursion / p.pendulum_length, 1.0)
    quick = surge / xp.sqrt(GRAVITY * p.pendulum_length)
    there = (high > 1e-6) & (quick > 1e-6)
    high, quick = xp.where(there, high, 0.1), xp.where(there, quick, 0.1)
    chord = xp.log(2.0) + 0.5 * xp.log(high * (2.0 - high))
    relative = xp.exp(p.excursion_power * chord + p.surge_power * xp.log(quick))
    return xp.where(there, p.pendulum_length * relative, 0.0)


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
    starts = starts & ~turned_round(inputs, intervals) & ~_beside(_stopping(inputs)) & (way > 0.0)
    prior = constant_variance(p)
    off = xp.log(xp.where(starts, way, 1.0) / xp.where(starts, swung, 1.0) / (p.start_gain * p.pendulum_constant))
    # [sd] as on a belt, where the integrated speed is about zero; no start over ground is that far off
    starts = starts & (off * off < 4.0**2 * (prior + p.start_noise**2))
    count = xp.sum(starts.astype(off.dtype))
    noise = 0.5 * p.start_noise**2 * (1.0 + 1.0 / xp.maximum(count, 1.0))
    share = xp.where(count > 0.0, prior / (prior + noise), 0.0)
    mean = xp.sum(xp.where(starts, off, 0.0)) / xp.maximum(count, 1.0)
    return p.pendulum_constant * xp.exp(share * mean), (1.0 - share) * prior


def begun(inputs: WaistInputs) -> Values:
    """(K,) the row at which the bout of each node begins."""
    row = xp.arange(inputs.fresh.shape[0], dtype=xp.int32)
    return largest_so_far(xp.where(inputs.fresh, row, 0))


def turned_round(inputs: WaistInputs, intervals: Intervals) -> Values:
    """(K,) bool: the walk has turned by more than a radian since the bout began."""
    heading, first = xp.cumsum(intervals.turn), begun(inputs)
    row = xp.arange(first.shape[0], dtype=xp.int32)
    away = xp.abs(heading - heading[first]) > 1.0  # [rad] the bias has turned, and integration is unreliable
    return largest_so_far(xp.where(away, row, -1)) >= first


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
    unsure = ~inputs.stood | turned_round(inputs, intervals)
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
    known_bias = xp.where(xp.any(inputs.still), p.acc_bias, p.acc_bias_unknown)
    known = p._replace(pendulum_constant=constant, acc_bias=known_bias)
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
    known: WaistParams, observed: WaistObservation, controls: WaistControl, dt: Values, mask: WaistObservation,
    options: WaistOptions,
) -> filtering.Inferred:  # fmt: skip
    return filtering.infer(
        MODEL, known, observed, smooth=options.smooth, controls=controls, dt=dt, mask=mask, initial=initial(known),
        method=options.method,
    )  # fmt: skip
