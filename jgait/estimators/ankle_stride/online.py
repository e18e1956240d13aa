r"""The ankle's estimator a sample at a time, in constant memory, for a device that counts strides during the walk.

Each sample passes causal low-passes and the step of the detector of swings that `events.shank` scans offline. After a
swing, `events.shank_stance` searches the valley of the stance rate, which is known only after the valley. So the filter
of `ankle_stride` without its smoother runs a fixed lag, some 0.26 s, behind the newest sample. When it has passed a
valley, or while the person stands, a swing since the last such instant makes a stride, whose length, height and turn
are then known, with their standard deviations. Axes, gyroscope bias at rest, placement and sampling rate come from a
recording of a walk (`worn`).

Deviations from `ankle_stride` without smoothing, which integrates signals filtered both ways and knows the whole walk:
    1. Signals are filtered causally, at the same cut-off; times have the delay removed.
    2. Swings by the lobes of a causally filtered rate.
    3. The valley is the first minimum that lasts, not the least rate in a part of the time between two swings.
    4. Standing is a leg that has hardly turned for half a second.
    5. A stride is read where the window of zero velocities around its valley ends, not in its middle.
    6. Nothing is known of a reading's range, so that clipped swings are not noticed.
"""

from functools import partial
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from jgait import filtering
from jgait.estimators import lagged
from jgait.estimators.ankle_stride import readout as ankle_strides
from jgait.estimators.ankle_stride.estimator import filtered, standing_prior
from jgait.estimators.ankle_stride.params import DEFAULT, AnkleParams
from jgait.estimators.ankle_stride.prepare import LOST, STANDING, WINDOW_S, prepare
from jgait.estimators.checks import JUMP_S
from jgait.estimators.lagged import LaggedMotion, LaggedSample, LaggedSignals, LaggedState
from jgait.estimators.notes import LONGEST_LOSS
from jgait.events import shank as shank_events
from jgait.events import shank_stance
from jgait.filtering import Belief
from jgait.geometry.rotation import between
from jgait.geometry.vectors import Vector, as_array, vector, wrapped
from jgait.notes import record
from jgait.signal import butterworth
from jgait.types import SIDES, Counts, Flags, Recording, RecordingError, Strides, Values


@record
class Worn(NamedTuple):
    """Mounting of a sensor, from a recording; every leaf is an array."""

    axes: Values  #: (3, 3) forward, left and up in the sensor's axes.
    gyr_bias: Values  #: (3,) gyroscope bias while standing, in the segment's axes [rad/s].
    still_time: Values  #: duration of the standing from which that bias was measured [s]; 0: the leg never stood still.
    mid_shank: Values  #: 1 if the sensor is at mid shank, 0 at the ankle.
    rate_hz: Values  #: sampling rate.
    side: Counts  #: 0 right, 1 left.
    #: (4,) samples for which a minimum of the stance rate must stay the lowest to count as the valley, for which the
    #: foot lands after a swing, for which the leg turns slowly before it stands, and half the width of a stance.
    samples: Counts
    shift: Values  #: delay of the stance rate relative to the integrated signals, in samples.
    #: one zero for each sample of the filter's lag, for each stored change of the readings, and for those around the
    #: sample that is integrated: their numbers, known when a program is compiled.
    lengths: tuple[Values, ...]


def worn(p: AnkleParams, recording: Recording, side: str) -> Worn:
    """Mounting of the sensor of one side, "right" or "left", from a recording of standing and walking; on the host.

    Raises:
        RecordingError: as `ankle_stride.prepare.prepare`; no sensor on that side, or one that does not walk.
    """
    number = SIDES.index(side)
    leg = prepare(recording).inputs[1 + number]
    if leg is None or int(leg.count) == 0:
        what = "has no sensor there" if leg is None else "does not walk there"
        raise RecordingError(f"a recording of walking is needed to know how the {side} sensor is worn; this one {what}")
    hz = recording.sampling_rate_hz
    late, slow = (float(butterworth.delay(cutoff, hz)) for cutoff in (p.cutoff_hz, shank_stance.CUTOFF_HZ))
    shift = max(0, round((slow - late) * hz))
    # [s] valleys before the highest rate in which the foot lands do not count; the first three are chosen by hand
    durations = (0.2, 0.25, 0.5, WINDOW_S, JUMP_S)
    hold, _, _, reach, around = samples = [max(1, round(seconds * hz)) for seconds in durations]
    sizes = (hold + reach + shift, max(round(late * hz) + around, 2 * around + 1), 2 * around + 1)
    return Worn(
        leg.axes, leg.gyr_bias, leg.still_time, leg.mid_shank, leg.rate_hz, np.asarray(number, np.int32),
        np.asarray(samples[:4], np.int32), np.asarray(shift, np.int32), tuple(map(np.zeros, sizes)),
    )  # fmt: skip


