"""Parameters and options of the ankle's stride estimator, with their units and ranges."""

from typing import Any, NamedTuple

from jgait import filtering, params
from jgait.estimators.interface import with_measures
from jgait.filtering.execution import Execution

LENGTHS = ("filter", "3d", "sl1", "sl2")
DETECTORS = ("swings", "machine", "paper")
SITES = ("auto", "ankle", "shank")


class AnkleParams(NamedTuple):
    """Parameters of the ankle's estimator, in natural units; the same for both legs.

    Attributes:
        lever_ankle: height over the ankle of a sensor worn at the ankle [m], before the walk tells more.
        lever_shank: the same of a sensor at mid shank [m].
        lever_forward: how far the sensor is in front of the ankle [m].
        lever_left: how far it is to the left of it [m].
        lever_along_sd: standard deviation of the height over the ankle [m].
        lever_across_sd: of the other two [m].
        cutoff_hz: of the low-pass, both ways, on the signals that are integrated [Hz].
        velocity_noise: standard deviation of the ankle's zero velocity around a valley [m/s].
        rate_noise: by how much that grows with the shank's rate [m/s per rad/s].
        acc_noise: root of the spectral density of the accelerometer's error [m/s²/√Hz].
        gyr_noise: the same of the gyroscope's [rad/s/√Hz].
        acc_jump_noise: error of the specific force over its change from sample to sample [1].
        gyr_jump_noise: the same of the angular rate [1].
        acc_bias_walk: root of the spectral density of the accelerometer bias's walk [m/s²·√Hz].
        gyr_bias_walk: the same of the gyroscope's [rad/s·√Hz].
        acc_bias: standard deviation of the accelerometer's bias at the start [m/s²].
        gyr_bias: of the gyroscope's, after standing [rad/s].
        gyr_bias_unknown: of the gyroscope's, without any standing [rad/s].
        sway: by how much a leg turns unseen while it is taken to stand still [rad].
        tilt: of the attitude at the first stance [rad].
        height_noise: of level ground from one stance to the next [m]; where `AnkleOptions.level` says it is level.
        stride_noise: error of a stride that the model knows nothing of [m]; enters the stated deviations only.
        leg_length: of the pendulum [m]; "sl1" and "sl2" only.
        angle_gain: of the swing's angle [1]; "sl2" only.
        time_gain: of the angle over the swing's time [s]; "sl2" only.
    """

    lever_ankle: Any = 0.03
    lever_shank: Any = 0.18
    lever_forward: Any = 0.0
    lever_left: Any = 0.0
    lever_along_sd: Any = 0.02
    lever_across_sd: Any = 0.01
    cutoff_hz: Any = 8.0
    velocity_noise: Any = 0.02
    rate_noise: Any = 0.02
    acc_noise: Any = 0.02
    gyr_noise: Any = 0.002
    acc_jump_noise: Any = 0.02
    gyr_jump_noise: Any = 0.005
    acc_bias_walk: Any = 1e-4
    gyr_bias_walk: Any = 1e-5
    acc_bias: Any = 0.1
    gyr_bias: Any = 1e-3
    gyr_bias_unknown: Any = 0.02
    sway: Any = 1.5e-3
    tilt: Any = 0.05
    height_noise: Any = 0.02
    stride_noise: Any = 0.012
    leg_length: Any = 0.85
    angle_gain: Any = 1.0
    time_gain: Any = 0.0


_OWN = {
    "lever_ankle": params.interval(-0.05, 0.2),
    "lever_shank": params.interval(0.0, 0.4),
    "lever_forward": params.interval(-0.15, 0.15),
    "lever_left": params.interval(-0.15, 0.15),
    "cutoff_hz": params.interval(1.0, 12.0),
    "time_gain": params.real,
}

TRANSFORMS = AnkleParams(**{name: _OWN.get(name, params.positive) for name in AnkleParams._fields})
"""The range of every parameter."""


class AnkleOptions(NamedTuple):
    """Which parts are on.

    Attributes:
        length: "filter": the error-state filter; "3d": strapdown from stance to stance; "sl1", "sl2":
            pendulum. Only the filter states standard deviations.
        detector: "swings": lobes of the rate filtered both ways; "machine": the paper's state machine that knows a foot
            which stops; "paper": the machine as printed.
        site: "ankle", "shank", or "auto": the ankle's sensor where there is one, else the shank's.
        smooth: Rauch–Tung–Striebel smoothing (offline).
        level: the ground is level, and the filter knows it.
        standing: the gyroscope's bias is read where the leg stands still; False leaves it to the filter alone.
        method: how the filter linearises, see `jgait.filtering`.
        execution: how the filter computes, see `jgait.filtering`.
    """

    length: str = "filter"
    detector: str = "swings"
    site: str = "auto"
    smooth: bool = True
    level: bool = False
    standing: bool = True
    method: Any = filtering.EKF()
    execution: Execution = "dense"


DEFAULT = AnkleOptions()
"""The best pipeline."""


def check_options(options: AnkleOptions) -> None:
    """Refuse options that are none.

    Raises:
        ValueError: naming what there is and what came.
    """
    for name, known in (("length", LENGTHS), ("detector", DETECTORS), ("site", SITES)):
        if getattr(options, name) not in known:
            raise ValueError(f"{name} must be one of {', '.join(known)}; got {getattr(options, name)!r}")


MEASURES = ("lever_ankle", "lever_shank", "leg_length")
"""Parameters that are measures of a person."""


def with_body(p: AnkleParams, body: dict[str, Any]) -> AnkleParams:
    """The parameters with a person's own measures put in.

    Args:
        p: parameters.
        body: "lever_ankle", "lever_shank" or "leg_length" [m], as far as known; a pair (right, left) counts as its
            mean.

    Raises:
        ValueError: if it names anything else.
    """
    return with_measures("the ankle's estimator", MEASURES, p, body)
