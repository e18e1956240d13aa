"""A toy figure: the distance in feet."""

from jgait.plot.style import ESTIMATE, Figure, blank
from jgait.types import Estimate, as_float


def toy_distance(estimate: Estimate, *, title: str = "") -> Figure:
    """The distance walked over time, in feet."""
    figure, axes = blank(1, 1, 4.0, 3.0)
    axes[0, 0].plot(as_float(estimate.time), as_float(estimate.distance) / 0.3048, **ESTIMATE)
    axes[0, 0].set_title(title)
    return figure
