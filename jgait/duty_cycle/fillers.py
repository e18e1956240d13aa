r"""Fillers of a gyroscope's gaps: hold the last value, repeat the last cycle, or average alike moments.

`neighbours`, the default: rates measured after similar accelerometer histories. Two samples are similar if their recent
histories are. With scales s, the sample j before the present sample t and a memory ρ = exp(−1/(τ f_s)) of the history,

    c_{t,j} = ‖a_t − a_{t−j}‖² / s_a²  (+ the same of the thigh's signals)
    d_{t,j} = c_{t,j} + ρ d_{t−1,j},   n_{t,j} = 1 + ρ n_{t−1,j}                  (0 before the first sample)
    q_{t,j} = d_{t,j} / n_{t,j} + κ (1 − (1 − ρ) n_{t,j})                         (a short history is worth less)
    w_{t,j} = softmax_j (−(q_{t,j} − min q) / (2 h² (min q + ε)))  over the samples j at which the gyroscope was on
    ω̂_t    = Σ_j w_{t,j} ω_{t−j}

The lag j stays the same while both histories advance, so each sample costs one pass over the memory. Only earlier rates
are used. The accelerometer's axes share one scale: an axis with little movement carries little information, and a
separate scale for each axis, which enlarges the noise of that axis, makes the error a quarter larger.

Source: P. S. Udaya Shankar, N. Raveendranathan, N. R. Gans, R. Jafari, "Towards power optimized Kalman filter for gait
assessment using wearable sensors", Wireless Health 2010, section 5: `replicate`.

Deviations from the paper:
    1. The paper replicates "from the previous cycle" of its schedule, 1.4 s ago. Where 1.4 s is no stride period, the
       error is larger than that of a rate that is left at zero; so the stride period is estimated.
"""

from functools import partial
from typing import Annotated, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, PyTree, Shaped

from jgait.duty_cycle.filling import (
    FILLED,
    HELD,
    PERIODS,
    Filled,
    Filler,
    Force,
    On,
    Rate,
    Signals,
    Thigh,
    filled_once_enough,
    finished,
    measured_enough,
    pace,
    past,
    pushed,
    reversed_behind,
    started,
)
from jgait.params import Param, Parameter, documented, fixed, interval, positive, ranges
from jgait.types import Scalar

FURTHEST = 1.0
"""[1] Greatest distance of the nearest history, over the number of compared signals; a sample without a nearer one is
`HELD`. On walks of `neura_sparse` and simulated ones with U-turns and a sensor on the thigh, rates of shanks that are
filled at distances of 0.1, 0.2, 0.5 and above 1 have errors of 0.2, 0.4, 0.7 and 2.1 rad/s (RMS); the last is as
large as the rate itself."""

MEMORY_S = 90.0
"""[s] Longest time before a sample in which the filler searches neighbours."""


class Hold(NamedTuple):
    """Parameters of `hold`: none."""


HOLD = Hold()


def hold(
    rate: Rate, usable: On, acc: Force | None, sampling_rate_hz: float, params: Hold = HOLD, *,
    thigh: Thigh | None = None,
) -> Filled:  # fmt: skip
    """The last measured value; a baseline for the other fillers.

    Every filled sample is flagged `HELD`. Arguments and errors: see `filling`.
    """
    s, _ = started(rate, usable, acc, sampling_rate_hz, params, thigh)
    return finished(s, s.rate, jnp.zeros_like(s.usable))


@documented
class Replicate(NamedTuple):
    """Parameters of `replicate`."""

    stretch: Annotated[Param, Parameter(
        interval(0.8, 1.25), "1", "lag of the replica over the estimated stride period",
    )] = 1.0  # fmt: skip
    least_strides: Annotated[Param, Parameter(
        fixed, "strides", "strides that must be measured before samples are filled rather than held",
    )] = 2.0  # fmt: skip


REPLICATE = Replicate()


