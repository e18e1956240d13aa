"""What the duty-cycled filters are told and tell, by name: parameters, options, inputs, states, estimates."""

from typing import Annotated, NamedTuple

import numpy as np

from jgait import filtering
from jgait.estimators.axes import Held, Sampled, Times
from jgait.estimators.leg_ekf.inputs import Segment
from jgait.filtering.execution import Execution
from jgait.geometry.vectors import GRAVITY
from jgait.params import Param, Parameter, documented, interval, positive, ranges
from jgait.types import Counts, Values


@documented
class DutyParams(NamedTuple):
    """Parameters of the thigh's and the shin's filter, in natural units."""

    thigh_length: Annotated[Param, Parameter(interval(0.2, 0.7), "m", "hip to knee")] = 0.43
    thigh_sensor: Annotated[Param, Parameter(interval(0.02, 0.7), "m", "d_s1, hip to the thigh's sensor")] = 0.215
    shank_sensor: Annotated[Param, Parameter(interval(0.02, 0.7), "m", "d_s2, knee to the shin's sensor")] = 0.215
    angle_noise: Annotated[Param, Parameter(
        positive, "rad²/s³", "σ of the angles, spectral density of the angular acceleration",
    )] = 100.0  # fmt: skip
    acceleration_noise: Annotated[Param, Parameter(
        positive, "m²/s⁵", "σ of the positions, spectral density of the jerk",
    )] = 1e5  # fmt: skip
    bias_noise: Annotated[Param, Parameter(
        positive, "m²/s³", "σ of the velocity bias, spectral density of its random walk",
    )] = 1e-10  # fmt: skip
    gyro_noise: Annotated[Param, Parameter(
        positive, "1", "multiplies R, the gyroscope's variance while standing",
    )] = 1.0  # fmt: skip
    joint_acceleration: Annotated[Param, Parameter(
        positive, "m/s²", "standard deviation of the joint's own acceleration, which the model leaves out",
    )] = GRAVITY  # fmt: skip
    standing_acceleration: Annotated[Param, Parameter(
        positive, "m/s²", "standard deviation of accelerations about 0 while standing",
    )] = 0.1  # fmt: skip
    position_closure: Annotated[Param, Parameter(
        positive, "m", "standard deviation of the sensor's position about the rigid link's",
    )] = 0.03  # fmt: skip
    velocity_closure: Annotated[Param, Parameter(positive, "m/s", "the same of its velocity")] = 0.03
    swing_noise: Annotated[Param, Parameter(
        positive, "rad √s",
        "how far the segment swings from the vertical, as white noise; used while its gyroscope is off, so "
        "that no gap turns it over",
    )] = 0.13  # fmt: skip


TRANSFORMS = ranges(DutyParams())
"""The range of every parameter."""


class DutyOptions(NamedTuple):
    """How the filters run.

    Attributes:
        gravity: use the accelerometers; without them angles come from the gyroscopes alone and drift.
        smooth: Rauch–Tung–Striebel smoothing (offline).
        method: how the filters linearise, see `jgait.filtering`.
        execution: how they compute, see `jgait.filtering`.
    """

    gravity: bool = True
    smooth: bool = False
    method: filtering.Method = filtering.EKF()
    execution: Execution = "auto"


DEFAULT = DutyOptions()
"""Causal, with accelerometer."""


class ThighState(NamedTuple):
    """The paper's nine states: sensor relative to hip in the sagittal plane, x downward, z forward; angle, rate.

    Attributes:
        down: x [m].
        down_velocity: ẋ [m/s].
        down_acceleration: ẍ [m/s²].
        forward: z [m].
        forward_velocity: ż [m/s].
        forward_acceleration: z̈ [m/s²].
        velocity_bias: v, by which the gyroscope falls short, as velocity of the sensor [m/s].
        angle: θ₁ from hanging straight down, positive forward [rad].
        rate: ω₁ [rad/s].
    """

    down: Values
    down_velocity: Values
    down_acceleration: Values
    forward: Values
    forward_velocity: Values
    forward_acceleration: Values
    velocity_bias: Values
    angle: Values
    rate: Values


