r"""The ankle's estimator a sample at a time, in constant memory, for a device that counts strides during the walk.

Each sample passes causal low-passes and a detector of `events.shank`, which detects the swings of the shank. After a
swing, `events.shank_stance` searches the valley of the stance rate, which is known only after the valley. The
error-state filter therefore runs a fixed lag, some 0.26 s, behind the newest sample, and uses the ankle's zero velocity
before and after the valley. When the filter has passed a valley, or while the person stands, a swing since the last
such instant makes a stride, whose length, height and turn are then known, with their standard deviations.

The host decides beforehand on axes, gyroscope bias at rest, placement and sampling rate, from a recording of a walk
(`ankle_stride.prepare.prepare`); the device then needs memory for a few hundred numbers, however long the walk.

Deviations from `ankle_stride` without smoothing, which integrates signals filtered both ways and knows the whole walk:
    1. Signals are filtered causally, at the same cut-off; times have the delay removed.
    2. Swings by the lobes of a causally filtered rate.
    3. The valley is the first minimum that lasts, not the least rate in a part of the time between two swings.
    4. Standing is a leg that has hardly turned for `CALM_S`.
    5. A stride is read where the window of zero velocities around its valley ends, not in its middle.
    6. A stride that lasts far longer than the usual one of the leg so far is in doubt (`LONG`): small steps in between
       may have been missed.
    7. Nothing is known of a reading's range, so that clipped swings are not noticed.
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import DTypeLike
from jaxtyping import PyTree

from jgait import filtering
from jgait.estimators import trust
from jgait.estimators.ankle_stride import model as ankle_model
from jgait.estimators.ankle_stride import readout as ankle_strides
from jgait.estimators.ankle_stride.estimator import control, model_params, standing_prior
from jgait.estimators.ankle_stride.model import AnkleObservation
from jgait.estimators.ankle_stride.params import AnkleParams
from jgait.estimators.ankle_stride.prepare import LOST_FORCE, LOST_RATE, STANDING
from jgait.estimators.ankle_stride.readout import Heading
from jgait.estimators.ankle_stride.worn import ONLINE, Worn, worn
from jgait.estimators.losses import held_bridge
from jgait.estimators.notes import LONGEST_LOSS
from jgait.events import shank as shank_events
from jgait.events import shank_stance
from jgait.filtering import Belief
from jgait.geometry.rotation import between
from jgait.geometry.vectors import Vector, as_array, vector, wrapped
from jgait.signal import butterworth
from jgait.signal.counted import scanned
from jgait.signal.marks import latest
from jgait.types import Counts, Flags, Strides, Values

__all__ = ["ONLINE", "AnkleOnlineState", "Now", "Worn", "begin", "over", "worn"]


LONG, WEIGHT = 1.5, 0.25
"""[1] Duration of a stride over the usual one of the leg from which on it is in doubt: the leg may have been down in
between; weight of a stride in the usual duration."""


class OnlineSwing(NamedTuple):
    """The swings since the last stride: begin and end [s], sample at which they became known, whether there was any."""

    leaves: Flags
    lands: Flags
    known: Flags
    any: Flags


class AnkleOnlineState(NamedTuple):
    """State between samples; every field has a fixed size."""

    index: Counts  #: index of the newest sample.
    last: Counts  #: (2, 6) the two newest readings, angular rate and specific force in the segment's axes.
    #: low-pass states of the integrated signals (6,), the stance rates (3,) and the sagittal rate ().
    low_passed: PyTree
    detector: PyTree  #: state of the swing detector.
    jumps: PyTree  #: (n, 2) changes of the last readings.
    history: PyTree  #: (lag, 10) ring buffer of the low-passed samples since the filter's sample.
    valley: shank_stance.StanceSearch  #: state of the search for the valley, see `events.shank_stance`.
    stood: PyTree  #: sample of the last valley.
    slow: PyTree  #: number of samples for which the leg has turned slowly.
    swung: OnlineSwing  #: swings since the last stride, see `OnlineSwing`.
    before: PyTree  #: (6,) the last integrated sample.
    belief: Belief  #: belief of the filter.
    restart: Flags  #: 1 if positions count from the filter's sample, else 0.
    started: Flags  #: whether the leg has stood, so that the filter has started.
    heading: Heading  #: heading at which the stride begins.
    since: Values  #: (2,) normalised innovations squared since the stride began, summed, and their number.
    landed: Flags  #: end of the last stride's swing [s]; −∞ before the first stride.
    usual: Values  #: usual duration of the leg's strides so far [s]; 0 before the second stride.
    lost: Values  #: time without samples since the stride began [s].
    count: Counts  #: number of strides so far.


class Now(NamedTuple):
    """Results after a sample."""

    stride: PyTree  #: bool, a stride has become known; `strides`, `stddev` and `flags` have a meaning only if True.
    strides: Strides  #: the stride, its fields scalars; times count from the first sample [s].
    stddev: Strides  #: standard deviations of the stride.
    #: the flags of `ankle_stride.readout.FLAGS` without "clipped", and "doubtful", see `trust.doubtful`.
    flags: dict[str, Any]
    count: Counts  #: number of strides so far.
    stands: Flags  #: bool, the person stands still.
    valid: Flags  #: False if the filter's update failed numerically and the filter kept its prediction.


type Filters = tuple[PyTree, ...]
"""Low-pass sections for the integrated signals, the stance rates and the sagittal rate."""


def filters_of(p: AnkleParams, worn: Worn, dtype: DTypeLike) -> Filters:
    """The low-passes of the online estimator."""
    cutoffs = (p.cutoff_hz, shank_stance.CUTOFF_HZ, shank_events.LOBES.cutoff_hz)
    return tuple(butterworth.section(jnp.asarray(hz, dtype), worn.rate_hz) for hz in cutoffs)


def reading(worn: Worn, gyr: Values, acc: Values) -> Values:
    """(6,) a reading in the segment's axes."""
    # sums of products: XLA calls a library for a matrix product, and compiles a loop with such a call step by step
    return jnp.concatenate([jnp.sum(worn.axes * jnp.asarray(values)[None], axis=1) for values in (gyr, acc)])


