"""Shared parts of all fillers of gyroscope gaps: records, the check of the arguments, and the last stage of a filler.

Every filler has the same arguments and the same result,

    fill(rate, usable, acc, sampling_rate_hz, params, *, thigh=None) → Filled(rate, how, latency, unlike).

`rate` (T,) [rad/s] and `acc` (T, 3) [m/s²] are signals of the shank, `usable` (T,) is True where the gyroscope was on
and awake, `thigh` has the signals of a sensor on the thigh. A filler is causal, or reports its latency in samples. It
is a `lax.scan` over the samples with fixed shapes, so it works under `jit` and `vmap`, and it is differentiable in its
parameters. Measured samples are passed on unchanged. As long as fewer than `least_strides` strides were measured, the
last measured value is held and `how` is `HELD`; `how` is also `HELD` at samples for which `neighbours` finds nothing
similar, as in a turn or when a person stops. `check_signals` and `started` list the errors.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int, PyTree, Shaped

from jgait.types import AnyArray, Maybe

MEASURED, FILLED, HELD = 0, 1, 2
"""Origin of a sample: the gyroscope; the filler; neither, because too little or nothing similar was measured before."""

RATES = (25.0, 400.0)
"""[Hz] Least and greatest sampling rate that the fillers support."""

PERIODS = (0.7, 2.0)
"""[s] Range of stride periods."""

Rate = Float[AnyArray, "time"]
On = Bool[AnyArray, "time"]
Force = Float[AnyArray, "time 3"]


class Thigh(NamedTuple):
    """A sensor on the thigh that is always on: sagittal rate (T,) [rad/s], specific force (T, 3) [m/s²]."""

    rate: Rate
    acc: Force


class Filled(NamedTuple):
    """A rate without gaps."""

    rate: Float[AnyArray, "*batch time"]  #: (T,) sagittal rate [rad/s].
    how: Int[AnyArray, "*batch time"]  #: (T,) int, `MEASURED`, `FILLED` or `HELD`.
    latency: Int[AnyArray, "*batch"]  #: number of samples after which a value is known [samples]; 0: causal.
    #: (T,) how unlike the earlier samples are that a sample was filled from [1]: a factor on the variance of its error;
    #: 1: not known.
    unlike: Float[AnyArray, "*batch time"] | float = 1.0


class Filler(NamedTuple):
    """A method that fills gaps: its function, see the module, with default parameters and their transforms."""

    fill: Callable[..., Filled]
    params: PyTree
    transforms: PyTree
    needs_acc: bool = False


class Signals(NamedTuple):
    """The arguments of a filler, checked and of one floating type."""

    rate: Float[Array, "time"]  #: (T,) sagittal rate of the shank [rad/s]; 0 where the gyroscope was off.
    usable: Bool[Array, "time"]  #: (T,) bool, where the gyroscope was on and awake.
    acc: Maybe[Float[Array, "time 3"]]  #: (T, 3) specific force of the shank [m/s²], or None.
    thigh: Maybe[Thigh]  #: signals of the thigh, or None.


def check_signals(rate: Rate, usable: On, acc: Force | None, sampling_rate_hz: float, thigh: Thigh | None) -> Signals:
    """The arguments of a filler in one floating type; rates of a gyroscope that is off are 0. Raises ValueError if the
    sampling rate is outside `RATES`.
    """
    if not RATES[0] <= sampling_rate_hz <= RATES[1]:
        raise ValueError(f"the sampling rate must lie between {RATES[0]:g} and {RATES[1]:g} Hz; got {sampling_rate_hz}")
    dtype = jnp.asarray(rate).dtype
    values, force, above = jax.tree.map(lambda v: jnp.asarray(v).astype(dtype), (rate, acc, thigh))
    return Signals(jnp.where(usable, values, 0.0), jnp.asarray(usable), force, above)


def started[P](
    rate: Rate, usable: On, acc: Force | None, sampling_rate_hz: float, params: P, thigh: Thigh | None, *,
    needs_acc: bool = False,
) -> tuple[Signals, P]:  # fmt: skip
    """The first stage of every filler: its arguments, and its parameters in the same floating type. Raises ValueError
    as `check_signals`, or if the filler needs an accelerometer and there is none.
    """
    s = check_signals(rate, usable, acc, sampling_rate_hz, thigh)
    if needs_acc and s.acc is None:
        raise ValueError("this filler needs the signal of the accelerometer; acc is None")
    return s, jax.tree.map(lambda p: jnp.asarray(p).astype(s.rate.dtype), params)


def held(s: Signals) -> Float[Array, "time"]:
    """The last measured rate [rad/s]; 0 before the first measured rate."""

    def step(last: Array, sample: tuple[Array, Array]) -> tuple[Array, Array]:
        value = jnp.where(sample[1], sample[0], last)
        return value, value

    return lax.scan(step, jnp.zeros_like(s.rate[0]), (s.rate, s.usable))[1]


def finished(s: Signals, filled: Rate, enough: On, latency: int = 0) -> Filled:
    """Measured samples; filled samples where `enough` was measured before them; held samples elsewhere."""
    rate = jnp.where(s.usable, s.rate, jnp.where(enough, filled, held(s)))
    how = jnp.where(s.usable, MEASURED, jnp.where(enough, FILLED, HELD)).astype(jnp.int32)
    return Filled(rate, how, jnp.asarray(latency, jnp.int32))


def reversed_behind(values: Shaped[AnyArray, "time *rest"], size: int) -> Shaped[Array, "longer *rest"]:
    """The samples in reverse, with `size` zeros behind: `past` takes its slices from them."""
    return jnp.concatenate([jnp.asarray(values)[::-1], jnp.zeros((size, *values.shape[1:]), values.dtype)])


def past(
    behind: Shaped[Array, "longer *rest"], count: int, number: Int[Array, ""], lag: int, size: int
) -> Shaped[Array, "memory *rest"]:
    """`size` samples from `lag` before the sample `number` of `count` on, newest first; 0 before the first sample."""
    return lax.dynamic_slice_in_dim(behind, count - 1 - number + lag, size)


def pushed(register: Shaped[Array, "n *rest"], now: Shaped[Array, "*rest"]) -> Shaped[Array, "n *rest"]:
    """The register of the latest n samples, newest first, after one more sample; the oldest sample is dropped."""
    return jnp.concatenate([now[None], register[:-1]])
