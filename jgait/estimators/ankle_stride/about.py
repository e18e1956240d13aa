"""Description of the ankle's estimator: body measures, options, table columns, figures and flags."""

from jgait.estimators.about import About, BodyMeasure, CommandOption, EstimateTable, MissingMeasure
from jgait.estimators.ankle_stride.params import DEFAULT, AnkleParams
from jgait.estimators.stride_flags import CLIPPED, DOUBTFUL, HALF, STAIRS, TURNING, UNEVEN_DURATION
from jgait.estimators.totals import HEIGHT, LEG_STRIDES, WAY, has_strides
from jgait.types import SIDES, Estimate

FLAGS = (TURNING, STAIRS, CLIPPED, HALF, UNEVEN_DURATION, DOUBTFUL)


def numbers(estimate: Estimate) -> dict[str, float]:
    """Height of each sensor over the ankle and its standard deviation [m], as the walk corrected them."""
    return {
        f"{name}_{side}_m": float(estimate.diagnostics[f"{key}_{side}"][2])
        for side in SIDES if f"lever_{side}" in estimate.diagnostics
        for name, key in (("lever", "lever"), ("lever_std", "lever_stddev"))
    }  # fmt: skip


def _lever(p: AnkleParams, _: float) -> AnkleParams:
    """A lever that is measured with a tape is known to 1 cm."""
    return p._replace(lever_along_sd=min(0.01, float(p.lever_along_sd)))


_HEIGHT = "height of the sensor over the ankle"
ABOUT = About(
    title="Strides from a sensor at the ankle or on the shank",
    needs="ankle_right_gyr_x … shank_left_acc_z, one leg or both, mounted in any way.",
    source="Silva et al. 2017",
    default=DEFAULT,
    measures=(
        BodyMeasure("lever_ankle", "m", -0.05, 0.2, f"{_HEIGHT}, of a sensor at the ankle", "--lever", 0.03),
        BodyMeasure("lever_shank", "m", 0.0, 0.4, f"{_HEIGHT}, of a sensor on the shank", "--lever", 0.18),
        HEIGHT,
    ),
    missing=(
        MissingMeasure(
            ("lever_ankle", "lever_shank"),
            "a sensor at the ankle is taken to sit {p.lever_ankle:g} m above it, one on the shank {p.lever_shank:g} m; "
            "the walk corrects that a little, and 0.1 m make a stride 3 to 7 cm wrong",
        ),
    ),
    options=(
        CommandOption(
            "--lever", f"{_HEIGHT} [m]; 0.03 at the ankle, 0.18 on the shank; nearer to the knee give lever_shank by "
            "--person.", low=-0.05, high=0.2, params=_lever
        ),
    ),
    tables=(EstimateTable("strides", "strides", json="strides"),),
    figures=(LEG_STRIDES, WAY._replace(when=has_strides)),
    flags=FLAGS,
    numbers=numbers,
    losses=("distance", "stride_length", "stride_height", "stride_time", "contact_times", "likelihood", "calibration"),
)  # fmt: skip
"""What commands, reports and the documentation say of this estimator; its ranges bound what a user can mean."""
