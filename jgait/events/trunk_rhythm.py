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
from jax.typing import ArrayLike
from jaxtyping import PyTree

from jgait.signal import butterworth
from jgait.signal import windows as signal
from jgait.types import Flags, Values

FRAME, HOP, MEMORY = 6.0, 1.0, 2.5
"""[s] Window of a step frequency, time between windows, standard deviation of the Gaussian that smooths over time."""

SLOWEST, FASTEST = 0.8, 3.5
"""[Hz] Least and greatest step frequency of the search."""

USUAL, OCTAVES = 1.8, 0.6
"""[Hz], [octaves] Centre and width of the Gaussian weight that separates a step from a stride or half a step."""

AS_WELL = 0.2
"""[1] Ratio of the autocorrelation at half a lag to that at the lag above which the sway decides which of the two is a
step. Symmetric walks have nearly 1. At a lower ratio, as in limping, the whole lag is kept. Chosen low."""

CUTOFFS = np.array([0.5, *np.geomspace(1.1, 5.0, 6)])
"""[Hz] Cut-offs of the low-pass filters; a filter with a changing cut-off is interpolated between them."""

WINDOW, WIDE = 5.0, 20.0
"""[s] Windows of the root mean squares with which the height of a maximum is compared: one about the maximum, and a
wide one that still contains the walking when the person has just stopped."""

NEAREST, FURTHEST = 0.65, 1.6
"""[steps] Least and greatest time from a contact to a closing step; the least also from it to the next contact."""

CUTOFF = 1.4
"""[1] Cut-off of the low-pass filter, over the step frequency.

With this and the next six, F1 is 0.985 on 36 walks of `ipol_gait`, and 0.982 to 0.984 with windows of 10 to 20 s in the
place of both. On three straight walks of `mobgap_lab` it is 1.
"""

LEAST, SHARE, FLOOR = 0.5, 0.9, 0.5
"""Least height of a maximum above the minima beside it: [m/s²] absolute, and [1] over the root mean squares of `WINDOW`
and of `WIDE`."""

WEAK = 0.5
"""[1] Share of the least height that a closing step, about one step after a tall maximum, needs."""

IN_A_ROW, APART = 4, 2.5
"""Least number of contacts in a row that count as walking; [steps] longest time between two contacts in a row."""


class Rhythm(NamedTuple):
    """Coarse instants, their step frequencies, and the low-passed forward acceleration."""

    valid: Flags  #: (capacity,) bool; False for a row without a contact.
    time: Values  #: (capacity,) instants in order, from the first sample on [s].
    frequency: Values  #: (capacity,) step frequency at the instant [Hz].
    forward: Values  #: (T,) forward acceleration, low-passed near the step frequency [m/s²].


