"""Every filler by name."""

from jgait.duty_cycle.fillers import neighbours, plain, ridge
from jgait.duty_cycle.fillers.base import Filler


def fillers() -> dict[str, Filler]:
    """Name → filler."""
    return {**plain.FILLERS, **ridge.FILLERS, **neighbours.FILLERS}
