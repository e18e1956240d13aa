r"""The foot's estimator a sample at a time, in constant memory, for a device that counts strides during the walk.

The filter runs a fixed lag, some 0.15 s, behind the newest sample: half a window of the stance detector, and `HOLD_S`,
for which the sample of least movement must stay the stillest to be the foothold. At each foothold a stride is known,
with length, height, turn, contacts and standard deviations.

The host finds the sensor's errors and the axis about which the foot turns from a recording of a walk
(`worn`).

Deviations from `foot_ins` without smoothing, which knows the whole walk:
    1. The threshold of a stance follows the stances before it, the lower of the last two, not the stance itself.
    2. The foothold is the first sample of a stance that stays the stillest for `HOLD_S`, not the stillest of all. One
       that is far less still than the stances before it may lie in a slow swing: both strides beside it are in doubt.
    3. A lost sample repeats the sample before it, and each counts; offline, up to 0.05 s in a row are interpolated.
    4. The vertical at the start is from 0.2 s, not 1 s; nothing is known of a sensor's range, so that clipped samples
       are not noticed; the noise of the zero velocity is constant.
    5. Contacts: pitch is the integral of the rate about one axis since the foot was still, without correction by the
       next stance.
"""

from functools import partial
from types import SimpleNamespace
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from jgait import filtering
from jgait.estimators import trust
from jgait.estimators.foot_ins import model as foot_model
from jgait.estimators.foot_ins.estimator import controls, model_params
from jgait.estimators.foot_ins.model import FootObservation
from jgait.estimators.foot_ins.online_state import (
    ONLINE,
    FootNow,
    FootOnlineState,
    FootSwing,
    FootWorn,
    StanceThreshold,
    begin,
    lag,
    level_prior,
    reading,
    worn,
)
from jgait.estimators.foot_ins.params import FootParams
from jgait.estimators.foot_ins.prepare import LOST_FORCE, LOST_RATE, REACH, REST_STEP
from jgait.estimators.foot_ins.readout import SHORTEST, timed, walks_on
from jgait.estimators.losses import held_bridge
from jgait.estimators.notes import LONGEST_LOSS
from jgait.estimators.sides import entries
from jgait.events import foot as events
from jgait.geometry.rotation import quaternion
from jgait.geometry.vectors import root, vector, wrapped
from jgait.signal.counted import scanned
from jgait.signal.marks import latest
from jgait.types import Counts, Flags, Strides, Values

__all__ = ["ONLINE", "FootNow", "FootOnlineState", "FootWorn", "begin", "lag", "over", "worn"]


class _FootEvent(NamedTuple):
    """What is decided at the filter's sample, before the filter runs."""

    time: Values  #: of the sample [s].
    row: Values  #: (7,) the sample, see `FootWorn.samples`.
    before: Values  #: (7,) the sample before it.
    jumps: Values  #: (2,) largest changes of rate [rad/s] and force [m/s²] about it.
    force: Values  #: (3,) mean specific force of the stored samples [m/s²].
    stands: Flags  #: bool, zero velocity is observed.
    began: Flags  #: bool, the filter had started before the sample.
    restart: Values  #: 1 if positions count from the sample before, else 0.
    foothold: Flags  #: bool, positions count from here.
    last: Values  #: time of the foothold before [s].
    swing: FootSwing  #: what happened since then.
    landed: Values  #: initial contact before [s].
    restless: Flags  #: bool, the foothold before or this one is far less still than the stances before it.


def _pushed(register: Values, value: Values) -> Values:
    return jnp.concatenate([register[1:], value[None]])


def _searched(state: StanceThreshold, value: Values) -> StanceThreshold:
    """The search after one more value of the statistic; as `events.foot.stances` finds valleys and swings."""
    ends = state.seeking & (value > jnp.maximum(events.RATIO * state.extreme, events.SWING))
    begins = ~state.seeking & (value < state.extreme / events.RATIO)
    beyond = jnp.where(state.seeking, value < state.extreme, value > state.extreme)
    valley = ends & (state.extreme < events.STANCE)
    return StanceThreshold(
        seeking=(state.seeking & ~ends) | begins,
        extreme=jnp.where(ends | begins | beyond, value, state.extreme),
        depths=jnp.where(valley, jnp.stack([state.depths[1], state.extreme]), state.depths),
    )


