r"""The foot's estimator a sample at a time, in constant memory, for a device that counts strides during the walk.

The filter of `foot_ins` without its smoother runs a fixed lag, some 0.15 s, behind the newest sample: half a window of
the stance detector, and `HOLD_S`. At each foothold a stride is known, with length, height, turn, contacts and standard
deviations. The sensor's errors and the axis about which the foot turns come from a recording of a walk (`worn`).

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
import numpy as np
from jaxtyping import PyTree

from jgait import filtering
from jgait.estimators import lagged
from jgait.estimators.checks import JUMP_S
from jgait.estimators.foot_ins.estimator import filtered, prior_of
from jgait.estimators.foot_ins.params import DEFAULT, FootParams
from jgait.estimators.foot_ins.prepare import LOST_FORCE, LOST_RATE, REST_STEP, STANCE_EDGE_S, FootSignals, prepare
from jgait.estimators.foot_ins.readout import SHORTEST_STRIDE_M, timed, walks_on
from jgait.estimators.lagged import LaggedMotion, LaggedSample, LaggedSignals, LaggedState
from jgait.estimators.notes import LONGEST_LOSS
from jgait.events import foot as events
from jgait.events.rest import JOLT
from jgait.filtering import Belief
from jgait.geometry.rotation import between, quaternion
from jgait.geometry.vectors import Vector, as_array, entries, root, vector, wrapped
from jgait.signal.windows import true_runs
from jgait.types import SIDES, Counts, Flags, Recording, RecordingError, Strides, Values

HOLD_S = 0.1
"""[s] Duration for which a sample must stay the stillest to be the foothold."""


class FootWorn(NamedTuple):
    """Mounting of a foot's sensor, from a recording; every leaf is an array."""

    gyr_bias: Values  #: (3,) gyroscope bias at rest [rad/s].
    acc_bias: Values  #: accelerometer bias along the vertical, from gravity at rest [m/s²].
    still_time: Values  #: duration of rest over which the gyroscope bias was measured [s].
    axis: Values  #: (3,) axis about which the foot turns, toes up positive, in the sensor's axes [1].
    rate_hz: Values  #: sampling rate.
    side: Counts  #: 0 right, 1 left.
    #: one zero for each sample of the detector's window, of the hold, of the largest change, and for those removed from
    #: the start and the end of a stance: their numbers, known when a program is compiled.
    lengths: tuple[Values, ...]


def worn(p: FootParams, recording: Recording, side: str) -> FootWorn:
    """Mounting of the sensor of one side, from a recording of standing and walking; on the host; no parameter matters.

    Raises:
        RecordingError: as `foot_ins.prepare.prepare`, or if the foot does not walk.
    """
    del p
    name = f"foot_{side}"
    made = prepare(recording._replace(sensors={name: recording.sensors[name]})).inputs
    foot: FootSignals = getattr(made, side)
    if (stances := len(true_runs(foot.stands))) < 3:
        raise RecordingError(
            f"a recording of walking is needed to know how '{name}' is worn; this one has {stances} stances"
        )
    hz = 1.0 / float(np.median(np.diff(made.time)))
    half, hold, around = (max(1, round(seconds * hz)) for seconds in (events.WINDOW / 2, HOLD_S, JUMP_S))
    sizes = (2 * half + 1, hold, 2 * around + 1, *(round(seconds * hz) for seconds in events.EROSION))
    # the main axis of the rotation in swing; with its sign the heel rises before the toes in most strides
    gyr, strides = np.asarray(foot.gyr - foot.gyr_bias), slice(int(foot.count) - 1)
    swinging = gyr[~np.asarray(foot.stands)]
    axis = np.linalg.eigh(swinging.T @ swinging)[1][:, -1]
    pitch = np.cumsum(gyr @ axis)
    axis *= np.sign(np.sum(pitch[foot.initial_contact[strides]] - pitch[foot.final_contact[strides]]))
    return FootWorn(
        foot.gyr_bias, foot.acc_bias @ foot.up, foot.still_time, axis, np.asarray(hz),
        np.asarray(SIDES.index(side), np.int32), tuple(map(np.zeros, sizes)),
    )  # fmt: skip


class StanceThreshold(NamedTuple):
    """Search for the valleys of the foot's unrest: extreme since the last turning point, and the last two valleys."""

    seeking: Flags
    extreme: Values
    depths: Values


class FootSwing(NamedTuple):
    """What happened since the last foothold; times [s]."""

    any: Flags  #: bool, the foot swung.
    pitch: Values  #: pitch since the foot was still, toes up positive [rad].
    lowest: Values  #: least pitch, at the final contact.
    final: Values  #: its time.
    highest: Values  #: largest pitch since then.
    initial: Values  #: time at which the pitch has fallen by `events.foot.LANDED` from it; below 0: it has not.
    stood: Values  #: time of the last sample of the stance before the swing.
    stands: Values  #: time of the first sample of the stance after it.
    lost: Values  #: duration of lost samples.