def begin(p: AnkleParams, worn: Worn, gyr: Values, acc: Values) -> AnkleOnlineState:
    """The state after a long time in which each reading equals the first, (3,) in the sensor's axes [rad/s, m/s²]."""
    x = reading(worn, gyr, acc)
    cascades = filters_of(p, worn, x.dtype)
    rates = x[:3] - worn.gyr_bias
    zero, none, no = jnp.zeros_like(x[0]), jnp.zeros((), jnp.int32), jnp.zeros((), bool)
    return AnkleOnlineState(
        index=none - 1,
        last=jnp.stack([x, x]),
        low_passed=tuple(map(butterworth.at_rest, cascades, (x, rates, rates[1]))),
        detector=shank_events.begin(rates[1], zero),
        jumps=jnp.asarray(worn.jumps, x.dtype),
        history=jnp.asarray(worn.history, x.dtype).at[:, :6].set(x),
        valley=shank_stance.begin(rates[1]),
        stood=none - 2**30,
        slow=none,
        swung=OnlineSwing(zero, zero, none, no),
        before=x,
        belief=jax.tree.map(lambda leaf: jnp.asarray(leaf, x.dtype), level_prior(p, worn, x)),
        restart=zero,
        started=no,
        heading=Heading(zero, zero),
        since=jnp.zeros_like(x[:2]),
        landed=zero - jnp.inf,
        usual=zero,
        lost=zero,
        count=none,
    )