def _detected(worn: FootWorn, samples: Values, threshold: StanceThreshold) -> tuple[Values, StanceThreshold]:
    """Unrest at the middle of the newest window, see `events.foot.unrest`, and the search for its valleys."""
    size = worn.window.shape[0]
    rows = samples[-size:]
    free = rows[:, :3] - worn.gyr_bias[None]
    force = rows[:, 3:6] - jnp.mean(rows[:, 3:6], axis=0)[None]
    turning, spread = (jnp.sum(values * values) / size for values in (free, force))
    unrest = jnp.sqrt(turning + spread / events.JOLT**2)
    return unrest, _searched(threshold, unrest)


def _largest_change(values: Values, window: int, at: int) -> Values:
    """Largest change between samples over a window about the sample `at` of (n, 3)."""
    half = window // 2
    near = values[at - half - 1 : at + half + 2]
    change = 0.5 * (near[2:] - near[:-2])
    return jnp.sqrt(jnp.max(jnp.sum(change * change, axis=1)))


def _swung(
    worn: FootWorn, swing: FootSwing, row: Values, before: Values, time: Values, unrest: Values, stands: Flags
) -> FootSwing:
    """What happened since the last foothold, after one more sample of the filter."""
    dt = 1.0 / worn.rate_hz
    swings = swing.any | (unrest >= events.SWING)
    still = stands & ~swings
    turned = jnp.sum((0.5 * (row + before)[:3] - worn.gyr_bias) * worn.axis) * dt
    pitch = jnp.where(still, 0.0, swing.pitch + turned)
    lower = still | (pitch < swing.lowest)
    higher = lower | (pitch > swing.highest)
    highest = jnp.where(higher, pitch, swing.highest)
    falls = (swing.initial < 0.0) & (pitch < (1.0 - events.LANDED) * highest)
    return FootSwing(
        any=swings,
        pitch=pitch,
        lowest=jnp.where(lower, pitch, swing.lowest),
        final=jnp.where(lower, time, swing.final),
        highest=highest,
        # a time below 0 says that the pitch has not fallen since it was highest
        initial=jnp.where(higher, -1.0, jnp.where(falls, time, swing.initial)),
        stood=jnp.where(still, time, swing.stood),
        stands=jnp.where(stands & swing.any & (swing.stands <= swing.final), time, swing.stands),
        lost=jnp.where(still, 0.0, swing.lost) + row[6] * dt,
    )


