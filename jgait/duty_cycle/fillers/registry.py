"""The registry of the fillers of gyroscope gaps."""

from jgait.duty_cycle.fillers import neighbours, plain
from jgait.duty_cycle.fillers.base import Filler


def fillers() -> dict[str, Filler]:
    """All fillers: name → filler."""
    return {**plain.FILLERS, **neighbours.FILLERS}
