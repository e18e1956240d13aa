"""What the ankle's estimator takes: signals and decisions of one or two legs, as arrays that pad, stack and map."""

from typing import Annotated, NamedTuple

from jaxtyping import PyTree

from jgait.estimators.axes import Axis, Held, Sampled, Times, fields_of
from jgait.types import Counts, Values

SHORTEST_STRIDE = 10
"""[samples] Less than from one stride to the next at the lowest rate; see `capacity`."""


def capacity(samples: int) -> int:
    """How many strides there is room for in a recording of some samples."""
    return samples // SHORTEST_STRIDE + 2


type PerStride = Annotated[Values, Axis("zero", capacity)]
"""(K,), one entry a stride; 0 or False behind the last."""


class AnkleSignals(NamedTuple):
    """One leg's sensor in the segment's axes (forward, left, up), and what was decided about it.

    Attributes:
        gyr: (T, 3) angular rate at each sample [rad/s], not filtered.
        acc: (T, 3) specific force [m/s²], not filtered.
        gyr_jump: (T,) change of the rate from sample to sample, the largest near by [rad/s].
        acc_jump: (T,) the same of the specific force [m/s²].
        gyr_doubt: (T,) standard deviation of the rate where it was lost or clipped, else 0 [rad/s].
        acc_doubt: (T,) the same of the specific force [m/s²].
        stands: (T,) bool, the ankle stands: around valleys, and while the person does.
        restart: (T,) 1 at the sample after one at which a stride begins, else 0; in floats.
        dt: (T,) since the sample before [s]; 0 up to the first stance, where the filter starts.
        valid: (T,) bool; False before the first stance and in padding.
        last: sample before the padding.
        rate_hz: of the samples.
        attitude: (4,) q_ws at the first stance, w first, its heading arbitrary.
        gyr_bias: (3,) while standing [rad/s].
        still_time: how long the leg stood still for it [s]; 0: never.
        mid_shank: 1 if the sensor is at mid shank, 0 at the ankle.
        axes: (3, 3) forward, left and up in the sensor's axes.
        begin: (K,) sample at which each stride begins; behind the last, 0.
        end: (K,) sample at which it ends.
        swing_begin: (K,) sample at which the shank begins to swing forward.
        swing_end: (K,) sample at which it has swung.
        leaves: (K,) time of the former, between samples [s].
        lands: (K,) time of the latter [s].
        half: (K,) bool, a stride from or to standing.
        clips: (K,) bool, its swing reaches the gyroscope's range.
        follows: (K,) bool, it begins where the one before ended.
        count: how many strides there are.
    """

    gyr: Held
    acc: Held
    gyr_jump: Sampled
    acc_jump: Sampled
    gyr_doubt: Sampled
    acc_doubt: Sampled
    stands: Sampled
    restart: Sampled
    dt: Sampled
    valid: Sampled
    last: Counts
    rate_hz: Values
    attitude: PyTree
    gyr_bias: Values
    still_time: Values
    mid_shank: Values
    axes: Values
    begin: PerStride
    end: PerStride
    swing_begin: PerStride
    swing_end: PerStride
    leaves: PerStride
    lands: PerStride
    half: PerStride
    clips: PerStride
    follows: PerStride
    count: Counts


class AnkleInputs(NamedTuple):
    """All that `ankle_stride.run` needs; every leaf is an array.

    Attributes:
        time: (T,) [s].
        right: right leg, or None.
        left: left leg, or None.
    """

    time: Times
    right: AnkleSignals | None
    left: AnkleSignals | None


PER_STRIDE = fields_of(AnkleSignals, capacity)
"""Names of the fields of `AnkleSignals` with an entry for each stride."""
