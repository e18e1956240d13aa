"""Parameters and options of the ankle's stride estimator, with their units and ranges."""

from typing import Annotated, NamedTuple

from jgait import filtering
from jgait.estimators.interface import with_measures
from jgait.notes import record
from jgait.params import Param, Parameter, documented, interval, positive, real
from jgait.types import Measures


@documented
@record
class AnkleParams(NamedTuple):
    """Parameters of the ankle's estimator, in natural units; the same for both legs."""

    lever_ankle: Annotated[Param, Parameter(
        interval(-0.05, 0.2), "m", "height over the ankle of a sensor worn at the ankle; the walk corrects it",
        stddev="lever_along_sd",
    )] = 0.03  # fmt: skip
    lever_shank: Annotated[Param, Parameter(
        interval(0.0, 0.4), "m", "the same of a sensor on the shank", stddev="lever_along_sd",
    )] = 0.18  # fmt: skip
    lever_forward: Annotated[Param, Parameter(
        interval(-0.15, 0.15), "m", "distance of the sensor in front of the ankle", stddev="lever_across_sd",
    )] = 0.0  # fmt: skip
    lever_left: Annotated[Param, Parameter(
        interval(-0.15, 0.15), "m", "distance to the left of the ankle", stddev="lever_across_sd",
    )] = 0.0  # fmt: skip
    lever_along_sd: Annotated[Param, Parameter(positive, "m", "standard deviation of the height over the ankle")] = 0.02
    lever_across_sd: Annotated[Param, Parameter(
        positive, "m", "standard deviation of `lever_forward` and `lever_left`",
    )] = 0.01  # fmt: skip
    cutoff_hz: Annotated[Param, Parameter(
        interval(1.0, 12.0), "Hz", "cut-off of the zero-phase low-pass on the signals that are integrated",
    )] = 8.0  # fmt: skip
    velocity_noise: Annotated[Param, Parameter(
        positive, "m/s", "standard deviation of the ankle's zero velocity around a valley",
    )] = 0.02  # fmt: skip
    rate_noise: Annotated[Param, Parameter(
        positive, "m/s per rad/s", "increase of `velocity_noise` with the angular rate of the shank",
    )] = 0.02  # fmt: skip
    acc_noise: Annotated[Param, Parameter(
        positive, "m/s²/√Hz", "root of the spectral density of the accelerometer's error",
    )] = 0.02  # fmt: skip
    gyr_noise: Annotated[Param, Parameter(positive, "rad/s/√Hz", "the same of the gyroscope's error")] = 0.002
    acc_jump_noise: Annotated[Param, Parameter(
        positive, "1", "error of the specific force, relative to its change from sample to sample",
    )] = 0.02  # fmt: skip
    gyr_jump_noise: Annotated[Param, Parameter(positive, "1", "the same of the angular rate")] = 0.005
    acc_bias_walk: Annotated[Param, Parameter(
        positive, "m/s²·√Hz", "root of the spectral density of the random walk of the accelerometer's bias",
    )] = 1e-4  # fmt: skip
    gyr_bias_walk: Annotated[Param, Parameter(positive, "rad/s·√Hz", "the same of the gyroscope's bias")] = 1e-5
    acc_bias: Annotated[Param, Parameter(
        positive, "m/s²", "standard deviation of the accelerometer's bias at the start",
    )] = 0.1  # fmt: skip
    gyr_bias: Annotated[Param, Parameter(
        positive, "rad/s", "standard deviation of the gyroscope's bias after standing",
    )] = 1e-3  # fmt: skip
    gyr_bias_unknown: Annotated[Param, Parameter(positive, "rad/s", "`gyr_bias` without any standing")] = 0.02
    sway: Annotated[Param, Parameter(
        positive, "rad", "standard deviation of the leg's rotation during a detected standing",
    )] = 1.5e-3  # fmt: skip
    tilt: Annotated[Param, Parameter(positive, "rad", "standard deviation of the attitude at the first stance")] = 0.05
    stride_noise: Annotated[Param, Parameter(
        positive, "m", "error of a stride that the model does not contain; used for the stated errors only",
    )] = 0.012  # fmt: skip
    lever_turn_sd: Annotated[Param, Parameter(
        positive, "m", "standard deviation of the sensor's place beside the ankle, for turns; stated errors only",
    )] = 0.035  # fmt: skip
    distance_noise: Annotated[Param, Parameter(
        positive, "1", "relative error of the distance, from lever and scale, that all strides share; used for the "
        "stated error of the distance only",
    )] = 0.025  # fmt: skip
    leg_length: Annotated[Param, Parameter(positive, "m", "length of the pendulum; sl1 and sl2 only")] = 0.85
    angle_gain: Annotated[Param, Parameter(positive, "1", "factor on the angle of the swing; sl2 only")] = 1.0
    time_gain: Annotated[Param, Parameter(real, "s", "factor on the angle over the swing's time; sl2 only")] = 0.0


class AnkleOptions(NamedTuple):
    """The parts of the method that are used.

    Attributes:
        length: "filter": the error-state filter; "3d": strapdown from stance to stance; "sl1", "sl2":
            pendulum. Only the filter states standard deviations.
        detector: "swings": lobes of the zero-phase filtered rate; "machine": the paper's state machine, extended to a
            foot that stops; "paper": the machine as printed.
        site: "ankle", "shank", or "auto": the ankle's sensor where there is one, else the shank's.
        smooth: Rauch–Tung–Striebel smoothing (offline).
        standing: the gyroscope's bias is measured while the leg stands still; False: the filter alone estimates it.
        method: how the filter linearises, see `jgait.filtering`.
    """

    length: str = "filter"
    detector: str = "swings"
    site: str = "auto"
    smooth: bool = True
    standing: bool = True
    method: filtering.Method = filtering.EKF()


DEFAULT = AnkleOptions()
"""The default pipeline, the most accurate one."""

KNOWN = {
    "length": ("filter", "3d", "sl1", "sl2"), "detector": ("swings", "machine", "paper"),
    "site": ("auto", "ankle", "shank"),
}  # fmt: skip
"""Option → its allowed values."""


def with_body(p: AnkleParams, body: Measures) -> AnkleParams:
    """The parameters with a person's "lever_ankle", "lever_shank" and "leg_length" [m], if known; a pair (right, left)
    counts as its mean. ValueError for other names.
    """
    return with_measures("the ankle's estimator", ("lever_ankle", "lever_shank", "leg_length"), p, body)