class OnlineSwing(NamedTuple):
    """The swings since the last stride: begin and end [s], sample at which they became known, whether there was any."""

    leaves: Values
    lands: Values
    known: Counts
    any: Flags


class AnkleDetector(NamedTuple):
    """State of the decisions between samples."""

    index: Counts  #: index of the newest sample.
    last: Values  #: (2, 6) the two newest readings, angular rate and specific force in the segment's axes.
    #: low-pass states of the integrated signals (6,), the stance rates (3,) and the sagittal rate ().
    low_passed: PyTree
    swings: shank_events.ShankState  #: state of the swing detector.
    jumps: Values  #: (n, 2) changes of the last readings.
    history: Values  #: (lag, 10) ring buffer of the low-passed samples since the filter's sample.
    valley: shank_stance.StanceSearch  #: state of the search for the valley, see `events.shank_stance`.
    stood: Counts  #: sample of the last valley.
    slow: Counts  #: number of samples for which the leg has turned slowly.
    swung: OnlineSwing  #: swings since the last stride.
    started: Flags  #: whether the leg has stood, so that the filter has started.
    landed: Values  #: end of the last stride's swing [s]; −∞ before the first stride.
    lost: Values  #: time without samples since the stride began [s].


def _low_passes(p: AnkleParams, worn: Worn) -> tuple[PyTree, ...]:
    """Sections for the integrated signals, the stance rates and the sagittal rate."""
    cutoffs = (p.cutoff_hz, shank_stance.CUTOFF_HZ, shank_events.LOBES.cutoff_hz)
    return tuple(butterworth.section(jnp.asarray(hz, worn.axes.dtype), worn.rate_hz) for hz in cutoffs)


def _reading(worn: Worn, gyr: Values, acc: Values) -> Values:
    """(6,) a reading in the segment's axes."""
    # sums of products: XLA calls a library for a matrix product, and compiles a loop with such a call step by step
    return jnp.concatenate([jnp.sum(worn.axes * jnp.asarray(values)[None], axis=1) for values in (gyr, acc)])


def begin(p: AnkleParams, worn: Worn, gyr: Values, acc: Values) -> LaggedState:
    """The state after a long time in which each reading equals the first, (3,) in the sensor's axes [rad/s, m/s²]."""
    x = _reading(worn, gyr, acc)
    rates = x[:3] - worn.gyr_bias
    zero, none, no = jnp.zeros_like(x[0]), jnp.zeros((), jnp.int32), jnp.zeros((), bool)
    low_passed = tuple(map(butterworth.at_rest, _low_passes(p, worn), (x, rates, rates[1])))
    lag, changes, _ = (values.shape[-1] for values in worn.lengths)
    history = jnp.concatenate([jnp.zeros((lag, 6), x.dtype) + x[None], jnp.zeros((lag, 4), x.dtype)], axis=1)
    detector = AnkleDetector(
        none - 1, jnp.stack([x, x]), low_passed, shank_events.begin(rates[1], zero), jnp.zeros((changes, 2), x.dtype),
        history, shank_stance.begin(rates[1]), none - 2**30, none, OnlineSwing(zero, zero, none, no), no,
        zero - jnp.inf, zero,
    )  # fmt: skip
    return lagged.begin(STEPS, p, worn, detector, x)


def _prior(p: AnkleParams, worn: Worn, x: Values) -> Belief:
    """The belief of a leg that stands, with the tilt from the specific force."""
    ones, zeros = jnp.ones_like(x[0]), jnp.zeros_like(x[0])
    attitude = between(vector(x[3:]), Vector(zeros, zeros, ones))
    return standing_prior(p, worn, as_array(attitude), x[:3]).joined()


