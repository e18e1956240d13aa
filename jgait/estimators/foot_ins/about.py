"""The `About` record of the foot estimator."""

from jgait.estimators.about import About, EstimateFigure, EstimateTable
from jgait.estimators.foot_ins.params import DEFAULT
from jgait.estimators.stride_flags import DOUBTFUL, HALF, STAIRS, TURNING, UNEVEN_DURATION
from jgait.estimators.totals import LEVEL, PIVOT, has_strides

ABOUT = About(
    title="Paths and strides of the feet from sensors on the shoes",
    needs="foot_right_gyr_x … foot_left_acc_z, one foot or both.",
    source="Potter et al., Foxlin 2005",
    default=DEFAULT,
    measures=(PIVOT,),
    options=(
        LEVEL._replace(
            settings=lambda settings, value: {**settings, "options": settings["options"]._replace(level=value)}
        ),
    ),
    tables=(EstimateTable("feet", "samples"), EstimateTable("strides", "strides")),
    figures=(
        EstimateFigure("foot_paths", "paths"),
        EstimateFigure("foot_height", "height"),
        EstimateFigure("stride_series", "strides", has_strides),
    ),
    flags=(TURNING, STAIRS, HALF, UNEVEN_DURATION, DOUBTFUL),
    losses=(
        "distance", "position", "position_log", "stride_length", "stride_height", "stride_time",
        "contact_times", "likelihood", "calibration",
    ),
)  # fmt: skip
