"""Inputs of the ankle's estimator: signals and decisions of one or two legs, in arrays that pad, stack and map."""

from typing import Annotated, NamedTuple

from jaxtyping import PyTree

from jgait.estimators.axes import Axis, Held, Sampled, Times, fields_of
from jgait.types import Counts, Values

SHORTEST_STRIDE = 10
"""[samples] Lower limit on the samples between two strides at the lowest sampling rate; see `capacity`."""


def capacity(samples: int) -> int:
    """K, the number of rows for strides in a recording of this number of samples."""
    return samples // SHORTEST_STRIDE + 2


type PerStride = Annotated[Values, Axis("zero", capacity)]
"""(K,), one entry per stride; 0 or False after the last stride."""


class AnkleSignals(NamedTuple):
    """Signals of one leg's sensor in the segment's axes (forward, left, up), and the decisions of `prepare`.

    Attributes:
        gyr: (T, 3) angular rate at each sample [rad/s], not filtered.
        acc: (T, 3) specific force [m/s²], not filtered.
        gyr_jump: (T,) largest change of the rate from sample to sample in a window around the sample [rad/s].
        acc_jump: (T,) the same of the specific force [m/s²].
        gyr_doubt: (T,) standard deviation of the rate where it was lost or clipped, else 0 [rad/s].
        acc_doubt: (T,) the same of the specific force [m/s²].
        stands: (T,) bool, the ankle stands: around valleys, and while the person stands.
        restart: (T,) 1 at the sample after the begin of a stride, else 0; in floats.
        dt: (T,) time since the sample before [s]; 0 up to the first stance, where the filter starts.
        valid: (T,) bool; False before the first stance and in padding.
        last: index of the last sample before the padding.
        rate_hz: sampling rate.
        attitude: (4,) q_ws at the first stance, w first, its heading arbitrary.
        gyr_bias: (3,) gyroscope bias while standing [rad/s].
        still_time: duration of the standing from which that bias was measured [s]; 0: the leg never stood still.
        mid_shank: 1 if the sensor is at mid shank, 0 at the ankle.
        axes: (3, 3) forward, left and up in the sensor's axes.
        begin: (K,) sample at which each stride begins; after the last stride, 0.
        end: (K,) sample at which each stride ends.
        swing_begin: (K,) sample at which the shank's forward swing begins.
        swing_end: (K,) sample at which the shank's forward swing ends.
        leaves: (K,) time at which the swing begins, between samples [s].
        lands: (K,) time at which the swing ends, between samples [s].
        half: (K,) bool, the stride begins or ends with standing.
        clips: (K,) bool, the stride's swing reaches the gyroscope's range.
        follows: (K,) bool, the stride begins where the stride before ended.
        count: number of strides.
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
    """Inputs of `ankle_stride.run`: signals of each leg with a sensor at times (T,) [s]; every leaf is an array."""

    time: Times
    right: AnkleSignals | None
    left: AnkleSignals | None


PER_STRIDE = fields_of(AnkleSignals, capacity)
"""Names of the fields of `AnkleSignals` with one entry per stride."""