def level_prior(p: AnkleParams, worn: Worn, x: Values) -> Belief:
    """The belief of a leg that stands, with the tilt from the specific force."""
    ones, zeros = jnp.ones_like(x[0]), jnp.zeros_like(x[0])
    attitude = between(vector(x[3:]), Vector(zeros, zeros, ones))
    return standing_prior(p, worn, as_array(attitude), x[:3]).joined()


class _Delayed(NamedTuple):
    """Rows of the history (T,), with the field names that `ankle_stride.estimator.control` uses."""

    gyr_jump: Values
    acc_jump: Values
    gyr_doubt: Values
    acc_doubt: Values
    dt: Values
    restart: Flags
    rate_hz: Values
    gyr_bias: Values


class _AnkleEvent(NamedTuple):
    """What is decided at the filter's sample, before the filter runs."""

    row: Values  #: (10,) the sample, see `AnkleOnlineState.history`.
    before: Values  #: (6,) the sample before it.
    stands: Flags  #: bool, zero velocity is observed.
    began: Flags  #: bool, the filter had started before the sample.
    restart: Values  #: 1 if positions count from the sample before, else 0.
    instant: Flags  #: bool, the middle of a stance or standing: positions count from here.
    half: Flags  #: bool, an instant of standing, not of a valley.
    ends: Flags  #: bool, a swing ends here.
    swung: OnlineSwing  #: the swings since the last instant.
    landed: Values  #: end of the swing before them [s].
    long: Flags  #: bool, they last far longer than the strides before.
    lost: Values  #: time without samples since the last instant [s].
    still: Flags  #: bool, the person stands at the newest sample.


def _seen(
    worn: Worn, filters: Filters, state: AnkleOnlineState, gyr: Values, acc: Values, measured: Flags
) -> tuple[AnkleOnlineState, Values]:
    """The state after event detection at the newest sample, and the row (10,) for the history."""
    there = jnp.asarray(measured)
    x = jnp.where(there, reading(worn, gyr, acc), state.last[1])
    index = state.index + 1
    rates = x[:3] - worn.gyr_bias
    (signals, smooth), (stance, slowly), (sagittal, rate) = (
        butterworth.step(cascade, before, values)
        for cascade, before, values in zip(filters, state.low_passed, (x, rates, rates[1]), strict=True)
    )
    time = index.astype(x.dtype) / worn.rate_hz
    detector, swing_events = shank_events.swing_step(shank_events.LOBES, state.detector, rate, time)
    leaves = (detector.phase == shank_events.TOE_OFF) | (detector.phase == shank_events.SWING)
    phase = shank_stance.Phase(swing_events.stride, leaves)
    valley, lasted = shank_stance.step(state.valley, index, slowly[1], phase, worn.hold, worn.landing)
    turns_slowly = jnp.sum(slowly * slowly) < STANDING**2
    slow = jnp.where(turns_slowly, jnp.minimum(state.slow, worn.calm) + 1, 0).astype(jnp.int32)
    change = 0.5 * (x - state.last[0]).reshape(2, 3)
    jumps = jnp.concatenate([state.jumps[1:], jnp.sqrt(jnp.sum(change * change, axis=1))[None]])
    jump = jnp.max(jnp.where(worn.jump_looks[:, None], jumps, 0.0), axis=0)
    calm = (slow >= worn.calm).astype(x.dtype)
    late = butterworth.delay(shank_events.LOBES.cutoff_hz, worn.rate_hz)
    swung = OnlineSwing(
        leaves=jnp.where(swing_events.stride & ~state.swung.any, swing_events.start - late, state.swung.leaves),
        lands=jnp.where(swing_events.stride, swing_events.end - late, state.swung.lands),
        known=jnp.where(swing_events.stride, index, state.swung.known),
        any=state.swung.any | swing_events.stride,
    )
    after = state._replace(
        index=index, last=jnp.stack([state.last[1], x]), low_passed=(signals, stance, sagittal), detector=detector,
        valley=valley, stood=jnp.where(lasted, valley.at, state.stood), slow=slow, jumps=jumps, swung=swung,
    )  # fmt: skip
    return after, jnp.concatenate([smooth, jump, jnp.where(there, 0.0, 1.0)[None], calm[None]])


