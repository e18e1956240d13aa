"""Parameters and options of the waist's estimator, with their units and ranges."""

import math
from typing import Annotated, NamedTuple

import jax
from jaxtyping import PyTree

from jgait import filtering
from jgait.estimators.proportions import HEIGHTS, SENSOR_SD, SENSOR_SHARE, in_metres, outside
from jgait.events.trunk import PaperRule, Peaks, Soft
from jgait.notes import record
from jgait.params import Param, Parameter, documented, fixed, interval, positive
from jgait.types import Measures, Values

DETECTORS: dict[str, Soft | Peaks | PaperRule] = {"soft": Soft(), "paper": PaperRule()}
"""Detector of initial contacts → its settings, see `events.trunk`."""
SITES = ("waist", "lower_back", "pelvis")
"""Placements; the first that the recording has is used."""


@documented
class VelocityUpdateParams(NamedTuple):
    """Parameters of the velocity update, in natural units."""

    threshold: Annotated[Param, Parameter(
        positive, "m/s", "ε, the least change over a cycle that is taken for a change of speed",
    )] = 0.3  # fmt: skip
    highest_hz: Annotated[Param, Parameter(fixed, "Hz", "f_max of the optimum rule")] = 1.0
    beta: Annotated[Param, Parameter(positive, "1", "β of OFDRI's weight")] = 0.1


@documented
@record
class WaistParams(NamedTuple):
    """Parameters of the waist's estimator, in natural units."""

    gyr_noise: Annotated[Param, Parameter(
        positive, "rad/s/√Hz", "root of the spectral density of the gyroscope's error",
    )] = 1e-3  # fmt: skip
    gyr_bias: Annotated[Param, Parameter(
        positive, "rad/s", "standard deviation of the gyroscope's bias about its mean reading at rest",
    )] = 3e-3  # fmt: skip
    gyr_bias_walk: Annotated[Param, Parameter(
        positive, "rad/s·√Hz", "root of the spectral density of the random walk of the gyroscope's bias",
    )] = 1e-5  # fmt: skip
    sensor_bias: Annotated[Param, Parameter(
        positive, "m/s²", "standard deviation of the accelerometer's bias along each axis",
    )] = 0.3  # fmt: skip
    sensor_bias_walk: Annotated[Param, Parameter(
        positive, "m/s²·√Hz", "root of the spectral density of the random walk of the accelerometer's bias",
    )] = 1e-4  # fmt: skip
    acc_noise: Annotated[Param, Parameter(
        positive, "m/s²/√Hz",
        "root of the spectral density of the specific force about gravity while walking; `acc_noise` / "
        "(`gyr_noise` · g) is the time in seconds after which gravity determines the tilt",
    )] = 0.15  # fmt: skip
    standing_noise: Annotated[Param, Parameter(positive, "m/s²/√Hz", "`acc_noise` while standing")] = 0.01
    heading_hz: Annotated[Param, Parameter(
        interval(0.05, 1.0), "Hz", "turns slower than this belong to the walk, faster ones to the trunk",
    )] = 0.35  # fmt: skip
    excursion_hz: Annotated[Param, Parameter(
        interval(0.05, 1.0), "Hz", "cut-off of the high-pass on the height of the trunk",
    )] = 0.5  # fmt: skip
    pendulum_length: Annotated[Param, Parameter(interval(0.3, 1.6), "m", "height of the sensor above ground")] = 0.97
    pendulum_length_sd: Annotated[Param, Parameter(
        positive, "m", "standard deviation of `pendulum_length`; smaller where `with_body` gets a measure",
    )] = 0.06  # fmt: skip
    pendulum_constant: Annotated[Param, Parameter(
        positive, "1",
        "K, length of a step over that of the pendulum, of a person about whom nothing is known: the mean of 25 people "
        "of `ipol_gait`, `mobgap_lab`, `tripod` and `walking5m`, whose sets have 1.10 to 1.25",
    )] = 1.18  # fmt: skip
    pendulum_constant_sd: Annotated[Param, Parameter(
        positive, "1", "standard deviation of log K among these people, and of a set about all",
    )] = 0.1  # fmt: skip
    start_gain: Annotated[Param, Parameter(
        positive, "1",
        "length of the first two steps after standing and gait initiation by integration over K times the pendulum's; "
        "on `ipol_gait` and `walking5m` alike",
    )] = 0.92  # fmt: skip
    start_noise: Annotated[Param, Parameter(
        positive, "1",
        "standard deviation of the logarithm of that ratio, one half of its variance white from one start of a person "
        "to the next; on the same 22 people",
    )] = 0.06  # fmt: skip
    excursion_power: Annotated[Param, Parameter(
        interval(0.0, 2.0), "1", "α, exponent of the chord of the inverted pendulum in the step length",
    )] = 0.6  # fmt: skip
    surge_power: Annotated[Param, Parameter(
        interval(-1.0, 2.0), "1", "β, exponent of the change of speed within a step in the step length",
    )] = 0.1  # fmt: skip
    turn_shortening: Annotated[Param, Parameter(
        positive, "1/rad", "by how much a step is shorter than the pendulum's for each radian of turn",
    )] = 0.5  # fmt: skip
    step_noise: Annotated[Param, Parameter(
        positive, "m", "standard deviation of the pendulum's step length, white from step to step",
    )] = 0.03  # fmt: skip
    turn_noise: Annotated[Param, Parameter(
        positive, "m/rad", "increase of `step_noise` with the turn over the step",
    )] = 0.3  # fmt: skip
    edge_noise: Annotated[Param, Parameter(
        positive, "m", "standard deviation of the pendulum's step length next to standing",
    )] = 0.2  # fmt: skip
    speed_noise: Annotated[Param, Parameter(
        positive, "m/s²/√Hz", "root of the spectral density of the forward acceleration's error",
    )] = 0.3  # fmt: skip
    acc_bias: Annotated[Param, Parameter(
        positive, "m/s²", "standard deviation of the forward acceleration's bias after standing",
    )] = 0.1  # fmt: skip
    acc_bias_unknown: Annotated[Param, Parameter(positive, "m/s²", "`acc_bias` without any standing")] = 0.3
    acc_bias_walk: Annotated[Param, Parameter(
        positive, "m/s²·√Hz", "root of the spectral density of the random walk of the forward acceleration's bias",
    )] = 0.02  # fmt: skip
    acc_bias_turn: Annotated[Param, Parameter(
        positive, "m/s²", "largest change of the forward acceleration's bias in turning round",
    )] = 0.3  # fmt: skip
    start_speed: Annotated[Param, Parameter(
        positive, "m/s", "speed at the start of walking that does not begin from standing",
    )] = 1.1  # fmt: skip
    start_speed_sd: Annotated[Param, Parameter(positive, "m/s", "standard deviation of `start_speed`")] = 0.4
    standing_speed: Annotated[Param, Parameter(
        positive, "m/s", "standard deviation of the speed while standing",
    )] = 0.03  # fmt: skip
    update: Annotated[VelocityUpdateParams, Parameter(
        None, "", "parameters of the velocity update, see `VelocityUpdateParams`",
    )] = VelocityUpdateParams()  # fmt: skip


