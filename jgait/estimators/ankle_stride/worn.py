"""Mounting of the ankle's sensor, computed from a recording, for the online estimator; on the host."""

from typing import NamedTuple

import numpy as np

from jgait.estimators.ankle_stride.params import AnkleOptions, AnkleParams
from jgait.estimators.ankle_stride.prepare import WINDOW_S, prepare
from jgait.estimators.lagged import JUMP_S
from jgait.events import shank_stance
from jgait.notes import record
from jgait.signal import butterworth
from jgait.types import SIDES, Counts, Recording, RecordingError, Values

HOLD_S = 0.2
"""[s] Duration for which a minimum of the stance rate must stay the lowest to count as the valley."""

LANDING_S = 0.25
"""[s] Duration after a swing in which the foot lands; valleys before the highest rate in it do not count."""

CALM_S = 0.5
"""[s] Duration of slow turning (see `prepare.STANDING`) from which on the leg counts as standing."""

ONLINE = AnkleOptions(smooth=False)
"""Options of the estimator over the whole recording to which the online estimator corresponds."""


@record
class Worn(NamedTuple):
    """Mounting and settings of a sensor, from a recording; every leaf is an array."""

    axes: Values  #: (3, 3) forward, left and up in the sensor's axes.
    gyr_bias: Values  #: (3,) gyroscope bias while standing, in the segment's axes [rad/s].
    still_time: Values  #: duration of the standing from which that bias was measured [s]; 0: the leg never stood still.
    mid_shank: Values  #: 1 if the sensor is at mid shank, 0 at the ankle.
    rate_hz: Values  #: sampling rate.
    side: Counts  #: 0 right, 1 left.
    hold: Values  #: `HOLD_S` in samples.
    landing: Values  #: `LANDING_S` in samples.
    calm: Values  #: `CALM_S` in samples.
    reach: Values  #: half width of the window of zero velocities around a valley, in samples.
    shift: Values  #: delay of the stance rate relative to the integrated signals, in samples.
    #: one zero for each sample of the filter's lag, for each stored change of the readings, and for those around the
    #: sample that is integrated: their numbers, known when a program is compiled.
    lengths: tuple[Values, ...]


def worn(p: AnkleParams, recording: Recording, side: str) -> Worn:
    """Mounting and settings of the sensor of one side, from a recording of standing and walking; on the host.

    Args:
        p: parameters; the cut-off gives the delay of the low-passed signals.
        recording: as of `ankle_stride.estimate`; a few strides, and half a second of standing for the gyroscope bias.
        side: "right" or "left".

    Raises:
        RecordingError: as `ankle_stride.prepare.prepare`; no sensor on that side, or one that does not walk.
        ValueError: another side.
    """
    if side not in SIDES:
        raise ValueError(f"side must be 'right' or 'left'; got {side!r}")
    number = SIDES.index(side)
    leg = prepare(recording, ONLINE).inputs[1 + number]
    if leg is None or int(leg.count) == 0:
        what = "has no sensor there" if leg is None else "does not walk there"
        raise RecordingError(f"a recording of walking is needed to know how the {side} sensor is worn; this one {what}")
    hz = recording.sampling_rate_hz
    late = float(butterworth.delay(p.cutoff_hz, hz))
    shift = max(0, round((float(butterworth.delay(shank_stance.CUTOFF_HZ, hz)) - late) * hz))
    around = max(1, round(JUMP_S * hz))
    changes = max(round(late * hz) + around, 2 * around + 1)
    times = (HOLD_S, LANDING_S, CALM_S, WINDOW_S)
    hold, landing, calm, reach = (np.asarray(max(1, round(seconds * hz)), np.int32) for seconds in times)
    return Worn(
        axes=leg.axes,
        gyr_bias=leg.gyr_bias,
        still_time=leg.still_time,
        mid_shank=leg.mid_shank,
        rate_hz=leg.rate_hz,
        side=np.asarray(number, np.int32),
        hold=hold,
        landing=landing,
        calm=calm,
        reach=reach,
        shift=np.asarray(shift, np.int32),
        lengths=tuple(map(np.zeros, (int(hold + reach) + shift, changes, 2 * around + 1))),
    )
