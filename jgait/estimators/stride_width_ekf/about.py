"""The `About` record of the stride width estimator."""

import numpy as np

from jgait.estimators import foot_ins
from jgait.estimators.about import BodyMeasure, CommandOption, EstimateFigure, MissingMeasure, Settings
from jgait.estimators.foot_ins.about import ABOUT as FOOT
from jgait.estimators.stride_flags import WIDTH
from jgait.estimators.stride_width_ekf.params import DEFAULT, PAPER
from jgait.estimators.totals import LEVEL, PIVOT
from jgait.types import as_float


def _level(settings: Settings, value: bool | str) -> Settings:
    options = settings.get("foot_options", foot_ins.DEFAULT)
    return {**settings, "foot_options": options._replace(level=value)}


def _pivot(settings: Settings, value: float) -> Settings:
    params = settings.get("foot_params", foot_ins.FootParams())
    return {**settings, "foot_params": foot_ins.with_body(params, {"pivot_height": value})}


ABOUT = FOOT._replace(
    title="Paths, strides and stride widths from sensors on both shoes",
    needs=(
        "foot_right_gyr_x … foot_left_acc_z, and feet_range [m], the distance between the feet, empty where none was "
        "measured."
    ),
    source="Potter et al.",
    default=DEFAULT,
    paper=PAPER,
    measures=(
        BodyMeasure(
            "range_offset", "m", -0.2, 0.4, "how much farther apart the feet are than the measured range",
            "--range-offset", 0.08,
        ),
    ),
    missing=(
        MissingMeasure(
            ("range_offset",), "the default of {p.range_offset:g} m is taken, and widths are off by its error"
        ),
    ),
    options=(
        CommandOption("--pivot", f"{PIVOT.meaning} [m]; 0.08.", low=PIVOT.low, high=PIVOT.high, settings=_pivot),
        LEVEL._replace(settings=_level),
    ),
    figures=(
        *FOOT.figures,
        EstimateFigure("two_feet", "widths", lambda made: bool(np.isfinite(as_float(made.strides.width)).any())),
    ),
    flags=(*FOOT.flags, WIDTH),
    losses=(
        "position", "position_log", "stride_length", "stride_width", "stride_height", "stride_time",
        "contact_times", "likelihood", "calibration",
    ),
)  # fmt: skip
"""What commands, reports and the documentation say of this estimator; its ranges bound what a user can mean."""
