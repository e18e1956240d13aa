"""Parameters and options of the stride width estimator, with their units, ranges and presets."""

import math
from typing import Annotated, NamedTuple

from jgait import filtering
from jgait.notes import record
from jgait.params import Param, Parameter, documented, fixed, interval, positive


@documented
@record
class WidthParams(NamedTuple):
    """Parameters of the stride width estimator, in natural units."""

    range_offset: Annotated[Param, Parameter(
        interval(-0.2, 0.4), "m",
        "distance between the sensors of the feet, across the walk, less the measured range; to be measured on "
        "the person, because its error is an error of the width",
        stddev="offset_noise",
    )] = 0.08  # fmt: skip
    offset_noise: Annotated[Param, Parameter(
        fixed, "m", "standard deviation of `range_offset`; used for the stated errors only",
    )] = 0.01  # fmt: skip
    passing_offset: Annotated[Param, Parameter(
        interval(-0.2, 0.2), "m",
        "distance of the right foot ahead of the left one when a range is measured; above 0 if the toes point "
        "outward. It changes step lengths, not widths",
        stddev="passing_offset_noise",
    )] = 0.0  # fmt: skip
    passing_offset_noise: Annotated[Param, Parameter(
        fixed, "m", "standard deviation of `passing_offset`; used for the stated errors only",
    )] = 0.03  # fmt: skip
    position_noise: Annotated[Param, Parameter(
        positive, "m/√m", "standard deviation of a foot's displacement, per square root of its length",
    )] = 0.01  # fmt: skip
    heading_noise: Annotated[Param, Parameter(
        positive, "rad", "standard deviation of the change of heading from stride to stride",
    )] = 0.01  # fmt: skip
    turn_noise: Annotated[Param, Parameter(positive, "1", "increase of `heading_noise` per radian of turn")] = 0.03
    range_noise: Annotated[Param, Parameter(
        positive, "m", "standard deviation of the range as a measure of the distance across",
    )] = 0.01  # fmt: skip
    passing_noise: Annotated[Param, Parameter(
        fixed, "m",
        "standard deviation of the distance of the right foot ahead of the left one when a range is measured; "
        "fixed, because nothing measures it and a likelihood would shrink it to millimetres",
    )] = 0.04  # fmt: skip
    usual_passing: Annotated[Param, Parameter(
        fixed, "m", "distance of the feet across when they pass, of people whose feet swing straight ahead; used "
        "without a range, see `stride_width_ekf.prepare.passings`",
    )] = 0.115  # fmt: skip
    passing_share: Annotated[Param, Parameter(
        fixed, "1", "increase of `usual_passing` with the distance by which swinging feet keep outside",
    )] = 0.5  # fmt: skip
    usual_noise: Annotated[Param, Parameter(
        fixed, "m", "standard deviation of the distance at a passing about its mean in a walk; used without a range",
    )] = 0.012  # fmt: skip
    people_noise: Annotated[Param, Parameter(
        fixed, "m", "standard deviation of that mean between people; used for the stated errors without a range",
    )] = 0.025  # fmt: skip
    start_width: Annotated[Param, Parameter(fixed, "m", "distance of the feet across at the start")] = 0.15
    start_across: Annotated[Param, Parameter(fixed, "m", "standard deviation of `start_width`")] = 0.15
    start_along: Annotated[Param, Parameter(
        fixed, "m", "standard deviation about 0 of the distance of the feet along the walk at the start",
    )] = 0.5  # fmt: skip
    start_heading: Annotated[Param, Parameter(
        fixed, "rad", "standard deviation about 0 of the angle between the first strides of the feet",
    )] = 0.2  # fmt: skip


class WidthOptions(NamedTuple):
    """Options of the stride width estimator.

    Attributes:
        method: how the filter linearises, see `jgait.filtering`.
        smooth: Rauch–Tung–Striebel smoothing (offline).
        longest_range: longer ranges are not those to the other leg and are left out [m].
        turn: change of heading between strides above which a foot is in a turn; ranges in turns are left out [rad].
        outlier: ranges that differ more than this from the median of the nine around them are left out [m].
        widest_stddev: widths with a larger standard deviation are flagged [m].
        most_misfits: share of ranges whose innovation, across or along, is above two standard deviations, above which
            no width is valid [1]; 5 % are expected. Chosen: simulated walks of ten gaits, and a recorded one with
            distances between markers, have fewer than 0.3; ranges of which half are far too short, and ranges that are
            read at any moment, have more.
        usual_passings: without a usable range, feet pass each other as those of usual people do, see
            `stride_width_ekf.prepare.passings`.
    """

    method: filtering.Method = filtering.IteratedEKF()
    smooth: bool = True
    longest_range: float = 0.5
    turn: float = math.radians(15.0)
    outlier: float = 0.1
    widest_stddev: float = 0.05
    most_misfits: float = 0.3
    usual_passings: bool = True


DEFAULT = WidthOptions()
"""The default pipeline, the most accurate one."""

PAPER = WidthOptions(
    method=filtering.EKF(), smooth=False, outlier=math.inf, usual_passings=False,
)  # fmt: skip
"""The paper's pipeline with its misprints corrected: an EKF, ranges up to 0.5 m, none in turns."""
