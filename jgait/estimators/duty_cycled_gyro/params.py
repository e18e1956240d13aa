"""What `duty_cycled_gyro` is told, by name: parameters with their ranges, options, and signals that pad and stack."""

from typing import Annotated, Any, NamedTuple

import jax

from jgait.duty_cycle.fillers.neighbours import NEIGHBOURS
from jgait.duty_cycle.power import ACCELEROMETER, GYROSCOPE, Battery, Schedule, Sensor
from jgait.duty_cycle.recording import check_filler
from jgait.estimators.axes import Held, Sampled, Times
from jgait.estimators.duty_cycled_gyro import model_params as duty_params
from jgait.estimators.duty_cycled_gyro.model_params import DutyOptions, DutyParams
from jgait.estimators.interface import with_measures
from jgait.estimators.leg_ekf import params as leg_params
from jgait.estimators.leg_ekf.params import BySide
from jgait.params import Param, Parameter, declared, documented, interval, positive, ranges
from jgait.types import Values

_USUAL = DutyParams()
_OF_FILTERS = declared(DutyParams)


@documented
class DutyCycledParams(NamedTuple):
    """Parameters of `duty_cycled_gyro`, in natural units."""

    thigh_length: Annotated[Param, Parameter(interval(0.2, 0.7), "m", "hip to knee")] = BySide(0.43, 0.43)
    shank_length: Annotated[Param, Parameter(interval(0.2, 0.7), "m", "knee to ankle")] = BySide(0.43, 0.43)
    thigh_place: Annotated[Param, Parameter(interval(0.05, 1.0), "1", "of the thigh's sensor, from hip to knee")] = 0.5
    shank_place: Annotated[Param, Parameter(
        interval(0.05, 1.0), "1", "of the shank's sensor, from knee to ankle",
    )] = 0.5  # fmt: skip
    angle_noise: Annotated[Param, _OF_FILTERS["angle_noise"]] = _USUAL.angle_noise
    acceleration_noise: Annotated[Param, _OF_FILTERS["acceleration_noise"]] = _USUAL.acceleration_noise
    bias_noise: Annotated[Param, _OF_FILTERS["bias_noise"]] = _USUAL.bias_noise
    gyro_noise: Annotated[Param, _OF_FILTERS["gyro_noise"]] = _USUAL.gyro_noise
    joint_acceleration: Annotated[Param, _OF_FILTERS["joint_acceleration"]] = _USUAL.joint_acceleration
    standing_acceleration: Annotated[Param, _OF_FILTERS["standing_acceleration"]] = _USUAL.standing_acceleration
    position_closure: Annotated[Param, _OF_FILTERS["position_closure"]] = _USUAL.position_closure
    velocity_closure: Annotated[Param, _OF_FILTERS["velocity_closure"]] = _USUAL.velocity_closure
    swing_noise: Annotated[Param, _OF_FILTERS["swing_noise"]] = _USUAL.swing_noise
    filled_noise: Annotated[Param, Parameter(
        positive, "rad/√s", "of a filled rate beyond the gyroscope's own, as white noise",
    )] = 0.1  # fmt: skip
    filler: Annotated[Values, Parameter(None, "", "parameters of the filler, see there for their units")] = NEIGHBOURS


TRANSFORMS = ranges(DutyCycledParams())
"""The range of every parameter, with the usual filler; `transforms_of` has those of another."""


