"""Parameters and options of the foot estimator, with their units, ranges and presets."""

from typing import Any, NamedTuple

from jgait import filtering, params
from jgait.estimators.interface import with_measures
from jgait.filtering.execution import Execution


class FootParams(NamedTuple):
    """Parameters of the foot estimator, in natural units; the same for both feet.

    Attributes:
        pivot_height: of the sensor over the point that a standing foot turns about [m]; 0: it stands quite still.
        velocity_noise: standard deviation of the zero velocity [m/s].
        rate_noise: by how much that grows with the foot's own rate [m/s per rad/s].
        acc_noise: root of the spectral density of the accelerometer's error [m/s²/√Hz].
        gyr_noise: the same of the gyroscope's [rad/s/√Hz].
        acc_jump_noise: error of the specific force over its change from sample to sample [1].
        gyr_jump_noise: the same of the angular rate [1].
        acc_bias_walk: root of the spectral density of the accelerometer bias's walk [m/s²·√Hz].
        gyr_bias_walk: the same of the gyroscope's [rad/s·√Hz].
        acc_bias: standard deviation of the accelerometer's bias at the start [m/s²].
        gyr_bias: of the gyroscope's, after ever so long a standing, about the vertical [rad/s].
        gyr_bias_tilt: the least about horizontal axes, where gravity corrects it [rad/s].
        sway: by how much a foot turns unseen while it is taken to stand still [rad].
        tilt: of the attitude at the first stance [rad].
        height_noise: of level ground from one foothold to the next [m]; where `FootOptions.level` says it is level.
        stride_noise: error of a stride that the model knows nothing of, per metre of it [1]; enters the stated
            standard deviations only.
    """

    pivot_height: Any = 0.08
    velocity_noise: Any = 0.01
    rate_noise: Any = 0.03
    acc_noise: Any = 0.05
    gyr_noise: Any = 0.002
    acc_jump_noise: Any = 0.15
    gyr_jump_noise: Any = 0.02
    acc_bias_walk: Any = 1e-4
    gyr_bias_walk: Any = 1e-5
    acc_bias: Any = 0.02
    gyr_bias: Any = 3e-4
    gyr_bias_tilt: Any = 3e-3
    sway: Any = 1.5e-3
    tilt: Any = 0.05
    height_noise: Any = 0.01
    stride_noise: Any = 0.01


TRANSFORMS = FootParams(
    pivot_height=params.interval(0.0 - 1e-9, 0.3),
    **{name: params.positive for name in FootParams._fields if name != "pivot_height"},
)
"""The range of every parameter."""


class FootOptions(NamedTuple):
    """Which parts are on.

    Attributes:
        smooth: Rauch–Tung–Striebel smoothing (offline).
        level: True: the ground is level, the filter knows it; False: nothing is known of it; "auto": as False, but
            where strides rise by less than 1.5 cm on average and 8 cm each, which is what errors make of level ground,
            the trajectory's footholds are put at one height. Strides keep the heights that were measured.
        detector: "adaptive": a threshold that follows the stride, see `jgait.events.foot`; or a detector of
            `jgait.events.zero_velocity` by name, with its default threshold and the adaptive one's footholds.
        method: how the filter linearises, see `jgait.filtering`.
        execution: how the filter computes, see `jgait.filtering`; "auto" takes "fast" for recordings of three minutes
            and more, whose smoothed values differ by some micrometres from those of "dense".
    """

    smooth: bool = True
    level: bool | str = "auto"
    detector: str = "adaptive"
    method: Any = filtering.EKF()
    execution: Execution = "auto"


DEFAULT = FootOptions()
"""The best pipeline."""

TEXTBOOK = FootParams(pivot_height=0.0, rate_noise=1e-9, acc_jump_noise=1e-9, gyr_jump_noise=1e-9)
"""Without the pivot and without noise that follows the signal: the filter as it is usually written."""


def with_body(p: FootParams, body: dict[str, Any]) -> FootParams:
    """The parameters with a person's own measure put in.

    Args:
        p: parameters.
        body: "pivot_height" [m], if known.

    Raises:
        ValueError: if it names anything else.
    """
    return with_measures("the foot estimator", ("pivot_height",), p, body)
