"""Whether pushed samples are in rad/s and m/s²: by means over seconds, since a jolt or a flight phase tells nothing."""

import math
from collections.abc import Sequence

import numpy as np

from jgait.estimators.checks import UNIT_FORCES
from jgait.geometry.vectors import GRAVITY

FADES_S, LEAST_S = 2.0, 0.75
"""[s] Time in which samples fade from the means by 1/e; samples in the sums from which on a mean counts."""

FASTEST_MEAN = 15.0
"""[rad/s] Largest mean rate of a limb; of feet, ankles, shanks and thighs in all public sets, also running, it is 6."""

LEAST_FORCE, LARGEST_FORCE = 0.5 * GRAVITY, UNIT_FORCES[-1][0]
"""[m/s²] Least and largest mean size of the specific force; in these sets it is from 9 to 30."""


class Sizes:
    """Fading sums of the sizes of rate and force of k sensors, and of the measured samples: (4 k,), rates first."""

    def __init__(self, placements: Sequence[str], sampling_rate_hz: float) -> None:
        self._placements, k = tuple(placements), len(placements)
        self._most, self._least = max(round(FADES_S * sampling_rate_hz), 1), LEAST_S * sampling_rate_hz
        self._limits = np.repeat([[-1.0, LEAST_FORCE], [FASTEST_MEAN, LARGEST_FORCE]], k, axis=1)
        parts = np.repeat(np.eye(4), (3, 3, 1, 1), axis=0)  # columns of a sensor → rate, force, and their samples
        sensors = np.einsum("ab,cd->acdb", np.eye(k), parts).reshape(8 * k, 4 * k)
        self._parts = np.concatenate([np.zeros((1, 4 * k)), sensors])
        self._sums = np.zeros(4 * k)

    def after(self, rows: np.ndarray) -> np.ndarray:
        """The sums after rows as of `clock.Block`; nothing is changed until `accept`.

        Raises:
            ValueError: rates or forces that are not in rad/s and m/s².
        """
        sums, k = self._sums, len(self._placements)
        for first in range(0, len(rows), self._most):
            part = rows[first : first + self._most]
            sums = sums * math.exp(-len(part) / self._most) + np.sqrt(np.square(part) @ self._parts).sum(axis=0)
            mean = sums[: 2 * k] / np.maximum(sums[2 * k :], 1.0)
            wrong = ((mean < self._limits[0]) | (mean > self._limits[1])) & (sums[2 * k :] > self._least)
            if wrong.any():
                at = int(np.argmax(wrong[:k] | wrong[k:]))
                raise ValueError(_words(self._placements[at], float(mean[at]), float(mean[k + at]), *wrong[at::k]))
        return sums

    def accept(self, sums: np.ndarray) -> None:
        """The samples have been processed."""
        self._sums = sums


def _words(name: str, rate: float, force: float, fast: bool, unlike_gravity: bool) -> str:
    """What is wrong with a sensor, and what it seems to be."""
    if force < 0.8 * GRAVITY < rate < 3.0 * GRAVITY:
        return (
            f"gyr and acc of '{name}' seem to be exchanged: on average they are {rate:.3g} rad/s and {force:.3g} m/s², "
            f"where gravity alone is {GRAVITY:.3g} m/s²"
        )
    words = []
    if fast:
        words.append(
            f"gyr of '{name}' must be in rad/s; on average it is {rate:.4g}, and no limb exceeds {FASTEST_MEAN:g}: is "
            "it in deg/s?"
        )
    if unlike_gravity:
        unit = next((unit for low, high, unit in UNIT_FORCES if low < force < high), "")
        words.append(
            f"acc of '{name}' must be in m/s²; on average it is {force:.3g}, where gravity alone is {GRAVITY:.3g}"
            + (f": is it in {unit}?" if unit else "")
        )
    return "; ".join(words)
