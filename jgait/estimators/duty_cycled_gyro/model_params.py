"""Inputs, states and estimates of the duty-cycled filters."""

from typing import NamedTuple

from jgait.estimators.interface import Held, Sampled, Times
from jgait.types import Counts, Values


class ThighState(NamedTuple):
    """The paper's nine states: sensor relative to hip in the sagittal plane, x downward, z forward; angle, rate.

    Positions are in m, with two derivatives each; the velocity bias is v = −d b [m/s], with gyroscope bias b and
    distance d of the sensor from the joint; the angle is θ₁ from hanging straight down, positive forward [rad], the
    rate ω₁ [rad/s].
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
    """The paper's eleven states: those of the shin's sensor relative to the hip, and the thigh's angle and rate."""

    shin: ThighState  #: its angle θ₂ and rate ω₂ are those of the shank.
    thigh_angle: Values  #: θ₁ [rad].
    thigh_rate: Values  #: ω₁ [rad/s].


class LinkParams(NamedTuple):
    """Parameters of the model of one filter, see `DutyCycledParams`."""

    thigh_length: Values  #: a₁ [m]; the shin's filter only.
    lever: Values  #: d, from the segment's joint to its sensor [m].
    angle_noise: Values  #: spectral density of the angular acceleration [rad²/s³].
    acceleration_noise: Values  #: spectral density of the jerk [m²/s⁵].
    bias_noise: Values  #: spectral density of the random walk of the velocity bias [m²/s³].
    position_variance: Values  #: variance of the sensor's position about the rigid link [m²].
    velocity_variance: Values  #: variance of the sensor's velocity about the rigid link [m²/s²].


class ThighObservation(NamedTuple):
    """Observations of a filter of one segment."""

    acc_up: Values  #: specific force along the segment, to its joint [m/s²].
    acc_forward: Values  #: specific force across the segment, forward [m/s²].
    gyro: Values  #: sagittal rate of the gyroscope [rad/s].
    link_down: Values  #: x minus that of the rigid link, observed as 0 [m]; the next three: z, ẋ and ż likewise.
    link_forward: Values
    link_down_velocity: Values
    link_forward_velocity: Values
    rest_down: Values  #: ẍ, observed as 0 while the person stands [m/s²]; `rest_forward`: z̈ likewise.
    rest_forward: Values
    swing: Values  #: the angle, observed as 0 while the gyroscope is off [rad].


class ShinObservation(NamedTuple):
    """Observations of the shin's filter: those of its segment, and the estimates of the thigh's filter."""

    shin: ThighObservation
    thigh_angle: Values  #: θ₁ [rad].
    thigh_rate: Values  #: ω₁ [rad/s].


class DutyControl(NamedTuple):
    """Variances of the observations at this sample.

    Of specific force and of accelerations while standing [m²/s⁴], of the gyroscope [rad²/s²], of the angle as
    observation of the vertical [rad²], and, for the shin's filter only, of the thigh's angle [rad²] and rate [rad²/s²].
    """

    acc_variance: Values
    rest_variance: Values
    gyro_variance: Values
    swing_variance: Values = 1.0
    thigh_angle_variance: Values = 1.0
    thigh_rate_variance: Values = 1.0


class PlanarSegment(NamedTuple):
    """One sensor's signals in the sagittal plane of its segment."""

    #: (T,) rate, positive when the distal end swings forward [rad/s]; any finite number where the gyroscope is off.
    gyr: Sampled
    acc_forward: Sampled  #: (T,) specific force along the segment's forward axis [m/s²].
    acc_up: Sampled  #: (T,) specific force along the segment to the proximal end, +g in standing [m/s²].
    measured: Sampled  #: (T,) bool, the accelerometer's sample arrived.
    gyro_on: Sampled  #: (T,) bool, the gyroscope was on and awake, or its sample has been filled.
    excess: Sampled  #: (T,) variance of the rate in addition to the gyroscope's [rad²/s²], see `excess`.
    bias: Values  #: gyroscope bias at rest [rad/s].
    variance: Values  #: gyroscope variance at rest [rad²/s²].


class DutyInputs(NamedTuple):
    """Inputs of `duty_cycled_gyro.model.run`: a leg's segments with a sensor; other fields as `LegInputs`."""

    thigh: PlanarSegment | None
    shank: PlanarSegment | None
    time: Times
    dt: Held
    still: Sampled
    valid: Sampled
    start_variance: Values


class SegmentEstimate(NamedTuple):
    """Estimates of one segment over time."""

    angle: Values  #: (T,) from hanging straight down, positive when the distal end is forward [rad].
    rate: Values  #: (T,) rate of the angle, without gyroscope bias [rad/s].
    angle_stddev: Values  #: (T,) standard deviation of the angle [rad].
    rate_stddev: Values  #: (T,) standard deviation of the rate [rad/s].
    gyro: Values  #: (T,) predicted gyroscope signal, bias included [rad/s].
    nis: Values  #: (T,) normalised innovation squared.
    count: Counts  #: (T,) observations used.
    log_likelihood: Values  #: (T,) [nat].
    valid: Sampled  #: (T,) bool, False where an update was not finite and the prediction was kept.


class DutyEstimate(NamedTuple):
    """Estimates of both segments; None for a segment without a sensor."""

    thigh: SegmentEstimate | None
    shank: SegmentEstimate | None
