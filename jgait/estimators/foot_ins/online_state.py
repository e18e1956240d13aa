"""The foot's online estimator: how the sensor is worn, from a recording, the state between samples, and the results."""

from types import SimpleNamespace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from jgait.estimators.foot_ins.estimator import prior_of
from jgait.estimators.foot_ins.params import DEFAULT, FootParams
from jgait.estimators.foot_ins.prepare import checked_clock, errors_at_rest
from jgait.events import foot as events
from jgait.events.rest import rest
from jgait.filtering import Belief
from jgait.geometry.rotation import between
from jgait.geometry.vectors import Vector, as_array, vector
from jgait.signal.windows import over_losses
from jgait.types import SIDES, Counts, Flags, Recording, RecordingError, Strides, Values

ONLINE = DEFAULT._replace(smooth=False)
"""Options of the estimator over the whole recording to which the online estimator corresponds."""


HOLD_S = 0.1
"""[s] Duration for which a sample must stay the stillest to be the foothold."""

JUMP_S = 0.0075
"""[s] Half width of the window whose largest change of the readings gives a reading's noise."""


class FootWorn(NamedTuple):
    """Mounting and settings of a foot's sensor, from a recording; every leaf is an array."""

    scale: Values  #: factor on the accelerometer [1].
    gyr_bias: Values  #: (3,) gyroscope bias at rest [rad/s].
    acc_bias: Values  #: accelerometer bias along the vertical, from gravity at rest [m/s²].
    still_time: Values  #: duration of rest over which the gyroscope bias was measured [s].
    axis: Values  #: (3,) axis about which the foot turns, toes up positive, in the sensor's axes [1].
    rate_hz: Values  #: sampling rate.
    side: Counts  #: 0 right, 1 left.
    samples: PyTree  #: (n, 7) zeros, one row for each stored sample: rate, specific force, whether it is lost.
    quiet: PyTree  #: (m,) zeros, one row for each stored sample of the detector.
    window: PyTree  #: (w,) zeros, as many as samples in the detector's window.
    jumps: PyTree  #: (j,) zeros, as many as samples in the window of the largest change.
    after_start: PyTree  #: (a,) zeros, as many as samples removed from the start of a stance.
    before_end: PyTree  #: (b,) zeros, as many as samples removed from its end.


def worn(recording: Recording, side: str) -> FootWorn:
    """Mounting and settings of the sensor of one side, from a recording of standing and walking; on the host.

    Raises:
        RecordingError: as `foot_ins.prepare.prepare`, or if the foot does not walk.
    """
    name = f"foot_{side}"
    time = checked_clock(recording, (side,))
    imu = recording.sensors[name]
    mask = np.asarray(imu.mask, bool)
    gyr, acc = (over_losses(np.arange(len(time)), values, mask) for values in (imu.gyr, imu.acc))
    hz = 1.0 / float(np.median(np.diff(time)))
    at_rest = rest(gyr, acc, mask, hz)
    scale, acc_bias = errors_at_rest(at_rest, name, [])
    free = gyr - at_rest.gyr_bias
    stances = events.stances(free, acc * scale, hz)
    if len(stances.start) < 3:
        raise RecordingError(
            f"a recording of walking is needed to know how '{name}' is worn; this one has {len(stances.start)} stances"
        )
    half, hold = len_of(events.WINDOW / 2, hz), len_of(HOLD_S, hz)
    around = len_of(JUMP_S, hz)
    after, before = (round(seconds * hz) for seconds in events.EROSION)
    return FootWorn(
        scale=np.asarray(scale),
        gyr_bias=at_rest.gyr_bias,
        acc_bias=np.asarray(acc_bias),
        still_time=np.asarray(max(at_rest.time, 0.05)),
        axis=_toes_up(free, stances, hz),
        rate_hz=np.asarray(hz),
        side=np.asarray(SIDES.index(side), np.int32),
        samples=np.zeros((max(2 * half + 1, half + hold + around + 3), 7)),
        quiet=np.zeros(after + hold + 2),
        window=np.zeros(2 * half + 1),
        jumps=np.zeros(2 * around + 1),
        after_start=np.zeros(after),
        before_end=np.zeros(before),
    )


def len_of(seconds: float, hz: float) -> int:
    """A duration in samples, at least one."""
    return max(1, round(seconds * hz))


def _toes_up(gyr: np.ndarray, stances: events.Stances, hz: float) -> np.ndarray:
    """(3,) main axis of the rotation in swing; with its sign the heel rises before the toes in most strides."""
    swinging = ~events.inside(stances, len(gyr))
    axis = np.linalg.eigh(gyr[swinging].T @ gyr[swinging])[1][:, -1]
    votes = 0
    for a, b in zip(stances.stillest[:-1], stances.stillest[1:], strict=True):
        pitch = np.cumsum(gyr[a:b] @ axis) / hz
        pitch -= np.linspace(0.0, pitch[-1], b - a)
        votes += 1 if np.argmax(pitch) > np.argmin(pitch) else -1
    return np.asarray(axis if votes >= 0 else -axis)


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
    initial: Values  #: time at which the pitch has fallen by `events.foot.LANDED` from it.
    stood: Values  #: time of the last sample of the stance before the swing.
    stands: Values  #: time of the first sample of the stance after it.
    lost: Values  #: duration of lost samples.


