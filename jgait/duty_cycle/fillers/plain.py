"""The two simplest fillers of gaps: hold the last measured value, or repeat the last cycle.

Source: P. S. Udaya Shankar, N. Raveendranathan, N. R. Gans, R. Jafari, "Towards power optimized Kalman filter for gait
assessment using wearable sensors", Wireless Health 2010, section 5: `replicate`.

Deviations from the paper:
    1. The paper replicates "from the previous cycle" of its schedule, 1.4 s ago. Where 1.4 s is no stride period, the
       error is larger than that of a rate that is left at zero; so the stride period is estimated.
"""

from typing import Annotated, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array

from jgait.duty_cycle.fillers.base import PERIODS, Filled, Filler, Force, On, Rate, Thigh, finished, pushed, started
from jgait.duty_cycle.fillers.pace import measured_enough, pace
from jgait.params import Param, Parameter, documented, fixed, interval, ranges


class Hold(NamedTuple):
    """Parameters of `hold`: none."""


HOLD = Hold()


def hold(
    rate: Rate, usable: On, acc: Force | None, sampling_rate_hz: float, params: Hold = HOLD, *,
    thigh: Thigh | None = None,
) -> Filled:  # fmt: skip
    """The last measured value; a baseline for the other fillers.

    Every filled sample is flagged `HELD`. Arguments and errors: see `base`.
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

    With an accelerometer the stride period is also estimated during the gap. Arguments and errors: see `base`.
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


FILLERS = {
    "hold": Filler(hold, HOLD, HOLD),
    "replicate": Filler(replicate, REPLICATE, ranges(REPLICATE)),
}
