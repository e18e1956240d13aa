r"""The ankle's estimator a sample at a time, in constant memory, for a device that counts strides during the walk.

Each sample passes causal low-passes and a detector of `events.shank`, which detects the swings of the shank. After a
swing, `events.shank_stance_online` searches the valley of the stance rate, which is known only after the valley. The
error-state filter therefore runs a fixed lag, some 0.26 s, behind the newest sample, and uses the ankle's zero velocity
before and after the valley. When the filter has passed a valley, or while the person stands, a swing since the last
such instant makes a stride, whose length, height and turn are then known, with their standard deviations.

The host decides beforehand on axes, gyroscope bias at rest, placement and sampling rate, from a recording of a walk
(`ankle_stride.prepare.prepare`); the device then needs memory for a few hundred numbers, however long the walk.

Deviations from `ankle_stride` without smoothing, which integrates signals filtered both ways and knows the whole walk:
    1. Signals are filtered causally, at the same cut-off; times have the delay removed.
    2. Swings by the lobes of a causally filtered rate, or by the paper's state machine.
    3. The valley is the first minimum that lasts, not the least rate in a part of the time between two swings.
    4. Standing is a leg that has hardly turned for `CALM_S`.
    5. A stride is read where the window of zero velocities around its valley ends, not in its middle.
    6. Nothing is known of a reading's range, so that clipped swings are not noticed.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import PyTree

from jgait import filtering
from jgait.estimators.ankle_stride import model as ankle_model
from jgait.estimators.ankle_stride import readout as ankle_strides
from jgait.estimators.ankle_stride.estimator import control, model_params
from jgait.estimators.ankle_stride.model import AnkleObservation
from jgait.estimators.ankle_stride.online_state import (
    AnkleOnlineState,
    Filters,
    Now,
    OnlineSwing,
    begin,
    filters_of,
    level_prior,
    reading,
)
from jgait.estimators.ankle_stride.params import AnkleOptions, AnkleParams
from jgait.estimators.ankle_stride.prepare import LOST_FORCE, LOST_RATE, STANDING
from jgait.estimators.ankle_stride.readout import Heading
from jgait.estimators.ankle_stride.worn import DETECTORS, ONLINE, Worn, check_options, worn
from jgait.events import shank as shank_events
from jgait.events import shank_stance
from jgait.events import shank_stance_online as shank_valley
from jgait.filtering import Belief
from jgait.filtering.compile import compiled
from jgait.geometry.vectors import Vector, vector, wrapped
from jgait.signal import butterworth
from jgait.types import Flags, Strides, Values

__all__ = [
    "ONLINE",
    "AnkleOnlineState",
    "Now",
    "Worn",
    "begin",
    "check_options",
    "one",
    "over",
    "step",
    "table",
    "walk",
    "worn",
]


class _Delayed(NamedTuple):
    """A row of the history, with the field names that `ankle_stride.estimator.control` uses."""

    gyr_jump: Values
    acc_jump: Values
    gyr_doubt: Values
    acc_doubt: Values
    dt: Values
    restart: Flags
    rate_hz: Values
    gyr_bias: Values


def _filter_step(
    p: AnkleParams, worn: Worn, state: AnkleOnlineState, row: PyTree, stands: Flags, options: AnkleOptions
) -> tuple[Belief, Values, Values]:
    """The filter's step over the oldest row of the history: belief, whether the filter has started, and is valid."""
    stands = stands & (row[8] == 0.0)
    started = state.started | stands
    initial = jax.tree.map(lambda a, b: jnp.where(state.started, a, b), state.belief, level_prior(p, worn, row[:6]))
    dt = jnp.where(state.started, 1.0 / worn.rate_hz, 0.0)
    mean = 0.5 * (row[:6] + state.before)
    now = _Delayed(row[6], row[7], row[8], row[9], dt, state.restart, worn.rate_hz, worn.gyr_bias)
    driven = control(p, now, vector(row[:3]), vector(mean[:3]), vector(mean[3:]))
    zero, seen = jnp.zeros_like(row[:1]), stands[None]
    speed, still = Vector(zero, zero, zero), Vector(seen, seen, seen)
    told = filtering.kalman_filter(
        ankle_model.MODEL,
        model_params(p),
        AnkleObservation(speed, zero),
        controls=jax.tree.map(lambda leaf: leaf[None], driven),
        dt=dt,
        mask=AnkleObservation(still, seen if options.level else False),
        method=options.method,
        initial=initial,
        keep=("mean", "cov", "valid"),
    )
    after = jax.tree.map(lambda leaf: leaf[0], Belief(told.mean, told.cov))
    return after, started, told.valid[0]


