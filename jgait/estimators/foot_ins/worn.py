"""Mounting and errors of the sensor on a foot, from a recording, for the online estimator; on the host."""

from typing import NamedTuple

import numpy as np
from jaxtyping import PyTree

from jgait.estimators.foot_ins.prepare import checked_clock, errors_at_rest
from jgait.events import foot as events
from jgait.events.rest import rest
from jgait.signal.windows import over_losses
from jgait.types import SIDES, Counts, Recording, RecordingError, Values

HOLD_S = 0.1
"""[s] Duration for which a sample must stay the stillest to be the foothold."""

JUMP_S = 0.0075
"""[s] Half width of the window whose largest change of the readings gives a reading's noise."""


class FootWorn(NamedTuple):
    """Mounting and settings of a foot's sensor, from a recording; every leaf is an array."""

    scale: Values  #: factor on the accelerometer [1].
    gyr_bias: Values  #: (3,) gyroscope bias at rest [rad/s].
    acc_bias: Values  #: accelerometer bias along the vertical, from gravity at rest [m/s²].
    still_time: Values  #: duration of rest over which the gyroscope bias was measured [s].
    axis: Values  #: (3,) axis about which the foot turns, toes up positive, in the sensor's axes [1].
    rate_hz: Values  #: sampling rate.
    side: Counts  #: 0 right, 1 left.
    samples: PyTree  #: (n, 7) zeros, one row for each stored sample: rate, specific force, whether it is lost.
    quiet: PyTree  #: (m,) zeros, one row for each stored sample of the detector.
    window: PyTree  #: (w,) zeros, as many as samples in the detector's window.
    jumps: PyTree  #: (j,) zeros, as many as samples in the window of the largest change.
    after_start: PyTree  #: (a,) zeros, as many as samples removed from the start of a stance.
    before_end: PyTree  #: (b,) zeros, as many as samples removed from its end.


def worn(recording: Recording, side: str) -> FootWorn:
    """Mounting and settings of the sensor of one side, from a recording of standing and walking; on the host.

    Raises:
        RecordingError: as `foot_ins.prepare.prepare`, or if the foot does not walk.
    """
    name = f"foot_{side}"
    time = checked_clock(recording, (side,))
    imu = recording.sensors[name]
    mask = np.asarray(imu.mask, bool)
    gyr, acc = (over_losses(np.arange(len(time)), values, mask) for values in (imu.gyr, imu.acc))
    hz = 1.0 / float(np.median(np.diff(time)))
    at_rest = rest(gyr, acc, mask, hz)
    scale, acc_bias = errors_at_rest(at_rest, name, [])
    free = gyr - at_rest.gyr_bias
    stances = events.stances(free, acc * scale, hz)
    if len(stances.start) < 3:
        raise RecordingError(
            f"a recording of walking is needed to know how '{name}' is worn; this one has {len(stances.start)} stances"
        )
    half, hold = len_of(events.WINDOW / 2, hz), len_of(HOLD_S, hz)
    around = len_of(JUMP_S, hz)
    after, before = (round(seconds * hz) for seconds in events.EROSION)
    return FootWorn(
        scale=np.asarray(scale),
        gyr_bias=at_rest.gyr_bias,
        acc_bias=np.asarray(acc_bias),
        still_time=np.asarray(max(at_rest.time, 0.05)),
        axis=_toes_up(free, stances, hz),
        rate_hz=np.asarray(hz),
        side=np.asarray(SIDES.index(side), np.int32),
        samples=np.zeros((max(2 * half + 1, half + hold + around + 3), 7)),
        quiet=np.zeros(after + hold + 2),
        window=np.zeros(2 * half + 1),
        jumps=np.zeros(2 * around + 1),
        after_start=np.zeros(after),
        before_end=np.zeros(before),
    )


def len_of(seconds: float, hz: float) -> int:
    """A duration in samples, at least one."""
    return max(1, round(seconds * hz))


def _toes_up(gyr: np.ndarray, stances: events.Stances, hz: float) -> np.ndarray:
    """(3,) main axis of the rotation in swing; with its sign the heel rises before the toes in most strides."""
    swinging = ~events.inside(stances, len(gyr))
    axis = np.linalg.eigh(gyr[swinging].T @ gyr[swinging])[1][:, -1]
    votes = 0
    for a, b in zip(stances.stillest[:-1], stances.stillest[1:], strict=True):
        pitch = np.cumsum(gyr[a:b] @ axis) / hz
        pitch -= np.linspace(0.0, pitch[-1], b - a)
        votes += 1 if np.argmax(pitch) > np.argmin(pitch) else -1
    return np.asarray(axis if votes >= 0 else -axis)
