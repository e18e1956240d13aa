r"""Initial contacts read off the trunk's accelerations by a soft argmax: smooth, with settings that can be learned.

As the foot meets the ground the trunk is braked and thrown up: forward acceleration falls, upward acceleration rises,
both within some 40 ms. With a and v low-passed, and their rates of change over their own local root mean square, the
score of an instant u after a coarse one is

    s(u) = (w_v v̇(u) / |v̇| − w_a ȧ(u) / |ȧ|) / τ − (u − c)² / (2 σ²),   contact = coarse + Σ u e^s / Σ e^s − δ,

over |u| <= 0.2 s. It has no branch: given the coarse instants it is differentiable in the signals and in each setting.

Either acceleration alone errs more; what both reach on real walks is in `experiments/kose2011`.
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
"""[s] How far before and after the coarse instant a contact may lie."""

GRID = 0.01
"""[s] Between the instants that are weighed; the same at every sampling rate, which the result then hardly shows."""

WINDOW = 3.0
"""[s] Over which the local root mean squares are taken: several steps."""

LEAST = 1.0
"""[m/s³] Added in quadrature to the root mean squares, so that standing still has a score too."""


class Soft(NamedTuple):
    """Settings of the soft detector; all can be learned by gradient.

    Attributes:
        forward: weight of the fall of the forward acceleration, w_a [1].
        upward: weight of the rise of the upward acceleration, w_v [1].
        temperature: τ [1]; the smaller, the nearer to a maximum.
        centre: where contacts are looked for, after the coarse instant, c [s].
        width: how far about it, σ [s].
        offset: what is subtracted: by how much scores are late, δ [s].
        cutoff_hz: of the low-pass filter [Hz].
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
    """Minus the forward, and the upward acceleration's rate of change, low-passed, over their local root mean squares.

    Args:
        forward: (T,) acceleration [m/s²], finite.
        upward: (T,) acceleration without gravity [m/s²], finite.
        sampling_rate_hz: of the samples [Hz]; static.
        cutoff_hz: of the low-pass filter [Hz].
        mask: (T,) bool, False where a sample does not count for the root mean squares; None: all count.

    Returns:
        (T, 2) without unit.
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
    """The contact near each coarse instant.

    Args:
        forward: (T,) acceleration, without gravity [m/s²], finite.
        upward: (T,) acceleration, without gravity [m/s²], finite.
        sampling_rate_hz: of the samples [Hz]; static.
        coarse: (n,) instants, from the first sample on [s].
        settings: weights, window and offset.
        mask: (T,) bool, False where a sample does not count; None: all count.

    Returns:
        (n,) times from the first sample on [s].
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