class FootDetector(NamedTuple):
    """State of the decisions between samples."""

    index: Counts  #: index of the newest sample.
    samples: Values  #: (n, 7) the newest samples: rate, specific force, 1 if lost.
    quiet: Values  #: (m,) margin of the newest samples of the detector [rad/s], below 0 in a stance.
    unrest: Values  #: (m,) the detector's statistic [rad/s].
    threshold: StanceThreshold  #: search for the valleys of the statistic.
    started: Flags  #: whether the foot has stood, so that the filter has started.
    foothold: Values  #: time of the last foothold [s].
    swing: FootSwing  #: what happened since then.
    landed: Values  #: initial contact of the last stride [s]; −∞ before the first.
    restless: Flags  #: bool, the last foothold is far less still than the stances before it.


def _sizes(worn: FootWorn) -> tuple[int, ...]:
    """Number of samples of the detector's window, the hold, the largest change, and those removed from a stance."""
    return tuple(values.shape[-1] for values in worn.lengths)


def lag(worn: FootWorn) -> int:
    """Number of samples by which the filter is behind the newest sample."""
    window, hold, *_ = _sizes(worn)
    return window // 2 + hold + 1


def begin(p: FootParams, worn: FootWorn, gyr: Values, acc: Values) -> LaggedState:
    """The state after a long time in which each reading equals the first, (3,) in the sensor's axes [rad/s, m/s²]."""
    window, hold, change, after_start, _ = _sizes(worn)
    row = jnp.concatenate([jnp.asarray(gyr), jnp.asarray(acc), jnp.zeros_like(gyr[:1])])
    zero, none, no = jnp.zeros_like(row[0]), jnp.zeros((), jnp.int32), jnp.zeros((), bool)
    rate = jnp.sqrt(jnp.sum((row[:3] - worn.gyr_bias) ** 2))
    quiet = jnp.zeros(after_start + hold + 2, row.dtype)
    start = zero - lag(worn) / worn.rate_hz
    stored = max(window, window // 2 + hold + change // 2 + 3)
    detector = FootDetector(
        none - 1, jnp.zeros((stored, 7), row.dtype) + row[None], quiet + rate - events.STILL, quiet + rate,
        StanceThreshold(~no, rate, jnp.zeros_like(row[:2])), no, start, _not_swung(start), zero - jnp.inf, no,
    )  # fmt: skip
    return lagged.begin(STEPS, p, worn, detector, row[:6])


def _not_swung(time: Values) -> FootSwing:
    zero = jnp.zeros_like(time)
    return FootSwing(jnp.zeros((), bool), zero, zero, time, zero, time, time, time, zero)


def _prior(p: FootParams, worn: FootWorn, reading: Values) -> Belief:
    """The belief of a foot that stands, with the tilt from the specific force."""
    up = reading[3:] / jnp.sqrt(jnp.sum(reading[3:] ** 2))
    zeros, ones = jnp.zeros_like(up[0]), jnp.ones_like(up[0])
    attitude = as_array(between(vector(up), Vector(zeros, zeros, ones)))
    foot: PyTree = SimpleNamespace(
        gyr=up, attitude=attitude, gyr_bias=worn.gyr_bias, acc_bias=worn.acc_bias * up, up=up,
        still_time=worn.still_time,
    )  # fmt: skip
    return prior_of(p, foot).joined()


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
        depths=jnp.where(valley, _pushed(state.depths, state.extreme), state.depths),
    )


def _unrest(worn: FootWorn, samples: Values) -> Values:
    """Unrest at the middle of the newest window, see `events.foot.unrest`."""
    rows = samples[-_sizes(worn)[0] :]
    free = rows[:, :3] - worn.gyr_bias[None]
    force = rows[:, 3:6] - jnp.mean(rows[:, 3:6], axis=0)[None]
    turning, spread = (jnp.sum(values * values) / len(rows) for values in (free, force))
    return jnp.sqrt(turning + spread / JOLT**2)


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
        initial=jnp.where(higher, -1.0, jnp.where(falls, time, swing.initial)),
        stood=jnp.where(still, time, swing.stood),
        stands=jnp.where(stands & swing.any & (swing.stands <= swing.final), time, swing.stands),
        lost=jnp.where(still, 0.0, swing.lost) + row[6] * dt,
    )


