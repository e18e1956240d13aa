r"""Stride width, step length and base of support from the trajectories of both feet and the range between them.

The zero-velocity trajectory of each foot gives accurate strides, but in a separate world frame whose heading drifts.
A range is measured only while one foot passes the other. It links the trajectories: it measures the distance between
the feet across the walk, and it shows that their distance along the walk is then zero.

Source: M. Potter, K. Liu, M. Selamet, G. Kumaravelu, "EKF estimation of stride width from individual IMU-based foot
trajectory estimates". The model is in `stride_width_ekf.model`, the selection of range readings in
`stride_width_ekf.prepare`.

Sensors:
    `foot_right` and `foot_left`, as of `foot_ins`, or trajectories of both feet with the middles of their stances from
    another zero-velocity method (`prepare_from_feet`, `estimator().solve`); and the distance from the inner side of the
    left ankle to the right leg, measured at least every few strides (`Recording.feet_range`). Without it, the feet pass
    each other as those of usual people.

Outputs:
    Strides of both feet with width, step length and length [m] and their standard deviations; z₁ and z₂ at stances,
    ranges and double support [m], with standard deviations; trajectories of both feet in one world frame.

How far to trust it:
    Without any usable range, the mean width has the spread of people, 2.5 cm, which its deviation states; a wide base
    is not measured. Changes from stride to stride are: on `gaitmap_example` their error is 0.8 cm, see
    `prepare.passings`. Between ranges, the standard deviation of widths grows with the distance walked;
    `diagnostics["width_valid"]` is False where it is above `WidthOptions.widest_stddev`.
    No width is valid, and a note says so, if more than 30 % of the ranges do not fit the paths of the feet. A constant
    error of the range, such as a wrong offset or scale, cannot be detected, nor can exchanged sensors of both feet.
    Both feet and the range must have one clock. A difference δ between the clocks of the feet cannot be separated from
    unequal steps: the steps of one foot are too long and those of the other too short by v δ / 2, with v the relative
    speed of the feet at the passing (8 cm for 50 ms in the paper's protocol), by v δ if the range is late; widths
    outside of turns stay within 4 mm. A range sensor that points forward or back has the same effect
    (`WidthParams.passing_offset`).

Deviations from the paper:
    `experiments/potter/literal.py` has the first one's signs as printed.

    1. Row 5 of equation 3 adds Δx sin θ, row 2 of equation 6 adds (y_R − y_L) sin θ; printed with minus. The gain takes
       Hᵀ and the predicted covariance.
    2. The filter runs over moments at which something happens (stances, ranges, double support) and not over samples:
       within a stride displacements add up exactly, so the result is the same, some twenty times sooner.
    3. R, the noise of the displacements, grows with the way moved; the noise of the heading is added at each stride.
    4. How far each foot has moved since it stood is part of the state, see `stride_width_ekf.model`.
    5. Readings of one passing count once, at the middle of their times; those unlike their neighbours are left out.
       Positions are taken at the time of the reading, not at the nearest sample.
    6. Updates are iterated: where little is known of the start, the first range moves the feet so far that one
       linearisation is off by several centimetres. Smoothing, after the paper's future work.
    7. Double support is the moment between two stances at which both feet are stillest; the paper takes it from the
       accelerometers.
"""

from jgait.estimators.stride_width_ekf.estimator import estimate, estimator, run, with_body
from jgait.estimators.stride_width_ekf.params import DEFAULT, PAPER, WidthOptions, WidthParams
from jgait.estimators.stride_width_ekf.prepare import WidthInputs, prepare_from_feet

__all__ = [
    "DEFAULT",
    "PAPER",
    "WidthInputs",
    "WidthOptions",
    "WidthParams",
    "estimate",
    "estimator",
    "prepare_from_feet",
    "run",
    "with_body",
]