def replicate(
    rate: Rate, usable: On, acc: Force | None, sampling_rate_hz: float,
    params: Replicate = REPLICATE, *, thigh: Thigh | None = None,
) -> Filled:  # fmt: skip
    """The last cycle repeated: ω̂_t = ω̂_{t − P}, P the stride period estimated from the samples up to t.

    With an accelerometer the stride period is also estimated during the gap. Arguments and errors: see `filling`.
    """
    s, p = started(rate, usable, acc, sampling_rate_hz, params, thigh)
    stride = pace(s, sampling_rate_hz)
    enough = measured_enough(stride, p.least_strides)
    length = int(np.ceil(1.25 * PERIODS[1] * sampling_rate_hz)) + 2

    def step(
        carry: tuple[Array, Array], sample: tuple[Array, Array, Array, Array]
    ) -> tuple[tuple[Array, Array], Array]:
        register, last = carry
        value, on, period, trusted = sample
        back = jnp.clip(p.stretch * period * sampling_rate_hz - 1.0, 0.0, length - 2.0)
        low = jnp.floor(lax.stop_gradient(back)).astype(jnp.int32)
        share = back - low.astype(back.dtype)
        again = (1.0 - share) * register[low] + share * register[low + 1]
        value = jnp.where(on, value, jnp.where(trusted, again, last))
        return (pushed(register, value), jnp.where(on, value, last)), value

    start = (jnp.zeros(length, s.rate.dtype), jnp.zeros_like(s.rate[0]))
    return finished(s, lax.scan(step, start, (s.rate, s.usable, stride.period, enough))[1], enough)


@documented
class Neighbours(NamedTuple):
    """Parameters of `neighbours`."""

    history_s: Annotated[Param, Parameter(positive, "s", "time constant τ of the compared histories")] = 0.1
    bandwidth: Annotated[Param, Parameter(
        positive, "1", "h, width of the kernel over the distance of the nearest neighbour",
    )] = 0.4  # fmt: skip
    floor: Annotated[Param, Parameter(positive, "1", "ε, distance below which neighbours are equally near")] = 1e-3
    short: Annotated[Param, Parameter(positive, "1", "κ, added to the distance of a history of one sample")] = 0.4
    acc_scale: Annotated[Param, Parameter(positive, "m/s²", "s_a of the shank's accelerometer")] = 6.0
    thigh_rate_scale: Annotated[Param, Parameter(positive, "rad/s", "of the thigh's gyroscope")] = 1.0
    thigh_acc_scale: Annotated[Param, Parameter(positive, "m/s²", "of the thigh's accelerometer")] = 3.0
    least_strides: Annotated[Param, Parameter(
        fixed, "strides", "strides that must be measured before samples are filled rather than held",
    )] = 2.0  # fmt: skip


NEIGHBOURS = Neighbours()


def nearest(alike: Float[Array, "memory"], usable: Bool[Array, "memory"]) -> Float[Array, ""]:
    """The least distance of a lag with a measured rate, 1 if there is none."""
    return jnp.where(usable.any(), jnp.min(jnp.where(usable, alike, jnp.inf)), 1.0)


def mean_rate(
    p: Neighbours, alike: Float[Array, "memory"], nearest: Scalar, rate: Float[Array, "memory"],
    usable: Bool[Array, "memory"],
) -> Float[Array, ""]:  # fmt: skip
    """The weighted mean of the measured rates, from their distances and the least of these; 0 without any."""
    further = jnp.where(usable, alike - nearest, 0.0)
    kernel = jnp.where(usable, jnp.exp(-0.5 * further / (p.bandwidth**2 * (nearest + p.floor))), 0.0)
    total = kernel.sum()
    return (kernel * rate).sum() / jnp.where(total > 0.0, total, 1.0)


def scaled(s: Signals, p: PyTree) -> Float[Array, "time channel"]:
    """The signals of all sensors over their scales [1]; `p` has the scales, as `Neighbours`."""
    parts = [s.acc / p.acc_scale]
    if s.thigh is not None:
        parts += [s.thigh.rate[:, None] / p.thigh_rate_scale, s.thigh.acc / p.thigh_acc_scale]
    return jnp.concatenate(parts, axis=1)


