"""Parameters and options of the leg estimator, with their units, ranges and presets."""

from typing import Any, NamedTuple

from jgait import filtering, params
from jgait.estimators.interface import with_measures
from jgait.estimators.leg_ekf.inclination import InclinationNoise
from jgait.filtering.execution import Execution


class BySide(NamedTuple):
    """A value for each leg."""

    right: Any
    left: Any


class LegParams(NamedTuple):
    """Parameters of the leg estimator, in natural units.

    Attributes:
        thigh_length: hip to knee [m].
        shank_length: knee to ankle [m].
        standing_hip: hip flexion in the calibrating stance [rad].
        standing_knee: knee flexion in the calibrating stance [rad].
        thigh_gain: thigh rotation per rotation of the thigh sensor, which skin and muscle hold back [1].
        position_noise: σ_xy, variance added to x and y each sample [m²].
        angle_noise: σ_θ, spectral density of the angular acceleration [rad²/s³].
        bias_noise: σ_β, variance added to the gyroscope biases each sample [rad²/s²].
        gyro_noise: multiplies R, the gyroscopes' variance while standing [1].
        closure_noise: standard deviation of x and y about the forward kinematics [m].
        inclination: noise of the gravity direction, see `InclinationNoise`.
        soft_tissue_thigh: standard deviation of the thigh about its sensor [rad]; enters the stated errors only.
        soft_tissue_shank: the same of the shank [rad].
        rollover_radius: how far the ankle moves forward per radian of the shank in stance [m].
        distance_scale: personal scale of the walked distance [1].
    """

    thigh_length: Any = BySide(0.43, 0.43)
    shank_length: Any = BySide(0.43, 0.43)
    standing_hip: Any = BySide(0.0, 0.0)
    standing_knee: Any = BySide(0.0, 0.0)
    thigh_gain: Any = BySide(1.0, 1.0)
    position_noise: Any = 1e-6
    angle_noise: Any = 10.0
    bias_noise: Any = 1e-12
    gyro_noise: Any = 1.0
    closure_noise: Any = 1e-3
    inclination: Any = InclinationNoise()
    soft_tissue_thigh: Any = 0.05
    soft_tissue_shank: Any = 0.02
    rollover_radius: Any = 0.07
    distance_scale: Any = 1.0


TRANSFORMS = LegParams(
    thigh_length=BySide(params.interval(0.2, 0.7), params.interval(0.2, 0.7)),
    shank_length=BySide(params.interval(0.2, 0.7), params.interval(0.2, 0.7)),
    standing_hip=BySide(params.interval(-0.6, 0.6), params.interval(-0.6, 0.6)),
    standing_knee=BySide(params.interval(-0.4, 0.8), params.interval(-0.4, 0.8)),
    thigh_gain=BySide(params.interval(0.6, 1.6), params.interval(0.6, 1.6)),
    position_noise=params.positive,
    angle_noise=params.positive,
    bias_noise=params.positive,
    gyro_noise=params.positive,
    closure_noise=params.positive,
    inclination=InclinationNoise(*(params.positive,) * 5),
    soft_tissue_thigh=params.positive,
    soft_tissue_shank=params.positive,
    rollover_radius=params.interval(0.0 - 1e-9, 0.3),
    distance_scale=params.positive,
)
"""The range of every parameter."""


class LegOptions(NamedTuple):
    """Which improvements are on; each is measured alone by `experiments/bennett2013`.

    Attributes:
        perpendicular_axis: make the functional sagittal axis perpendicular to gravity.
        gravity: 3-D inclination from gyroscope and accelerometer instead of the sagittal rate alone.
        closure: tie x and y to the forward kinematics.
        standing: quiet standing fixes inclination and gyroscope bias.
        smooth: Rauch–Tung–Striebel smoothing (offline).
        distance: "stance": the leg that stands carries the hip; "accumulate": the paper's Σ Δx⁺ + Σ |Δy|;
            "forward": Σ Δx⁺ alone, how far the foot swings, which follows the foot's own way over time.
        rate_hz: resample to this rate first [Hz]; None keeps the recording's.
        median: width of a median filter on the gyroscopes in samples; 1 is none.
        method: how the filter linearises, see `jgait.filtering`.
        execution: how the filters compute, see `jgait.filtering`. "fast" is more than ten times faster than "auto" on
            a hundred recordings at once, with equal results, and takes half a minute longer to compile.
    """

    perpendicular_axis: bool = True
    gravity: bool = True
    closure: bool = True
    standing: bool = True
    smooth: bool = True
    distance: str = "stance"
    rate_hz: float | None = None
    median: int = 1
    method: Any = filtering.EKF()
    execution: Execution = "auto"


DEFAULT = LegOptions()
"""The best pipeline."""

PAPER = LegOptions(
    perpendicular_axis=True, gravity=False, closure=False, standing=False, smooth=False, distance="accumulate",
    rate_hz=50.0, median=5,
)  # fmt: skip
"""The paper's pipeline: 50 Hz, five-sample median filter, two rates, accumulation."""


def one_side(p: LegParams, side: int) -> LegParams:
    """The parameters of one leg (0 right, 1 left): each `BySide` gives way to its value."""
    return LegParams(*(value[side] if isinstance(value, BySide) else value for value in p))


MEASURES = ("thigh_length", "shank_length")
"""Parameters that are measures of a person."""


def with_body(p: LegParams, body: dict[str, Any]) -> LegParams:
    """The parameters with a person's own lengths put in.

    Args:
        p: parameters.
        body: "thigh_length" and "shank_length" [m], as far as known; each a number or (right, left).

    Raises:
        ValueError: if it names anything else, or a measure is not one number or two.
    """
    return with_measures("the leg estimator", MEASURES, p, body)
