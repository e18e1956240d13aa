r"""Strides counted and measured from one inertial sensor at the ankle or on the shank.

Swings are detected in the sagittal rate; between two swings the ankle stands at the valley of the stance rate. An
error-state filter integrates the sensor's signals and corrects the velocity at each valley: the *ankle's* velocity is
zero, the sensor's velocity is ω × r. The lever r and the biases are states, which the filter estimates from the walk;
the smoother uses the zero velocity of each stance to correct the swing before it.

Source: H. D. Silva, J. A. Afonso, L. A. Rocha, "Walk distance estimation using an ankle-mounted inertial measurement
unit", 2017; equations in `ankle_stride.model`, and those of the paper's own methods in `ankle_stride.length` and
`events.shank`.

Sensors:
    `ankle_right`, `ankle_left`, `shank_right` or `shank_left`, one or two of them on one clock, gyroscope and
    accelerometer, 25 to 400 Hz, mounted in any way: forward, left and up are computed from the walk. Half a second of
    quiet standing anywhere gives the gyroscope's bias; without standing the filter estimates the bias.

Outputs:
    Strides with length, height, turn and speed and their standard deviations; the distance; in `diagnostics` for every
    stride whether it is one of a turn, of stairs, from or to standing (`half`), or its swing was clipped; for each leg
    the lever and the gyroscope's bias that the filter estimated. A recording without walking gives an empty table.

Deviations from the paper:
    Effects are those of `experiments/silva2017`.

    1. A filter with smoother instead of each stride by itself (`length="3d"` and others bring those back): a bias of
       0.02 rad/s that nothing read at rest moves a leg's total by 0.1 to 0.4 % on average (four sets).
    2. Swings by the detector of lobes; `detector="paper"` is the paper's machine.
    3. Zero velocity at the ankle, a lever away, not at the sensor; each 10 cm of lever are 3 to 7 cm a stride.

The filter estimates the lever only roughly (in stance the ankle moves slightly forward as the shank rolls over it, and
this looks like a shorter lever). For a lever known to millimetres, set a small `lever_along_sd`: on `tripod` with 5 mm
instead of 2 cm strides err by 2.5 instead of 2.7 cm.

Parameters whose gradient is zero by construction:
    those that a method does not use (`UNUSED`): the pendulum's in the filter, the filter's in the pendulum; the lever
    of a placement without a sensor; `gyr_bias` and `sway` if no leg ever stood still, `gyr_bias_unknown` if all legs
    did. Decisions (axes, swings, stances, flags) have none. Gravity enters "3d" only as a constant that cancels in the
    length; `stride_noise` and `distance_noise` enter standard deviations alone.
"""

from jgait.estimators.ankle_stride.estimator import UNUSED, estimate, estimator, run
from jgait.estimators.ankle_stride.params import DEFAULT, AnkleOptions, AnkleParams, with_body
from jgait.estimators.ankle_stride.prepare import prepare as prepared
from jgait.estimators.ankle_stride.readout import FLAGS

__all__ = [
    "DEFAULT",
    "FLAGS",
    "UNUSED",
    "AnkleOptions",
    "AnkleParams",
    "estimate",
    "estimator",
    "prepared",
    "run",
    "with_body",
]
