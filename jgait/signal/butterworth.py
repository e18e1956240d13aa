r"""Butterworth low-pass filters: causal, sample by sample, and without delay over a whole recording.

A cascade of second-order sections by the bilinear transform, prewarped so that the cut-off is exact. With
k = tan(π f_c / f_s) and each section's damping d,

    y_n = b (x_n + 2 x_{n−1} + x_{n−2}) − a_1 y_{n−1} − a_2 y_{n−2},
    b = k² / (1 + d k + k²),   a_1 = 2 (k² − 1) / (1 + d k + k²),   a_2 = (1 − d k + k²) / (1 + d k + k²).

Everything is JAX, usable under `jit` and `vmap`, along the first axis, and differentiable in the signal and in the
cut-off. `low_pass` is a `lax.scan` of `step`, so that a device which calls `step` at each sample has the same result.
"""

import math
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array, lax
from jaxtyping import Float

from jgait.types import AnyArray, Integer, Scalar, Values

UNROLL = 4
"""Samples per iteration of the scan [1]; chosen because one sample costs less than the overhead of an iteration."""


class FilterSection(NamedTuple):
    """One second-order low-pass, gain 1 at zero frequency: numerator b (1, 2, 1), denominator (1, a1, a2)."""

    b: Scalar
    a1: Scalar
    a2: Scalar


class SectionState(NamedTuple):
    """The two delayed values of a section in the transposed direct form II; each has the shape of a sample."""

    first: Values
    second: Values


def sections(cutoff_hz: Scalar, sampling_rate_hz: Scalar, order: int = 2) -> tuple[FilterSection, ...]:
    """The order/2 sections of a Butterworth low-pass, to be applied one after the other.

    The gain is 1/√2 at the cut-off [Hz], between 0 and half the sampling rate; orders are 2, 4, 6 ….

    Raises:
        ValueError: if the order is not even and positive, or a concrete cut-off is outside its range.
    """
    if order < 2 or order % 2:
        raise ValueError(f"order must be 2, 4, 6 …; got {order}")
    if all(isinstance(value, int | float) for value in (cutoff_hz, sampling_rate_hz)):
        low, high = float(cutoff_hz), float(sampling_rate_hz)
        if not 0.0 < low < 0.5 * high:
            raise ValueError(f"cutoff_hz must lie between 0 and half the sampling rate of {high:g} Hz; got {low:g}")
    k = jnp.tan(jnp.pi * jnp.asarray(cutoff_hz) / sampling_rate_hz)
    damped = [2.0 * math.sin(math.pi * (2 * number + 1) / (2 * order)) for number in range(order // 2)]
    return tuple(
        FilterSection(k * k / whole, 2.0 * (k * k - 1.0) / whole, (1.0 - d * k + k * k) / whole)
        for d, whole in ((d, 1.0 + d * k + k * k) for d in damped)
    )


def delay(cutoff_hz: Scalar, sampling_rate_hz: Scalar, order: int = 2) -> Scalar:
    """The delay of the causal filter for slow signals [s]: its group delay at zero frequency, Σ d / (2 f_s k)."""
    k = jnp.tan(jnp.pi * jnp.asarray(cutoff_hz) / sampling_rate_hz)
    damped = sum(2.0 * math.sin(math.pi * (2 * number + 1) / (2 * order)) for number in range(order // 2))
    return damped / (2.0 * sampling_rate_hz * k)


def at_rest(cascade: tuple[FilterSection, ...], sample: Values) -> tuple[SectionState, ...]:
    """The state of each section after a constant input (...) of infinite duration."""
    x = jnp.asarray(sample)
    return tuple(SectionState((1.0 - s.b) * x, (s.b - s.a2) * x) for s in cascade)


def step(
    cascade: tuple[FilterSection, ...], state: tuple[SectionState, ...], sample: Values
) -> tuple[tuple[SectionState, ...], Float[Array, "..."]]:
    """Filter one sample (...) of any unit: the next states of the sections, and the filtered sample."""
    value: Array = jnp.asarray(sample)
    after = []
    for section, before in zip(cascade, state, strict=True):
        come = section.b * value
        gone = come + before.first
        after.append(SectionState(2.0 * come - section.a1 * gone + before.second, come - section.a2 * gone))
        value = gone
    return tuple(after), value


def _filtered(
    cascade: tuple[FilterSection, ...], values: Float[Array, "time *rest"], *, reverse: bool = False
) -> Float[Array, "time *rest"]:
    typed = tuple(FilterSection(*(jnp.asarray(c, values.dtype) for c in section)) for section in cascade)
    start = at_rest(typed, values[-1] if reverse else values[0])
    return lax.scan(lambda s, x: step(typed, s, x), start, values, reverse=reverse, unroll=UNROLL)[1]


def _samples(x: AnyArray, least: int) -> Float[Array, "time *rest"]:
    values = jnp.asarray(x)
    if not jnp.issubdtype(values.dtype, jnp.floating):
        raise ValueError(f"x must be floating point; got {values.dtype}")
    if values.ndim == 0 or values.shape[0] < least:
        raise ValueError(f"x must have at least {least} samples along its first axis; got shape {values.shape}")
    return values


def low_pass(x: AnyArray, cutoff_hz: Scalar, sampling_rate_hz: Scalar, order: int = 2) -> Float[Array, "time *rest"]:
    """The causal filter over a recording; before the recording the signal is assumed constant at its first sample.

    `x` is (T, ...), floating point, any unit, finite; the result is delayed by `delay`.

    Raises:
        ValueError: as `sections`; if there is no sample, or they are not floating point.
    """
    return _filtered(sections(cutoff_hz, sampling_rate_hz, order), _samples(x, 1))


def low_pass_both_ways(
    x: AnyArray, cutoff_hz: Scalar, sampling_rate_hz: Scalar, order: int = 2
) -> Float[Array, "time *rest"]:
    """The filter forwards and then backwards: no delay, and the squared gain of one way, 1/2 at the cut-off [Hz].

    Both ends of the signal (T, ...), T > 3 (order + 1), are continued by a point reflection of 3 (order + 1) samples,
    as SciPy's `filtfilt` does.

    Raises:
        ValueError: as `low_pass`, or if there are too few samples.
    """
    cascade, more = sections(cutoff_hz, sampling_rate_hz, order), 3 * (order + 1)
    values = _samples(x, more + 1)
    before = 2.0 * values[:1] - values[more:0:-1]
    behind = 2.0 * values[-1:] - values[-2 : -more - 2 : -1]
    there = _filtered(cascade, jnp.concatenate([before, values, behind]))
    return _filtered(cascade, there, reverse=True)[more:-more]


def low_pass_until(
    x: AnyArray, cutoff_hz: Scalar, sampling_rate_hz: Scalar, last: Integer, order: int = 2
) -> Float[Array, "time *rest"]:
    """The filter forwards and then backwards over a recording, unchanged by the padding after its `last` sample.

    Before its first sample and after its last one the signal (T, ...) is assumed constant; for the backward filter,
    constant at the last output of the forward filter. The gain is 1/2 at the cut-off [Hz]. The padding has the response
    to the constant signal.

    Raises:
        ValueError: as `low_pass`.
    """
    cascade = sections(cutoff_hz, sampling_rate_hz, order)
    forth = _filtered(cascade, _samples(x, 1))
    inside = jnp.arange(forth.shape[0], dtype=jnp.int32) <= last
    inside = inside.reshape(inside.shape + (1,) * (forth.ndim - 1))
    return _filtered(cascade, jnp.where(inside, forth, forth[last][None]), reverse=True)
