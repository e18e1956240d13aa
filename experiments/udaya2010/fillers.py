"""All fillers of Figure 7: those of the library, and the filters' predictions that only this experiment compares."""

from experiments.udaya2010 import oscillator
from jgait.duty_cycle.fillers import registry
from jgait.duty_cycle.fillers.base import Filler


def fillers() -> dict[str, Filler]:
    """Name → filler."""
    return {**registry.fillers(), **oscillator.FILLERS}