def _decided(
    worn: FootWorn, state: FootOnlineState, sample: tuple[Values, Values, Flags]
) -> tuple[FootOnlineState, _FootEvent]:
    """One sample: the detector at the middle of its newest window, and what follows for the filter's sample."""
    gyr, acc, there = sample
    newest = jnp.where(there, reading(worn, gyr, acc, there), state.samples[-1].at[6].set(1.0))
    index = state.index + 1
    samples = _pushed(state.samples, newest)
    statistic, threshold = _detected(worn, samples, state.threshold)
    limit = jnp.maximum(events.STILL, events.ABOVE * jnp.min(threshold.depths))
    quiet, unrest = _pushed(state.quiet, statistic - limit), _pushed(state.unrest, statistic)
    # the filter's sample among the stored values of the detector, and among the stored samples
    k, before_end = worn.after_start.shape[0], worn.before_end.shape[0]
    at = samples.shape[0] - 1 - lag(worn)
    row, before = samples[at], samples[at - 1]
    time = (index - lag(worn)).astype(newest.dtype) / worn.rate_hz
    stands = jnp.all(quiet[: k + before_end + 1] < 0.0) & (row[6] == 0.0) & (index >= lag(worn))
    goes_on = jnp.all(quiet[1 : k + before_end + 2] < 0.0)
    stillest = unrest[k] <= jnp.min(unrest[k + 1 :])
    swing = _swung(worn, state.swing, row, before, time, unrest[k], stands)
    since = time - state.foothold
    ends = swing.any & (stillest | ~goes_on) & (since >= events.SHORTEST)
    foothold = stands & (~state.started | ends | (~swing.any & (since >= REST_STEP)))
    restless = unrest[k] > events.WORSE * jnp.maximum(jnp.min(threshold.depths), events.LEAST_DEPTH)
    size = worn.jumps.shape[0]
    jumps = jnp.stack([_largest_change(part, size, at) for part in (samples[:, :3], samples[:, 3:6])])
    event = _FootEvent(
        time, row, before, jumps, jnp.mean(samples[:, 3:6], axis=0), stands, state.started, state.restart, foothold,
        state.foothold, swing, state.landed, state.restless | restless,
    )  # fmt: skip
    none = jnp.zeros_like(time)
    fresh = FootSwing(jnp.zeros((), bool), none, none, time, none, time, time, time, none)
    after = state._replace(
        index=index,
        samples=samples,
        quiet=quiet,
        unrest=unrest,
        threshold=threshold,
        started=state.started | stands,
        restart=foothold.astype(newest.dtype),
        foothold=jnp.where(foothold, time, state.foothold),
        swing=jax.tree.map(lambda new, old: jnp.where(foothold, new, old), fresh, swing),
        landed=jnp.where(foothold & swing.any, _landing(swing, time), state.landed),
        restless=jnp.where(foothold, restless, state.restless),
    )
    return after, event


def _landing(swing: FootSwing, time: Values) -> Values:
    """Time of the initial contact [s]; that of the foothold if the pitch never fell."""
    return jnp.where(swing.initial < 0.0, time, swing.initial)


def _filtered(
    p: FootParams, worn: FootWorn, state: FootOnlineState, event: _FootEvent, real: Flags
) -> filtering.Posterior:
    """The filter over the samples of events (T,), those with `real` alone."""
    begins = real & ~event.began & event.stands
    prior = level_prior(p, worn, event.force[jnp.argmax(begins)])
    initial = jax.tree.map(lambda a, b: jnp.where(state.started, a, b), state.belief, prior)
    dt = jnp.where(real & event.began, 1.0 / worn.rate_hz, 0.0)
    mean, lost = 0.5 * (event.row + event.before), event.row[:, 6]
    rate = jnp.sqrt(jnp.sum((event.row[:, :3] - worn.gyr_bias[None]) ** 2, axis=1))
    goes, turned, moved = held_bridge(lost, event.swing.lost, 1.0 / worn.rate_hz, LOST_RATE, LOST_FORCE)
    dt = jnp.where(goes, dt, 0.0)
    now: PyTree = SimpleNamespace(
        gyr=mean[:, :3], acc=mean[:, 3:6], gyr_jump=event.jumps[:, 0], acc_jump=event.jumps[:, 1], gyr_doubt=turned,
        acc_doubt=moved, rate=rate, features=jnp.zeros_like(mean[:, :1]), restart=event.restart, dt=dt,
    )  # fmt: skip
    zero = jnp.zeros_like(mean[:, :3])
    return filtering.kalman_filter(
        foot_model.MODEL, model_params(p), FootObservation(zero, zero[:, 0]),
        controls=controls(p, now), dt=dt,
        mask=FootObservation(event.stands & real, False), initial=initial,
        keep=("mean", "cov", "nis", "count", "valid"),
    )  # fmt: skip


def _summed(
    since: Values, posterior: filtering.Posterior, event: _FootEvent, count: Counts | None
) -> tuple[Values, Values]:
    """`FootOnlineState.since` after the last sample, and (T, 3) before each foothold is reset."""
    used = event.began | event.stands
    columns = (posterior.mean.position[:, 2], posterior.nis, posterior.count.astype(posterior.nis.dtype))
    rows = jnp.stack([jnp.where(used, column, 0.0) for column in columns], axis=1)

    def add(total: Values, sample: tuple[Values, Flags]) -> tuple[Values, Values]:
        row, foothold = sample
        whole = jnp.concatenate([jnp.maximum(total[:1], row[:1]), total[1:] + row[1:]])
        return jnp.where(foothold, 0.0, whole), whole

    return scanned(add, since, (rows, event.foothold), count)


