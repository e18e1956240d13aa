"""Samples as they are pushed: checked, lost ones marked, gaps filled with lost samples."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from jgait.estimators.checks import UNIT_FORCES
from jgait.geometry.vectors import GRAVITY
from jgait.types import AnyArray, as_float

LONGEST_GAP_S = 5.0
"""[s] Longest time without samples that is bridged; of a longer gap only so much. Chosen by hand."""

LATE = 1.5
"""[1] Interval over the usual one from which on samples are missing; half way to one that is missing."""

FASTEST_MEAN = 15.0
"""[rad/s] Largest mean rate of a limb; of feet, ankles, shanks and thighs in all public sets, also running, it is 6."""


class Block(NamedTuple):
    """A block of pushed samples."""

    time: np.ndarray  #: (n,) of the pushed samples [s].
    #: (m, 1 + 8 k) for the devices: time since the previous sample [s], and for each sensor rate, force, whether the
    #: rate and whether the force was measured; m > n if samples are missing.
    rows: np.ndarray
    kept: np.ndarray | slice  #: rows of the pushed samples, as an index.
    samples: int  #: number of samples since the first one, at the end of the block.
    offset: float  #: time of the newest sample less that which the devices count [s].
    #: (k, 4) sums of the sizes of rate and force and of the measured samples of both, since the first sample.
    sizes: np.ndarray


class Pushes:
    """Times, shapes and units of pushed samples."""

    def __init__(self, placements: tuple[str, ...], sampling_rate_hz: float) -> None:
        self._placements = placements
        self._rate_hz = sampling_rate_hz
        self._last: float | None = None
        self._samples = 0
        self._sizes = np.zeros((len(placements), 4))

    def block(self, time: AnyArray | float, signals: Mapping[str, tuple[AnyArray, AnyArray | None]]) -> Block:
        """The samples of one call of `Online.push`; nothing is changed until `accept`.

        Raises:
            ValueError: as `Online.push`.
        """
        times = np.atleast_1d(as_float(time))
        if times.ndim != 1 or not times.size or not np.isfinite(times).all():
            raise ValueError(f"time must be one finite number or (n,) of them, n > 0; got shape {np.shape(time)}")
        if set(signals) != set(self._placements):
            more = sorted(set(signals) - set(self._placements))
            hint = f"; leave out {', '.join(more)}" if more and set(self._placements) <= set(signals) else ""
            raise ValueError(f"push needs the samples of {', '.join(self._placements)}; got {sorted(signals)}{hint}")
        rows = np.zeros((times.size, 1 + 8 * len(self._placements)))
        rows[:, 0] = self._steps(times)
        sensors = rows[:, 1:].reshape(times.size, -1, 8)
        for number, name in enumerate(self._placements):
            _fill(sensors[:, number], name, signals[name], (*np.shape(time), 3))
        sizes = self._sized(sensors)
        kept: np.ndarray | slice = slice(None)
        if rows[:, 0].max() * self._rate_hz > LATE:
            rows, kept = self._with_missing(rows)
        samples = self._samples + len(rows)
        return Block(times, rows, kept, samples, float(times[-1]) - (samples - 1) / self._rate_hz, sizes)

    def accept(self, block: Block) -> None:
        """The block has been processed."""
        self._last, self._samples, self._sizes = float(block.time[-1]), block.samples, block.sizes

    def _steps(self, times: np.ndarray) -> np.ndarray:
        """Time since the previous sample of each; 0 of the first of all."""
        first = self._last is None
        step = times - np.append(times[0] if self._last is None else self._last, times[:-1])
        late = first + np.flatnonzero(step[first:] <= 0.0)
        if late.size:
            before = self._last if late[0] == 0 else times[late[0] - 1]
            raise ValueError(f"time must increase; {times[late[0]]:.6g} s follows {before:.6g} s")
        if len(step) > 3 and abs(step[1:].mean() * self._rate_hz - 1.0) > 0.1:
            ratio = float(np.median(step[1:])) * self._rate_hz  # samples may be missing
            if not 0.8 < ratio < 1.25:
                raise ValueError(
                    f"samples come at {self._rate_hz / ratio:.4g} Hz; the calibration has {self._rate_hz:.4g} Hz"
                )
        return step

    def _with_missing(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The rows with lost samples where some are missing, and the index of those that are not."""
        gap = np.minimum(rows[:, 0], LONGEST_GAP_S)
        missing = np.where(gap * self._rate_hz > LATE, np.rint(gap * self._rate_hz).astype(int) - 1, 0)
        kept = np.arange(len(rows)) + np.cumsum(missing)
        every = np.zeros((int(kept[-1]) + 1, rows.shape[1]))
        every[kept] = rows
        every[:, 0] = np.repeat(gap / (missing + 1), missing + 1)
        return every, kept

    def _sized(self, sensors: np.ndarray) -> np.ndarray:
        """The sums after samples (n, k, 8). Raises ValueError for rates or forces not in rad/s and m/s².

        Sizes count from 0.75 s on: a jolt or a flight phase tells nothing of units.
        """
        sizes = (np.sqrt(np.square(sensors[..., part]).sum(axis=2)) for part in (slice(3), slice(3, 6)))
        sums = self._sizes + np.stack([*sizes, sensors[..., 6], sensors[..., 7]], axis=2).sum(axis=0)
        rate, force = (sums[:, :2] / np.maximum(sums[:, 2:], 1.0)).T
        # in the sets of `FASTEST_MEAN` the mean force is from 9 to 30 m/s²
        unlike = (force < 0.5 * GRAVITY) | (force > UNIT_FORCES[-1][0])
        wrong = np.stack([rate > FASTEST_MEAN, unlike], axis=1)
        wrong &= sums[:, 2:] > 0.75 * self._rate_hz
        if wrong.any():
            first = int(np.argmax(wrong.any(axis=1)))
            raise ValueError(_other_unit(self._placements[first], rate[first], force[first], *wrong[first]))
        return sums


