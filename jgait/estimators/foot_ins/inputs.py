"""Inputs of the foot estimator: signals, stances and footholds of one or two feet, as arrays."""

from typing import Annotated, NamedTuple

from jaxtyping import PyTree

from jgait.estimators.interface import Axis, Held, Sampled, Times
from jgait.notes import record
from jgait.types import Counts, Values

FOOTHOLDS = Axis("hold", 20, 2)
"""The axis of footholds; from stance to stance are twenty samples or more."""

PerFoothold = Annotated[Values, FOOTHOLDS]
"""(K,), one entry a foothold; padding repeats the last entry."""


class FootSignals(NamedTuple):
    """Signals of one foot's sensor, with its stances and footholds."""

    gyr: Held  #: (T, 3) mean angular rate over the interval that ends at each sample [rad/s].
    acc: Held  #: (T, 3) mean specific force over it [m/s²].
    gyr_jump: Sampled  #: (T,) change of the rate from sample to sample, the largest over a short window [rad/s].
    acc_jump: Sampled  #: (T,) change of the specific force from sample to sample, likewise [m/s²].
    gyr_doubt: Sampled  #: (T,) standard deviation of the rate where it was lost or clipped, else 0 [rad/s].
    acc_doubt: Sampled  #: (T,) standard deviation of the specific force, likewise [m/s²].
    rate: Sampled  #: (T,) magnitude of the rate, without bias [rad/s].
    stands: Sampled  #: (T,) bool, True in stance.
    margin: Sampled  #: (T,) logarithm of the detector's threshold over its statistic, above 0 exactly where `stands`.
    features: Held  #: (T, F) features of noise models, see `jgait.estimators.noise.features`.
    restart: Sampled  #: (T,) float, 1 at the sample after each foothold, else 0.
    dt: Sampled  #: (T,) time since the previous sample [s]; 0 up to the first stance, where the filter starts.
    valid: Sampled  #: (T,) bool; False before the first stance and in padding.
    attitude: PyTree  #: (4,) q_ws at the first stance, w first, its heading arbitrary.
    gyr_bias: Values  #: (3,) gyroscope bias at rest [rad/s].
    acc_bias: Values  #: (3,) accelerometer bias along the vertical, measured from gravity at rest [m/s²].
    up: Values  #: (3,) the vertical at the first stance, in the sensor's axes [1].
    still_time: Values  #: duration of rest over which the gyroscope bias was measured [s].
    foothold: PerFoothold  #: (K,) samples of the footholds, in order; padding repeats the last.
    #: (K,) sample at or before the end of the stance, at which the timing of the next stride starts.
    leaves: PerFoothold
    #: (K,) sample at or after the start of the stance, at which the timing of the last stride ends.
    arrives: PerFoothold
    final_contact: PerFoothold  #: (K,) sample of the final contact after the foothold.
    initial_contact: PerFoothold  #: (K,) sample of the next initial contact.
    whole: PerFoothold  #: (K,) bool; False where too many samples are lost up to the next foothold to estimate a stride
    known: Sampled  #: (T,) bool; False in the strides that `whole` excludes.
    count: Counts  #: number of footholds.


@record
class FootInputs(NamedTuple):
    """Inputs of `foot_ins.run`: signals of each foot with a sensor at times (T,) [s]; every leaf is an array."""

    time: Times
    right: FootSignals | None
    left: FootSignals | None
