"""The `About` record of the leg estimator."""

from jaxtyping import PyTree

from jgait.estimators.about import About, CommandOption, EstimateTable, TotalColumn
from jgait.estimators.leg_ekf.params import DEFAULT, PAPER
from jgait.estimators.totals import (
    DISTANCE,
    DURATION,
    FOOT_PATH,
    HEIGHT,
    JOINT_ANGLES,
    JOINT_COLUMNS,
    NO_LENGTHS,
    SHANK,
    THIGH,
    WAY,
    distance,
    duration,
    joint_ranges,
)
from jgait.types import Estimate


def _totals(estimate: Estimate) -> list[dict[str, PyTree]]:
    spread = float(estimate.diagnostics["distance_stddev"][-1])
    way = {"distance_m": distance(estimate), "distance_std_m": spread}
    return [{"duration_s": duration(estimate), **way, **joint_ranges(estimate)}]


ABOUT = About(
    title="Hip and knee angles and distance from sensors on thigh and shank",
    needs=(
        "thigh_right_gyr_x … thigh_right_acc_z, likewise shank_right, thigh_left, shank_left; one leg is enough. "
        "Accelerometers keep the angles correct in turns and on long walks."
    ),
    source="Bennett et al. 2013",
    default=DEFAULT,
    paper=PAPER,
    measures=(THIGH, SHANK, HEIGHT),
    missing=(NO_LENGTHS,),
    options=(
        CommandOption(
            "--scale", "personal scale of the distance; 1.", low=0.1,
            params=lambda p, value: p._replace(distance_scale=value),
        ),
    ),
    totals=_totals,
    columns=(DURATION, DISTANCE, TotalColumn("distance_std_m", "±", "m"), *JOINT_COLUMNS),
    caption="angles: smallest … largest flexion",
    tables=(EstimateTable("legs", "samples"),),
    figures=(JOINT_ANGLES, FOOT_PATH, WAY),
    losses=("distance", "trajectory", "joint_angles", "foot_path", "stride_length", "likelihood", "calibration"),
)  # fmt: skip
