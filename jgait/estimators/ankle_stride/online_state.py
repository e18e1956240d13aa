"""State of the ankle's online estimator between samples, and its results after each sample."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import DTypeLike
from jaxtyping import PyTree

from jgait.estimators.ankle_stride.estimator import standing_prior
from jgait.estimators.ankle_stride.params import AnkleParams
from jgait.estimators.ankle_stride.readout import Heading
from jgait.estimators.ankle_stride.worn import Worn
from jgait.events import shank as shank_events
from jgait.events import shank_stance
from jgait.events import shank_stance_online as shank_valley
from jgait.filtering import Belief
from jgait.geometry.rotation import between
from jgait.geometry.vectors import Vector, vector
from jgait.signal import butterworth
from jgait.types import Counts, Flags, Strides, Values


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
    valley: shank_valley.StanceSearch  #: state of the search for the valley, see `events.shank_stance_online`.
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
    lost: Values  #: time without samples since the stride began [s].
    count: Counts  #: number of strides so far.
    distance: Values  #: way along them [m], see `sides.of_turns`.


class Now(NamedTuple):
    """Results after a sample."""

    stride: PyTree  #: bool, a stride has become known; `strides`, `stddev` and `flags` have a meaning only if True.
    strides: Strides  #: the stride, its fields scalars; times count from the first sample [s].
    stddev: Strides  #: standard deviations of the stride.
    #: the flags of `ankle_stride.readout.FLAGS` without "clipped", and "doubtful", see `trust.doubtful`.
    flags: dict[str, Any]
    count: Counts  #: number of strides so far.
    distance: Values  #: way along them [m], see `sides.of_turns`.
    stands: Flags  #: bool, the person stands still.
    valid: Flags  #: False if the filter's update failed numerically and the filter kept its prediction.


class Filters(NamedTuple):
    """Low-pass sections for the integrated signals, the stance rates and the sagittal rate."""

    signals: PyTree
    stance: PyTree
    sagittal: PyTree


def filters_of(p: AnkleParams, worn: Worn, dtype: DTypeLike) -> Filters:
    """The low-passes of the online estimator."""
    cutoffs = (p.cutoff_hz, shank_stance.CUTOFF_HZ, shank_events.LOBES.cutoff_hz)
    cascades = (butterworth.section(jnp.asarray(hz, dtype), worn.rate_hz) for hz in cutoffs)
    return Filters(*cascades)


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
        valley=shank_valley.begin(rates[1]),
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
        lost=zero,
        count=none,
        distance=zero,
    )


def level_prior(p: AnkleParams, worn: Worn, x: Values) -> Belief:
    """The belief of a leg that stands, with the tilt from the specific force."""
    ones, zeros = jnp.ones_like(x[0]), jnp.zeros_like(x[0])
    attitude = between(vector(x[3:]), Vector(zeros, zeros, ones))
    return standing_prior(p, worn, attitude, vector(x[:3])).joined()
