"""The `About` record of the foot estimator."""

import numpy as np
from jaxtyping import PyTree

from jgait.estimators.about import About, EstimateFigure, EstimateTable, TotalColumn
from jgait.estimators.foot_ins.params import DEFAULT
from jgait.estimators.stride_flags import DOUBTFUL, HALF, TURNING
from jgait.estimators.totals import DISTANCE, DURATION, LEVEL, MEDIANS, PIVOT, distance, duration, has_strides, median
from jgait.types import Estimate


def totals(estimate: Estimate) -> list[dict[str, PyTree]]:
    """Totals of a recording, with medians over the valid strides."""
    rows = np.flatnonzero(np.asarray(estimate.strides.valid, bool))
    return [{
        "duration_s": duration(estimate), "distance_m": distance(estimate), "strides": str(rows.size),
        "stride_length_m": median(estimate.strides.length, rows),
        "walking_speed_mps": median(estimate.strides.speed, rows),
    }]  # fmt: skip


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
    totals=totals,
    columns=(DURATION, DISTANCE, TotalColumn("strides", "strides"), *MEDIANS),
    caption="length and speed: medians over the strides",
    tables=(EstimateTable("feet", "samples"), EstimateTable("strides", "strides")),
    figures=(
        EstimateFigure("foot_paths", "paths"),
        EstimateFigure("foot_height", "height"),
        EstimateFigure("stride_series", "strides", has_strides),
    ),
    flags=(TURNING, HALF, DOUBTFUL),
    losses=(
        "distance", "position", "position_log", "stride_length", "stride_height", "stride_time",
        "contact_times", "likelihood", "calibration",
    ),
)  # fmt: skip
