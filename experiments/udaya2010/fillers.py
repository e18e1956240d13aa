"""All fillers of Figure 7: those of the library, and those that only this experiment compares."""

from functools import partial

from experiments.udaya2010 import oscillator, ridge
from jgait.duty_cycle.fillers import FILLERS
from jgait.duty_cycle.filling import Filler
from jgait.params import ranges

LATER = Filler(partial(ridge.ridge, latency_s=0.4), ridge.RIDGE, ranges(ridge.RIDGE), needs_acc=True)
"""Ridge regression that waits for later samples."""


def fillers() -> dict[str, Filler]:
    """Name → filler."""
    return {**FILLERS, **ridge.FILLERS, "ridge_later": LATER, **oscillator.FILLERS}