def _decided(
    worn: Worn, filters: Filters, state: AnkleOnlineState, sample: tuple[Values, Values, Values]
) -> tuple[AnkleOnlineState, _AnkleEvent]:
    """One sample: detection of swing and stance at the newest sample, and what follows for the filter's sample."""
    before = state
    state, newest = _seen(worn, filters, state, *sample)
    rows, index = state.history.shape[0], state.index
    row = state.history[index % rows]
    calm = state.history[(index + worn.shift) % rows, 9] > 0.0
    full = index >= rows
    # the sample of the stance rates that was measured at the time of the filter's sample
    looked = index - rows + worn.shift
    near = full & (jnp.abs(looked - state.stood) <= worn.reach)
    stands = (near | (calm & full)) & (row[8] == 0.0)
    started = state.started | stands
    passed = near & (looked == state.stood + worn.reach)
    instant = started & (passed | (calm & full))
    ends = instant & state.swung.any & (looked >= state.swung.known)
    lost = before.lost + (row[8] > 0.0).astype(row.dtype) / worn.rate_hz
    lasts, most = state.swung.lands - state.landed, LONG * state.usual
    follows = ends & (state.swung.leaves - state.landed <= shank_stance.PAUSE_S)
    known = follows & (state.usual > 0.0)
    event = _AnkleEvent(
        row, before.before, stands, before.started, before.restart, instant, ~passed, ends, state.swung, state.landed,
        known & (lasts > most), lost, state.slow >= worn.calm,
    )  # fmt: skip
    # all rows are written: setting one would be a scatter, which XLA does not compile as a part of a loop
    history = jnp.where(jnp.arange(rows, dtype=index.dtype)[:, None] == index % rows, newest[None], state.history)
    after = state._replace(
        history=history,
        before=row[:6],
        started=started,
        restart=instant.astype(newest.dtype),
        swung=state.swung._replace(any=state.swung.any & ~ends),
        landed=jnp.where(ends, state.swung.lands, state.landed),
        usual=jnp.where(
            known,
            state.usual + WEIGHT * (jnp.minimum(lasts, most) - state.usual),
            jnp.where(follows, lasts, state.usual),
        ),
        lost=jnp.where(instant, 0.0, lost),
    )
    return after, event


def _filtered(
    p: AnkleParams, worn: Worn, state: AnkleOnlineState, event: _AnkleEvent, real: Flags
) -> filtering.Posterior:
    """The filter over the samples of events (T,), those with `real` alone."""
    begins = real & ~event.began & event.stands
    prior = level_prior(p, worn, event.row[jnp.argmax(begins), :6])
    initial = jax.tree.map(lambda a, b: jnp.where(state.started, a, b), state.belief, prior)
    dt = jnp.where(real & event.began, 1.0 / worn.rate_hz, 0.0)
    mean = 0.5 * (event.row[:, :6] + event.before)
    jumps = (event.row[:, 6], event.row[:, 7])
    goes, turned, moved = held_bridge(event.row[:, 8], event.lost, 1.0 / worn.rate_hz, LOST_RATE, LOST_FORCE)
    dt = jnp.where(goes, dt, 0.0)
    now = _Delayed(*jumps, turned, moved, dt, event.restart, worn.rate_hz, worn.gyr_bias)
    driven = control(p, now, event.row[:, :3], mean[:, :3], mean[:, 3:])
    return filtering.kalman_filter(
        ankle_model.MODEL,
        model_params(p),
        AnkleObservation(jnp.zeros_like(mean[:, :3])),
        controls=driven,
        dt=dt,
        mask=AnkleObservation(event.stands & real),
        initial=initial,
        keep=("mean", "cov", "nis", "count", "valid"),
    )