class ShinState(NamedTuple):
    """The paper's eleven states: as `ThighState` for the shin's sensor, relative to the hip, with both angles.

    Attributes:
        down: x [m].
        down_velocity: ẋ [m/s].
        down_acceleration: ẍ [m/s²].
        forward: z [m].
        forward_velocity: ż [m/s].
        forward_acceleration: z̈ [m/s²].
        velocity_bias: v of the shin's gyroscope [m/s].
        thigh_angle: θ₁ [rad].
        thigh_rate: ω₁ [rad/s].
        angle: θ₂, of the shank from hanging straight down, positive forward [rad].
        rate: ω₂ [rad/s].
    """

    down: Values
    down_velocity: Values
    down_acceleration: Values
    forward: Values
    forward_velocity: Values
    forward_acceleration: Values
    velocity_bias: Values
    thigh_angle: Values
    thigh_rate: Values
    angle: Values
    rate: Values


class LinkParams(NamedTuple):
    """Parameters of one filter's model; units as of `DutyParams`.

    Attributes:
        thigh_length: a₁ [m]; the shin's filter only.
        lever: d, from the segment's joint to its sensor [m].
        angle_noise: [rad²/s³].
        acceleration_noise: [m²/s⁵].
        bias_noise: [m²/s³].
        position_variance: of the rigid link [m²].
        velocity_variance: of the rigid link [m²/s²].
    """

    thigh_length: Values
    lever: Values
    angle_noise: Values
    acceleration_noise: Values
    bias_noise: Values
    position_variance: Values
    velocity_variance: Values


class ThighObservation(NamedTuple):
    """What a filter of one segment can be told.

    Attributes:
        acc_up: along the segment, to its joint [m/s²].
        acc_forward: across it [m/s²].
        gyro: [rad/s].
        link_down: always 0: x minus the rigid link's [m].
        link_forward: always 0: z minus the rigid link's [m].
        link_down_velocity: always 0 [m/s].
        link_forward_velocity: always 0 [m/s].
        rest_down: always 0: ẍ, while the person stands [m/s²].
        rest_forward: always 0: z̈, while the person stands [m/s²].
        swing: always 0: the angle, while the gyroscope is off [rad].
    """

    acc_up: Values
    acc_forward: Values
    gyro: Values
    link_down: Values
    link_forward: Values
    link_down_velocity: Values
    link_forward_velocity: Values
    rest_down: Values
    rest_forward: Values
    swing: Values


class ShinObservation(NamedTuple):
    """What the shin's filter can be told: as `ThighObservation`, and what the thigh's filter found.

    Attributes:
        acc_up: [m/s²].
        acc_forward: [m/s²].
        gyro: [rad/s].
        link_down: always 0 [m].
        link_forward: always 0 [m].
        link_down_velocity: always 0 [m/s].
        link_forward_velocity: always 0 [m/s].
        rest_down: always 0 [m/s²].
        rest_forward: always 0 [m/s²].
        swing: always 0 [rad].
        thigh_angle: θ₁ [rad].
        thigh_rate: ω₁ [rad/s].
    """

    acc_up: Values
    acc_forward: Values
    gyro: Values
    link_down: Values
    link_forward: Values
    link_down_velocity: Values
    link_forward_velocity: Values
    rest_down: Values
    rest_forward: Values
    swing: Values
    thigh_angle: Values
    thigh_rate: Values


class DutyControl(NamedTuple):
    """How good the sensors are at this sample.

    Attributes:
        acc_variance: [m²/s⁴].
        rest_variance: of the accelerations while standing [m²/s⁴].
        gyro_variance: [rad²/s²].
        swing_variance: [rad²].
        thigh_angle_variance: [rad²]; the shin's filter only.
        thigh_rate_variance: [rad²/s²]; the shin's filter only.
    """

    acc_variance: Values
    rest_variance: Values
    gyro_variance: Values
    swing_variance: Values = 1.0
    thigh_angle_variance: Values = 1.0
    thigh_rate_variance: Values = 1.0


