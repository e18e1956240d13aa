"""Parameters and options of the foot estimator, with their units, ranges and presets."""

from typing import Annotated, Any, NamedTuple

from jgait import filtering
from jgait.estimators.interface import with_measures
from jgait.estimators.noise import Constant
from jgait.geometry.vectors import Vector
from jgait.notes import record
from jgait.params import Param, Parameter, documented, interval, lognormal, normal, positive
from jgait.types import Measures


@documented
@record
class FootParams(NamedTuple):
    """Parameters of the foot estimator, in natural units; the same for both feet."""

    pivot_height: Annotated[Param, Parameter(
        interval(0.0 - 1e-9, 0.3), "m",
        "height of the sensor over the point about which a standing foot turns; 0: the foot does not turn",
    )] = 0.08  # fmt: skip
    velocity_noise: Annotated[Param, Parameter(
        positive, "m/s", "standard deviation of the zero velocity", lognormal(0.01, 2.0),
    )] = 0.01  # fmt: skip
    rate_noise: Annotated[Param, Parameter(
        positive, "m/s per rad/s", "increase of `velocity_noise` with the rate of the foot", lognormal(0.03, 2.0),
    )] = 0.03  # fmt: skip
    acc_noise: Annotated[Param, Parameter(
        positive, "m/s²/√Hz", "root of the spectral density of the accelerometer's error", lognormal(0.05, 2.0),
    )] = 0.05  # fmt: skip
    gyr_noise: Annotated[Param, Parameter(
        positive, "rad/s/√Hz", "the same of the gyroscope's error", lognormal(0.002, 2.0),
    )] = 0.002  # fmt: skip
    acc_jump_noise: Annotated[Param, Parameter(
        positive, "1", "error of the specific force over its change between samples", lognormal(0.15, 2.0),
    )] = 0.15  # fmt: skip
    gyr_jump_noise: Annotated[Param, Parameter(
        positive, "1", "the same of the angular rate", lognormal(0.07, 2.0),
    )] = 0.07  # fmt: skip
    acc_bias_walk: Annotated[Param, Parameter(
        positive, "m/s²·√Hz", "root of the spectral density of the random walk of the accelerometer's bias",
    )] = 1e-4  # fmt: skip
    gyr_bias_walk: Annotated[Param, Parameter(positive, "rad/s·√Hz", "the same of the gyroscope's bias")] = 1e-5
    acc_bias: Annotated[Param, Parameter(
        positive, "m/s²", "standard deviation of the accelerometer's bias at the start",
    )] = 0.02  # fmt: skip
    gyr_bias: Annotated[Param, Parameter(
        positive, "rad/s", "standard deviation of the gyroscope's bias about the vertical, after a long standing",
    )] = 3e-4  # fmt: skip
    gyr_bias_tilt: Annotated[Param, Parameter(
        positive, "rad/s", "smallest standard deviation of the gyroscope's bias about horizontal axes",
    )] = 3e-3  # fmt: skip
    sway: Annotated[Param, Parameter(
        positive, "rad", "standard deviation of the foot's rotation during a detected standing",
    )] = 1.5e-3  # fmt: skip
    tilt: Annotated[Param, Parameter(
        positive, "rad", "standard deviation of the attitude at the first stance",
    )] = 0.05  # fmt: skip
    height_noise: Annotated[Param, Parameter(
        positive, "m", "standard deviation of level ground from one foothold to the next, see `FootOptions.level`",
    )] = 0.01  # fmt: skip
    stride_noise: Annotated[Param, Parameter(
        positive, "1",
        "error of a stride that the model does not contain, per metre; used for the stated errors only",
    )] = 0.01  # fmt: skip
    tracked_point: Annotated[Vector, Parameter(
        interval(-0.3, 0.3), "m", "point of the foot whose path is returned, such as a marker or the heel, from the "
        "sensor in its axes; strides do not depend on it", normal(0.0, 0.05),
    )] = Vector(0.0, 0.0, 0.0)  # fmt: skip
    softness: Annotated[Param, Parameter(
        positive, "1", "width of the change from stance to swing, in the logarithm of the detector's statistic; "
        "used if `FootOptions.soft` is set", lognormal(0.2, 2.0),
    )] = 0.2  # fmt: skip
    threshold_factor: Annotated[Param, Parameter(
        positive, "1", "factor on the detector's threshold; used if `FootOptions.soft` is set", lognormal(1.0, 2.0),
    )] = 1.0  # fmt: skip
    noise: Annotated[Any, Parameter(
        None, "", "noise model of the zero velocity, see `jgait.estimators.noise`",
    )] = Constant()  # fmt: skip


@record
class FootOptions(NamedTuple):
    """Which parts of the method are used.

    Attributes:
        smooth: Rauch–Tung–Striebel smoothing (offline).
        level: True: the filter assumes level ground; False: it assumes nothing about the ground; "auto": as False, but
            both footholds of a stride get one height in the trajectory where the rises of all strides say that the
            ground is level, see `jgait.estimators.foot_ins.readout`. Strides keep their measured heights.
        method: how the filter linearises, see `jgait.filtering`.
        soft: False: zero velocity is observed in stances alone. True: at every sample, with a variance that grows
            smoothly as the detector's statistic exceeds its threshold, so that a gradient reaches the decision; the
            limit of small `softness` is the hard decision.
        noise: noise model of the zero velocity, a name in `jgait.estimators.noise.MODELS`.
    """

    smooth: bool = True
    level: bool | str = "auto"
    method: filtering.Method = filtering.EKF()
    soft: bool = False
    noise: str = "constant"


DEFAULT = FootOptions()
"""The default pipeline, the most accurate one."""

TEXTBOOK = FootParams(pivot_height=0.0, rate_noise=1e-9, acc_jump_noise=1e-9, gyr_jump_noise=1e-9)
"""Parameters of the standard filter: no pivot, and noise that does not depend on the signal."""


def with_body(p: FootParams, body: Measures) -> FootParams:
    """The parameters with the "pivot_height" [m] of a person. Raises ValueError if `body` contains another name."""
    return with_measures("the foot estimator", ("pivot_height",), p, body)