def _summed(state: AnkleOnlineState, posterior: filtering.Posterior, stands: Flags) -> Values:
    """(T, 2) sums of the normalised innovations squared and of the observed components since the last instant before
    the samples.
    """
    used = stands & jnp.isfinite(posterior.nis)
    rows = jnp.stack([posterior.nis, posterior.count.astype(posterior.nis.dtype)], axis=1)
    return state.since[None] + jnp.cumsum(jnp.where(used[:, None], rows, 0.0), axis=0)


def _strides(
    p: AnkleParams, worn: Worn, event: _AnkleEvent, posterior: filtering.Posterior, here: Heading, nis: Values
) -> tuple[Strides, Strides, dict[str, Values]]:
    """The strides that would end at each of the filter's samples (T,), standard deviations, flags; `here` is the
    heading at which each begins, `nis` the mean normalised innovation squared since then.
    """
    way = ankle_strides.measured(vector(posterior.mean.position), ankle_strides.across(posterior.cov))
    there = ankle_strides.heading(posterior.mean, posterior.cov)
    swung = event.swung
    follows = swung.leaves - event.landed <= shank_stance.PAUSE_S
    start = jnp.where(follows, event.landed, swung.leaves)
    duration = jnp.maximum(swung.lands - start, 1e-3)
    times = (start, swung.leaves, swung.lands)
    turn = wrapped(there.angle - here.angle)
    ends = event.ends & event.began & (event.lost <= LONGEST_LOSS)
    strides = ankle_strides.table(worn.side, times, duration, way.length, way.height, turn, ends)
    stddev = ankle_strides.deviations(p, strides, way, here, there, duration)
    away = ankle_strides.off(vector(posterior.mean.lever), ankle_strides.lever_of(p, worn)) > ankle_strides.FARTHEST_OFF
    doubt = trust.doubtful(strides, stddev, nis) | away | event.long
    return strides, stddev, ankle_strides.flags(strides, half=~follows | event.half, doubtful=doubt)


def over(
    p: AnkleParams, worn: Worn, state: AnkleOnlineState, gyr: Values, acc: Values, measured: Flags | None = None,
    count: Counts | None = None,
) -> tuple[AnkleOnlineState, Now]:  # fmt: skip
    """The samples (T,) that follow; not compiled, for use in a compiled program.

    First a scan decides on swings and stances, then the filter runs over the samples, then the strides are read: the
    filter does not influence the decisions.

    Args:
        p: parameters.
        worn: from `worn`.
        state: from `begin` or the samples before.
        gyr: (T, 3) in the sensor's axes [rad/s].
        acc: (T, 3) [m/s²].
        measured: (T,) False where a sample was lost; None: all are measured.
        count: number of samples; later ones are ignored. None: T.
    """
    filters = filters_of(p, worn, state.last.dtype)
    samples = gyr.shape[0]
    there = jnp.ones(samples, bool) if measured is None else measured
    newest = samples - 1 if count is None else count - 1
    real = jnp.arange(samples, dtype=jnp.int32) <= newest
    after, event = scanned(partial(_decided, worn, filters), state, (gyr, acc, there), count)
    posterior = _filtered(p, worn, state, event, real)
    now = (ankle_strides.heading(posterior.mean, posterior.cov), _summed(state, posterior, event.stands & real))
    begins, last = latest((state.heading, jnp.zeros_like(state.since)), now, event.instant & real)
    since = now[1] - begins[1]
    nis = since[:, 0] / jnp.maximum(since[:, 1], 1.0)
    strides, stddev, flags = _strides(p, worn, event, posterior, begins[0], nis)
    stride = strides.valid
    number = state.count + jnp.cumsum(stride, dtype=jnp.int32)
    after = after._replace(
        belief=posterior.belief(newest),
        heading=last[0],
        since=now[1][-1] - last[1],
        count=number[-1],
    )
    return after, Now(stride, strides, stddev, flags, number, event.still, posterior.valid)
