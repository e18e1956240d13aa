r"""Initial contacts from the trunk's accelerations by a soft argmax: differentiable, with settings that can be learned.

At initial contact the trunk is braked and pushed up: the forward acceleration a falls, the upward acceleration v rises,
both within some 40 ms. With a and v low-passed, and their rates of change divided by the local root mean squares of
these rates, the score of an instant u after a coarse instant is

    s(u) = (w_v v̇(u) / |v̇| − w_a ȧ(u) / |ȧ|) / τ − (u − c)² / (2 σ²),   contact = coarse + Σ u e^s / Σ e^s − δ,

over |u| <= 0.2 s. For given coarse instants the contact is differentiable in the signals and in each setting.

Either acceleration alone has larger errors; the errors with both on real walks are in `experiments/kose2011`.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike
from jaxtyping import PyTree

from jgait.signal import butterworth
from jgait.signal import windows as signal
from jgait.types import Scalar, Values

REACH = 0.2
"""[s] Longest time between the coarse instant and its contact, before or after."""

GRID = 0.01
"""[s] Time between the instants of the soft argmax; the same for every sampling rate, which then hardly matters."""

WINDOW = 3.0
"""[s] Window of the local root mean squares: several steps."""

LEAST = 1.0
"""[m/s³] Added in quadrature to the root mean squares, so that the score of standing still is finite."""


class Soft(NamedTuple):
    """Settings of the soft detector; all can be learned by gradient.

    Attributes:
        forward: weight of the fall of the forward acceleration, w_a [1].
        upward: weight of the rise of the upward acceleration, w_v [1].
        temperature: τ [1]; with a smaller τ the soft argmax is nearer to the maximum.
        centre: centre of the search, after the coarse instant, c [s].
        width: standard deviation of the search about its centre, σ [s].
        offset: delay of the score, which is subtracted, δ [s].
        cutoff_hz: cut-off of the low-pass filter [Hz].
    """

    forward: Values = 1.0
    upward: Values = 1.0
    temperature: Values = 0.3
    centre: Values = 0.0
    width: Values = 0.05
    offset: Values = 0.01
    cutoff_hz: Values = 8.0


SOFT = Soft()
"""Equal weights. Cut-offs of 6 to 12 Hz, temperatures of 0.2 to 0.5, widths of 40 to 70 ms change errors by 2 ms."""


def rates_of_change(
    forward: ArrayLike, upward: ArrayLike, sampling_rate_hz: float, cutoff_hz: Scalar, mask: ArrayLike | None = None
) -> Array:
    """Rates of change of −forward and of upward acceleration, low-passed, divided by their local root mean squares: (T,
    2).

    The accelerations are (T,), upward without gravity [m/s²], finite; where `mask` is False a sample does not count.
    """
    both = jnp.stack([-jnp.asarray(forward), jnp.asarray(upward)], axis=1)
    smooth = butterworth.low_pass_both_ways(both, cutoff_hz, sampling_rate_hz)
    slope: PyTree = jnp.gradient(smooth, axis=0)
    rate: Array = slope * sampling_rate_hz
    size = min(signal.window_size(WINDOW, sampling_rate_hz), 2 * (rate.shape[0] // 2) - 1)
    counts = (
        jnp.ones_like(rate) if mask is None else jnp.asarray(mask).astype(rate.dtype)[:, None] * jnp.ones_like(rate)
    )
    weight = signal.moving_mean(counts, size)
    power = signal.moving_mean(rate * rate * counts, size) / jnp.maximum(weight, 1.0 / size)
    return rate / jnp.sqrt(power + LEAST**2)


def instants(
    forward: ArrayLike, upward: ArrayLike, sampling_rate_hz: float, coarse: ArrayLike, settings: Soft = SOFT,
    mask: ArrayLike | None = None,
) -> Array:  # fmt: skip
    """The contact near each coarse instant: (n,) times from the first sample on [s].

    The accelerations are (T,), without gravity [m/s²], finite; where `mask` is False a sample does not count.
    """
    score = rates_of_change(forward, upward, sampling_rate_hz, settings.cutoff_hz, mask)
    about, last = jnp.asarray(coarse, score.dtype), score.shape[0] - 1
    later = jnp.asarray(GRID * np.arange(-round(REACH / GRID), round(REACH / GRID) + 1), score.dtype)
    place = (about[:, None] + later[None, :]) * sampling_rate_hz
    low = jnp.clip(jnp.floor(place), 0, last - 1).astype(jnp.int32)
    share = jnp.clip(place - low.astype(score.dtype), 0.0, 1.0)
    seen = score[low] * (1.0 - share)[..., None] + score[low + 1] * share[..., None]
    aside = (later - settings.centre) / settings.width
    logits = (settings.forward * seen[..., 0] + settings.upward * seen[..., 1]) / settings.temperature
    logits = jnp.where((place >= 0.0) & (place <= last), logits - 0.5 * (aside * aside)[None, :], -jnp.inf)
    weight = jnp.exp(logits - jnp.max(logits, axis=1, keepdims=True))
    return about + (weight * later[None, :]).sum(axis=1) / weight.sum(axis=1) - settings.offset
