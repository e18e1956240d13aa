r"""Initial contacts from the trunk's accelerations by a soft argmax: differentiable, with settings that can be learned.

At initial contact the trunk is braked and pushed up: the forward acceleration a falls, the upward acceleration v rises,
both within some 40 ms, and the blow of the foot reaches the trunk. With a and v low-passed, their rates of change and
the envelope b of what is faster than a step's motion, each divided by its local root mean square, the score of an
instant u after a coarse instant is

    s(u) = (w_v v̇(u) / |v̇| − w_a ȧ(u) / |ȧ| + w_b b(u) / |b|) / τ − (u − c)² / (2 σ²),
    contact = coarse + Σ u e^s / Σ e^s − δ − λ T,

over |u| <= 0.2 s, with the step time T: the longer a step, the later the foot is loaded. For given coarse instants the
contact is differentiable in the signals and in each setting.

Either acceleration alone has larger errors; the errors with both on real walks are in `experiments/kose2011`.
"""

from typing import NamedTuple

import numpy as np

from jgait.geometry.arrays import xp
from jgait.signal import butterworth
from jgait.signal import windows as signal
from jgait.types import AnyArray, Scalar, Values

SEARCHED_S = 0.2
"""[s] Longest time between the coarse instant and its contact, before or after."""

GRID = 0.01
"""[s] Time between the instants of the soft argmax; the same for every sampling rate, which then hardly matters."""

WINDOW = 3.0
"""[s] Window of the local root mean squares: several steps."""

SMALLEST_RMS = 1.0
"""[m/s³], [m/s²] Added in quadrature to the root mean squares, so that the score of standing still is finite."""

BLOW_HZ = 10.0
"""[Hz] Lower limit of the band of the impact of the foot."""


class Soft(NamedTuple):
    """Settings of the soft detector; all can be learned by gradient."""

    forward: Values = 1.0  #: weight of the fall of the forward acceleration, w_a [1].
    upward: Values = 1.0  #: weight of the rise of the upward acceleration, w_v [1].
    blow: Values = 1.0  #: weight of the envelope of the fast accelerations, w_b [1].
    temperature: Values = 0.6  #: τ [1]; with a smaller τ the soft argmax is nearer to the maximum.
    centre: Values = -0.035  #: centre of the search, after the coarse instant, c [s].
    width: Values = 0.03  #: standard deviation of the search about its centre, σ [s].
    offset: Values = -0.032  #: delay of the score, which is subtracted, δ [s].
    loading: Values = 0.095  #: delay as a share of the step time, which is subtracted too, λ [1].
    cutoff_hz: Values = 12.0  #: cut-off of the low-pass filter [Hz].


SOFT = Soft()
"""Equal weights; the centre is how late coarse instants are. `offset` and `loading` are those of 12 people of
`ipol_gait`; learned on 11 of them, they leave the twelfth a mean error of 15 ms. Cut-offs of 10 to 16 Hz, temperatures
of 0.3 to 0.9, widths of 25 to 35 ms change errors by less than 1 ms."""


def cues(
    forward: AnyArray, upward: AnyArray, sampling_rate_hz: float, cutoff_hz: Scalar, mask: AnyArray | None = None
) -> AnyArray:
    """Rates of change of −forward and of upward acceleration, low-passed, and the blow: (T, 3), each divided by its
    local root mean square.

    The accelerations are (T,), upward without gravity [m/s²], finite; where `mask` is False a sample does not count.
    """
    rate, both = sampling_rate_hz, xp.stack([-forward, upward], axis=1)
    slow, blunt = butterworth.low_passed(both, (cutoff_hz, BLOW_HZ), rate)
    slope = xp.gradient(slow, axis=0)
    fast = both - blunt
    blow = butterworth.low_pass_both_ways(xp.sqrt((fast * fast).sum(axis=1, keepdims=True) + 1e-6), cutoff_hz, rate)
    columns = xp.concatenate([slope * rate, blow], axis=1)
    size = min(signal.window_size(WINDOW, rate), 2 * (columns.shape[0] // 2) - 1)
    counts = xp.ones_like(columns[:, 0]) if mask is None else mask.astype(columns.dtype)
    counts = counts[:, None] * xp.ones_like(columns)
    weight = signal.moving_mean(counts, size)
    power = signal.moving_mean(columns * columns * counts, size) / xp.maximum(weight, 1.0 / size)
    return columns / xp.sqrt(power + SMALLEST_RMS**2)


def instants(
    forward: AnyArray, upward: AnyArray, sampling_rate_hz: float, coarse: AnyArray, step_frequency: AnyArray,
    settings: Soft = SOFT, mask: AnyArray | None = None,
) -> AnyArray:  # fmt: skip
    """The contact near each coarse instant: (n,) times from the first sample on [s].

    The accelerations are (T,), without gravity [m/s²], finite; where `mask` is False a sample does not count. Coarse
    instants [s] and step frequencies [Hz] are (n,).
    """
    score = cues(forward, upward, sampling_rate_hz, settings.cutoff_hz, mask)
    return located(score, sampling_rate_hz, coarse, step_frequency, settings)


def located(
    score: AnyArray, sampling_rate_hz: float, coarse: AnyArray, step_frequency: AnyArray, settings: Soft = SOFT
) -> AnyArray:
    """`instants` from `cues` (T, 3), whose cut-off has been applied."""
    about, last = xp.asarray(coarse, score.dtype), score.shape[0] - 1
    later = np.asarray(GRID * np.arange(-round(SEARCHED_S / GRID), round(SEARCHED_S / GRID) + 1), score.dtype)
    place = (about[:, None] + later[None, :]) * sampling_rate_hz
    cues_at = signal.between_samples(score, place)
    aside = (later - settings.centre) / settings.width
    weights = (settings.forward, settings.upward, settings.blow)
    logits = sum(weight * cues_at[..., k] for k, weight in enumerate(weights)) / settings.temperature
    logits = xp.where((place >= 0.0) & (place <= last), logits - 0.5 * (aside * aside)[None, :], -xp.inf)
    weight = xp.exp(logits - xp.max(logits, axis=1, keepdims=True))
    late = (weight * later[None, :]).sum(axis=1) / weight.sum(axis=1)
    step = 1.0 / xp.maximum(xp.asarray(step_frequency, score.dtype), 0.1)
    return about + late - settings.offset - settings.loading * step
