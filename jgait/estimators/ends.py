"""A recording that begins or ends in walking: the time before its first whole stride and after its last one."""

from collections.abc import Mapping

import numpy as np

from jgait.estimators.stride_flags import durations
from jgait.events.rest import longest_still
from jgait.notes import Kind, Note
from jgait.quality import SensorQuality
from jgait.types import AnyArray, Estimate, as_float

MID_STANCE = 0.31
"""[1] Share of a stride from the middle of a stance to the final contact: a foot stands for some 62 % of a stride."""

LONGEST_REST, RESTING = 0.45, 0.5
"""[1], [rad/s] Longest rest of a sensor in a stance, as a share of a stride, and the rate below which it rests; in a
longer rest the person stands."""

STANDS, SWINGS = 0.75, 2.0
"""[1], [rad/s] Share of a stride after which a foot has left the ground in walking, and a rate that it then reaches."""

SHORT = 0.5
"""[1] Share of the median length below which a first or last stride starts or ends in standing; the strides in turns,
which are short too, are longer."""

LEAST_CUT_STRIDES, MOST = 0.2, 1.5
"""[strides] Limits of the walking that a recording cuts off: in less, a person stands for a moment; in more, the
activity is another one."""

WALKING_CUT = Kind(
    "walking_cut", "info", "{placement}: the recording {does} in walking, {seconds:.1f} s {where} whole stride",
    "The part of a stride there is in no stride of the table. The distance of one estimator does not count it; that of "
    "all sensors together counts it with the median walking speed, and with a larger deviation.",
)  # fmt: skip


def cut_off(estimate: Estimate, sensors: Mapping[int, tuple[str, AnyArray]]) -> dict[str, SensorQuality]:
    """Walking before the first and after the last stride of each sensor.

    Args:
        estimate: without padding, with strides.
        sensors: side → placement, and angular rate (T,) or (T, 3) of its sensor, without bias [rad/s].
    """
    cuts = {placement: unseen(estimate, side, gyr) for side, (placement, gyr) in sensors.items()}
    return {
        placement: SensorQuality(walks_before=before, walks_after=after) for placement, (before, after) in cuts.items()
    }


def cut_notes(quality: Mapping[str, SensorQuality]) -> list[Note]:
    """Notes on sensors whose recording cuts off a stride."""
    return [
        WALKING_CUT(placement=placement, seconds=seconds, does=does, where=where)
        for placement, facts in quality.items()
        for seconds, does, where in (
            (facts.walks_before, "begins", "before the first"), (facts.walks_after, "ends", "after the last"),
        ) if seconds > 0.0
    ]  # fmt: skip


def unseen(estimate: Estimate, side: int, gyr: AnyArray) -> tuple[float, float]:
    """Duration of walking before the first and after the last stride of a side [s]; 0 where the person stands."""
    strides, time = estimate.strides, as_float(estimate.time)
    mine = np.flatnonzero((np.asarray(strides.side) == side) & np.asarray(strides.valid, bool))
    if not len(mine):
        return 0.0, 0.0
    leaves, lands, length = (as_float(part)[mine] for part in (strides.final_contact, strides.end, strides.length))
    known = durations(strides)[mine]
    if not np.isfinite(known).any():
        return 0.0, 0.0
    lasts, usual = float(np.nanmedian(known)), float(np.nanmedian(length))
    rates = as_float(gyr).reshape(len(time), -1)
    hz = (len(time) - 1) / max(float(np.ptp(time)), 1e-9)
    cuts = []
    speed, stance = np.linalg.norm(rates, axis=1), MID_STANCE * lasts
    for at, beyond, moment, beside in (
        (time <= leaves[0], time <= leaves[0] - stance, leaves[0] - time[0], length[0]),
        (time >= lands[-1], time >= lands[-1] + stance, time[-1] - lands[-1], length[-1]),
    ):
        missing = float(moment) - stance
        walks = LEAST_CUT_STRIDES * lasts < missing < MOST * lasts and beside > SHORT * usual
        if walks:
            rests = longest_still(rates[at], hz, threshold=RESTING, at_least_s=LONGEST_REST * lasts)
            stays = moment > STANDS * lasts and not (speed[beyond] > SWINGS).any()
            walks = rests is None and not stays
        cuts.append(missing if walks else 0.0)
    return cuts[0], cuts[1]
