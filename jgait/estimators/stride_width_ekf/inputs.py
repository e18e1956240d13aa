"""Inputs of the stride width estimator: moments of stances, ranges and double support, as arrays."""

from typing import Annotated, NamedTuple

import numpy as np

from jgait.estimators.interface import Axis, Held, Sampled
from jgait.estimators.stride_width_ekf.model import PathControl
from jgait.notes import record


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


@record
class WidthInputs(NamedTuple):
    """Inputs of `stride_width_ekf.run` at N moments: stances, ranges, double support; every leaf is an array, so that
    inputs can be padded, stacked and mapped.
    """

    time: Held  #: (N,) [s].
    right: Annotated[PathControl, Axis()]  #: control over the interval that ends at each moment, fields (N,).
    left: Annotated[PathControl, Axis()]
    height_right: Held  #: (N,) height of the right foot's sensor in the world frame of its trajectory [m].
    height_left: Held
    #: (N,) measured range, or without one how far swinging feet keep outside, see `passings` [m]; 0 at other moments.
    distance: Sampled
    range_measured: Sampled  #: (N,) bool, True at moments with a usable range.
    turning: Sampled  #: (N,) bool, True in a turn of one of the feet.
    double_support: Sampled  #: (N,) bool, both feet are on the ground.
    usual: np.ndarray  #: bool, True: there is no range, and feet pass each other as those of usual people.
    start_heading: np.ndarray  #: (2,) heading of the right and of the left foot before the first moment [rad].
    strides: Annotated[StrideRows, Axis()]  #: strides and the moments at which they end.
    valid: Sampled  #: (N,) bool, False for padding.
