"""Whether pushed samples are in rad/s and m/s²: by means over seconds, since a jolt or a flight phase tells nothing."""

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
    """Fading sums of the sizes of rate and force of k sensors."""

    def __init__(self, placements: Sequence[str], sampling_rate_hz: float) -> None:
        self._placements, self._rate_hz = tuple(placements), sampling_rate_hz
        self._sums = np.zeros((2, len(self._placements), 2))

    def after(self, rows: np.ndarray) -> np.ndarray:
        """The sums (2, k, 2) after rows as of `clock.Block`: sizes, then samples; nothing is changed until `accept`.

        Raises:
            ValueError: rates or forces that are not in rad/s and m/s².
        """
        sums, most = self._sums, max(round(FADES_S * self._rate_hz), 1)
        for first in range(0, len(rows), most):
            part = rows[first : first + most, 1:].reshape(-1, len(self._placements), 8)
            sizes = np.sqrt(np.square(part[:, :, :6].reshape(*part.shape[:2], 2, 3)).sum(axis=3)).sum(axis=0)
            sums = sums * np.exp(-len(part) / most) + np.stack([sizes, part[:, :, 6:].sum(axis=0)])
            rate, force = (sums[0] / np.maximum(sums[1], 1.0)).T
            wrong = np.stack([rate > FASTEST_MEAN, (force < LEAST_FORCE) | (force > LARGEST_FORCE)], axis=1)
            wrong &= sums[1] > LEAST_S * self._rate_hz
            if wrong.any():
                at = int(np.argmax(wrong.any(axis=1)))
                raise ValueError(_words(self._placements[at], float(rate[at]), float(force[at]), *wrong[at]))
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