class FootOnlineState(NamedTuple):
    """State between samples; every field has a fixed size."""

    index: Counts  #: index of the newest sample.
    samples: PyTree  #: (n, 7) the newest samples, see `FootWorn`.
    quiet: PyTree  #: (m,) margin of the newest samples of the detector [rad/s], below 0 in a stance.
    unrest: PyTree  #: (m,) the detector's statistic [rad/s].
    threshold: StanceThreshold  #: search for the valleys of the statistic.
    started: Flags  #: whether the foot has stood, so that the filter has started.
    restart: Values  #: 1 if positions count from the filter's sample, else 0.
    belief: Belief  #: belief of the filter.
    foothold: Values  #: time of the last foothold [s].
    heading: Values  #: heading there [rad], and variance [rad²].
    swing: FootSwing  #: what happened since then.
    #: of the filter since then: largest height of the sensor [m], sum of the normalised innovations squared, number of
    #: observations.
    since: Values
    landed: Values  #: initial contact of the last stride [s]; −∞ before the first.
    restless: Flags  #: bool, the last foothold is far less still than the stances before it.
    count: Counts  #: number of strides so far.


class FootNow(NamedTuple):
    """Results after a sample; those of the filter are `lag` samples behind."""

    stride: Flags  #: bool, a stride has become known; `strides`, `stddev` and `flags` have a meaning only if True.
    strides: Strides  #: the stride, its fields scalars; times count from the first sample [s].
    stddev: Strides  #: standard deviations of the stride.
    flags: dict[str, Values]  #: "doubtful", see `trust.doubtful`; also beside footholds that are not still.
    count: Counts  #: number of strides so far.
    stands: Flags  #: bool, zero velocity was observed.
    foothold: Flags  #: bool, positions count from this sample on.
    started: Flags  #: bool, the filter runs.
    position: Values  #: (3,) since the last foothold [m].
    velocity: Values  #: (3,) [m/s].
    attitude: Values  #: (4,) q_ws, w first, its heading arbitrary.
    valid: Flags  #: False if the filter's update failed numerically and the filter kept its prediction.


def lag(worn: FootWorn) -> int:
    """Number of samples by which the filter is behind the newest sample."""
    half = worn.window.shape[-1] // 2
    return half + worn.quiet.shape[-1] - worn.after_start.shape[-1] - 1


def begin(p: FootParams, worn: FootWorn, gyr: Values, acc: Values) -> FootOnlineState:
    """The state after a long time in which each reading equals the first, (3,) in the sensor's axes [rad/s, m/s²]."""
    row = reading(worn, gyr, acc, jnp.ones((), bool))
    zero, none, no = jnp.zeros_like(row[0]), jnp.zeros((), jnp.int32), jnp.zeros((), bool)
    rate = jnp.sqrt(jnp.sum((row[:3] - worn.gyr_bias) ** 2))
    quiet = jnp.zeros_like(worn.quiet)
    start = zero - lag(worn) / worn.rate_hz
    swing = FootSwing(no, zero, zero, start, zero, start, start, start, zero)
    return FootOnlineState(
        index=none - 1,
        samples=jnp.zeros_like(worn.samples) + row[None],
        quiet=quiet + rate - events.STILL,
        unrest=quiet + rate,
        threshold=StanceThreshold(~no, rate, jnp.zeros_like(row[:2])),
        started=no,
        restart=zero,
        belief=jax.tree.map(lambda leaf: jnp.asarray(leaf, row.dtype), level_prior(p, worn, row[3:6])),
        foothold=start,
        heading=jnp.zeros_like(row[:2]),
        swing=swing,
        since=jnp.zeros_like(row[:3]),
        landed=zero - jnp.inf,
        restless=no,
        count=none,
    )


def reading(worn: FootWorn, gyr: Values, acc: Values, measured: Flags) -> Values:
    """(7,) a sample as it is stored, see `FootWorn.samples`."""
    lost = jnp.where(measured, 0.0, 1.0).astype(jnp.asarray(gyr).dtype)
    return jnp.concatenate([jnp.asarray(gyr), jnp.asarray(acc) * worn.scale, lost[None]])


def level_prior(p: FootParams, worn: FootWorn, force: Values) -> Belief:
    """The belief of a foot that stands, with the tilt from the mean specific force (3,)."""
    up = force / jnp.sqrt(jnp.sum(force * force))
    zeros, ones = jnp.zeros_like(up[0]), jnp.ones_like(up[0])
    attitude = as_array(between(vector(up), Vector(zeros, zeros, ones)))
    foot: PyTree = SimpleNamespace(
        gyr=force, attitude=attitude, gyr_bias=worn.gyr_bias, acc_bias=worn.acc_bias * up, up=up,
        still_time=worn.still_time,
    )  # fmt: skip
    return prior_of(p, foot).joined()
