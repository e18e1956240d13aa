r"""Foot trajectories and strides from an inertial sensor on each shoe.

An error-state filter integrates the sensor and corrects it wherever the foot stands; the smoother carries what each
stance tells back into the swing before it. A foot that counts as standing still rolls over the ground, heel to toe:
its velocity is that of a turn about a point on the ground below, which takes away a bias of three centimetres a
stride. Jolts are measured worse than slow motion, so the process noise grows with the change between samples.

Source: the filter that M. Potter, K. Liu, M. Selamet and G. Kumaravelu, "EKF estimation of stride width from
individual IMU-based foot trajectory estimates", take from L. Ojeda and J. Borenstein, "Non-GPS navigation for security
personnel and first responders", Journal of Navigation 60(3), 2007, section II there; equations in `foot_ins.model`.

Sensors:
    `foot_right` or `foot_left` or both, on one clock, gyroscope and accelerometer, 45 Hz or more, mounted in any way.
    Half a second of quiet standing anywhere gives the gyroscope's bias.

Outputs:
    Position, velocity and attitude of each sensor, x along the first stride and z up, with standard deviations; strides
    with length, height, speed, turn, lift and the foot's pitch at contact and push-off, with standard deviations. Each
    foot has a world of its own: where the other foot is, `stride_width_ekf` says.

Deviations from the paper (which names its filter but does not print it); effects by `experiments/foot_ins`:
    1. The foot turns about a pivot while it stands (`pivot_height`); 0 brings the still foot back.
    2. Noise of both sensors grows with their change from sample to sample.
    3. Stances are found by a threshold that follows the stride, see `jgait.events.foot`.
    4. The filter takes the ground for level only if `level` says so.
    5. Smoothing; `smooth=False` gives the filter.

Parameters without a gradient: `sway`, `gyr_bias` and `gyr_bias_tilt` enter the belief at the start alone, and what
decides (stances, footholds, contacts) has none.
"""

from jgait.estimators.foot_ins.estimator import (
    DEFAULT,
    TEXTBOOK,
    TRANSFORMS,
    FootOptions,
    FootParams,
    controls,
    estimate,
    estimator,
    model_params,
    prepared,
    prior_of,
    run,
    with_body,
)

__all__ = [
    "DEFAULT",
    "TEXTBOOK",
    "TRANSFORMS",
    "FootOptions",
    "FootParams",
    "controls",
    "estimate",
    "estimator",
    "model_params",
    "prepared",
    "prior_of",
    "run",
    "with_body",
]
