r"""A count of strides that has a slope: thresholds of the detector of swings tuned by gradient against counts.

Every negative lobe of the rate counts for a part of a stride, the more the faster and the farther the shank swings,

    n = Σ_k σ((peak_k − threshold) / w_rate) σ((angle_k − least_angle) / w_angle),     σ(x) = 1 / (1 + exp(−x)).

The lobes are those of `shank_events.swings` without any threshold; where they lie is decided and carries no gradient,
their peaks and angles are of the filtered rate, so that the count also has a slope in the cut-off. With widths that go
to zero it is the number of strides that `swings` finds.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from jgait import params, shank_events
from jgait.shank_events import LOBES, Detector


class Widths(NamedTuple):
    """How soft the thresholds are.

    Attributes:
        rate: of the peak rate [rad/s].
        angle: of the angle [rad].
    """

    rate: Any = np.deg2rad(15.0)
    angle: Any = np.deg2rad(3.0)


SOFT = Widths()
"""The usual widths."""

TRANSFORMS = Detector(params.interval(1.0, 12.0), params.positive, params.positive, params.fixed, params.fixed)
"""The range of every setting; a small rest is told by decisions alone, so that its settings are not tuned."""


def weights(
    rate: ArrayLike, sampling_rate_hz: float, d: Detector = LOBES, widths: Widths = SOFT, measured: Any = None
) -> Any:
    """What each lobe counts for, at the sample at which it is known to be over.

    Args:
        rate: (T,) sagittal rate, the forward swing negative [rad/s]; a lost sample repeats the one before.
        sampling_rate_hz: of the samples [Hz]; static.
        d: settings; differentiable in cut-off, threshold and least angle.
        widths: how soft the thresholds are.
        measured: (T,) bool, False in padding behind the recording; None: there is none.

    Returns:
        (T,) from 0 to 1 [1]; 0 where no lobe ends.

    Raises:
        ValueError: a width that is not positive; see `shank_events.swings`.
    """
    for name, width in widths._asdict().items():
        if isinstance(width, int | float) and not width > 0.0:
            raise ValueError(f"the width of the {name} must be positive; got {width}")
    every = d._replace(threshold=0.0, least_angle=0.0)
    found = shank_events.swings(rate, sampling_rate_hz, every)
    there = found.stride if measured is None else found.stride & measured
    fast = jax.nn.sigmoid((found.peak - d.threshold) / widths.rate)
    far = jax.nn.sigmoid((found.angle - d.least_angle) / widths.angle)
    return jnp.where(there, fast * far, 0.0)


def soft_count(
    rate: ArrayLike, sampling_rate_hz: float, d: Detector = LOBES, widths: Widths = SOFT, measured: Any = None
) -> Any:
    """How many strides there are, smooth in cut-off, threshold and least angle [1]; arguments as of `weights`."""
    return jnp.sum(weights(rate, sampling_rate_hz, d, widths, measured))