def _decide(
    worn: FootWorn, state: FootDetector, sample: tuple[Values, Values, Flags]
) -> tuple[FootDetector, LaggedSample]:
    """One sample: the detector at the middle of its newest window, and what follows for the filter's sample."""
    gyr, acc, there = sample
    *_, change, k, before_end = _sizes(worn)
    reading = jnp.where(there, jnp.concatenate([gyr, acc]), state.samples[-1, :6])
    samples = _pushed(state.samples, jnp.append(reading, (~there).astype(reading.dtype)))
    index, statistic = state.index + 1, _unrest(worn, samples)
    threshold = _searched(state.threshold, statistic)
    depth = jnp.min(threshold.depths)
    quiet = _pushed(state.quiet, statistic - jnp.maximum(events.STILL, events.ABOVE * depth))
    unrest = _pushed(state.unrest, statistic)
    # the filter's sample among the stored samples; among the stored values of the detector it is k
    at = samples.shape[0] - 1 - lag(worn)
    row, before = samples[at], samples[at - 1]
    near = samples[at - change // 2 - 1 : at + change // 2 + 2, :6]
    changes = 0.5 * (near[2:] - near[:-2]).reshape(change, 2, 3)
    largest = jnp.sqrt(jnp.max(jnp.sum(changes * changes, axis=2), axis=0))
    time = (index - lag(worn)).astype(reading.dtype) / worn.rate_hz
    stands = jnp.all(quiet[: k + before_end + 1] < 0.0) & (row[6] == 0.0) & (index >= lag(worn))
    goes_on = jnp.all(quiet[1 : k + before_end + 2] < 0.0)
    stillest = unrest[k] <= jnp.min(unrest[k + 1 :])
    swing = _swung(worn, state.swing, row, before, time, unrest[k], stands)
    lasts = time - state.foothold
    ends = swing.any & (stillest | ~goes_on) & (lasts >= events.SHORTEST_STRIDE_S)
    foothold = stands & (~state.started | ends | (~swing.any & (lasts >= REST_STEP)))
    restless = unrest[k] > events.WORSE * jnp.maximum(depth, 0.1)  # [rad/s] stances are hardly ever stiller
    lagged_sample = LaggedSample(
        row[:6], largest, jnp.mean(samples[:, 3:6], axis=0), row[6], swing.lost, stands, state.started, foothold,
        (time, state.foothold, swing, state.landed, state.restless | restless),
    )  # fmt: skip
    landed = jnp.where(swing.any, _landing(swing, time), state.landed)
    here, old = (time, _not_swung(time), landed, restless), (state.foothold, swing, state.landed, state.restless)
    since = jax.tree.map(lambda new, old: jnp.where(foothold, new, old), here, old)
    return FootDetector(index, samples, quiet, unrest, threshold, state.started | stands, *since), lagged_sample


def _landing(swing: FootSwing, time: Values) -> Values:
    """Time of the initial contact [s]; that of the foothold if the pitch never fell."""
    return jnp.where(swing.initial < 0.0, time, swing.initial)


def _filtered(p: FootParams, signals: LaggedSignals, stands: Flags, belief: Belief) -> filtering.Posterior:
    free = signals.rates - signals.gyr_bias[None]
    foot: PyTree = SimpleNamespace(
        **signals._asdict(), rate=jnp.sqrt(jnp.sum(free**2, axis=1)), features=jnp.zeros_like(free[:, :1]),
        stands=stands, valid=True,
    )  # fmt: skip
    options, keep = DEFAULT._replace(smooth=False), ("mean", "cov", "nis", "count", "valid")
    return filtered(p, foot, initial=belief, options=options, keep=keep).filtered


def _heading(posterior: filtering.Posterior) -> tuple[Values, Values]:
    q = quaternion(posterior.mean.attitude)
    yaw = jnp.arctan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z))
    return yaw, *entries(posterior.cov["attitude", "attitude"], "zz")


def _strides(
    p: FootParams, worn: FootWorn, at: LaggedSample, motion: LaggedMotion
) -> tuple[Strides, Strides, dict[str, Values]]:
    """The strides that would end at each of the filter's samples (T,), standard deviations, and flags."""
    way, (time, last, swing, landed, restless) = vector(motion.posterior.mean.position), at.events
    length = root(way.x * way.x + way.y * way.y)
    initial = _landing(swing, time)
    known = Strides(
        side=jnp.full(length.shape, worn.side, jnp.int32), start=None, final_contact=swing.final, end=initial,
        length=length, width=jnp.full_like(length, jnp.nan), height=way.z,
        valid=at.instant & at.began & swing.any & (length > SHORTEST_STRIDE_M) & (swing.lost <= LONGEST_LOSS),
        standing=jnp.maximum(last, swing.stood - STANCE_EDGE_S),
        standing_end=jnp.minimum(time, jnp.maximum(swing.stands, initial) + STANCE_EDGE_S),
        turn=wrapped(motion.there[0] - motion.here[0]), lift=motion.highest - jnp.maximum(way.z, 0.0),
    )  # fmt: skip
    spread = entries(motion.posterior.cov["position", "position"], "xx", "xy", "yy", "zz")
    follows, yaw = walks_on(landed, swing.final, initial), motion.there[1] - motion.here[1]
    strides, stddev = timed(p, known, way, spread, landed, follows, yaw, motion.nis, jnp.zeros_like(length))
    strides, stddev, doubtful = lagged.judged("foot_ins", strides, stddev, motion.nis)
    return strides, stddev, {"doubtful": (doubtful | restless) & strides.valid}


STEPS = lagged.Steps(
    lambda _, worn: partial(_decide, worn), _prior, _filtered, _heading, _strides, (LOST_RATE, LOST_FORCE)
)
"""What this estimator does with samples."""

over = partial(lagged.over, STEPS)
"""The samples that follow, see `lagged.over`."""
