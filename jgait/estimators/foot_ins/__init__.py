r"""Foot trajectories and strides from an inertial sensor on each shoe.

An error-state filter integrates the sensor's signals and corrects the state at each stance; the smoother applies the
correction of each stance to the swing before it as well. In stance the foot rolls over the ground from heel to toe:
the model gives it the velocity of a rotation about a point on the ground, which removes a bias of three centimetres
a stride. Sensors measure jolts less accurately than slow motion, so process noise grows with the change of the signal.

Source: the filter that M. Potter, K. Liu, M. Selamet and G. Kumaravelu, "EKF estimation of stride width from
individual IMU-based foot trajectory estimates", take from L. Ojeda and J. Borenstein, "Non-GPS navigation for security
personnel and first responders", Journal of Navigation 60(3), 2007, section II there; equations in `foot_ins.model`.

Sensors:
    `foot_right` or `foot_left` or both, on one clock, gyroscope and accelerometer, 45 Hz or more, mounted in any way.
    The gyroscope bias is measured in quiet standing of half a second or more at any time of the recording.

Outputs:
    Position, velocity and attitude of each sensor, x along the first stride and z up, with standard deviations; strides
    with length, height, speed, turn, lift and the foot's pitch at contact and push-off, with standard deviations. Each
    foot has a separate world frame: `stride_width_ekf` estimates the position of one foot relative to the other.

Deviations from the paper:
    The paper names its filter but does not print it. Effects are those of `experiments/foot_ins`.

    1. The foot turns about a pivot while it stands (`pivot_height`); with 0 it does not move.
    2. Noise of both sensors grows with their change from sample to sample.
    3. Stances are found by a threshold that follows the stride, and by the velocity between rests, see
       `jgait.events.foot`.
    4. The filter assumes level ground only if `level` says so; otherwise the rises of all strides say where the ground
       is level, see `jgait.estimators.foot_ins.readout`.
    5. Smoothing; `smooth=False` gives the filter.
    6. Standard deviations of stride lengths are the filter's times a factor from the innovations of the stride.
    7. With smoothing, the headings of two feet are kept from drifting apart, see `jgait.estimators.foot_ins.readout`;
       the estimate of one recording only: in cohorts and in tuning each foot is estimated by itself.

Parameters without a gradient: `sway`, `gyr_bias` and `gyr_bias_tilt` enter only the belief at the start; the detection
of stances, footholds and contacts has no gradient.
"""

from jgait.estimators.foot_ins.estimator import estimate, estimator, run
from jgait.estimators.foot_ins.params import DEFAULT, TEXTBOOK, FootOptions, FootParams, with_body
from jgait.estimators.foot_ins.prepare import prepare as prepared

__all__ = ["DEFAULT", "TEXTBOOK", "FootOptions", "FootParams", "estimate", "estimator", "prepared", "run", "with_body"]
