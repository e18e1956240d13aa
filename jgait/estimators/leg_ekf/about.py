"""The `About` record of the leg estimator."""

from jgait.estimators.about import About, CommandOption, EstimateTable
from jgait.estimators.leg_ekf.params import DEFAULT, PAPER
from jgait.estimators.totals import FOOT_PATH, HEIGHT, JOINT_ANGLES, NO_LENGTHS, SHANK, THIGH, WAY

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
    tables=(EstimateTable("legs", "samples"),),
    figures=(JOINT_ANGLES, FOOT_PATH, WAY),
    losses=("distance", "trajectory", "joint_angles", "foot_path", "stride_length", "likelihood", "calibration"),
)  # fmt: skip
"""The description of `leg_ekf`."""
