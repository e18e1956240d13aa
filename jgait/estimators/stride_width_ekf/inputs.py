"""Inputs of the stride width estimator: moments of stances, ranges and double support, as arrays."""

from typing import Annotated, NamedTuple

import numpy as np

from jgait.estimators.axes import Axis, Held, Sampled
from jgait.estimators.stride_width_ekf.model import PathControl


class StrideRows(NamedTuple):
    """Strides of both feet as indices of moments in `WidthInputs`; every field is (N,), with padding at the end."""

    side: np.ndarray  #: 0 right, 1 left.
    moment: np.ndarray  #: index of the moment at the end of the stride, the middle of its second stance.
    start: np.ndarray  #: initial contact at the start of the stride [s].
    final_contact: np.ndarray  #: final contact [s].
    end: np.ndarray  #: initial contact at the end of the stride [s].
    standing: np.ndarray  #: middle of the first stance [s].
    standing_end: np.ndarray  #: middle of the second stance [s].
    height: np.ndarray  #: rise from stance to stance [m].
    turn: np.ndarray  #: change of heading from the previous stride [rad].
    passed: np.ndarray  #: True if the other foot has exactly one stance in between.
    valid: np.ndarray  #: False for padding.


class WidthInputs(NamedTuple):
    """Inputs of `stride_width_ekf.run` at N moments: stances, ranges, double support.

    Every leaf is an array, so that inputs can be padded, stacked and mapped.

    Attributes:
        time: (N,) [s].
        right: the right foot's control over the interval that ends at each moment, fields (N,).
        left: the left foot's control, likewise.
        height_right: (N,) height of the right foot's sensor in the world frame of its trajectory [m].
        height_left: (N,) height of the left foot's sensor, likewise [m].
        distance: (N,) measured range [m], 0 at moments without a range.
        seen: (N,) bool, True at moments with a usable range.
        turning: (N,) bool, True in a turn of one of the feet.
        double_support: (N,) bool, both feet are on the ground.
        start_heading: (2,) heading of the right and of the left foot before the first moment [rad].
        strides: strides and the moments at which they end.
        valid: (N,) bool, False for padding.
    """

    time: Held
    right: Annotated[PathControl, Axis()]
    left: Annotated[PathControl, Axis()]
    height_right: Held
    height_left: Held
    distance: Sampled
    seen: Sampled
    turning: Sampled
    double_support: Sampled
    start_heading: np.ndarray
    strides: Annotated[StrideRows, Axis()]
    valid: Sampled


def exchanged(inputs: WidthInputs) -> WidthInputs:
    """The inputs with right and left foot exchanged, as for sensors worn on the wrong feet.

    The rows of strides are not exchanged, so only the filter may be run on the result.
    """
    return inputs._replace(
        right=inputs.left,
        left=inputs.right,
        height_right=inputs.height_left,
        height_left=inputs.height_right,
        start_heading=inputs.start_heading[::-1],
    )
