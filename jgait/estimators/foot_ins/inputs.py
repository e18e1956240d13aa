"""What the foot estimator takes: signals and decisions of one or two feet, as arrays that pad, stack and map."""

from typing import Annotated, NamedTuple

from jaxtyping import PyTree

from jgait.estimators.axes import Axis, Held, Sampled, Times
from jgait.types import Counts, Values

SHORTEST_STANCE_TO_STANCE = 20
"""[samples] Less than from one stance to the next at the lowest rate; see `capacity`."""


def capacity(samples: int) -> int:
    """How many footholds there is room for in a recording of some samples."""
    return samples // SHORTEST_STANCE_TO_STANCE + 2


type PerFoothold = Annotated[Values, Axis("hold", capacity)]
"""(K,), one entry a foothold; the last one goes on behind it."""


class FootSignals(NamedTuple):
    """One foot's sensor, and what was decided about it.

    Attributes:
        gyr: (T, 3) mean angular rate over the interval that ends at each sample [rad/s].
        acc: (T, 3) mean specific force over it, scaled to gravity at rest [m/s²].
        gyr_jump: (T,) change of the rate from sample to sample, the largest near by [rad/s].
        acc_jump: (T,) the same of the specific force [m/s²].
        gyr_doubt: (T,) standard deviation of the rate where it was lost or clipped, else 0 [rad/s].
        acc_doubt: (T,) the same of the specific force [m/s²].
        rate: (T,) magnitude of the rate, without bias [rad/s].
        stands: (T,) bool, the foot stands.
        restart: (T,) 1 at the sample after a foothold's, else 0; in floats.
        dt: (T,) since the sample before [s]; 0 up to the first stance, where the filter starts.
        valid: (T,) bool; False before the first stance and in padding.
        attitude: (4,) q_ws at the first stance, w first, its heading arbitrary.
        gyr_bias: (3,) at rest [rad/s].
        acc_bias: (3,) of the accelerometer, as far as gravity at rest tells it [m/s²].
        up: (3,) the vertical at the first stance, in the sensor's axes [1].
        still_time: how long the foot stood still for the bias [s].
        foothold: (K,) samples of the footholds, in order; the last repeated.
        leaves: (K,) sample at which it is last seen to stand there.
        arrives: (K,) sample at which it is first seen to stand there.
        final_contact: (K,) sample of the final contact after it.
        initial_contact: (K,) sample of the next initial contact.
        whole: (K,) bool; False where too much is lost between a foothold and the next for a stride to be told.
        known: (T,) bool; False there.
        count: how many footholds there are.
    """

    gyr: Held
    acc: Held
    gyr_jump: Sampled
    acc_jump: Sampled
    gyr_doubt: Sampled
    acc_doubt: Sampled
    rate: Sampled
    stands: Sampled
    restart: Sampled
    dt: Sampled
    valid: Sampled
    attitude: PyTree
    gyr_bias: Values
    acc_bias: Values
    up: Values
    still_time: Values
    foothold: PerFoothold
    leaves: PerFoothold
    arrives: PerFoothold
    final_contact: PerFoothold
    initial_contact: PerFoothold
    whole: PerFoothold
    known: Sampled
    count: Counts


class FootInputs(NamedTuple):
    """All that `foot_ins.run` needs; every leaf is an array.

    Attributes:
        time: (T,) [s].
        right: right foot, or None.
        left: left foot, or None.
    """

    time: Times
    right: FootSignals | None
    left: FootSignals | None
