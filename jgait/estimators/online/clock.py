"""Samples as they are pushed: checked, lost ones marked, gaps filled with lost samples."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from jgait.types import AnyArray, as_float

LONGEST_GAP_S = 5.0
"""[s] Longest time without samples that is bridged; of a longer gap only so much."""

LATE = 1.5
"""[1] Interval over the usual one from which on samples are missing."""

RATE_OFF = 1.25
"""[1] Largest ratio of the usual interval of a block to that of the calibration."""


class Block(NamedTuple):
    """A block of pushed samples."""

    time: np.ndarray  #: (n,) of the pushed samples [s].
    #: (m, 1 + 8 k) for the devices: time since the previous sample [s], and for each sensor rate, force, whether the
    #: rate and whether the force was measured; m > n if samples are missing.
    rows: np.ndarray
    kept: np.ndarray | slice  #: rows of the pushed samples, as an index.
    samples: int  #: number of samples since the first one, at the end of the block.
    offset: float  #: time of the newest sample less that which the devices count [s].


class Pushes:
    """Times and shapes of pushed samples."""

    def __init__(self, placements: tuple[str, ...], sampling_rate_hz: float) -> None:
        self._placements = placements
        self._rate_hz = sampling_rate_hz
        self._last: float | None = None
        self._samples = 0

    def block(self, time: AnyArray | float, signals: Mapping[str, tuple[AnyArray, AnyArray | None]]) -> Block:
        """The samples of one call of `Online.push`; nothing is changed until `accept`.

        Raises:
            ValueError: as `Online.push`.
        """
        alone = np.ndim(time) == 0
        times = np.atleast_1d(as_float(time))
        if times.ndim != 1 or not times.size or not np.isfinite(times).all():
            raise ValueError(f"time must be one finite number or (n,) of them, n > 0; got shape {np.shape(time)}")
        if set(signals) != set(self._placements):
            more = sorted(set(signals) - set(self._placements))
            hint = f"; leave out {', '.join(more)}" if more and set(self._placements) <= set(signals) else ""
            raise ValueError(f"push needs the samples of {', '.join(self._placements)}; got {sorted(signals)}{hint}")
        step = np.empty_like(times)
        np.subtract(times[1:], times[:-1], out=step[1:])
        step[0] = 0.0 if self._last is None else times[0] - self._last
        if (step[1:] <= 0.0).any() or (self._last is not None and step[0] <= 0.0):
            at = 0 if self._last is not None and step[0] <= 0.0 else 1 + int(np.argmax(step[1:] <= 0.0))
            before = self._last if at == 0 else times[at - 1]
            raise ValueError(f"time must increase; {times[at]:.6g} s follows {before:.6g} s")
        self._check_rate(step[1:])
        rows = np.zeros((times.size, 1 + 8 * len(self._placements)))
        rows[:, 0] = step
        for number, name in enumerate(self._placements):
            self._fill(rows[:, 1 + 8 * number : 9 + 8 * number], name, signals[name], times.size, alone=alone)
        return self._spaced(times, rows)

    def _check_rate(self, step: np.ndarray) -> None:
        if step.size < 3 or abs(step.sum() * self._rate_hz / step.size - 1.0) < 0.1:
            return
        ratio = float(np.median(step)) * self._rate_hz  # samples may be missing
        if not 1.0 / RATE_OFF < ratio < RATE_OFF:
            raise ValueError(
                f"samples come at {self._rate_hz / ratio:.4g} Hz; the calibration has {self._rate_hz:.4g} Hz"
            )

    def _fill(
        self, rows: np.ndarray, name: str, signals: tuple[AnyArray, AnyArray | None], samples: int, *, alone: bool
    ) -> None:
        """Rate, force and whether they were measured, of one sensor."""
        if not isinstance(signals, tuple) or len(signals) != 2:
            raise ValueError(f"the samples of '{name}' must be (gyr, acc); got {type(signals).__name__}")
        for number, (what, values) in enumerate(zip(("gyr", "acc"), signals, strict=True)):
            if values is None:
                if what == "acc":
                    continue
                raise ValueError(f"'{name}' needs a gyroscope; gyr is None")
            array = as_float(values)
            wanted = (3,) if alone else (samples, 3)
            if array.shape != wanted:
                raise ValueError(f"{what} of '{name}' must have the shape {wanted}; got {array.shape}")
            array = array.reshape(samples, 3)
            if np.isfinite(array).all():
                rows[:, 3 * number : 3 * number + 3], rows[:, 6 + number] = array, 1.0
            else:
                there = np.isfinite(array).all(axis=1)
                rows[:, 3 * number : 3 * number + 3] = np.where(there[:, None], array, 0.0)
                rows[:, 6 + number] = there

    def _spaced(self, times: np.ndarray, rows: np.ndarray) -> Block:
        """The rows, with lost samples where some are missing."""
        samples = self._samples + len(rows)
        if rows[:, 0].max() * self._rate_hz <= LATE:
            return Block(times, rows, slice(None), samples, float(times[-1]) - (samples - 1) / self._rate_hz)
        gap = np.minimum(rows[:, 0], LONGEST_GAP_S)
        missing = np.where(gap * self._rate_hz > LATE, np.rint(gap * self._rate_hz).astype(int) - 1, 0)
        kept = np.arange(times.size) + np.cumsum(missing)
        every = np.zeros((int(kept[-1]) + 1, rows.shape[1]))
        every[kept] = rows
        for at, count, seconds in zip(kept, missing, gap, strict=True):
            every[at - count : at + 1, 0] = seconds / (count + 1)
        samples = self._samples + len(every)
        return Block(times, every, kept, samples, float(times[-1]) - (samples - 1) / self._rate_hz)

    def accept(self, block: Block) -> None:
        """The block has been processed."""
        self._last, self._samples = float(block.time[-1]), block.samples
