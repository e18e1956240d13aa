"""Parameters and options of the waist's estimator, with their units and ranges."""

import math
from typing import Any, NamedTuple

import jax

from jgait import params
from jgait.estimators.waist.velocity_update import VelocityUpdateParams
from jgait.events.trunk import LITERAL, PaperRule, Peaks
from jgait.events.trunk_soft import Soft
from jgait.filtering.execution import Execution

DISTANCES = ("fused", "pendulum", "update")
DETECTORS = {"soft": Soft(), "peaks": Peaks(), "paper": PaperRule(), "literal": LITERAL}
SITES = ("auto", "waist", "lower_back", "pelvis")


class WaistParams(NamedTuple):
    """Parameters of the waist's estimator, in natural units.

    Attributes:
        gyr_noise: root of the spectral density of the gyroscope's error [rad/s/√Hz].
        gyr_bias: standard deviation of the gyroscope's bias about what it reads at rest [rad/s].
        gyr_bias_walk: root of the spectral density of its walk [rad/s·√Hz].
        sensor_bias: standard deviation of the accelerometer's bias along each axis [m/s²].
        sensor_bias_walk: root of the spectral density of its walk [m/s²·√Hz].
        acc_noise: the same of the specific force about gravity while walking [m/s²/√Hz]; over `gyr_noise` · g it is
            the time [s] after which tilt is gravity's.
        standing_noise: the same while standing [m/s²/√Hz].
        heading_hz: slower turns than this are of the walk, faster ones of the trunk [Hz].
        excursion_hz: of the high-pass on the height of the trunk [Hz].
        pendulum_length: of the sensor above the ground [m].
        pendulum_constant: K, length of a step over that of the pendulum's [1].
        pendulum_constant_sd: standard deviation of its logarithm among people [1].
        excursion_power: α, how a step grows with the chord of the inverted pendulum [1].
        surge_power: β, how it grows with the change of speed within it [1].
        turn_shortening: how much shorter than the pendulum's a step is that turns, for every radian [1/rad].
        step_noise: error of the pendulum's step, white from step to step [m].
        turn_noise: by how much that grows with the turn over the step [m/rad].
        edge_noise: error of the pendulum's step in setting off from standing and in stopping [m].
        speed_noise: root of the spectral density of the forward acceleration's error [m/s²/√Hz].
        acc_bias: standard deviation of the forward acceleration's bias after standing [m/s²].
        acc_bias_unknown: the same without any standing [m/s²].
        acc_bias_walk: root of the spectral density of its walk [m/s²·√Hz].
        acc_bias_turn: by how much it changes, at most, in turning round [m/s²].
        start_speed: of walking where it begins otherwise than from standing [m/s].
        start_speed_sd: its standard deviation [m/s].
        standing_speed: standard deviation of the speed while standing [m/s].
        update_noise: of the mean speed that the velocity update gives, over a whole bout [m/s]; "fused" only.
        update: of the velocity update, see `VelocityUpdateParams`.
    """

    gyr_noise: Any = 1e-3
    gyr_bias: Any = 3e-3
    gyr_bias_walk: Any = 1e-5
    sensor_bias: Any = 0.3
    sensor_bias_walk: Any = 1e-4
    acc_noise: Any = 0.15
    standing_noise: Any = 0.01
    heading_hz: Any = 0.35
    excursion_hz: Any = 0.5
    pendulum_length: Any = 0.97
    pendulum_constant: Any = 1.36
    pendulum_constant_sd: Any = 0.05
    excursion_power: Any = 0.8
    surge_power: Any = 0.1
    turn_shortening: Any = 0.35
    step_noise: Any = 0.03
    turn_noise: Any = 0.4
    edge_noise: Any = 0.2
    speed_noise: Any = 0.6
    acc_bias: Any = 0.1
    acc_bias_unknown: Any = 0.3
    acc_bias_walk: Any = 0.02
    acc_bias_turn: Any = 0.3
    start_speed: Any = 1.1
    start_speed_sd: Any = 0.4
    standing_speed: Any = 0.03
    update_noise: Any = 0.3
    update: VelocityUpdateParams = VelocityUpdateParams()


_OWN: dict[str, Any] = {
    "heading_hz": params.interval(0.05, 1.0),
    "excursion_hz": params.interval(0.05, 1.0),
    "pendulum_length": params.interval(0.3, 1.6),
    "excursion_power": params.interval(0.0, 2.0),
    "surge_power": params.interval(-1.0, 2.0),
    "update": VelocityUpdateParams(
        threshold=params.positive, width=params.positive, cutoff_hz=params.fixed, highest_hz=params.fixed,
        beta=params.positive,
    ),
}  # fmt: skip

TRANSFORMS = WaistParams(**{name: _OWN.get(name, params.positive) for name in WaistParams._fields})
"""The range of every parameter."""


class WaistOptions(NamedTuple):
    """Which parts are on.

    Attributes:
        distance: "fused": the state-space model over speed, bias and pendulum; "pendulum": the pendulum's steps alone;
            "update": the paper's (direct and reverse integration with the velocity update).
        detector: of initial contacts, see `trunk_events`: "soft", "peaks", "paper" or "literal".
        site: the placement; "auto": whichever there is.
        updated: "fused" also hears the velocity update where the walk began from standing.
        smooth: Rauch–Tung–Striebel smoothing (offline).
        execution: how the filters compute, see `jgait.filtering`.
    """

    distance: str = "fused"
    detector: str = "soft"
    site: str = "auto"
    updated: bool = False
    smooth: bool = True
    execution: Execution = "dense"


DEFAULT = WaistOptions()
"""The best pipeline."""

PAPER = WaistOptions(distance="update", detector="paper")
"""The paper's pipeline, in the readings of `trunk_events` and `velocity_update`."""


def check_options(options: WaistOptions) -> None:
    """Refuse options that are none.

    Raises:
        ValueError: naming what there is and what came.
    """
    for name, known in (("distance", DISTANCES), ("detector", tuple(DETECTORS)), ("site", SITES)):
        if getattr(options, name) not in known:
            raise ValueError(f"{name} must be one of {', '.join(known)}; got {getattr(options, name)!r}")


SENSOR_SHARE = 0.6
"""[1] Height of a sensor at the waist over a person's; two people of `mobgap_lab` have 0.606 and 0.617."""


def with_body(p: WaistParams, body: dict[str, Any]) -> WaistParams:
    """The parameters with a person's own measures put in.

    Args:
        p: parameters.
        body: "sensor_height" [m] or "height" [m], as far as known, and "pendulum_constant" [1].

    Raises:
        ValueError: if it names anything else, or a measure is not finite and positive.
    """
    known = ("sensor_height", "height", "pendulum_constant")
    unknown = [name for name in body if name not in known]
    if unknown:
        raise ValueError(f"the waist's estimator takes {', '.join(known)} of a person; got {unknown[0]!r}")

    def one(value: Any) -> Any:
        if isinstance(value, jax.Array):
            return value
        if not (math.isfinite(value) and value > 0.0):
            raise ValueError(f"a person's measures must be finite and positive; got {value}: leave out what is unknown")
        return float(value)

    if "height" in body:
        p = p._replace(pendulum_length=SENSOR_SHARE * one(body["height"]))
    if "sensor_height" in body:
        p = p._replace(pendulum_length=one(body["sensor_height"]))
    if "pendulum_constant" in body:
        p = p._replace(pendulum_constant=one(body["pendulum_constant"]))
    return p
