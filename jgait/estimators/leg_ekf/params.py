"""Parameters and options of the leg estimator, with their units, ranges and presets."""

from typing import Annotated, Any, NamedTuple

from jgait import filtering
from jgait.estimators.interface import with_measures
from jgait.estimators.leg_ekf.inclination import InclinationNoise
from jgait.notes import record
from jgait.params import Param, Parameter, documented, interval, positive
from jgait.types import Measures, Values


@record
class BySide(NamedTuple):
    """A value for each leg."""

    right: Values
    left: Values


@documented
@record
class LegParams(NamedTuple):
    """Parameters of the leg estimator, in natural units."""

    thigh_length: Annotated[Param, Parameter(interval(0.2, 0.7), "m", "hip to knee")] = BySide(0.43, 0.43)
    shank_length: Annotated[Param, Parameter(interval(0.2, 0.7), "m", "knee to ankle")] = BySide(0.43, 0.43)
    standing_hip: Annotated[Param, Parameter(
        interval(-0.6, 0.6), "rad", "usual hip flexion in standing",
    )] = BySide(0.0, 0.0)  # fmt: skip
    standing_knee: Annotated[Param, Parameter(
        interval(-0.4, 0.8), "rad", "usual knee flexion in standing",
    )] = BySide(0.0, 0.0)  # fmt: skip
    thigh_gain: Annotated[Param, Parameter(
        interval(0.6, 1.6), "1", "rotation of the thigh per rotation of its sensor, which skin and muscle reduce",
    )] = BySide(1.0, 1.0)  # fmt: skip
    thigh_pull: Annotated[Param, Parameter(
        interval(-0.4, 0.4), "1", "rotation of the thigh's sensor per radian of knee flexion, by the muscle below it",
    )] = BySide(0.0, 0.0)  # fmt: skip
    position_noise: Annotated[Param, Parameter(positive, "m²", "σ_xy, variance added to x and y each sample")] = 1e-6
    angle_noise: Annotated[Param, Parameter(
        positive, "rad²/s³", "σ_θ, spectral density of the angular acceleration",
    )] = 10.0  # fmt: skip
    bias_noise: Annotated[Param, Parameter(
        positive, "rad²/s²", "σ_β, variance added to the gyroscope biases each sample",
    )] = 1e-12  # fmt: skip
    gyro_noise: Annotated[Param, Parameter(
        positive, "1", "factor on R, the variance of the gyroscopes while standing",
    )] = 1.0  # fmt: skip
    closure_noise: Annotated[Param, Parameter(
        positive, "m", "standard deviation of x and y about the forward kinematics",
    )] = 1e-3  # fmt: skip
    inclination: Annotated[Values, Parameter(
        None, "", "noise of the direction of gravity, see `InclinationNoise`",
    )] = InclinationNoise()  # fmt: skip
    standing_hip_sd: Annotated[Param, Parameter(
        positive, "rad", "standard deviation of `standing_hip` between people; by it standing weighs beside walking",
    )] = 0.09  # fmt: skip
    standing_knee_sd: Annotated[Param, Parameter(positive, "rad", "the same of `standing_knee`")] = 0.085
    thigh_gain_sd: Annotated[Param, Parameter(
        positive, "1", "standard deviation of `thigh_gain`; this and the next three are for the stated errors only",
    )] = 0.1  # fmt: skip
    shank_gain_sd: Annotated[Param, Parameter(positive, "1", "the same for the shank, whose skin moves less")] = 0.04
    soft_tissue_thigh: Annotated[Param, Parameter(
        positive, "rad", "standard deviation of the angle between thigh and sensor, at any angle",
    )] = 0.02  # fmt: skip
    soft_tissue_shank: Annotated[Param, Parameter(positive, "rad", "the same for the shank")] = 0.01
    rollover_radius: Annotated[Param, Parameter(
        interval(0.0 - 1e-9, 0.3), "m", "how far the ankle moves forward per radian of the shank in stance",
    )] = 0.07  # fmt: skip
    distance_scale: Annotated[Param, Parameter(positive, "1", "personal scale of the walked distance")] = 1.0
    lever_shank: Annotated[Param, Parameter(
        interval(0.0, 0.4), "m", "height of the shank's sensor over the ankle; the walk corrects it",
    )] = 0.18  # fmt: skip
    distance_noise: Annotated[Param, Parameter(
        positive, "1",
        "relative error that all strides share, of the strapdown distance, on 18 people of `walking5m` whose "
        "reference errs by nearly as much; for the stated error only",
    )] = 0.03  # fmt: skip
    kinematic_noise: Annotated[Param, Parameter(
        positive, "1", "relative error of the distance by the leg's kinematics; used for the stated error only",
    )] = 0.12  # fmt: skip


@record
class LegOptions(NamedTuple):
    """The improvements that are used; the effect of each is measured by `experiments/bennett2013`.

    Attributes:
        gravity: 3-D inclination from gyroscope and accelerometer instead of the sagittal rate alone.
        closure: observe x and y as equal to the forward kinematics.
        standing: correct inclination and gyroscope bias in quiet standing.
        smooth: Rauch–Tung–Striebel smoothing (offline).
        distance: "stance": movement of the hip over the stance leg; "strapdown": the same, scaled to the strides that
            the shanks' accelerometers measure, or "stance" where there are none; "accumulate": the paper's
            Σ Δx⁺ + Σ |Δy|; "forward": Σ Δx⁺ alone, the forward displacement of the foot relative to the hip.
        rate_hz: resample to this rate first [Hz]; "strapdown" is then computed as "stance". None keeps the rate.
        median: width of a median filter on the gyroscopes in samples; 1 for no filter.
        method: how the filter linearises, see `jgait.filtering`.
    """

    gravity: bool = True
    closure: bool = True
    standing: bool = True
    smooth: bool = True
    distance: str = "strapdown"
    rate_hz: float | None = None
    median: int = 1
    method: filtering.Method = filtering.EKF()


DEFAULT = LegOptions()
"""The default pipeline, the most accurate one."""

PAPER = LegOptions(
    gravity=False, closure=False, standing=False, smooth=False, distance="accumulate", rate_hz=50.0, median=5
)
"""The paper's pipeline: 50 Hz, five-sample median filter, two rates, accumulation."""


def one_side[P: tuple[Any, ...]](p: P, side: int) -> P:
    """The parameters of one leg (0 right, 1 left): the value of that side replaces each `BySide`."""
    return type(p)(*(value[side] if isinstance(value, BySide) else value for value in p))


MEASURES = ("thigh_length", "shank_length")
"""Parameters that are measures of a person."""


def with_body(p: LegParams, body: Measures) -> LegParams:
    """The parameters with the "thigh_length" and "shank_length" [m] of a person, each a number or (right, left).

    Raises:
        ValueError: if `body` contains another name, or a measure is not one number or two.
    """
    return with_measures("the leg estimator", MEASURES, p, body)