def _stride(
    p: AnkleParams, worn: Worn, state: AnkleOnlineState, swung: OnlineSwing, belief: Belief, stood: PyTree
) -> tuple[Strides, Strides, dict[str, Values], Heading]:
    """The stride that ends at the filter's sample, its standard deviations and flags, and the heading at the sample."""
    way = ankle_strides.measured(belief.mean.position, ankle_strides.across(belief.cov))
    there = ankle_strides.heading(belief.mean, belief.cov)
    follows = swung.leaves - state.landed <= shank_stance.PAUSE_S
    start = jnp.where(follows, state.landed, swung.leaves)
    duration = jnp.maximum(swung.lands - start, 1e-3)
    times = (start, swung.leaves, swung.lands)
    turn = wrapped(there.angle - state.heading.angle)
    strides = ankle_strides.table(0, times, duration, way.length, way.height, turn, jnp.ones((), bool))
    strides = strides._replace(side=jnp.asarray(worn.side))
    stddev = ankle_strides.deviations(p, strides, way, state.heading, there, duration)
    flags = ankle_strides.flags(strides, half=~follows | stood)
    return strides, stddev, flags, there


def _seen(
    worn: Worn,
    filters: Filters,
    state: AnkleOnlineState,
    gyr: Values,
    acc: Values,
    measured: Flags,
    options: AnkleOptions,
) -> tuple[AnkleOnlineState, Values]:
    """The state after event detection at the newest sample, and the row (11,) for the history."""
    there = jnp.asarray(measured)
    x = jnp.where(there, reading(worn, gyr, acc), state.last[1])
    index = state.index + 1
    advance, settings = DETECTORS[options.detector]
    rates = x[:3] - worn.gyr_bias
    (signals, smooth), (stance, slowly), (sagittal, rate) = (
        butterworth.step(cascade, before, values)
        for cascade, before, values in zip(filters, state.low_passed, (x, rates, rates[1]), strict=True)
    )
    time = index.astype(x.dtype) / worn.rate_hz
    detector, found = advance(settings, state.detector, rate, time)
    leaves = (detector.phase == shank_events.TOE_OFF) | (detector.phase == shank_events.SWING)
    phase = shank_valley.Phase(found.stride, leaves)
    valley, lasted = shank_valley.step(state.valley, index, slowly[1], phase, worn.hold, worn.landing)
    turns_slowly = jnp.sum(slowly * slowly) < STANDING**2
    slow = jnp.where(turns_slowly, jnp.minimum(state.slow, worn.calm) + 1, 0).astype(jnp.int32)
    change = 0.5 * (x - state.last[0]).reshape(2, 3)
    jumps = jnp.concatenate([state.jumps[1:], jnp.sqrt(jnp.sum(change * change, axis=1))[None]])
    jump = jnp.max(jnp.where(worn.jump_looks[:, None], jumps, 0.0), axis=0)
    doubt = jnp.where(there, 0.0, jnp.asarray([LOST_RATE, LOST_FORCE], x.dtype))
    calm = (slow >= worn.calm).astype(x.dtype)
    late = butterworth.delay(settings.cutoff_hz, worn.rate_hz)
    swung = OnlineSwing(
        leaves=jnp.where(found.stride & ~state.swung.any, found.start - late, state.swung.leaves),
        lands=jnp.where(found.stride, found.end - late, state.swung.lands),
        known=jnp.where(found.stride, index, state.swung.known),
        any=state.swung.any | found.stride,
    )
    after = state._replace(
        index=index, last=jnp.stack([state.last[1], x]), low_passed=(signals, stance, sagittal), detector=detector,
        valley=valley, stood=jnp.where(lasted, valley.at, state.stood), slow=slow, jumps=jumps, swung=swung,
    )  # fmt: skip
    return after, jnp.concatenate([smooth, jump, doubt, calm[None]])