class WaistOptions(NamedTuple):
    """The parts of the method that are used.

    Attributes:
        distance: "fused": the state-space model over speed, bias and pendulum; "update": the paper's method (direct and
            reverse integration with the velocity update).
        detector: of initial contacts, see `events.trunk`: "soft" or "paper".
        smooth: Rauch–Tung–Striebel smoothing (offline).
        method: how the filter linearises, see `jgait.filtering`.
    """

    distance: str = "fused"
    detector: str = "soft"
    smooth: bool = True
    method: filtering.Method = filtering.EKF()


DEFAULT = WaistOptions()
"""The default pipeline, the most accurate one."""

PAPER = WaistOptions(distance="update", detector="paper")
"""The paper's pipeline, as `events.trunk` and `velocity_update` read it."""


KNOWN = {"distance": ("fused", "update"), "detector": DETECTORS}
"""Option → its allowed values."""

TAPE_SD = 0.01
"""[m] Standard deviation of the sensor's height where it was measured with a tape. Chosen by hand."""


def with_body(p: WaistParams, body: Measures) -> WaistParams:
    """The parameters with a person's body measures: any of "sensor_height" [m], "height" [m] and "pendulum_constant"
    [1].

    Raises:
        ValueError: another name, a measure that is not positive, or a height outside `HEIGHTS`.
    """
    body, known = in_metres(body), ("sensor_height", "height", "pendulum_constant")
    unknown = [name for name in body if name not in known]
    if unknown:
        raise ValueError(f"the waist's estimator takes {', '.join(known)} of a person; got {unknown[0]!r}")

    def measure(name: str) -> PyTree:
        value: Values = body[name]
        if isinstance(value, jax.Array):
            return value
        if name == "height" and (wrong := outside(name, value, *HEIGHTS)):
            raise ValueError(wrong)
        if not (math.isfinite(value) and value > 0.0):
            raise ValueError(f"{name} must be finite and positive; got {value}: leave out what is unknown")
        return float(value)

    if "height" in body:
        p = p._replace(pendulum_length=SENSOR_SHARE * measure("height"), pendulum_length_sd=SENSOR_SD)
    if "sensor_height" in body:
        p = p._replace(pendulum_length=measure("sensor_height"), pendulum_length_sd=TAPE_SD)  # [m] of a measured height
    if "pendulum_constant" in body:
        # [1] of log K among walks of one person of `ipol_gait`
        p = p._replace(pendulum_constant=measure("pendulum_constant"), pendulum_constant_sd=0.02)
    return p
