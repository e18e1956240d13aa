"""Parameters of `duty_cycled_gyro` with their ranges, options, inputs, and records of its filters."""

from typing import Annotated, NamedTuple

from jgait import filtering
from jgait.duty_cycle.fillers import NEIGHBOURS
from jgait.duty_cycle.power import GYROSCOPE, Schedule, Sensor
from jgait.duty_cycle.recording import check_filler
from jgait.estimators.interface import Held, Sampled, Times, with_measures
from jgait.estimators.leg_ekf import params as leg_params
from jgait.estimators.leg_ekf.params import BySide
from jgait.geometry.vectors import GRAVITY
from jgait.notes import record
from jgait.params import Param, Parameter, documented, interval, positive
from jgait.types import Counts, Measures, Values


@documented
@record
class DutyCycledParams(NamedTuple):
    """Parameters of `duty_cycled_gyro`, in natural units."""

    thigh_length: Annotated[Param, Parameter(interval(0.2, 0.7), "m", "hip to knee")] = BySide(0.43, 0.43)
    shank_length: Annotated[Param, Parameter(interval(0.2, 0.7), "m", "knee to ankle")] = BySide(0.43, 0.43)
    thigh_place: Annotated[Param, Parameter(interval(0.05, 1.0), "1", "sensor: 0 at the hip, 1 at the knee")] = 0.5
    shank_place: Annotated[Param, Parameter(interval(0.05, 1.0), "1", "sensor: 0 at the knee, 1 at the ankle")] = 0.5
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
        positive, "1", "factor on R, the variance of the gyroscope while standing",
    )] = 1.0  # fmt: skip
    joint_acceleration: Annotated[Param, Parameter(
        positive, "m/s²", "standard deviation of the joint's acceleration, which the model does not contain",
    )] = GRAVITY  # fmt: skip
    standing_acceleration: Annotated[Param, Parameter(
        positive, "m/s²", "standard deviation of accelerations about 0 while standing",
    )] = 0.1  # fmt: skip
    position_closure: Annotated[Param, Parameter(
        positive, "m", "standard deviation of the sensor's position about that of the rigid link",
    )] = 0.03  # fmt: skip
    velocity_closure: Annotated[Param, Parameter(positive, "m/s", "the same for the velocity")] = 0.03
    swing_noise: Annotated[Param, Parameter(
        positive, "rad √s",
        "swing of the segment about the vertical, as white noise; keeps the segment upright while its gyroscope "
        "is off",
    )] = 0.13  # fmt: skip
    turn_tilt: Annotated[Param, Parameter(
        positive, "rad", "sideways tilt of the segment in turns, by which the gyroscope's axis measures a part of the "
        "turn",
    )] = 0.2  # fmt: skip
    filled_noise: Annotated[Param, Parameter(
        positive, "rad/√s",
        "white noise of a filled rate, beyond the gyroscope's, at a distance of 1; its variance grows with distance",
    )] = 0.5  # fmt: skip
    standing_hip_sd: Annotated[Param, Parameter(
        positive, "rad", "standard deviation of the hip angle in standing; used for the stated errors only",
    )] = leg_params.LegParams().standing_hip_sd  # fmt: skip
    standing_knee_sd: Annotated[Param, Parameter(
        positive, "rad", "standard deviation of the knee angle in standing; used for the stated errors only",
    )] = leg_params.LegParams().standing_knee_sd  # fmt: skip
    filler: Annotated[Values, Parameter(None, "", "parameters of the filler")] = NEIGHBOURS


@record
class DutyCycledOptions(NamedTuple):
    """Which parts of the method are used.

    Attributes:
        filler: name of the method that fills gaps, see `duty_cycle.fillers`.
        schedule: hides samples of shanks while the gyroscope is off, a `power.Schedule` or duty cycle [1]; None: none.
        warm_up: time for which the gyroscopes are on before the schedule starts [s]; fillers need two measured strides.
        above: use the signals of the thigh in the filler of the shank, if the thigh has a sensor.
        gyroscope: power and wake-up time of a gyroscope.
        sampling_rate_hz: sampling rate [Hz]; set by `prepared`, as are `gaps` and `accelerometers`.
        gaps: True if any sample of a gyroscope is missing.
        accelerometers: True if every sensor has one; otherwise angles come from the gyroscopes alone and drift.
        method: how the filters linearise, see `jgait.filtering`.
    """

    filler: str = "neighbours"
    schedule: Schedule | float | None = None
    warm_up: float = 0.0
    above: bool = True
    gyroscope: Sensor = GYROSCOPE
    sampling_rate_hz: float = 50.0
    gaps: bool = True
    accelerometers: bool = True
    method: filtering.Method = filtering.EKF()


DEFAULT = DutyCycledOptions()
"""The default pipeline: the filters with their misprints corrected, and the filler "neighbours"."""

PAPER = DutyCycledOptions(filler="replicate", above=False)
"""The paper's filler, which repeats the last cycle."""


def params_of(options: DutyCycledOptions) -> DutyCycledParams:
    """The default parameters, with those of the options' filler."""
    return DutyCycledParams(filler=check_filler(options.filler).params)


def with_body(p: DutyCycledParams, body: Measures) -> DutyCycledParams:
    """The parameters with a person's segment lengths, see `leg_ekf.params.with_body`; relative sensor places stay."""
    return with_measures("the estimator for sleeping gyroscopes", leg_params.MEASURES, p, body)


def levers(p: DutyCycledParams) -> tuple[Values, Values]:
    """The distances of the thigh's sensor from the hip and of the shank's from the knee, d_s1 and d_s2 [m]."""
    return p.thigh_place * p.thigh_length, p.shank_place * p.shank_length


class GapSegment(NamedTuple):
    """One sensor's signals in its segment's axes (forward, left, up)."""

    #: (T,) sagittal rate, positive when the distal end swings forward [rad/s]; 0 while the gyroscope is off.
    gyr: Sampled
    turn: Sampled  #: (T,) rate about the segment's long axis, without bias [rad/s]; 0 while the gyroscope is off.
    acc: Held  #: (T, 3) specific force [m/s²]; zeros without an accelerometer.
    on: Sampled  #: (T,) bool, the gyroscope was on and awake, and its sample arrived.
    acc_measured: Sampled  #: (T,) bool, the accelerometer's sample arrived.
    bias: Values  #: gyroscope bias at rest [rad/s].
    variance: Values  #: gyroscope variance at rest [rad²/s²].


class GapLeg(NamedTuple):
    """Thigh and shank of one leg; None for a segment without a sensor."""

    thigh: GapSegment | None
    shank: GapSegment | None


@record
class DutyCycledInputs(NamedTuple):
    """Inputs of `duty_cycled_gyro.run`; fields as those of `leg_ekf.inputs.LegInputs`."""

    right: GapLeg | None
    left: GapLeg | None
    time: Times
    dt: Sampled
    still: Sampled
    valid: Sampled
    start_variance: Values


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
    excess: Sampled  #: (T,) variance of the rate in addition to the gyroscope's [rad²/s²], see `model.excess`.
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
