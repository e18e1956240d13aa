"""A sensor's attitude and the integral of its specific force over a whole recording; NumPy, on the host.

Both are in the axes of the first sample, without a correction: only differences over some seconds are of use.
"""

import numpy as np
from jaxtyping import Float

from jgait.geometry.rotation import Quaternion, product, rotated, small_turn
from jgait.geometry.vectors import as_array, vector
from jgait.types import AnyArray


def integrated(
    gyr: Float[AnyArray, "time 3"], acc: Float[AnyArray, "time 3"], sampling_rate_hz: float
) -> tuple[Quaternion, np.ndarray]:
    """Attitude at each sample (T,), and the integral of the specific force since the first (T, 3) [m/s].

    Args:
        gyr: (T, 3) angular rate without bias [rad/s].
        acc: (T, 3) specific force [m/s²].
        sampling_rate_hz: rate of the samples [Hz].
    """
    mean = 0.5 * (gyr + np.concatenate([gyr[:1], gyr[:-1]])) / sampling_rate_hz
    attitude, shift = small_turn(vector(mean)), 1
    while shift < len(gyr):  # products of 2, 4, 8 … turns
        earlier, later = (Quaternion(*(part[at] for part in attitude)) for at in (slice(-shift), slice(shift, None)))
        joined = zip(attitude, product(earlier, later), strict=True)
        attitude, shift = Quaternion(*(np.concatenate([old[:shift], new]) for old, new in joined)), 2 * shift
    force = as_array(rotated(attitude, vector(acc)))
    total = np.cumsum(0.5 * (force[1:] + force[:-1]) / sampling_rate_hz, axis=0)
    return attitude, np.concatenate([np.zeros((1, 3)), total])
