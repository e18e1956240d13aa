r"""Butterworth low-pass filters: causal, sample by sample, and without delay over a whole recording.

A cascade of second-order sections by the bilinear transform, the cut-off where it was asked for. With
k = tan(π f_c / f_s) and each section's damping d,

    y_n = b (x_n + 2 x_{n−1} + x_{n−2}) − a_1 y_{n−1} − a_2 y_{n−2},
    b = k² / (1 + d k + k²),   a_1 = 2 (k² − 1) / (1 + d k + k²),   a_2 = (1 − d k + k²) / (1 + d k + k²).

Everything is JAX, usable under `jit` and `vmap`, along the first axis, and differentiable in the signal and in the
cut-off. `low_pass` is a `lax.scan` of `step`, so that a device which calls `step` at each sample has the same result.
"""

import math
from typing import Any, NamedTuple

import jax.numpy as jnp
from jax import Array, lax
from jax.typing import ArrayLike

UNROLL = 4
"""Samples a turn of the scan: the work on one is less than what a turn costs."""


class Section(NamedTuple):
    """One second-order low-pass, gain 1 at rest: b (1, 2, 1) over (1, a1, a2)."""

    b: Any
    a1: Any
    a2: Any


class SectionState(NamedTuple):
    """What a section remembers, in the transposed direct form II; each of a sample's shape."""

    first: Any
    second: Any


