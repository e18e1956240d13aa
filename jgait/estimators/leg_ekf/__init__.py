r"""Hip and knee angles, foot displacement and walked distance from gyroscopes on thigh and shin.

The paper's extended Kalman filter, with additions that real walks need: a functional sagittal axis, sensors put in
their places, a zero from standing and walking, inclination from gravity, kinematic closure, standing, smoothing, and
another distance: the movement of the hip over the stance leg, scaled to the strides that the shanks' accelerometers
measure (`ankle_stride`).
`LegOptions` turns the parts on and off; `PAPER` is the paper's method.

Source: T. Bennett, R. Jafari, N. Gans, "An extended Kalman filter to estimate human gait parameters and walking
distance", ACC 2013. The model is in `leg_ekf.model`; `mounting.leg` finds the axes of the sensors.

Sensors:
    `thigh_right` and `shank_right`, or the left ones, or all four; gyroscopes, and accelerometers if available;
    on one clock, 40 Hz or more; without accelerometers with half a second of quiet standing.

Outputs:
    Hip and knee flexion [rad], ankle relative to hip [m], walked distance [m], and standard deviations of all of them,
    that of the distance in `diagnostics["distance_stddev"]`.

Deviations from the paper:
    Their effect is measured on the straight part of `neura_sparse` (right/left leg) by `experiments/bennett2013`, of
    the first two by its `literal.py`.

    1. Element C of equation 6 is the derivative of equation 3 (autodiff); as printed, and with Q as printed too, the
       error of y grows from 4.8/3.5 to 29/18 cm (σ_θ = 0.01).
    2. Q's angle blocks are σ_θ [T³/3, T²/2; T²/2, T] with the sample time T; as printed they hold powers of σ_θ, and
       from σ_θ = 1 on the angles are lost (36° and more).
    3. R holds variances; the text says standard deviations. Not measured apart.
    4. x and y start on the forward kinematics instead of at 0, so that the closure can hold; displacements stay.
    5. Knee angles come out flexion positive, hip angles from the vertical; the filter's own state keeps the paper's.
    6. Distance "accumulates" Σ Δx⁺ + Σ |Δy|; the paper leaves open which vertical displacement. It falls 21 % short,
       the movement of the hip over the stance leg 6 %, the default, the strapdown at the shanks, 2 % (whole walk).
"""

from jgait.estimators.leg_ekf.estimator import estimate, estimator, run
from jgait.estimators.leg_ekf.params import DEFAULT, PAPER, BySide, LegOptions, LegParams, one_side, with_body
from jgait.estimators.leg_ekf.prepare import prepare as prepared

__all__ = [
    "DEFAULT",
    "PAPER",
    "BySide",
    "LegOptions",
    "LegParams",
    "estimate",
    "estimator",
    "one_side",
    "prepared",
    "run",
    "with_body",
]
