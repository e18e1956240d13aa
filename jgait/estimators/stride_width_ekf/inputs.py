"""What the stride width estimator takes: moments at which something happens, as arrays that pad, stack and map."""

from typing import Annotated, NamedTuple

import numpy as np

from jgait.estimators.axes import Axis, Held, Sampled
from jgait.estimators.stride_width_ekf.model import PathControl


class StrideRows(NamedTuple):
    """Strides of both feet as places in the moments of `WidthInputs`; every field is (N,), rows of padding behind.

    Attributes:
        side: 0 right, 1 left.
        moment: at which the stride ends, the middle of its second stance.
        start: the contact that begins it [s].
        final_contact: when the foot leaves [s].
        end: the contact that ends it [s].
        standing: middle of its first stance [s].
        standing_end: middle of its second [s].
        height: rise from stance to stance [m].
        turn: from the heading of the stride before [rad].
        passed: the other foot stood just once in between.
        valid: False for padding.
    """

    side: np.ndarray
    moment: np.ndarray
    start: np.ndarray
    final_contact: np.ndarray
    end: np.ndarray
    standing: np.ndarray
    standing_end: np.ndarray
    height: np.ndarray
    turn: np.ndarray
    passed: np.ndarray
    valid: np.ndarray


class WidthInputs(NamedTuple):
    """All that `stride_width_ekf.run` needs, at N moments: stances, ranges, double support.

    Every leaf is an array, so that inputs pad, stack and vmap.

    Attributes:
        time: (N,) [s].
        right: the right foot's control over the interval that ends at each moment, fields (N,).
        left: the left foot's.
        height_right: (N,) height of the right foot's sensor in its own world [m].
        height_left: (N,) the left one's.
        distance: (N,) range read [m], 0 where there is none.
        seen: (N,) bool, a range that can be used was read.
        turning: (N,) bool, one of the feet turns.
        double_support: (N,) bool, both feet are on the ground.
        start_heading: (2,) heading of the right and of the left foot before the first moment [rad].
        strides: which moments make strides.
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
    """The filter's part of the inputs with the feet exchanged: what they would be, had they been taken for each other.

    Strides keep their side; nothing but the filter is to be run on it.
    """
    return inputs._replace(
        right=inputs.left,
        left=inputs.right,
        height_right=inputs.height_left,
        height_left=inputs.height_right,
        start_heading=inputs.start_heading[::-1],
    )
