r"""Leg angles from thigh and shank sensors whose gyroscopes are switched off most of the time.

While a gyroscope is off, its sagittal rate is filled from earlier measured strides (`duty_cycle.fillers`). The Kalman
filters of thigh and shin (`duty_cycled_gyro.model`) use measured and filled rates; filled rates have a larger variance,
by `filled_noise` and by how unlike the earlier strides were. If too few strides, or none alike, were measured before a
gap, its rates are flagged and not used: the filters use gravity, the rigid link and a weak observation of the vertical,
and no angle is stated. `power` computes the energy that is saved.

Source: P. S. Udaya Shankar, N. Raveendranathan, N. R. Gans, R. Jafari, "Towards power optimized Kalman filter for
gait assessment using wearable sensors", Wireless Health 2010; tests/estimators/duty_cycled_gyro/test_estimator.py.

Sensors:
    `thigh_right` or `shank_right` or both, or those of the left leg, or all four; gyroscopes, and accelerometers for
    most fillers; on one clock, 40 to 400 Hz, half a second of quiet standing with all gyroscopes on. The times at
    which they are on come from a mask of the gyroscope, or a schedule that hides samples. Where the mask of the
    recording is False, the accelerometer's sample is lost as well.

Outputs:
    Hip and knee flexion [rad] and the ankle relative to the hip [m], with standard deviations, of legs on which both
    segments are worn. In `diagnostics`, for every sensor such as `shank_right`: `angle_`, `angle_stddev_`, `rate_`,
    `gyro_` (the rate as measured or filled) and `how_` (0 measured, 1 filled, 2 held) over time; power of the sensors.

Deviations from the paper:
    The first twelve are those of the filters, see `duty_cycled_gyro.model`; `experiments/udaya2010/literal.py` has
    the printed ones.

    13. The paper replicates the cycle 1.4 s before; here neighbours on the accelerometer's history fill the gaps, and
        "replicate" looks a stride period back. On `tripod` after the paper's protocol their errors at duty 40 and 10 %
        are 0.06 and 0.09 of the signal, those printed 0.27 and 0.30 (`experiments/udaya2010`).
    14. The paper judges the gyroscope's rate; here angles come out as well. One axis of the gyroscope does not measure
        turns, so that in a turn its rate counts for less, see `duty_cycled_gyro.model`. `leg_ekf`
        measures turns, but takes filled samples (`duty_cycle.recording`) as measured, with too small deviations.
"""

from jgait.estimators.duty_cycled_gyro import model as duty_model
from jgait.estimators.duty_cycled_gyro.estimator import estimate, estimator, run
from jgait.estimators.duty_cycled_gyro.params import (
    DEFAULT,
    PAPER,
    DutyCycledOptions,
    DutyCycledParams,
    params_of,
    with_body,
)
from jgait.estimators.duty_cycled_gyro.prepare import prepare as prepared

__all__ = [
    "DEFAULT", "PAPER", "DutyCycledOptions", "DutyCycledParams", "duty_model", "estimate", "estimator", "params_of",
    "prepared", "run", "with_body",
]  # fmt: skip