def _strides(
    p: FootParams, worn: FootWorn, event: _FootEvent, posterior: filtering.Posterior, since: Values, turn: Values,
    yaw: Values,
) -> tuple[Strides, Strides, Flags]:  # fmt: skip
    """The strides that would end at each of the filter's samples (T,), standard deviations, and which are in doubt.

    `turn` is the change of the heading since the last foothold [rad], `yaw` that of its variance [rad²].
    """
    way, swing = vector(posterior.mean.position), event.swing
    length = root(way.x * way.x + way.y * way.y)
    initial = _landing(swing, event.time)
    known = Strides(
        side=jnp.full(length.shape, worn.side, jnp.int32), start=None, final_contact=swing.final, end=initial,
        length=length, width=jnp.full_like(length, jnp.nan), height=way.z,
        valid=event.foothold & event.began & swing.any & (length > SHORTEST) & (swing.lost <= LONGEST_LOSS),
        standing=jnp.maximum(event.last, swing.stood - REACH),
        standing_end=jnp.minimum(event.time, jnp.maximum(swing.stands, initial) + REACH),
        turn=turn, lift=since[:, 0] - jnp.maximum(way.z, 0.0),
    )  # fmt: skip
    spread = entries(posterior.cov, "position", ("xx", "xy", "yy", "zz"))
    nis = since[:, 1] / jnp.maximum(since[:, 2], 1.0)
    follows = walks_on(event.landed, swing.final, initial)
    strides, stddev = timed(p, known, way, spread, event.landed, follows, yaw, nis, jnp.zeros_like(nis))
    return strides, stddev, (trust.doubtful(strides, stddev, nis) | event.restless) & strides.valid


def over(
    p: FootParams, worn: FootWorn, state: FootOnlineState, gyr: Values, acc: Values, measured: Flags | None = None,
    count: Counts | None = None,
) -> tuple[FootOnlineState, FootNow]:  # fmt: skip
    """The samples (T,) that follow; not compiled, for use in a compiled program.

    First a scan decides on stances and footholds, then the filter runs over the samples, then the strides are read: the
    filter does not influence the decisions.

    Args:
        p: parameters.
        worn: from `worn`.
        state: from `begin` or the samples before.
        gyr: (T, 3) in the sensor's axes [rad/s].
        acc: (T, 3) [m/s²].
        measured: (T,) False where a sample was lost; None: all are measured.
        count: number of samples; later ones are ignored. None: T.

    Returns:
        The state after the last sample, and the results after each sample.
    """
    samples = gyr.shape[0]
    there = jnp.ones(samples, bool) if measured is None else measured
    newest = samples - 1 if count is None else count - 1
    real = jnp.arange(samples, dtype=jnp.int32) <= newest
    after, event = scanned(partial(_decided, worn), state, (gyr, acc, there), count)
    posterior = _filtered(p, worn, state, event, real)
    foothold = event.foothold & real
    mean, q = posterior.mean, quaternion(posterior.mean.attitude)
    yaw = jnp.arctan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z))
    headings = jnp.stack([yaw, *entries(posterior.cov, "attitude", ("zz",))], axis=1)
    since, before = _summed(state.since, posterior, event, count)
    before_each, heading = latest(state.heading, headings, foothold)
    change = headings - before_each
    strides, stddev, doubtful = _strides(p, worn, event, posterior, before, wrapped(change[:, 0]), change[:, 1])
    stride = strides.valid & real
    number = state.count + jnp.cumsum(stride, dtype=jnp.int32)
    after = after._replace(
        belief=posterior.belief(newest),
        heading=heading,
        since=since,
        count=number[-1],
    )
    return after, FootNow(
        stride, strides, stddev, {"doubtful": doubtful}, number, event.stands, foothold,
        event.began | event.stands, mean.position, mean.velocity, mean.attitude, posterior.valid,
    )  # fmt: skip
