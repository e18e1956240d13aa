"""Strides sample by sample of a segment that rests once a stride, in constant memory; shared by foot and ankle.

A stance is known only after it. So the error-state filter runs a fixed lag behind the newest sample: a detector decides
on stances at the newest sample, and says what follows at the filter's sample. The filter, which is that of the
estimator without smoother, does not influence the decisions.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from jgait import filtering, quality
from jgait.estimators.checks import held_bridge
from jgait.filtering import Belief
from jgait.notes import record
from jgait.quality.evidence import of_stride
from jgait.signal.counted import scanned
from jgait.signal.marks import latest
from jgait.types import Counts, Flags, Strides, Values


class LaggedSample(NamedTuple):
    """The filter's sample, and what the detector decides there; leaves (T, …) over samples."""

    reading: Values  #: (6,) angular rate [rad/s] and specific force [m/s²].
    jumps: Values  #: (2,) largest changes of rate and force about it.
    upright: Values  #: (3,) specific force that gives the tilt if the filter starts here [m/s²].
    lost: Values  #: 1 where the sample was lost, else 0.
    lost_s: Values  #: time without samples since the last instant [s].
    stands: Flags  #: bool, zero velocity is observed.
    began: Flags  #: bool, the filter had started before the sample.
    instant: Flags  #: bool, the middle of a stance or standing: positions count from here.
    events: PyTree  #: what else the strides need.


class LaggedSignals(NamedTuple):
    """Signals of the filter, leaves (T, …), with the names of the signals over a whole recording."""

    gyr: Values  #: (3,) mean rate over the interval [rad/s].
    acc: Values  #: (3,) mean specific force [m/s²].
    rates: Values  #: (3,) rate at the sample [rad/s].
    gyr_jump: Values
    acc_jump: Values
    gyr_doubt: Values
    acc_doubt: Values
    restart: Values
    dt: Values
    rate_hz: Values
    gyr_bias: Values


@record
class LaggedState(NamedTuple):
    """State between samples; every field has a fixed size."""

    detector: PyTree  #: state of the detector; its `started` says whether the filter has started.
    belief: Belief  #: belief of the filter.
    heading: PyTree  #: heading at the last instant [rad], and its variance [rad²].
    since: Values  #: (2,) normalised innovations squared since then, summed, and the number of observations.
    highest: Values  #: largest height since then [m].
    before: Values  #: (6,) the last reading of the filter.
    restart: Values  #: 1 if it was an instant, so that positions count from there, else 0.


class LaggedNow(NamedTuple):
    """Results after each sample (T, …)."""

    stride: Flags  #: bool, a stride has become known; `strides`, `stddev` and `flags` have a meaning only if True.
    strides: Strides  #: the stride; times count from the first sample [s].
    stddev: Strides  #: its standard deviations.
    flags: dict[str, Values]  #: its flags, as of the estimator.
    stands: Flags  #: bool, zero velocity is observed at the filter's sample.
    instant: Flags  #: bool, positions count from the filter's sample on.


class LaggedMotion(NamedTuple):
    """The filter at each sample (T, …), since the last instant, as the strides need it."""

    posterior: filtering.Posterior
    here: PyTree  #: heading at the last instant, and its variance.
    there: PyTree  #: those at the sample.
    nis: Values  #: mean normalised innovation squared [1].
    highest: Values  #: largest height [m].


class Steps(NamedTuple):
    """What an estimator does with samples; p are its parameters, worn is the mounting of a sensor."""

    decide: Callable[..., PyTree]  #: (p, worn) → function of a detector and a sample: the next, and `LaggedSample`.
    prior: Callable[..., Belief]  #: (p, worn, reading (6,)) → belief of a segment that stands.
    #: (p, signals, stands (T,), belief before) → the filter's results.
    filtered: Callable[..., filtering.Posterior]
    heading: Callable[..., PyTree]  #: posterior → heading and its variance (T,).
    #: (p, worn, `LaggedSample`, `LaggedMotion`) → strides that would end at each sample, their deviations, and flags.
    strides: Callable[..., tuple[Strides, Strides, dict[str, Values]]]
    lost: tuple[tuple[float, float], tuple[float, float]]  #: errors over lost samples, see `checks.held_bridge`.