def neighbours(
    rate: Rate, usable: On, acc: Force | None, sampling_rate_hz: float,
    params: Neighbours = NEIGHBOURS, *, thigh: Thigh | None = None,
) -> Filled:  # fmt: skip
    """Earlier measured rates, weighted by the similarity of the accelerometer's histories; causal.

    Arguments and errors: see `filling`; an accelerometer is needed.
    """
    s, p = started(rate, usable, acc, sampling_rate_hz, params, thigh, needs_acc=True)
    return _filled(s, p, sampling_rate_hz)


@partial(jax.jit, static_argnames="sampling_rate_hz")
def _filled(s: Signals, p: Neighbours, sampling_rate_hz: float) -> Filled:
    rate, distance = _predicted(s, p, sampling_rate_hz)
    unlike = distance / (1 if s.thigh is None else 3)  # with the thigh's gyroscope and accelerometer
    filled = filled_once_enough(s, rate, sampling_rate_hz, p.least_strides)._replace(unlike=unlike)
    nothing_alike = (filled.how == FILLED) & (unlike > FURTHEST)
    return filled._replace(how=jnp.where(nothing_alike, HELD, filled.how))


def _predicted(s: Signals, p: Neighbours, sampling_rate_hz: float) -> tuple[Float[Array, "time"], Float[Array, "time"]]:
    """The weighted mean of the neighbours [rad/s], 0 without any, and the least distance, where the gyroscope is off.

    The memory is not moved by each sample: it is a slice of the recording in reverse. Without a gap in what follows,
    distances are not computed.
    """
    compared = scaled(s, p)
    count, size = len(s.rate), min(len(s.rate), round(MEMORY_S * sampling_rate_hz))
    keep = jnp.exp(-1.0 / (p.history_s * sampling_rate_hz)).astype(s.rate.dtype)
    weights = lax.scan(lambda w, _: (1.0 + keep * w,) * 2, jnp.zeros_like(keep), length=count)[1]
    short = p.short * (1.0 - (1.0 - keep) * weights)

    known = [reversed_behind(values, size) for values in (s.rate, s.usable, weights, short)]
    signals = [reversed_behind(values, size) for values in compared.T]
    lags = jnp.arange(size, dtype=jnp.int32)
    later = lax.cummax((~s.usable).astype(jnp.int32), reverse=True) > 0

    def fill_sample(distance: Array, sample: tuple[Array, ...]) -> tuple[Array, tuple[Array, Array]]:
        number, now, off, any_later = sample

        def before(values: Shaped[Array, "longer"]) -> Shaped[Array, "memory"]:
            return past(values, count, number, 1, size)

        def further(distance: Array) -> Array:
            apart = sum((value - before(signal)) ** 2 for value, signal in zip(now, signals, strict=True))
            return jnp.where(lags < number, apart, 0.0) + keep * distance

        def filled(distance: Array) -> tuple[Array, Array]:
            rate, usable, weight, added = map(before, known)
            alike = distance / jnp.where(lags < number, weight, 1.0) + added
            least = nearest(alike, usable)
            return mean_rate(p, alike, least, rate, usable), least

        distance = lax.cond(any_later, further, lambda d: d, distance)
        return distance, lax.cond(off, filled, lambda d: (jnp.zeros_like(d[0]),) * 2, distance)

    samples = (jnp.arange(count, dtype=jnp.int32), compared, ~s.usable, later)
    return lax.scan(fill_sample, jnp.zeros(size, s.rate.dtype), samples)[1]


FILLERS = {
    "hold": Filler(hold, HOLD, HOLD),
    "replicate": Filler(replicate, REPLICATE, ranges(REPLICATE)),
    "neighbours": Filler(neighbours, NEIGHBOURS, ranges(NEIGHBOURS), needs_acc=True),
}
"""Name → filler of gyroscope gaps."""
