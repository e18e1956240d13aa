"""Walking in which no contact was found, from the size of the specific force alone; NumPy, on the host.

The size of the force does not depend on axes or on the gyroscope, so that it shows steps that wrong ones take away.
"""

import numpy as np

from jgait.signal.windows import held_mean, window_size
from jgait.types import as_float

REDUCED_HZ = 25.0
"""[Hz] About the rate to which the force is averaged; a step has at least eight samples."""

WINDOW_S = 2.0
"""[s] Window of the force's standard deviation and of its correlation with itself one step later."""

SHAKES, RHYTHM, LAGS = 0.7, 0.4, (0.75, 1.3)
"""[1], [1], [steps] Standard deviation of the force over its median near contacts, and largest correlation with itself
at one of these lags, above which the trunk moves as in walking: a sensor that is handled has no rhythm."""

BESIDE, FAR = 1.0, 1.5
"""[steps] Time to the nearest contact up to which the trunk walks, and from which on no contact is near."""

LEAST_S = 2.0
"""[s] Duration from which on walking is missing. Undamaged recordings of `ipol_gait`, `mobgap_lab`, `neura_sparse` and
`tripod` have none; a sensor that is handled before the walk has up to 1.2 s; where a walk of them disappears behind a
turn, most have 3.5 s and more."""


def missed(acc: np.ndarray, measured: np.ndarray, time: np.ndarray, contact: np.ndarray) -> np.ndarray:
    """(T,) bool, samples in which the trunk moves as in walking, far from every contact.

    Args:
        acc: (T, 3) specific force [m/s²], finite.
        measured: (T,) bool, False at lost samples.
        time: (T,) of the samples [s].
        contact: instants of contacts, in order [s].
    """
    nowhere = np.zeros(len(time), bool)
    rate = (len(time) - 1) / float(time[-1] - time[0])
    every = max(1, int(rate / REDUCED_HZ))
    count = len(time) // every
    if len(contact) < 2 or count < 2:
        return nowhere
    force = np.linalg.norm(as_float(acc), axis=1)[: count * every].reshape(count, every).mean(axis=1)
    step, hz, at = float(np.median(np.diff(contact))), rate / every, time[: count * every : every]
    size = window_size(WINDOW_S, hz)
    swings = force - held_mean(force, size)
    strength = np.sqrt(held_mean(swings**2, size))
    rhythm = np.zeros(count)
    for lag in range(int(LAGS[0] * step * hz), min(int(LAGS[1] * step * hz) + 1, count - 1)):
        now, later = swings[: count - lag], swings[lag:]
        power = held_mean(now**2, size) * held_mean(later**2, size)
        alike = held_mean(now * later, size) / np.sqrt(np.maximum(power, 1e-12))
        middle = rhythm[lag // 2 : lag // 2 + count - lag]
        np.maximum(middle, alike, out=middle)
    after = np.searchsorted(contact, at)
    ends = (contact[np.clip(after + k, 0, len(contact) - 1)] for k in (-1, 0))
    apart = np.min([np.abs(at - end) for end in ends], axis=0) / step
    near = apart < BESIDE
    if not near.any():
        return nowhere
    walks = (apart > FAR) & (strength > SHAKES * np.median(strength[near])) & (rhythm > RHYTHM)
    nowhere[: count * every] = np.repeat(walks, every)
    return nowhere & measured