def begin(of: Steps, p: PyTree, worn: PyTree, detector: PyTree, reading: Values) -> LaggedState:
    """The state before the first sample, after a long time in which each reading equals the first (6,)."""
    belief = jax.tree.map(lambda leaf: jnp.asarray(leaf, reading.dtype), of.prior(p, worn, reading))
    zero = jnp.zeros_like(reading[0])
    return LaggedState(detector, belief, (zero, zero), jnp.zeros_like(reading[:2]), zero, reading, zero)


def over(
    of: Steps, p: PyTree, worn: PyTree, state: LaggedState, gyr: Values, acc: Values, measured: Flags | None = None,
    count: Counts | None = None,
) -> tuple[LaggedState, LaggedNow]:  # fmt: skip
    """The state after the samples (T,) that follow, and the results after each; for use in a compiled program.

    `gyr` (T, 3) [rad/s] and `acc` (T, 3) [m/s²] are in the sensor's axes; `measured` (T,) is False where a sample was
    lost, None: nowhere. Samples from `count` on are ignored.
    """
    samples = gyr.shape[0]
    there = jnp.ones(samples, bool) if measured is None else measured
    newest = samples - 1 if count is None else count - 1
    real = jnp.arange(samples, dtype=jnp.int32) <= newest
    detector, at = scanned(of.decide(p, worn), state.detector, (gyr, acc, there), count)
    first = jnp.argmax(real & ~at.began & at.stands)
    prior = of.prior(p, worn, jnp.concatenate([at.reading[first, :3], at.upright[first]]))
    belief = jax.tree.map(lambda old, new: jnp.where(state.detector.started, old, new), state.belief, prior)
    goes, turned, moved = held_bridge(at.lost, at.lost_s, 1.0 / worn.rate_hz, *of.lost)
    dt = jnp.where(real & at.began & goes, 1.0 / worn.rate_hz, 0.0)
    stands, instant = at.stands & real, at.instant & real
    before, restart = (
        jnp.concatenate([old[None], new[:-1]])
        for old, new in ((state.before, at.reading), (state.restart, instant.astype(dt.dtype)))
    )
    mean = 0.5 * (at.reading + before)
    signals = LaggedSignals(
        mean[:, :3], mean[:, 3:], at.reading[:, :3], at.jumps[:, 0], at.jumps[:, 1], turned, moved, restart, dt,
        worn.rate_hz, worn.gyr_bias,
    )  # fmt: skip
    posterior = of.filtered(p, signals, stands, belief)
    squares = jnp.stack([posterior.nis, posterior.count.astype(dt.dtype)], axis=1)
    used = stands & jnp.isfinite(posterior.nis)
    sums = state.since[None] + jnp.cumsum(jnp.where(used[:, None], squares, 0.0), axis=0)
    heading = of.heading(posterior)
    (here, begun), (last, ended) = latest((state.heading, jnp.zeros_like(state.since)), (heading, sums), instant)
    nis = (sums - begun)[:, 0] / jnp.maximum((sums - begun)[:, 1], 1.0)
    height = jnp.where(at.began | at.stands, posterior.mean.position[:, 2], 0.0)
    highest, climbed = scanned(_climbed, state.highest, (height, instant), count)
    strides, stddev, flags = of.strides(p, worn, at, LaggedMotion(posterior, here, heading, nis, climbed))
    after = LaggedState(
        detector, posterior.belief(newest), last, sums[-1] - ended, highest, at.reading[newest],
        instant[newest].astype(dt.dtype),
    )  # fmt: skip
    return after, LaggedNow(strides.valid & real, strides, stddev, flags, at.stands, at.instant)


def judged(estimator: str, strides: Strides, stddev: Strides, nis: Values) -> tuple[Strides, Strides, Flags]:
    """The strides, with deviations by the evidence of each stride itself, and whether they are in doubt."""
    evidence = of_stride(nis, strides.height, stddev.height)
    evidence["sensor_innovation"] = evidence["innovation"]  # that of the whole recording is not known yet
    p = quality.learned(estimator)
    times = quality.factor(p, evidence, stddev.length, strides.length)
    stddev = stddev._replace(length=times * stddev.length, speed=times * stddev.speed)
    return strides, stddev, quality.doubt(p, evidence) > quality.DOUBTFUL_FROM


def _climbed(highest: Values, sample: tuple[Values, Flags]) -> tuple[Values, Values]:
    height, instant = sample
    highest = jnp.maximum(highest, height)
    return jnp.where(instant, 0.0, highest), highest