def _fill(rows: np.ndarray, name: str, signals: tuple[AnyArray, AnyArray | None], shape: tuple[int, ...]) -> None:
    """Rate, force and whether they were measured, of one sensor, whose signals have a shape."""
    if not isinstance(signals, tuple) or len(signals) != 2:
        raise ValueError(f"the samples of '{name}' must be (gyr, acc); got {type(signals).__name__}")
    for number, (what, values) in enumerate(zip(("gyr", "acc"), signals, strict=True)):
        if values is None:
            if what == "acc":
                continue
            raise ValueError(f"'{name}' needs a gyroscope; gyr is None")
        array = as_float(values)
        if array.shape != shape:
            raise ValueError(f"{what} of '{name}' must have the shape {shape}; got {array.shape}")
        array = array.reshape(len(rows), 3)
        there = np.isfinite(array).all(axis=1)
        rows[:, 3 * number : 3 * number + 3] = np.where(there[:, None], array, 0.0)
        rows[:, 6 + number] = there


def _other_unit(name: str, rate: float, force: float, fast: bool, unlike_gravity: bool) -> str:
    """What is wrong with a sensor's mean rate and force, and what it seems to be."""
    if force < 0.8 * GRAVITY < rate < 3.0 * GRAVITY:
        return (
            f"gyr and acc of '{name}' seem to be exchanged: on average they are {rate:.3g} rad/s and {force:.3g} m/s², "
            f"where gravity alone is {GRAVITY:.3g} m/s²"
        )
    unit = next((f": is it in {unit}?" for low, high, unit in UNIT_FORCES if low < force < high), "")
    sentences = {
        f"gyr of '{name}' must be in rad/s; on average it is {rate:.4g}, and no limb exceeds {FASTEST_MEAN:g}: "
        "is it in deg/s?": fast,
        f"acc of '{name}' must be in m/s²; on average it is {force:.3g}, where gravity alone is {GRAVITY:.3g}"
        f"{unit}": unlike_gravity,
    }  # fmt: skip
    return "; ".join(sentence for sentence, applies in sentences.items() if applies)
