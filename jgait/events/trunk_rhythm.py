r"""Coarse instants of initial contacts, from the rhythm of the trunk's accelerations: decisions, without gradient.

The step frequency f at a moment is the frequency of the greatest autocorrelation of both accelerations over some
seconds. Both accelerations repeat with every stride, too; the sway to the sides, which a step reverses and a stride
repeats, distinguishes a step from a stride. Low-passed at 1.4 f, the upward acceleration v has its maximum, and the
forward acceleration a its steepest fall, some 25 ms after the contact; so coarse instants are the maxima of

    v − ȧ / (2π f)

whose rise from the minimum before and fall to the minimum after exceed a threshold. A smaller maximum also counts if it
follows another by about one step and no other is near: the closing step before standing. Walking has at least four in
a row.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jaxtyping import PyTree

from jgait.geometry.arrays import as_given, largest_so_far, of_jax, places, put, xp
from jgait.signal import butterworth
from jgait.signal import windows as signal
from jgait.types import AnyArray, Flags, Values

SLOWEST = 0.8
"""[Hz] Least step frequency of the search. Chosen by hand."""

CUTOFFS = np.array([0.5, *np.geomspace(1.1, 5.0, 6)])
"""[Hz] Cut-offs of the low-pass filters; a filter with a changing cut-off is interpolated between them. The outermost
are the band of walking."""


class Rhythm(NamedTuple):
    """Coarse instants, their step frequencies, and the low-passed forward acceleration."""

    valid: Flags  #: (capacity,) bool; False for a row without a contact.
    time: Values  #: (capacity,) instants in order, from the first sample on [s].
    frequency: Values  #: (capacity,) step frequency at the instant [Hz].
    forward: Values  #: (T,) forward acceleration, low-passed near the step frequency [m/s²].


def step_frequency(bank: AnyArray, sampling_rate_hz: float) -> AnyArray:
    """The step frequency (T,) [Hz] at every sample; where nobody walks, that of the walking near by.

    The lag l of the greatest r(l) w(l) is one step: r(l) is the mean of x_k x_{k+l} over 6 s, summed over the forward
    and the upward acceleration in the band between the outermost of `CUTOFFS`, w a Gaussian about 1.8 Hz over the
    logarithm of the frequency. It is a stride if the sway, the acceleration to the left, repeats after l and reverses
    after l / 2. The frequency is smoothed over time with the weights r(l). `bank` is low-passed at `CUTOFFS`: (number
    of cut-offs, T, 3), forward, upward and to the left [m/s²].
    """
    rate = sampling_rate_hz
    band = bank[-1] - bank[0]
    count, size, hop = band.shape[0], round(6.0 * rate), round(rate)
    middle = np.arange(0, count + hop - 1, hop)
    index = middle[:, None] + np.arange(size)[None, :] - size // 2
    inside = ((index >= 0) & (index < count))[..., None]
    frames = xp.where(inside, band[np.clip(index, 0, count - 1)], 0.0)
    fourier = jnp.fft if of_jax(frames) else np.fft
    power = xp.abs(fourier.rfft(frames, 2 * size, axis=1)) ** 2
    lags = np.arange(int(rate / 3.5), int(np.ceil(rate / SLOWEST)) + 1)
    terms = np.arange(size, size - lags[-1] - 2, -1)
    means = fourier.irfft(power, axis=1)[:, : len(terms)] / terms.astype(band.dtype)[None, :, None]
    mean, sway = means[..., :2].sum(axis=2), means[..., 2]
    usual = np.exp(-0.5 * (np.log2(rate / lags / 1.8) / 0.6) ** 2)
    at = lags[0] + xp.argmax(mean[:, lags] * usual.astype(band.dtype)[None, :], axis=1)
    row, half = np.arange(len(middle)), xp.maximum((at + 1) // 2, lags[0])
    is_stride = (sway[row, at] > 0.0) & (sway[row, half] < 0.0)
    at = xp.where(is_stride, half, at)
    before, here, after = (mean[row, at + k] for k in (-1, 0, 1))
    frequency = rate / (at.astype(band.dtype) + signal.vertex(before, here, after))
    weight = xp.maximum(here, 0.0) + np.finfo(band.dtype).tiny ** 0.5
    near = np.exp(-0.5 * (np.arange(-10, 11) / 2.5) ** 2).astype(band.dtype)  # [s] as the windows are
    smooth = xp.convolve(frequency * weight, near, "full") / xp.convolve(weight, near, "full")
    smooth = smooth[10 : 10 + len(middle)]
    return signal.between_samples(smooth, (np.arange(count) / hop).astype(band.dtype))


@jax.jit
def _maxima(values: Array, enough: Array) -> tuple[Array, Array]:
    """Maxima of values (T,) whose rise from the minimum before and fall to the minimum after exceed thresholds (T, n):
    (T, n) bool, a maximum is confirmed at this sample, and (T, n) the sample of that maximum.
    """

    def step(carry: PyTree, item: PyTree) -> PyTree:
        up, extreme, at = carry
        index, value, threshold = item
        further = jnp.where(up, value > extreme, value < extreme)
        extreme, at = jnp.where(further, value, extreme), jnp.where(further, index, at)
        turned = jnp.where(up, extreme - value, value - extreme) > threshold
        after = (up != turned, jnp.where(turned, value, extreme), jnp.where(turned, index, at))
        return after, (up & turned, at)

    indices = jnp.arange(values.shape[0])
    start = (jnp.zeros(enough.shape[1:], bool), jnp.full(enough.shape[1:], values[0]), jnp.zeros(enough.shape[1:], int))
    peaks: tuple[Array, Array] = lax.scan(step, start, (indices, values, enough))[1]
    return peaks


@jax.jit
def _closing(time: Array, frequency: Array, tall: Array, there: Array, coming: Array) -> Array:
    """Maxima that are tall, or follow a maximum by about one step."""

    def step(carry: PyTree, item: PyTree) -> PyTree:
        before, followed = carry
        t, f, high, some, ahead = item
        late, early = (t - before) * f, (ahead - t) * f  # [steps]
        follows = some & ~high & ~followed & (late < 1.6) & (jnp.minimum(late, early) > 0.65)
        keep = high | follows
        return (jnp.where(keep, t, before), jnp.where(keep, follows, followed)), keep

    start = (jnp.full_like(time[0], -jnp.inf), jnp.asarray(True))
    keep: Array = lax.scan(step, start, (time, frequency, tall, there, coming))[1]
    return keep


def _kept(time: AnyArray, frequency: AnyArray, tall: AnyArray, there: AnyArray) -> AnyArray:
    """Maxima that are tall, or follow a maximum by about one step; of these, the rows of at least four."""
    coming = -largest_so_far(xp.where(tall, -time, -xp.inf)[::-1])[::-1]
    keep = as_given(_closing(time, frequency, tall, there, coming), time)
    number, rows = xp.cumsum(keep.astype(np.int32)), time.shape[0]
    order = places(keep, rows)
    first = time[order[:1]]
    steps = xp.diff(time[order], prepend=first) * frequency[order]
    run = xp.cumsum(xp.where((steps > 2.5) & (order >= 0), 1, 0))  # [steps]
    length = put(np.zeros(rows + 1, np.int32), run, (order >= 0).astype(np.int32), "add")
    return keep & (length[run[xp.maximum(number - 1, 0)]] >= 4)


def contacts_nearby(
    forward: AnyArray, upward: AnyArray, leftward: AnyArray, sampling_rate_hz: float, capacity: int
) -> Rhythm:
    """Coarse instants of initial contacts, in (capacity,) rows; without walking no row is valid. The accelerations are
    (T,), upward without gravity [m/s²], finite, leftward 0 if unknown; further maxima are left out.
    """
    rate = sampling_rate_hz
    bank = butterworth.low_passed(xp.stack([forward, upward, leftward], axis=1), tuple(CUTOFFS), rate)
    along = step_frequency(bank, rate)
    # low-passed with a cut-off that changes slowly: interpolated between the two nearest filters, over its logarithm
    number = np.arange(len(CUTOFFS), dtype=bank.dtype)
    place = xp.interp(xp.log(1.4 * along), np.log(CUTOFFS).astype(bank.dtype), number).astype(bank.dtype)
    share = xp.maximum(0.0, 1.0 - xp.abs(place[None, :] - number[:, None]))
    slow = (bank * share[:, :, None]).sum(axis=0)
    slope = xp.gradient(slow[:, 0])
    shock = slow[:, 1] - slope * rate / (2.0 * np.pi * along)
    # least height of a maximum: absolute, and over the root mean square about it; F1 is 0.985 on `ipol_gait`
    size = min(signal.window_size(5.0, rate), 2 * (shock.shape[0] // 2) - 1)
    enough = xp.maximum(0.5, 0.9 * xp.sqrt(xp.maximum(signal.moving_mean(shock * shock, size), 0.0)))
    # a closing step, about one step after a tall maximum, needs half of that height
    thresholds = xp.stack([enough, 0.5 * enough], axis=1)
    confirmed, where = as_given(_maxima(shock, thresholds), shock, thresholds)
    sure, certain = confirmed.T
    tall = put(xp.zeros_like(shock, dtype=bool), xp.where(sure, where[:, 0], shock.shape[0]), True)
    row = places(certain, capacity)
    there, at = row >= 0, where[row, 1]
    sides = (xp.clip(at + k, 0, shock.shape[0] - 1) for k in (-1, 0, 1))
    time = (at.astype(shock.dtype) + signal.vertex(*(shock[k] for k in sides))) / rate
    frequency = along[at]
    kept = _kept(time, frequency, there & tall[at], there)
    return Rhythm(kept, time, frequency, slow[:, 0])
