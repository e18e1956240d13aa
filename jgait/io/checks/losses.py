"""Losses of samples of one sensor."""

import numpy as np

from jgait.io.checks import limits as at
from jgait.notes import DATA_LOST, Note
from jgait.signal.windows import true_runs
from jgait.types import Imu


def in_long_gaps(imu: Imu, rate_hz: float) -> np.ndarray:
    """(T,) bool, samples in gaps that are too long to be bridged."""
    lost = np.zeros(len(imu.mask), bool)
    for start, end in true_runs(~np.asarray(imu.mask, bool)):
        lost[start:end] = end - start > at.LONG_GAP_S * rate_hz
    return lost


def loss_notes(placement: str, present: np.ndarray, imu: Imu, rate_hz: float) -> list[Note]:
    """Notes about long stretches of samples that are not present (T,), and about the number of others."""
    gaps = true_runs(~present)
    long = [(start, end) for start, end in gaps if end - start > at.LONG_GAP_S * rate_hz]
    notes = []
    if len(long) < len(gaps):
        many = "{placement}: samples missing: {missing} of {samples}"
        notes.append(DATA_LOST.note(many, placement=placement, missing=(~present).sum(), samples=len(present)))
    for start, end in long:
        begin = float(imu.time[start] - imu.time[0])
        seconds = (end - start) / rate_hz
        notes.append(DATA_LOST.note(f"{seconds:.2f} s missing from {begin:.2f} s", placement=placement))
    return notes