class DutyCycledOptions(NamedTuple):
    """Which parts are on.

    Attributes:
        filler: of the gaps, by name, see `duty_cycle.fillers.fillers`; all but "ridge_later" are causal. The usual one
            is the best of them on a treadmill and for a shank alone; over ground with the thigh's sensor "blend" errs
            less.
        schedule: that hides samples as if asleep, a `power.Schedule` or a duty cycle [1]; None: what is masked only.
        asleep: which segments follow the schedule, "shank", "thigh" or both.
        warm_up: how long gyroscopes are on before the schedule, which is then off first [s]; fillers need two strides,
            and until they were measured rates are only held.
        above: tell the shank's filler the signals of the thigh, where it is worn.
        filters: how the Kalman filters run.
        gyroscope: what it draws and how long it takes to wake up.
        accelerometer: what it draws; it never sleeps.
        battery: what feeds all sensors; one watt-hour, so that lives are those per watt-hour.
        sampling_rate_hz: of the samples [Hz]; told by `prepared`, as what follows.
        gaps: whether any gyroscope's sample is missing.
        felt: whether every sensor has an accelerometer.
    """

    filler: str = "neighbours"
    schedule: Schedule | float | None = None
    asleep: tuple[str, ...] = ("shank",)
    warm_up: float = 0.0
    above: bool = True
    filters: DutyOptions = duty_params.DEFAULT
    gyroscope: Sensor = GYROSCOPE
    accelerometer: Sensor = ACCELEROMETER
    battery: Battery = Battery.from_watt_hours(1.0)
    sampling_rate_hz: float = 50.0
    gaps: bool = True
    felt: bool = True


ENDLESS = 1e9
"""[s] What a ranged parameter can say of an infinite time."""

DEFAULT = DutyCycledOptions()
"""Corrected filters behind nearest neighbours."""

PAPER = DutyCycledOptions(filler="replicate", above=False)
"""The paper's filler: the last cycle once more."""


def params_of(options: DutyCycledOptions) -> DutyCycledParams:
    """The usual parameters, with those of the options' filler; a time constant without end becomes thirty years."""
    usual = check_filler(options.filler).params
    return DutyCycledParams(filler=jax.tree.map(lambda value: min(value, ENDLESS), usual))


def transforms_of(options: DutyCycledOptions) -> DutyCycledParams:
    """The ranges of the parameters, with those of the options' filler."""
    return TRANSFORMS._replace(filler=check_filler(options.filler).transforms)


def one_side(p: DutyCycledParams, side: int) -> DutyCycledParams:
    """The parameters of one leg (0 right, 1 left): each `BySide` gives way to its value."""
    return DutyCycledParams(*(value[side] if isinstance(value, BySide) else value for value in p))


def with_body(p: DutyCycledParams, body: dict[str, Any]) -> DutyCycledParams:
    """The parameters with a person's own lengths put in, see `leg_ekf.params.with_body`; sensors keep their share."""
    return with_measures("the estimator for sleeping gyroscopes", leg_params.MEASURES, p, body)


def filter_params(p: DutyCycledParams) -> DutyParams:
    """The Kalman filters' own parameters, of one side."""
    same = {name: getattr(p, name) for name in DutyParams._fields if name in DutyCycledParams._fields}
    places = {"thigh_sensor": p.thigh_place * p.thigh_length, "shank_sensor": p.shank_place * p.shank_length}
    return DutyParams(**same, **places)


class GapSegment(NamedTuple):
    """One sensor's signals in its segment's axes (forward, left, up).

    Attributes:
        gyr: (T,) sagittal rate, positive when the distal end swings forward [rad/s]; 0 where it is off.
        acc: (T, 3) specific force [m/s²]; zeros without an accelerometer.
        on: (T,) bool, the gyroscope was on and awake, and its sample arrived.
        bias: of the gyroscope at rest [rad/s].
        variance: of the gyroscope at rest [rad²/s²].
    """

    gyr: Sampled
    acc: Held
    on: Sampled
    bias: Values
    variance: Values


class GapLeg(NamedTuple):
    """Thigh and shank of one leg; None where no sensor was worn."""

    thigh: GapSegment | None
    shank: GapSegment | None


class DutyCycledInputs(NamedTuple):
    """All that `duty_cycled_gyro.run` needs; every leaf is an array, so that inputs pad, stack and vmap.

    Attributes:
        right: right leg, or None.
        left: left leg, or None.
        time: (T,) [s].
        dt: (T,) time from the sample before [s]; 0 at the first.
        still: (T,) bool, the person stands.
        valid: (T,) bool, False for padding.
        start_variance: of the angles at the first sample [rad²].
    """

    right: GapLeg | None
    left: GapLeg | None
    time: Times
    dt: Held
    still: Sampled
    valid: Sampled
    start_variance: Values