def _advanced(
    p: AnkleParams, worn: Worn, filters: Filters, state: AnkleOnlineState, sample: tuple[Values, Values, Values],
    options: AnkleOptions,
) -> tuple[AnkleOnlineState, Now]:  # fmt: skip
    """One sample: detection of swing and stance, then the filter a lag behind, then the stride if a stride ends."""
    state, newest = _seen(worn, filters, state, *sample, options)
    rows, index = state.history.shape[0], state.index
    row = state.history[index % rows]
    calm = state.history[(index + worn.shift) % rows, 10] > 0.0
    full = index >= rows
    # the sample of the stance rates that was measured at the time of the filter's sample
    looked = index - rows + worn.shift
    near = full & (jnp.abs(looked - state.stood) <= worn.reach)
    belief, started, sound = _filter_step(p, worn, state, row, near | (calm & full), options)
    passed = near & (looked == state.stood + worn.reach)
    instant = started & (passed | (calm & full))
    ends = instant & state.swung.any & (looked >= state.swung.known)
    strides, stddev, flags, heading = _stride(p, worn, state, state.swung, belief, ~passed)
    stride = ends & state.started & strides.valid
    walked = jnp.where(stride, strides.length, 0.0)
    after = state._replace(
        history=state.history.at[index % rows].set(newest),
        before=row[:6],
        belief=belief,
        started=started,
        restart=instant.astype(newest.dtype),
        heading=Heading(*(jnp.where(instant, new, old) for new, old in zip(heading, state.heading, strict=True))),
        swung=state.swung._replace(any=state.swung.any & ~ends),
        landed=jnp.where(ends, state.swung.lands, state.landed),
        count=state.count + stride.astype(jnp.int32),
        distance=state.distance + walked,
    )
    strides, flags = strides._replace(valid=stride), {name: flag & stride for name, flag in flags.items()}
    stands = state.slow >= worn.calm
    return after, Now(stride, strides, stddev._replace(valid=stride), flags, after.count, after.distance, stands, sound)


def one(
    p: AnkleParams, worn: Worn, state: AnkleOnlineState, gyr: Values, acc: Values, measured: Flags = True,
    options: AnkleOptions = ONLINE,
) -> tuple[AnkleOnlineState, Now]:  # fmt: skip
    """`step`, not compiled, for use in another compiled program."""
    check_options(options)
    filters = filters_of(p, worn, options, state.last.dtype)
    return _advanced(p, worn, filters, state, (gyr, acc, measured), options)


def over(
    p: AnkleParams, worn: Worn, state: AnkleOnlineState, gyr: Values, acc: Values, measured: Flags | None = None,
    options: AnkleOptions = ONLINE,
) -> tuple[AnkleOnlineState, Now]:  # fmt: skip
    """The same step over many samples in one scan, not compiled, for use in another compiled program.

    `gyr` [rad/s] and specific force `acc` [m/s²] are (T, 3) in the sensor's axes; `measured` (T,) is False where a
    sample was lost. Returns the state after the last sample, and the results after each sample.
    """
    check_options(options)
    filters = filters_of(p, worn, options, state.last.dtype)
    there = jnp.ones(gyr.shape[0], bool) if measured is None else measured
    return lax.scan(lambda s, x: _advanced(p, worn, filters, s, x, options), state, (gyr, acc, there))


step = compiled(one, static_argnames=("options",))
_over = compiled(over, static_argnames=("options",))


def walk(
    p: AnkleParams, worn: Worn, gyr: Values, acc: Values, measured: Flags | None = None, options: AnkleOptions = ONLINE
) -> Now:  # fmt: skip
    """A recording processed as by the device: `begin`, then `over`, compiled; arguments as of these functions.

    Returns:
        The results after each sample, (T,); `table` gives the strides alone.
    """
    state = begin(p, worn, jnp.asarray(gyr)[0], jnp.asarray(acc)[0], options)
    return _over(p, worn, state, gyr, acc, measured, options)[1]


def table(now: Now) -> tuple[Strides, Strides, dict[str, Values]]:
    """The strides of `over` or `walk` alone, in the order in which they became known; on the host.

    Returns:
        Strides (n,), their standard deviations, and their flags with `known`, the sample at which each became known.
    """
    at = np.flatnonzero(np.asarray(now.stride))
    parts = jax.tree.map(lambda leaf: np.asarray(leaf)[at], (now.strides, now.stddev, now.flags))
    return parts[0], parts[1], {**parts[2], "known": at}
