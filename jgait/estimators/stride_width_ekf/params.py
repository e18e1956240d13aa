"""Parameters and options of the stride width estimator, with their units, ranges and presets."""

import math
from typing import Any, NamedTuple

from jgait import filtering, params
from jgait.filtering.execution import Execution


class WidthParams(NamedTuple):
    """Parameters of the stride width estimator, in natural units.

    Attributes:
        range_offset: what the foot sensors are farther apart, across the walk, than the range says: from the left
            foot's sensor to the range sensor, and from the skin of the right leg to its foot's sensor [m]. To be
            measured on the person: its error is the width's.
        offset_noise: standard deviation of that measurement [m]; enters the stated errors only.
        passing_offset: how far the right foot is ahead of the left one when a range comes [m]; above 0 where the range
            sensor looks forward because its wearer's toes point out. Step lengths shift by it, widths do not.
        passing_offset_noise: standard deviation of it [m]; enters the stated errors only.
        position_noise: standard deviation of a foot's displacement per square root of the way moved [m/√m].
        heading_noise: standard deviation of the change of heading from stride to stride [rad].
        turn_noise: more of it, for each radian that the heading changes [1].
        range_noise: standard deviation of the range as the distance across [m].
        passing_noise: standard deviation of how far the right foot is ahead when a range comes [m]. Nobody measures it,
            so no likelihood can learn it: it would shrink to millimetres.
        start_width: distance across at the start [m].
        start_across: its standard deviation [m].
        start_along: standard deviation of the distance along at the start [m], 0 expected.
        start_heading: standard deviation of the angle between both feet's first strides [rad], 0 expected.
    """

    range_offset: Any = 0.08
    offset_noise: Any = 0.01
    passing_offset: Any = 0.0
    passing_offset_noise: Any = 0.03
    position_noise: Any = 0.01
    heading_noise: Any = 0.01
    turn_noise: Any = 0.03
    range_noise: Any = 0.01
    passing_noise: Any = 0.04
    start_width: Any = 0.15
    start_across: Any = 0.15
    start_along: Any = 0.5
    start_heading: Any = 0.2


TRANSFORMS = WidthParams(
    range_offset=params.interval(-0.2, 0.4),
    offset_noise=params.fixed,
    passing_offset=params.interval(-0.2, 0.2),
    passing_offset_noise=params.fixed,
    position_noise=params.positive,
    heading_noise=params.positive,
    turn_noise=params.positive,
    range_noise=params.positive,
    passing_noise=params.fixed,
    start_width=params.fixed,
    start_across=params.fixed,
    start_along=params.fixed,
    start_heading=params.fixed,
)
"""The range of every parameter; fixed is what no recording can tell."""


class WidthOptions(NamedTuple):
    """How the estimator works.

    Attributes:
        method: how the filter linearises, see `jgait.filtering`.
        smooth: Rauch–Tung–Striebel smoothing (offline).
        longest_range: readings above it are of something else than the other leg [m].
        turn: a foot that turns more than this from stride to stride turns; ranges are then left out [rad].
        outlier: readings farther than this from the median of their nine neighbours are left out [m].
        align_range: estimate how late the range's clock is, and take it off.
        check_swap: filter a second time with the feet exchanged, to find out whether they were.
        every_sample: estimate at every sample of the feet too, instead of only where something happens.
        widest_stddev: a width with a larger standard deviation is flagged [m].
        execution: how the filters compute, see `jgait.filtering`.
    """

    method: Any = filtering.IteratedEKF()
    smooth: bool = True
    longest_range: float = 0.5
    turn: float = math.radians(15.0)
    outlier: float = 0.1
    align_range: bool = True
    check_swap: bool = True
    every_sample: bool = False
    widest_stddev: float = 0.05
    execution: Execution = "auto"


DEFAULT = WidthOptions()
"""The best pipeline."""

PAPER = WidthOptions(
    method=filtering.EKF(), smooth=False, outlier=math.inf, align_range=False, check_swap=False
)  # fmt: skip
"""The paper's pipeline, its misprints put right: an EKF, ranges up to 0.5 m, none in turns."""
