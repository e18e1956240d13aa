r"""When the ankle stands: the valley of the shank's rate in each stance, where stride lengths begin and end.

Between two swings the shank rolls over the foot; its rate is least some 40 % into that, and the ankle hardly moves.
The paper calls it the vertical event (the shank leans by 4 to 12° there). Before the first swing, after the last and
in a pause, the person stands: there the instant is the still sample next to the swing. On the host, not under jit.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Shaped

from jgait.types import AnyArray, as_float

EARLIEST, LATEST = 0.12, 0.85
"""Part of the time between two swings in which the valley lies [1], between the bumps of landing and push-off."""

PAUSE_S = 1.5
"""[s] A longer time between two swings is a pause."""

NEAR_S, FAR_S = 0.1, 0.9
"""[s] How far from a swing the still sample of standing is looked for."""

STILL = 0.25
"""[rad/s] A shank that turns more slowly is still."""

CUTOFF_HZ = 4.0
"""[Hz] Of the rates that are looked at, filtered both ways."""


class ShankStances(NamedTuple):
    """The instants around each swing.

    Attributes:
        begin: (n,) sample at which the stride of each swing begins.
        end: (n,) sample at which it ends; the begin of the next but for pauses.
        standing: (n, 2) bool, whether the instant is one of standing rather than a valley.
    """

    begin: np.ndarray
    end: np.ndarray
    standing: np.ndarray


def stances(
    rate: Float[AnyArray, "time"],
    speed: Float[AnyArray, "time"],
    start: Shaped[AnyArray, "swing"],
    end: Shaped[AnyArray, "swing"],
    sampling_rate_hz: float,
) -> ShankStances:
    """The instants around each swing at which the ankle stands.

    Args:
        rate: (T,) sagittal rate, the forward swing negative, low-passed at `CUTOFF_HZ` without delay [rad/s].
        speed: (T,) norm of the rate, its axes low-passed in the same way [rad/s].
        start: samples, whole or between, at which swings begin, increasing.
        end: samples at which they end, each before the next start.
        sampling_rate_hz: of the samples [Hz].

    Returns:
        Instants for each swing.

    Raises:
        ValueError: if swings overlap.
    """
    x, norm = as_float(rate), as_float(speed)
    first, last = (np.clip(np.rint(as_float(v)).astype(np.int64), 0, len(x) - 1) for v in (start, end))
    if np.any(last <= first) or np.any(first[1:] < last[:-1]):
        raise ValueError("every swing must end after it starts and before the next; these do not")
    n = len(first)
    before, after = np.zeros(n, np.int64), np.zeros(n, np.int64)
    standing = np.zeros((n, 2), bool)
    for k in range(n + 1):
        low = last[k - 1] if k > 0 else None
        high = first[k] if k < n else None
        if low is not None and high is not None and high - low <= PAUSE_S * sampling_rate_hz:
            span = high - low
            a, b = low + int(EARLIEST * span), high - int((1.0 - LATEST) * span)
            after[k - 1] = before[k] = a + int(np.argmin(x[a : max(b, a + 1)]))
            continue
        if low is not None:
            after[k - 1] = _still(norm, low, 1, sampling_rate_hz, limit=high)
            standing[k - 1, 1] = True
        if high is not None:
            before[k] = _still(norm, high, -1, sampling_rate_hz, limit=low)
            standing[k, 0] = True
    return ShankStances(before, after, standing)


def _still(norm: np.ndarray, swing: int, way: int, rate_hz: float, limit: int | None) -> int:
    """The still sample nearest to a swing's end, looking forwards (1) or backwards (−1)."""
    index = swing + way * np.arange(int(NEAR_S * rate_hz), max(int(FAR_S * rate_hz), int(NEAR_S * rate_hz) + 1))
    edge = (len(norm) - 1 if way > 0 else 0) if limit is None else limit
    index = index[index <= edge] if way > 0 else index[index >= edge]
    if len(index) == 0:
        return edge
    seen = norm[index]
    return int(index[np.argmax(seen < max(STILL, 1.2 * float(seen.min())))])