def _decide(
    worn: Worn, low_passes: tuple[PyTree, ...], state: AnkleDetector, sample: tuple[Values, Values, Values]
) -> tuple[AnkleDetector, LaggedSample]:
    """One sample: detection of swing and stance at the newest sample, and what follows for the filter's sample."""
    gyr, acc, measured = sample
    there, (hold, landing, calm, reach) = jnp.asarray(measured), worn.samples
    x = jnp.where(there, _reading(worn, gyr, acc), state.last[1])
    index, rates = state.index + 1, x[:3] - worn.gyr_bias
    low_passed, (smooth, slowly, rate) = zip(
        *map(butterworth.step, low_passes, state.low_passed, (x, rates, rates[1])), strict=True
    )
    time = index.astype(x.dtype) / worn.rate_hz
    swings, swing = shank_events.swing_step(shank_events.LOBES, state.swings, rate, time)
    leaves = (swings.phase == shank_events.TOE_OFF) | (swings.phase == shank_events.SWING)
    phase = shank_stance.Phase(swing.stride, leaves)
    valley, lasted = shank_stance.step(state.valley, index, slowly[1], phase, hold, landing)
    stood = jnp.where(lasted, valley.at, state.stood)
    turns_slowly = jnp.sum(slowly * slowly) < STANDING**2
    slow = jnp.where(turns_slowly, jnp.minimum(state.slow, calm) + 1, 0).astype(jnp.int32)
    change = 0.5 * (x - state.last[0]).reshape(2, 3)
    jumps = jnp.concatenate([state.jumps[1:], jnp.sqrt(jnp.sum(change * change, axis=1))[None]])
    late = butterworth.delay(shank_events.LOBES.cutoff_hz, worn.rate_hz)
    swung = OnlineSwing(
        leaves=jnp.where(swing.stride & ~state.swung.any, swing.start - late, state.swung.leaves),
        lands=jnp.where(swing.stride, swing.end - late, state.swung.lands),
        known=jnp.where(swing.stride, index, state.swung.known),
        any=state.swung.any | swing.stride,
    )
    # the filter's sample, the oldest stored one, and the sample of the stance rates that was measured at its time
    rows = state.history.shape[0]
    row, looked, full = state.history[index % rows], index - rows + worn.shift, index >= rows
    calmly = full & (state.history[(index + worn.shift) % rows, 9] > 0.0)
    near = full & (jnp.abs(looked - stood) <= reach)
    stands = (near | calmly) & (row[8] == 0.0)
    started = state.started | stands
    passed = near & (looked == stood + reach)
    instant = started & (passed | calmly)
    ends = instant & swung.any & (looked >= swung.known)
    lost = state.lost + (row[8] > 0.0).astype(row.dtype) / worn.rate_hz
    lagged_sample = LaggedSample(
        row[:6], row[6:8], row[3:6], row[8], lost, stands, state.started, instant, (~passed, ends, swung, state.landed)
    )
    flags = jnp.stack([~there, slow >= calm]).astype(x.dtype)
    newest = jnp.concatenate([smooth, jnp.max(jumps[: worn.lengths[2].shape[-1]], axis=0), flags])
    # all rows are written: setting one would be a scatter, which XLA does not compile as a part of a loop
    history = jnp.where(jnp.arange(rows, dtype=index.dtype)[:, None] == index % rows, newest[None], state.history)
    return AnkleDetector(
        index, jnp.stack([state.last[1], x]), low_passed, swings, jumps, history, valley, stood, slow,
        swung._replace(any=swung.any & ~ends), started, jnp.where(ends, swung.lands, state.landed),
        jnp.where(instant, 0.0, lost),
    ), lagged_sample  # fmt: skip


def _filtered(p: AnkleParams, signals: LaggedSignals, stands: Flags, belief: Belief) -> filtering.Posterior:
    readings, keep = (signals.rates, signals.gyr, signals.acc), ("mean", "cov", "nis", "count", "valid")
    return filtered(p, signals, readings, stands, belief, DEFAULT._replace(smooth=False), keep).filtered


def _strides(
    p: AnkleParams, worn: Worn, at: LaggedSample, motion: LaggedMotion
) -> tuple[Strides, Strides, dict[str, Values]]:
    """The strides that would end at each of the filter's samples (T,), standard deviations, and flags.

    The events there: whether it is an instant of standing, not of a valley; whether a swing ends; the swings since the
    last instant, and the end of the one before them [s].
    """
    mean, (half, ends, swung, landed) = motion.posterior.mean, at.events
    way = ankle_strides.measured(mean, motion.posterior.cov)
    here, there = (ankle_strides.Heading(*yaw) for yaw in (motion.here, motion.there))
    follows = swung.leaves - landed <= shank_stance.PAUSE_S
    start = jnp.where(follows, landed, swung.leaves)
    duration = jnp.maximum(swung.lands - start, 1e-3)
    strides = ankle_strides.table(
        worn.side, (start, swung.leaves, swung.lands), duration, way.length, way.height,
        wrapped(there.angle - here.angle), ends & at.began & (at.lost_s <= LONGEST_LOSS),
    )  # fmt: skip
    stddev = ankle_strides.deviations(p, strides, way, here, there, duration)
    away = ankle_strides.off(vector(mean.lever), ankle_strides.lever_of(p, worn)) > ankle_strides.FARTHEST_OFF
    strides, stddev, doubt = lagged.judged("ankle_stride", strides, stddev, motion.nis)
    return strides, stddev, ankle_strides.flags(strides, half=~follows | half, doubtful=doubt | away)


STEPS = lagged.Steps(
    lambda p, worn: partial(_decide, worn, _low_passes(p, worn)), _prior, _filtered,
    lambda posterior: tuple(ankle_strides.heading(posterior.mean, posterior.cov)), _strides, LOST,
)  # fmt: skip
"""What this estimator does with samples."""

over = partial(lagged.over, STEPS)
"""The samples that follow, see `lagged.over`."""
