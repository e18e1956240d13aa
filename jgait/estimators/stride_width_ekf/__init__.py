r"""Stride width, step length and base of support from two feet's own trajectories and a range between them.

Each foot's zero-velocity trajectory is sure of its own strides, but lives in a world of its own, whose heading drifts.
A range that the feet hear only while one passes the other ties them together: it says how far apart they are across
the walk, and that they are side by side along it.

Source: M. Potter, K. Liu, M. Selamet, G. Kumaravelu, "EKF estimation of stride width from individual IMU-based foot
trajectory estimates". The model is in `stride_width_ekf.model`, decisions about a recording in
`stride_width_ekf.prepare`.

Sensors:
    `foot_right` and `foot_left`, as of `foot_ins`, or both feet's trajectories with the middles of their stances by any
    other zero-velocity method (`estimate_from_feet`); and the distance from the inner side of the left ankle to the
    right leg, heard at least every few strides (`Recording.feet_range`).

Outputs:
    Strides of both feet with width, step length and length [m] and their standard deviations; z₁ and z₂ at stances,
    ranges and double support [m], with theirs; both feet in one world.

How far to trust it:
    A width without ranges is a guess whose standard deviation grows with the way walked: `diagnostics["width_valid"]`
    is False for each stride whose standard deviation is above `WidthOptions.widest_stddev`.
    Feet taken for each other are told apart by a turn, in which the outer foot goes farther, and by steps that vary: a
    foot that lands farther out must lengthen the range and not shorten it. `diagnostics["swap_evidence"]` is how many
    nats better the feet explain the ranges as they are labelled than exchanged; near 0 (a short straight walk with even
    steps) nothing is known. Below −6 the notes say that the feet seem to be exchanged; the estimate stays as labelled.
    A range whose clock is late makes the feet pass alternately before and behind each other; that is estimated and
    taken off. Feet whose clocks differ by δ are not told from feet of unequal steps: the range's clock is put between
    them, and the steps of one foot come out too long, those of the other too short, by v δ / 2 with v the speed at
    which the feet pass (8 cm for 50 ms in the paper's protocol); widths outside of turns stay within 4 mm.
    The same holds, for steps, of a range sensor that looks forward or back (`WidthParams.passing_offset`).

Deviations from the paper; `experiments/potter/literal.py` has the first one's signs as printed:
    1. Row 5 of equation 3 adds Δx sin θ, row 2 of equation 6 adds (y_R − y_L) sin θ; printed with minus. The gain takes
       Hᵀ and the predicted covariance.
    2. The filter runs over moments at which something happens (stances, ranges, double support) and not over samples:
       within a stride displacements add up exactly, so the result is the same, some twenty times sooner.
    3. R, the noise of the displacements, grows with the way moved, and that of the heading comes with each stride.
    4. How far each foot has moved since it stood is part of the state, see `stride_width_ekf.model`.
    5. Readings of one passing count once, at the middle of when the feet hear each other; those unlike their
       neighbours are left out. Positions are taken at the time of the reading, not at the nearest sample.
    6. Updates are iterated: where little is known of the start, the first range moves the feet so far that one
       linearisation is off by several centimetres. Smoothing, after the paper's future work.
    7. Double support is the moment between two stances at which both feet are stillest; the paper takes it from the
       accelerometers.
"""

from jgait.estimators.stride_width_ekf.estimator import (
    DEFAULT,
    PAPER,
    TRANSFORMS,
    WidthInputs,
    WidthOptions,
    WidthParams,
    estimate,
    estimate_from_feet,
    estimator,
    prepare_from_feet,
    run,
    with_body,
)

__all__ = [
    "DEFAULT",
    "PAPER",
    "TRANSFORMS",
    "WidthInputs",
    "WidthOptions",
    "WidthParams",
    "estimate",
    "estimate_from_feet",
    "estimator",
    "prepare_from_feet",
    "run",
    "with_body",
]
