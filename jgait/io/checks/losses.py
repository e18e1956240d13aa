"""Losses of samples of one sensor."""

import numpy as np

from jgait.io.checks import limits as at
from jgait.notes import LOSSES, Kind, Note
from jgait.signal.windows import true_runs
from jgait.types import Imu

SAMPLES_MISSING = Kind(
    "samples_missing", "check", "{placement}: {missing} of {samples} samples {missing:is|are} missing", LOSSES
)
STRETCH_MISSING = Kind("stretch_missing", "check", "{placement}: {seconds:.2f} s missing from {begin_s:.2f} s", LOSSES)


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
        notes.append(SAMPLES_MISSING(placement=placement, missing=(~present).sum(), samples=len(present)))
    for start, end in long:
        begin = float(imu.time[start] - imu.time[0])
        notes.append(STRETCH_MISSING(placement=placement, seconds=(end - start) / rate_hz, begin_s=begin))
    return notes
