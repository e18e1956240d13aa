"""Inputs of the ankle's estimator: signals and decisions of one or two legs, in arrays that pad, stack and map."""

from typing import Annotated, NamedTuple

from jaxtyping import PyTree

from jgait.estimators.interface import Axis, Held, Sampled, Times
from jgait.notes import record
from jgait.types import Counts, Values

STRIDES = Axis("zero", 10, 2)
"""The axis of strides; no stride is shorter than ten samples."""

PerStride = Annotated[Values, STRIDES]
"""(K,), one entry per stride; 0 or False after the last stride."""


class AnkleSignals(NamedTuple):
    """Signals of one leg's sensor in the segment's axes (forward, left, up), and the decisions of `prepare`."""

    gyr: Held  #: (T, 3) angular rate at each sample [rad/s], not filtered.
    acc: Held  #: (T, 3) specific force [m/s²], not filtered.
    gyr_jump: Sampled  #: (T,) largest change of the rate from sample to sample in a window around the sample [rad/s].
    acc_jump: Sampled  #: (T,) the same of the specific force [m/s²].
    gyr_doubt: Sampled  #: (T,) standard deviation of the rate where it was lost or clipped, else 0 [rad/s].
    acc_doubt: Sampled  #: (T,) the same of the specific force [m/s²].
    stands: Sampled  #: (T,) bool, the ankle stands: around valleys, and while the person stands.
    restart: Sampled  #: (T,) 1 at the sample after the begin of a stride, else 0; in floats.
    dt: Sampled  #: (T,) time since the sample before [s]; 0 up to the first stance, where the filter starts.
    valid: Sampled  #: (T,) bool; False before the first stance and in padding.
    last: Counts  #: index of the last sample before the padding.
    rate_hz: Values  #: sampling rate.
    attitude: PyTree  #: (4,) q_ws at the first stance, w first, its heading arbitrary.
    gyr_bias: Values  #: (3,) gyroscope bias while standing [rad/s].
    still_time: Values  #: duration of the standing from which that bias was measured [s]; 0: the leg never stood still.
    mid_shank: Values  #: 1 if the sensor is at mid shank, 0 at the ankle.
    axes: Values  #: (3, 3) forward, left and up in the sensor's axes.
    begin: PerStride  #: (K,) sample at which each stride begins; after the last stride, 0.
    end: PerStride  #: (K,) sample at which each stride ends.
    swing_begin: PerStride  #: (K,) sample at which the shank's forward swing begins.
    swing_end: PerStride  #: (K,) sample at which the shank's forward swing ends.
    leaves: PerStride  #: (K,) time at which the swing begins, between samples [s].
    lands: PerStride  #: (K,) time at which the swing ends, between samples [s].
    half: PerStride  #: (K,) bool, the stride begins or ends with standing.
    clips: PerStride  #: (K,) bool, the stride's swing reaches the gyroscope's range.
    follows: PerStride  #: (K,) bool, the stride begins where the stride before ended.
    count: Counts  #: number of strides.


@record
class AnkleInputs(NamedTuple):
    """Inputs of `ankle_stride.run`: signals of each leg with a sensor at times (T,) [s]; every leaf is an array."""

    time: Times
    right: AnkleSignals | None
    left: AnkleSignals | None
