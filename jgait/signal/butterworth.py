r"""Butterworth low-pass filters of second order: causal, sample by sample, and without delay over a whole recording.

By the bilinear transform, prewarped so that the cut-off is exact. With k = tan(π f_c / f_s) and the damping d = √2,

    y_n = b (x_n + 2 x_{n−1} + x_{n−2}) − a_1 y_{n−1} − a_2 y_{n−2},
    b = k² / (1 + d k + k²),   a_1 = 2 (k² − 1) / (1 + d k + k²),   a_2 = (1 − d k + k²) / (1 + d k + k²).

Everything is usable under `jit` and `vmap`, along the first axis, and differentiable in the signal and in the cut-off.
`low_pass` is a `lax.scan` of `step`, so that a device which calls `step` at each sample has the same result; NumPy's
arrays are filtered on the host, where nothing is compiled.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jaxtyping import Float

from jgait.geometry.arrays import of_jax, xp
from jgait.signal.windows import samples
from jgait.types import AnyArray, Integer, Scalar, Values

DAMPING = math.sqrt(2.0)
"""[1] Damping of a Butterworth filter of second order."""


class FilterSection(NamedTuple):
    """A second-order low-pass, gain 1 at zero frequency: numerator b (1, 2, 1), denominator (1, a1, a2)."""

    b: Values
    a1: Values
    a2: Values


class SectionState(NamedTuple):
    """The two delayed values of the filter in the transposed direct form II; each has the shape of a sample."""

    first: Values
    second: Values


def section(cutoff_hz: Values, sampling_rate_hz: Scalar) -> FilterSection:
    """The coefficients of a filter whose gain is 1/√2 at the cut-off [Hz], between 0 and half the sampling rate.

    Raises:
        ValueError: if a concrete cut-off is outside its range.
    """
    if all(isinstance(value, int | float) for value in (cutoff_hz, sampling_rate_hz)):
        low, high = float(cutoff_hz), float(sampling_rate_hz)
        if not 0.0 < low < 0.5 * high:
            raise ValueError(f"cutoff_hz must lie between 0 and half the sampling rate of {high:g} Hz; got {low:g}")
    k = xp.tan(xp.pi * cutoff_hz / sampling_rate_hz)
    whole = 1.0 + DAMPING * k + k * k
    return FilterSection(k * k / whole, 2.0 * (k * k - 1.0) / whole, (1.0 - DAMPING * k + k * k) / whole)


def delay(cutoff_hz: Scalar, sampling_rate_hz: Scalar) -> Scalar:
    """The delay of the causal filter for slow signals [s]: its group delay at zero frequency, d / (2 f_s k)."""
    k = jnp.tan(jnp.pi * jnp.asarray(cutoff_hz) / sampling_rate_hz)
    return DAMPING / (2.0 * sampling_rate_hz * k)


def at_rest(s: FilterSection, sample: Values) -> SectionState:
    """The state after a constant input (...) of infinite duration."""
    x = jnp.asarray(sample)
    return SectionState((1.0 - s.b) * x, (s.b - s.a2) * x)


def step(s: FilterSection, before: SectionState, sample: Values) -> tuple[SectionState, Float[Array, "..."]]:
    """Filter one sample (...) of any unit: the next state, and the filtered sample."""
    come = s.b * jnp.asarray(sample)
    gone: Array = come + before.first
    return SectionState(2.0 * come - s.a1 * gone + before.second, come - s.a2 * gone), gone


def _filtered(
    s: FilterSection, values: Float[AnyArray, "time *rest"], *, reverse: bool = False
) -> Float[AnyArray, "time *rest"]:
    if not of_jax(values, *s):
        host = np.asarray(values)
        return _on_host(s, host[::-1])[::-1] if reverse else _on_host(s, host)
    # one array each for the coefficients and for the state: every array of a loop is a function more to compile
    numbers = jnp.stack([jnp.asarray(c, values.dtype) for c in s])
    typed = FilterSection(numbers[0], numbers[1], numbers[2])

    def advance(state: Array, x: Array) -> tuple[Array, Array]:
        after, gone = step(typed, SectionState(state[0], state[1]), x)
        return jnp.stack(after), gone

    start = jnp.stack(at_rest(typed, values[-1] if reverse else values[0]))
    return lax.scan(advance, start, jnp.asarray(values), reverse=reverse)[1]


def _on_host(s: FilterSection, values: np.ndarray) -> np.ndarray:
    """The filter over NumPy's array (T, ...): the difference equation as a banded triangular system."""
    from scipy.linalg.blas import dtbsv  # with SciPy's linear algebra, which takes a third of a second to import

    b, a1, a2 = (float(c) for c in s)
    x = np.asarray(values, float).reshape(len(values), -1)
    before = np.concatenate([x[:1], x[:1], x])
    right = b * (before[2:] + 2.0 * before[1:-1] + before[:-2])
    right[0] -= (a1 + a2) * x[0]
    right[1:2] -= a2 * x[0]
    bands = np.tile([[1.0], [a1], [a2]], len(x))
    y = np.stack([dtbsv(2, bands, column, lower=1, diag=1) for column in right.T], axis=1)
    return y.reshape(values.shape).astype(values.dtype)


