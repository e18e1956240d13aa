"""What the joint estimator of both feet takes: each foot's signals, and the range on their clock."""

from typing import Any, NamedTuple

import numpy as np

from jgait.estimators.foot_ins import inputs as foot_inputs
from jgait.estimators.foot_ins.inputs import FootInputs, FootSignals


class TwoFeetInputs(NamedTuple):
    """All that `two_feet.run` needs; every leaf is an array.

    Attributes:
        time: (T,) [s].
        right: right foot.
        left: left foot.
        distance: (T,) range at the sample nearest to it [m]; 1 where there is none.
        late: (T,) how long after the sample it was read [s].
        seen: (T,) bool, a range that can be used was read.
        heading_right: (T,) direction of the right foot's stride in its own horizontal world [rad], to a few degrees.
        heading_left: (T,) the same of the left foot, in its own.
        yaw: how far the left foot's world is turned from the right one's, as first strides say [rad].
        turning: (T,) bool, one of the feet turns.
        double_support: (T,) bool, the moment between two stances at which both feet are stillest.
    """

    time: Any
    right: FootSignals
    left: FootSignals
    distance: Any
    late: Any
    seen: Any
    heading_right: Any
    heading_left: Any
    yaw: Any
    turning: Any
    double_support: Any


def pad(inputs: TwoFeetInputs, samples: int) -> TwoFeetInputs:
    """The same recording with invalid samples behind it, so that recordings of different length stack.

    Args:
        inputs: of T samples.
        samples: length wanted, T or more.

    Returns:
        Inputs of `samples` samples; the estimate at the first T is unchanged.

    Raises:
        ValueError: if `samples` is less than T.
    """
    feet: Any = foot_inputs.pad(FootInputs(inputs.time, inputs.right, inputs.left), samples)
    more = samples - inputs.time.shape[0]

    def longer(values: Any, *, edge: bool = False) -> np.ndarray:
        return np.pad(np.asarray(values), (0, more), mode="edge" if edge else "constant")

    return inputs._replace(
        time=feet.time,
        right=feet.right,
        left=feet.left,
        distance=np.pad(np.asarray(inputs.distance), (0, more), constant_values=1.0),
        late=longer(inputs.late),
        seen=longer(inputs.seen),
        heading_right=longer(inputs.heading_right, edge=True),
        heading_left=longer(inputs.heading_left, edge=True),
        turning=longer(inputs.turning),
        double_support=longer(inputs.double_support),
    )