def sections(cutoff_hz: ArrayLike, sampling_rate_hz: ArrayLike, order: int = 2) -> tuple[Section, ...]:
    """The sections of a Butterworth low-pass.

    Args:
        cutoff_hz: where the gain is 1/√2 [Hz], between 0 and half the sampling rate.
        sampling_rate_hz: of the samples [Hz].
        order: 2, 4, 6 …; static.

    Returns:
        order/2 sections, to be applied one after the other.

    Raises:
        ValueError: if the order is not even and positive, or a concrete cut-off is outside its range.
    """
    if order < 2 or order % 2:
        raise ValueError(f"order must be 2, 4, 6 …; got {order}")
    if all(isinstance(value, int | float) for value in (cutoff_hz, sampling_rate_hz)):
        low, high = float(cutoff_hz), float(sampling_rate_hz)  # type: ignore[arg-type]
        if not 0.0 < low < 0.5 * high:
            raise ValueError(f"cutoff_hz must lie between 0 and half the sampling rate of {high:g} Hz; got {low:g}")
    k = jnp.tan(jnp.pi * jnp.asarray(cutoff_hz) / sampling_rate_hz)
    damped = [2.0 * math.sin(math.pi * (2 * number + 1) / (2 * order)) for number in range(order // 2)]
    return tuple(
        Section(k * k / whole, 2.0 * (k * k - 1.0) / whole, (1.0 - d * k + k * k) / whole)
        for d, whole in ((d, 1.0 + d * k + k * k) for d in damped)
    )


def delay(cutoff_hz: ArrayLike, sampling_rate_hz: ArrayLike, order: int = 2) -> Any:
    """How late slow signals leave the causal filter [s]: its group delay at zero frequency, Σ d / (2 f_s k)."""
    k = jnp.tan(jnp.pi * jnp.asarray(cutoff_hz) / sampling_rate_hz)
    damped = sum(2.0 * math.sin(math.pi * (2 * number + 1) / (2 * order)) for number in range(order // 2))
    return damped / (2.0 * sampling_rate_hz * k)


def at_rest(cascade: tuple[Section, ...], sample: ArrayLike) -> tuple[SectionState, ...]:
    """The state of sections that have seen one value for ever.

    Args:
        cascade: from `sections`.
        sample: (...) the value, any unit.

    Returns:
        One state a section.
    """
    x = jnp.asarray(sample)
    return tuple(SectionState((1.0 - s.b) * x, (s.b - s.a2) * x) for s in cascade)


def step(
    cascade: tuple[Section, ...], state: tuple[SectionState, ...], sample: ArrayLike
) -> tuple[tuple[SectionState, ...], Array]:
    """One sample through the filter.

    Args:
        cascade: from `sections`.
        state: from `at_rest` or the step before.
        sample: (...) any unit.

    Returns:
        The state to carry on, and the filtered sample.
    """
    value, after = jnp.asarray(sample), []
    for section, before in zip(cascade, state, strict=True):
        come = section.b * value
        gone = come + before.first
        after.append(SectionState(2.0 * come - section.a1 * gone + before.second, come - section.a2 * gone))
        value = gone
    return tuple(after), value


def _filtered(cascade: tuple[Section, ...], values: Array, *, reverse: bool = False) -> Array:
    typed = tuple(Section(*(jnp.asarray(c, values.dtype) for c in section)) for section in cascade)
    start = at_rest(typed, values[-1] if reverse else values[0])
    return lax.scan(lambda s, x: step(typed, s, x), start, values, reverse=reverse, unroll=UNROLL)[1]


def _samples(x: ArrayLike, least: int) -> Array:
    values = jnp.asarray(x)
    if not jnp.issubdtype(values.dtype, jnp.floating):
        raise ValueError(f"x must be floating point; got {values.dtype}")
    if values.ndim == 0 or values.shape[0] < least:
        raise ValueError(f"x must have at least {least} samples along its first axis; got shape {values.shape}")
    return values


def low_pass(x: ArrayLike, cutoff_hz: ArrayLike, sampling_rate_hz: ArrayLike, order: int = 2) -> Array:
    """The causal filter over a recording; before it the first sample is taken to have lasted for ever.

    Args:
        x: (T, ...) samples, floating point, any unit, finite.
        cutoff_hz: where the gain is 1/√2 [Hz].
        sampling_rate_hz: of the samples [Hz].
        order: 2, 4, 6 …; static.

    Returns:
        The same shape and unit, late by `delay`.

    Raises:
        ValueError: as `sections`; if there is no sample, or they are not floating point.
    """
    return _filtered(sections(cutoff_hz, sampling_rate_hz, order), _samples(x, 1))


def low_pass_both_ways(x: ArrayLike, cutoff_hz: ArrayLike, sampling_rate_hz: ArrayLike, order: int = 2) -> Array:
    """The filter forwards and then backwards: no delay, its gain squared.

    Both ends are continued by a point reflection of 3 (order + 1) samples, as SciPy's `filtfilt` does.

    Args:
        x: (T, ...) samples, floating point, any unit, finite; T > 3 (order + 1).
        cutoff_hz: where the gain of both ways together is 1/2 [Hz].
        sampling_rate_hz: of the samples [Hz].
        order: of one way: 2, 4, 6 …; static.

    Returns:
        The same shape and unit.

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
    x: ArrayLike, cutoff_hz: ArrayLike, sampling_rate_hz: ArrayLike, last: ArrayLike, order: int = 2
) -> Array:
    """The filter forwards and then backwards over a recording with padding behind it, which changes nothing.

    Before its first sample and behind its last one the recording is taken to have lasted for ever, on the way back as
    the filter left it.

    Args:
        x: (T, ...) samples, floating point, any unit, finite.
        cutoff_hz: where the gain of both ways together is 1/2 [Hz].
        sampling_rate_hz: of the samples [Hz].
        last: index of the last sample before the padding.
        order: of one way: 2, 4, 6 …; static.

    Returns:
        The same shape and unit; in the padding, what follows from the last sample.

    Raises:
        ValueError: as `low_pass`.
    """
    cascade = sections(cutoff_hz, sampling_rate_hz, order)
    forth = _filtered(cascade, _samples(x, 1))
    inside = jnp.arange(forth.shape[0], dtype=jnp.int32) <= last
    inside = inside.reshape(inside.shape + (1,) * (forth.ndim - 1))
    return _filtered(cascade, jnp.where(inside, forth, forth[last][None]), reverse=True)
