r"""Heel strikes and walked distance from one inertial sensor at the waist.

The sensor tells which way it is worn; a gravity filter takes gravity off; contacts of both feet are read off the
forward and upward accelerations. The distance is that of a state-space model over speed, the accelerometer's bias and
the pendulum's constant (`waist.model`), a row a step, with the steps of an inverted pendulum as observations and zero
speed while standing. The paper's own way is an option: direct and reverse integration of every cycle with a velocity
update (`velocity_update`).

Source: A. Köse, A. Cereatti, U. Della Croce, "Estimation of traversed distance in level walking using a single inertial
measurement unit attached to the waist", 2011.

Sensors:
    `waist`, `lower_back` or `pelvis`, gyroscope and accelerometer [m/s²], 25 to 400 Hz, mounted in any way. Two seconds
    of quiet standing give the gyroscope's bias; a start from standing gives the speed.

Outputs:
    Contacts, strides with length and standard deviation, the distance, and in `diagnostics` its standard deviation, the
    pendulum's constant, and for every stride whether it is one of a turn, and whether integration can be relied on. No
    walking is an empty table.

Deviations from the paper; effects by `experiments/kose2011`:
    1. `distance="fused"` instead of the velocity update, which needs a forward acceleration without bias, so a tilt
       known to hundredths of a degree. `distance="update"` is the paper.
    2. Contacts by a soft argmax; `detector="paper"` is the paper's midpoint rule, "literal" by the letter.
    3. The paper's orientation filter is cited, not printed: here a filter on the direction of gravity.

Parameters whose gradient is zero by construction:
    what a way of measuring does not use (`UNUSED`); what decides (axes, standing, contacts, bouts) has none.
"""

from jgait.estimators.waist.estimator import (
    DEFAULT,
    FLAGS,
    PAPER,
    TRANSFORMS,
    UNUSED,
    WaistOptions,
    WaistParams,
    estimate,
    estimator,
    papers_estimator,
    prepared,
    run,
    with_body,
)

__all__ = [
    "DEFAULT",
    "FLAGS",
    "PAPER",
    "TRANSFORMS",
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
