r"""Every stride counted and measured from one inertial sensor at the ankle or on the shank.

Swings are told from the sagittal rate, and between two of them the instant at which the ankle stands: the valley of the
stance rate. An error-state filter integrates the sensor and corrects it there: the *ankle's* velocity is zero, the
sensor's is ω × r. The lever r and the biases are states, so that the walk itself tells them; the smoother carries what
each stance tells back into the swing before it.

Source: H. D. Silva, J. A. Afonso, L. A. Rocha, "Walk distance estimation using an ankle-mounted inertial measurement
unit", 2017; equations in `ankle_stride.model`, and those of the paper's own methods in `ankle_stride.length` and
`events.shank`.

Sensors:
    `ankle_right`, `ankle_left`, `shank_right` or `shank_left`, one or two of them on one clock, gyroscope and
    accelerometer, 25 to 400 Hz, mounted in any way: the walk tells forward, left and up. Half a second of quiet
    standing anywhere gives the gyroscope's bias; without it the filter finds it.

Outputs:
    Strides with length, height, turn and speed and their standard deviations; the distance; in `diagnostics` for every
    stride whether it is one of a turn, of stairs, from or to standing (`half`), or its swing was clipped; for each leg
    the lever and the gyroscope's bias that the filter found. No walking is an empty table.

Deviations from the paper; effects by `experiments/silva2017`:
    1. A filter with smoother instead of each stride by itself (`length="3d"` and others bring those back): a bias of
       0.02 rad/s that nothing read at rest moves a leg's total by 0.1 to 0.4 % on average (four sets).
    2. Swings by the detector of lobes; `detector="paper"` is the paper's machine.
    3. Zero velocity at the ankle, a lever away, not at the sensor; each 10 cm of lever are 3 to 7 cm a stride.

The walk tells the lever only roughly (the ankle goes a little forward as the shank rolls over it, which looks like a
shorter lever), so that a lever known to millimetres wants a small `lever_along_sd`: on `tripod` with 5 mm instead of
2 cm strides err by 2.5 instead of 2.7 cm.

Parameters whose gradient is zero by construction:
    what a method does not use (`UNUSED`): those of the pendulum in the filter, those of the filter in the pendulum;
    the lever of the placement that is not worn; `height_noise` without `level`; `gyr_bias` and `sway` where no leg ever
    stood still, `gyr_bias_unknown` where all did. What decides (axes, swings, stances, flags) has none. Gravity enters
    "3d" only as a constant that cancels in the length; `stride_noise` enters standard deviations alone.
"""

from jgait.estimators.ankle_stride.estimator import (
    DEFAULT,
    FLAGS,
    TRANSFORMS,
    UNUSED,
    AnkleOptions,
    AnkleParams,
    estimate,
    estimator,
    prepared,
    run,
    with_body,
)

__all__ = [
    "DEFAULT",
    "FLAGS",
    "TRANSFORMS",
    "UNUSED",
    "AnkleOptions",
    "AnkleParams",
    "estimate",
    "estimator",
    "prepared",
    "run",
    "with_body",
]
