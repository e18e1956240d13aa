"""Description of the ankle's estimator: body measures, options, table columns, figures and flags."""

import numpy as np
from jaxtyping import PyTree

from jgait.estimators.about import About, BodyMeasure, CommandOption, EstimateTable, MissingMeasure, TotalColumn
from jgait.estimators.ankle_stride.params import DEFAULT, AnkleParams
from jgait.estimators.ankle_stride.sensor_axes import axes_of, worn_otherwise
from jgait.estimators.sides import of_turns
from jgait.estimators.stride_flags import CLIPPED, DOUBTFUL, HALF, STAIRS, TURNING
from jgait.estimators.totals import DISTANCE, HEIGHT, LEG_STRIDES, MEDIANS, WAY, has_strides, median
from jgait.types import SIDES, Estimate, as_float

TAPE_SD = 0.01
"""[m] Standard deviation of the sensor's height over the ankle, measured with a tape."""

FLAGS = (TURNING, STAIRS, CLIPPED, HALF, DOUBTFUL)


def totals(estimate: Estimate) -> list[dict[str, PyTree]]:
    """One row for each leg with a sensor: totals of the leg's strides; medians are over whole strides."""
    strides, rows = estimate.strides, []
    side, half = np.asarray(strides.side), np.asarray(estimate.diagnostics["half"], bool)
    lasts = as_float(strides.end) - as_float(strides.start)
    way = as_float(of_turns(strides.length, strides.turn)[0])
    for number, name in enumerate(SIDES):
        if f"instants_{name}" not in estimate.diagnostics:
            continue
        of_leg = side == number
        whole = of_leg & ~half if np.any(of_leg & ~half) else of_leg
        flags = {f.name: int(np.sum(np.asarray(estimate.diagnostics.get(f.name, False), bool) & of_leg)) for f in FLAGS}
        rows.append({
            "side": name,
            "strides": int(of_leg.sum()),
            "distance_m": float(way[of_leg].sum()),
            "stride_length_m": median(strides.length, whole),
            "stride_duration_s": median(lasts, whole),
            "walking_speed_mps": median(strides.speed, whole),
            **flags,
            "lever_m": float(estimate.diagnostics[f"lever_{name}"][2]),
            "lever_std_m": float(estimate.diagnostics[f"lever_stddev_{name}"][2]),
            "special": ", ".join(f"{flags[f.name]} {f.word}" for f in FLAGS if flags[f.name]) or "–",
        })  # fmt: skip
    return rows


def leg_table(estimate: Estimate) -> list[dict[str, PyTree]]:
    """The totals without the column of words (`special`), which only the terminal shows."""
    return [{name: value for name, value in row.items() if name != "special"} for row in totals(estimate)]


def _lever(p: AnkleParams, _: float) -> AnkleParams:
    """A measured lever gets a smaller standard deviation than the default lever."""
    return p._replace(lever_along_sd=min(TAPE_SD, float(p.lever_along_sd)))


_HEIGHT = "height of the sensor over the ankle"
ABOUT = About(
    title="Strides from a sensor at the ankle or on the shank",
    needs="ankle_right_gyr_x … shank_left_acc_z, one leg or both, mounted in any way.",
    source="Silva et al. 2017",
    default=DEFAULT,
    measures=(
        BodyMeasure("lever_ankle", "m", -0.05, 0.2, f"{_HEIGHT}, of a sensor at the ankle", "--lever", 0.03),
        BodyMeasure("lever_shank", "m", -0.05, 0.2, f"{_HEIGHT}, of a sensor on the shank", "--lever", 0.18),
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
            "--lever", f"{_HEIGHT} [m]; 0.03 at the ankle, 0.18 on the shank.", low=-0.05, high=0.2, params=_lever
        ),
        CommandOption(
            "--axes", "which of the sensor's axes should look forward, left and up, such as x,y,z; used only to detect "
            "sensors that are upside down or on the other leg.", str, parse=axes_of, notes=worn_otherwise,
        ),
    ),
    totals=totals,
    columns=(
        TotalColumn("side", "leg"), TotalColumn("strides", "strides", digits=0), DISTANCE, *MEDIANS,
        TotalColumn("special", "special", left=True),
    ),
    caption="length and speed: medians over whole strides; whole tables in the files",
    tables=(EstimateTable("strides", "strides", json="strides"), EstimateTable("totals", leg_table, json="legs")),
    figures=(LEG_STRIDES, WAY._replace(when=has_strides)),
    flags=FLAGS,
    losses=("distance", "stride_length", "stride_height", "stride_time", "contact_times", "likelihood", "calibration"),
)  # fmt: skip
