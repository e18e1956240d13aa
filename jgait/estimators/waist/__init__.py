r"""Heel strikes and walked distance from one inertial sensor at the waist.

The sensor's axes are computed from the walk; a Kalman filter on attitude removes gravity; initial contacts of both feet
are detected in the forward and upward accelerations. A state-space model of speed, accelerometer bias and pendulum
constant (`waist.model`) computes the distance, one time step per step of the walk; it observes the step lengths of an
inverted pendulum, and zero speed while standing. The paper's method is an option: direct and reverse integration of
every cycle with a velocity update (`velocity_update`).

Source: A. Köse, A. Cereatti, U. Della Croce, "Estimation of traversed distance in level walking using a single inertial
measurement unit attached to the waist", 2011.

Sensors:
    `waist`, `lower_back` or `pelvis`, gyroscope and accelerometer [m/s²], 25 to 400 Hz, mounted in any way. Two seconds
    of quiet standing give the gyroscope's bias; a start from standing gives the speed.

Outputs:
    Initial contacts with sides and their probabilities; strides with length and standard deviation; the distance; in
    `diagnostics` the distance's standard deviation and, for every stride, whether it is part of a turn, whether
    integration is unreliable and whether its side is unknown. A recording without walking gives an empty table.

Deviations from the paper:
    Effects are those of `experiments/kose2011`.

    1. `distance="fused"` instead of the velocity update, which needs a forward acceleration without bias, so a tilt
       known to hundredths of a degree. `distance="update"` is the paper.
    2. Contacts by a soft argmax; `detector="paper"` is the paper's midpoint rule.
    3. The paper's orientation filter is cited, not printed: here a filter on the direction of gravity.

Parameters whose gradient is zero by construction:
    those that the distance method does not use (`UNUSED`). Decisions (axes, standing, contacts, bouts) have none.
"""

from jgait.estimators.waist.about import SIDE_KNOWN
from jgait.estimators.waist.estimator import FLAGS, UNUSED, estimate, estimator, papers_estimator, run
from jgait.estimators.waist.params import DEFAULT, PAPER, WaistOptions, WaistParams, with_body
from jgait.estimators.waist.prepare import prepare as prepared

__all__ = [
    "DEFAULT",
    "FLAGS",
    "PAPER",
    "SIDE_KNOWN",
    "UNUSED",
    "WaistOptions",
    "WaistParams",
    "estimate",
    "estimator",
    "papers_estimator",
    "prepared",
    "run",
    "with_body",
]