def step_frequency(bank: ArrayLike, sampling_rate_hz: float) -> Array:
    """The step frequency (T,) [Hz] at every sample; where nobody walks, that of the walking near by.

    The lag l of the greatest r(l) w(l) is one step: r(l) is the mean of x_k x_{k+l} over `FRAME`, summed over the
    forward and the upward acceleration in the band between the outermost of `CUTOFFS`, w a Gaussian about `USUAL` over
    the logarithm of the frequency. It is a stride, and l / 2 a step, if the sway, the acceleration to the left, repeats
    after l and reverses after l / 2, and r(l / 2) is large enough (`AS_WELL`). The frequency is then smoothed over time
    with the weights r(l). `bank` is from `low_passed`: (number of cut-offs, T, 3), forward, upward and to the left
    [m/s²]; the last is 0 if unknown.
    """
    rate = sampling_rate_hz
    filters = jnp.asarray(bank)
    band = filters[-1] - filters[0]
    count, size = band.shape[0], round(FRAME * rate)
    hop = round(HOP * rate)
    middle = np.arange(0, count + hop - 1, hop)
    index = middle[:, None] + np.arange(size)[None, :] - size // 2
    inside = jnp.asarray((index >= 0) & (index < count))[..., None]
    frames = jnp.where(inside, band[np.clip(index, 0, count - 1)], 0.0)
    power = jnp.abs(jnp.fft.rfft(frames, 2 * size, axis=1)) ** 2
    lags = np.arange(int(rate / FASTEST), int(np.ceil(rate / SLOWEST)) + 1)
    terms = np.arange(size, size - lags[-1] - 2, -1)
    means = jnp.fft.irfft(power, axis=1)[:, : len(terms)] / jnp.asarray(terms, band.dtype)[None, :, None]
    mean, sway = means[..., :2].sum(axis=2), means[..., 2]
    usual = np.exp(-0.5 * (np.log2(rate / lags / USUAL) / OCTAVES) ** 2)
    at = lags[0] + jnp.argmax(mean[:, lags] * jnp.asarray(usual, band.dtype)[None, :], axis=1)
    row, half = np.arange(len(middle)), jnp.maximum((at + 1) // 2, lags[0])
    is_stride = (sway[row, at] > 0.0) & (sway[row, half] < 0.0) & (mean[row, half] > AS_WELL * mean[row, at])
    at = jnp.where(is_stride, half, at)
    before, here, after = (mean[row, at + k] for k in (-1, 0, 1))
    frequency = rate / (at.astype(band.dtype) + signal.vertex(before, here, after))
    weight = jnp.maximum(here, 0.0) + jnp.finfo(band.dtype).tiny ** 0.5
    reach = int(np.ceil(4.0 * MEMORY / HOP))
    near = jnp.asarray(np.exp(-0.5 * (HOP * np.arange(-reach, reach + 1) / MEMORY) ** 2), band.dtype)
    smooth = jnp.convolve(frequency * weight, near, "full") / jnp.convolve(weight, near, "full")
    smooth = smooth[reach : reach + len(middle)]
    return signal.between_samples(smooth, jnp.asarray(np.arange(count) / hop, band.dtype))


def low_passed(x: ArrayLike, sampling_rate_hz: float) -> Array:
    """A signal (T, ...) low-passed without delay at each of `CUTOFFS`: (number of cut-offs, T, ...)."""
    values = jnp.asarray(x)
    corners = jnp.asarray(CUTOFFS, values.dtype)
    return jax.vmap(lambda c: jnp.asarray(butterworth.low_pass_both_ways(values, c, sampling_rate_hz)))(corners)


def between(bank: ArrayLike, cutoff_hz: ArrayLike) -> Array:
    """The signal (T, ...) low-passed with a cut-off (T,) [Hz] that changes slowly, from the `bank` of `low_passed`.

    It is interpolated between the two nearest filters, over the logarithm of the cut-off, within `CUTOFFS`.
    """
    filters = jnp.asarray(bank)
    number = jnp.arange(len(CUTOFFS), dtype=filters.dtype)
    place = jnp.interp(jnp.log(jnp.asarray(cutoff_hz)), jnp.asarray(np.log(CUTOFFS), filters.dtype), number)
    share = jnp.maximum(0.0, 1.0 - jnp.abs(place[None, :] - number[:, None]))
    return (filters * share.reshape(*share.shape, *[1] * (filters.ndim - 2))).sum(axis=0)


def maxima(x: ArrayLike, enough: ArrayLike) -> tuple[Array, Array]:
    """Maxima of x (T,) whose rise from the minimum before and fall to the minimum after exceed a threshold (T,).

    Returns:
        (T,) bool, a maximum is confirmed at this sample, and (T,) the sample of that maximum [samples].
    """
    values = jnp.asarray(x)

    def step(carry: PyTree, item: PyTree) -> PyTree:
        up, extreme, at = carry
        index, value, least = item
        further = jnp.where(up, value > extreme, value < extreme)
        extreme, at = jnp.where(further, value, extreme), jnp.where(further, index, at)
        turned = jnp.where(up, extreme - value, value - extreme) > least
        after = (up != turned, jnp.where(turned, value, extreme), jnp.where(turned, index, at))
        return after, (up & turned, at)

    indices = jnp.arange(values.shape[0])
    start = (jnp.asarray(False), values[0], indices[0])
    peaks: tuple[Array, Array] = lax.scan(step, start, (indices, values, jnp.asarray(enough)))[1]
    return peaks


def _kept(time: Array, frequency: Array, tall: Array, there: Array) -> Array:
    """Maxima that are tall, or follow a maximum by about one step; of these, the rows of at least `IN_A_ROW`."""
    coming = lax.cummin(jnp.where(tall, time, jnp.inf), reverse=True)

    def step(carry: PyTree, item: PyTree) -> PyTree:
        before, followed = carry
        t, f, high, some, ahead = item
        late = (t - before) * f
        follows = some & ~high & ~followed & (late > NEAREST) & (late < FURTHEST) & ((ahead - t) * f > NEAREST)
        keep = high | follows
        return (jnp.where(keep, t, before), jnp.where(keep, follows, followed)), keep

    start = (jnp.full_like(time[0], -jnp.inf), jnp.asarray(True))
    keep = lax.scan(step, start, (time, frequency, tall, there, coming))[1]
    number, rows = jnp.cumsum(keep.astype(jnp.int32)), time.shape[0]
    order = jnp.nonzero(keep, size=rows, fill_value=-1)[0]
    steps = jnp.diff(time[order], prepend=time[order[:1]]) * frequency[order]
    run = jnp.cumsum(jnp.where((steps > APART) & (order >= 0), 1, 0))
    length = jax.ops.segment_sum((order >= 0).astype(jnp.int32), run, rows + 1)
    return keep & (length[run[jnp.maximum(number - 1, 0)]] >= IN_A_ROW)


def contacts_nearby(
    forward: ArrayLike, upward: ArrayLike, leftward: ArrayLike, sampling_rate_hz: float, capacity: int
) -> Rhythm:
    """Coarse instants of initial contacts, in (capacity,) rows; without walking no row is valid.

    The accelerations are (T,), upward without gravity [m/s²], finite, leftward 0 if unknown; further maxima are left
    out.
    """
    rate = sampling_rate_hz
    bank = low_passed(jnp.stack([jnp.asarray(x) for x in (forward, upward, leftward)], axis=1), rate)
    along = step_frequency(bank, rate)
    slow = between(bank, CUTOFF * along)
    slope: PyTree = jnp.gradient(slow[:, 0])
    shock = slow[:, 1] - slope * rate / (2.0 * jnp.pi * along)
    enough = jnp.zeros_like(shock) + LEAST
    for window, share in ((WINDOW, SHARE), (WIDE, FLOOR)):
        size = min(signal.window_size(window, rate), 2 * (shock.shape[0] // 2) - 1)
        enough = jnp.maximum(enough, share * jnp.sqrt(jnp.maximum(signal.moving_mean(shock * shock, size), 0.0)))
    (sure, certain), (peak, where) = jax.vmap(maxima, (None, 0))(shock, jnp.stack([enough, WEAK * enough]))
    tall = jnp.zeros_like(shock, dtype=bool).at[jnp.where(sure, peak, shock.shape[0])].set(True, mode="drop")
    row = jnp.nonzero(certain, size=capacity, fill_value=-1)[0]
    there, at = row >= 0, where[row]
    sides = (jnp.clip(at + k, 0, shock.shape[0] - 1) for k in (-1, 0, 1))
    time = (at.astype(shock.dtype) + signal.vertex(*(shock[k] for k in sides))) / rate
    frequency = along[at]
    kept = _kept(time, frequency, there & tall[at], there)
    return Rhythm(kept, time, frequency, slow[:, 0])