def low_pass(x: AnyArray, cutoff_hz: Values, sampling_rate_hz: Scalar) -> Float[AnyArray, "time *rest"]:
    """The causal filter over a recording; before the recording the signal is assumed constant at its first sample.

    `x` is (T, ...), floating point, any unit, finite; the result is delayed by `delay`. The cut-off [Hz] is one number,
    or one for each column of JAX's array.

    Raises:
        ValueError: as `section`; if there is no sample, or they are not floating point.
    """
    return _filtered(section(cutoff_hz, sampling_rate_hz), samples(x))


def low_pass_both_ways(x: AnyArray, cutoff_hz: Scalar, sampling_rate_hz: Scalar) -> Float[AnyArray, "time *rest"]:
    """The filter forwards and then backwards: no delay, and the squared gain of one way, 1/2 at the cut-off [Hz].

    Both ends of the signal (T, ...), T > 9, are continued by a point reflection of 9 samples, three times the number of
    the filter's coefficients, as SciPy's `filtfilt` does.

    Raises:
        ValueError: as `low_pass`, or if there are too few samples.
    """
    s, values = section(cutoff_hz, sampling_rate_hz), samples(x, 10)
    before, behind = 2.0 * values[:1] - values[9:0:-1], 2.0 * values[-1:] - values[-2:-11:-1]
    there = _filtered(s, xp.concatenate([before, values, behind]))
    return _filtered(s, there, reverse=True)[9:-9]


def low_passed(
    x: AnyArray, cutoffs_hz: Sequence[Scalar], sampling_rate_hz: Scalar
) -> Float[AnyArray, "cutoff time *rest"]:
    """`low_pass_both_ways` at each of several cut-offs."""
    if not of_jax(x, *cutoffs_hz):
        return np.stack([low_pass_both_ways(x, float(corner), sampling_rate_hz) for corner in cutoffs_hz])
    corners = jnp.stack([jnp.asarray(corner, x.dtype) for corner in cutoffs_hz])
    return jax.vmap(lambda corner: low_pass_both_ways(x, corner, sampling_rate_hz))(corners)


def low_pass_until(
    x: AnyArray, cutoff_hz: Scalar, sampling_rate_hz: Scalar, last: Integer
) -> Float[AnyArray, "time *rest"]:
    """The filter forwards and then backwards over a recording, unchanged by the padding after its `last` sample.

    Before its first sample and after its last one the signal (T, ...) is assumed constant; for the backward filter,
    constant at the last output of the forward filter. The gain is 1/2 at the cut-off [Hz]. The padding has the response
    to the constant signal.

    Raises:
        ValueError: as `low_pass`.
    """
    s = section(cutoff_hz, sampling_rate_hz)
    forth = _filtered(s, samples(x))
    inside = np.arange(forth.shape[0], dtype=np.int32) <= last
    inside = inside.reshape(inside.shape + (1,) * (forth.ndim - 1))
    return _filtered(s, xp.where(inside, forth, forth[last][None]), reverse=True)