class PlanarSegment(NamedTuple):
    """One sensor's signals in the sagittal plane of its segment.

    Attributes:
        gyr: (T,) rate, positive when the distal end swings forward [rad/s]; any finite number where the gyroscope
            is off.
        acc_forward: (T,) specific force along the segment's forward axis [m/s²].
        acc_up: (T,) specific force along its axis to the proximal end, +g standing [m/s²].
        measured: (T,) bool, the sample arrived.
        gyro_on: (T,) bool, the gyroscope was on and awake, or its sample has been filled.
        excess: (T,) variance of the rate beyond the gyroscope's own [rad²/s²]; 0 where it was measured.
        bias: gyroscope bias at rest [rad/s].
        variance: gyroscope variance at rest [rad²/s²].
    """

    gyr: Sampled
    acc_forward: Sampled
    acc_up: Sampled
    measured: Sampled
    gyro_on: Sampled
    excess: Sampled
    bias: Values
    variance: Values


class DutyInputs(NamedTuple):
    """All that `duty_cycled_gyro.model.run` needs; every leaf is an array, so that inputs pad, stack and vmap.

    Attributes:
        thigh: the thigh's sensor, or None.
        shank: the shin's sensor, or None.
        time: (T,) [s].
        dt: (T,) time from the sample before [s]; 0 at the first.
        still: (T,) bool, the person stands.
        valid: (T,) bool, False for padding.
        start_variance: of the angles at the first sample [rad²]; small when the recording starts standing.
    """

    thigh: PlanarSegment | None
    shank: PlanarSegment | None
    time: Times
    dt: Held
    still: Sampled
    valid: Sampled
    start_variance: Values


class SegmentEstimate(NamedTuple):
    """One segment over time.

    Attributes:
        angle: (T,) from hanging straight down, positive when the distal end is forward [rad].
        rate: (T,) its rate, the gyroscope's bias taken out [rad/s].
        angle_stddev: (T,) [rad].
        rate_stddev: (T,) [rad/s].
        gyro: (T,) what the gyroscope would read, bias included [rad/s].
        nis: (T,) normalised innovation squared.
        count: (T,) observations used.
        log_likelihood: (T,) [nat].
        valid: (T,) bool, False where the numbers broke down and the prediction was kept.
    """

    angle: Values
    rate: Values
    angle_stddev: Values
    rate_stddev: Values
    gyro: Values
    nis: Values
    count: Counts
    log_likelihood: Values
    valid: Sampled


class DutyEstimate(NamedTuple):
    """What the filters found; a segment that was not worn is None."""

    thigh: SegmentEstimate | None
    shank: SegmentEstimate | None


def planar(segment: Segment, gyro_on: Values | None = None, excess: Values | None = None) -> PlanarSegment:
    """The sagittal plane of a leg's segment, as `mounting.leg` gives it, under a gyroscope mask.

    Args:
        segment: in segment axes (forward, left, up).
        gyro_on: (T,) bool, see `PlanarSegment`; None: always.
        excess: (T,) see `PlanarSegment` [rad²/s²]; None: none.

    Raises:
        ValueError: if a mask does not have the length of the signals.
    """
    samples = segment.gyr.shape[0]
    for name, values in (("gyro_on", gyro_on), ("excess", excess)):
        if values is not None and np.shape(values) != (samples,):
            raise ValueError(f"{name} must have shape ({samples},), one for each sample; got {np.shape(values)}")
    return PlanarSegment(
        -segment.gyr[:, 1],
        segment.acc[:, 0],
        segment.acc[:, 2],
        segment.measured,
        np.ones(samples, bool) if gyro_on is None else gyro_on,
        np.zeros(samples, segment.gyr.dtype) if excess is None else excess,
        -segment.bias[1],
        segment.variance,
    )
