"""From a recording to what the foot estimator takes: stances, scale, level, footholds. NumPy, on the host.

Everything here is a decision: which samples stand, where footholds are, what the gyroscope reads at rest. Nothing
here carries a gradient; what follows (`foot_ins.run`) is smooth given these decisions.
"""

import itertools

import numpy as np

from jgait.estimators.checks import common_time
from jgait.estimators.foot_ins.inputs import FootInputs, FootSignals, capacity
from jgait.estimators.foot_ins.notes import NEVER_RESTS, STRIDES_MISSING
from jgait.estimators.interface import Prepared
from jgait.estimators.notes import CLIPPED, SCALE_CORRECTED, STRIDES_UNCERTAIN
from jgait.events import foot as events
from jgait.events import zero_velocity
from jgait.events.rest import Rest, rest
from jgait.geometry.vectors import GRAVITY
from jgait.notes import Note
from jgait.types import SIDES, Imu, Recording, RecordingError, as_float

SLOWEST_HZ = 45.0
"""A heel strike lasts some 30 ms: below this rate the jolt falls between samples."""

OFF_SCALE = 0.12
"""The accelerometer at rest may differ from gravity by this share [1]; beyond it the unit is in doubt."""

SCALE_SPREAD, BIAS_SPREAD = 0.005, 0.1
"""[1], [m/s²] What accelerometers usually err by: a difference at rest is shared out between scale and bias so."""

LOST_RATE, LOST_FORCE = 2.0, 15.0
"""[rad/s], [m/s²] How wrong a straight line through lost samples may be."""

LONGEST_LOSS = 0.25
"""[s] A stride of which more is lost is none: a swing takes half a second."""

CLIPPED_RATE, CLIPPED_FORCE = 3.0, 30.0
"""[rad/s], [m/s²] How wrong a clipped reading may be."""

CLIPS_ABOVE_RATE, CLIPS_ABOVE_FORCE = 8.0, 35.0
"""[rad/s], [m/s²] Equal readings in a row at the top of the range count as clipped from here on."""

REST_STEP = 20.0
"""[s] Footholds of a foot that rests are this far apart."""

REACH = 0.3
"""[s] A stride is timed from at most this long before the foot is seen to leave, to as long after it arrives."""


def worn_sides(recording: Recording, estimator: str = "foot_ins") -> tuple[str, ...]:
    """The sides whose foot wears a sensor.

    Raises:
        RecordingError: if neither does.
    """
    sides = tuple(side for side in SIDES if f"foot_{side}" in recording.sensors)
    if not sides:
        raise RecordingError(
            f"{estimator} needs 'foot_right' or 'foot_left'; the recording has {sorted(recording.sensors)}"
        )
    return sides


def prepare(recording: Recording, detector: str = "adaptive") -> Prepared[FootInputs]:
    """The inputs of `foot_ins.run` for a recording.

    Args:
        recording: sensors on one or both feet, on one clock.
        detector: see `FootOptions`.

    Raises:
        RecordingError: no foot sensor, clocks that differ, no accelerometer, NaN, too slow, a unit in doubt, or a foot
            that never stands.
    """
    sides = worn_sides(recording)
    time = _checked_clock(recording, sides)
    feet: dict[str, FootSignals | None] = dict.fromkeys(SIDES)
    notes: list[Note] = []
    standing = None
    for side in sides:
        feet[side], said, rests = _foot(recording.sensors[f"foot_{side}"], time, f"foot_{side}", detector)
        notes += said
        standing = rests if standing is None else standing
    return Prepared(FootInputs(time, feet["right"], feet["left"]), None, tuple(notes), standing)


def _checked_clock(recording: Recording, sides: tuple[str, ...]) -> np.ndarray:
    """The time that all feet share, checked together with the signals."""
    time = as_float(recording.sensors[f"foot_{sides[0]}"].time)
    if time.size < 3:
        raise RecordingError(f"foot_ins needs a walk; 'foot_{sides[0]}' has {time.size} samples")
    names = [f"foot_{side}" for side in sides]
    common_time(recording, names, "foot_ins", "both feet")
    rate = 1.0 / float(np.median(np.diff(time)))
    if rate < SLOWEST_HZ:
        raise RecordingError(f"foot_ins needs {SLOWEST_HZ:g} Hz or more; the recording has {rate:.1f} Hz")
    return time


def _filled(values: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Lost samples on a straight line between their neighbours."""
    if mask.all():
        return values
    index, there = np.arange(len(values)), np.flatnonzero(mask)
    return np.stack([np.interp(index, there, column[there]) for column in values.T], axis=1)


def _largest(values: np.ndarray, size: int) -> np.ndarray:
    """The largest of a centred window of an odd number of samples."""
    padded = np.pad(values, size // 2, mode="edge")
    largest = padded[: len(values)]
    for shift in range(1, size):
        largest = np.maximum(largest, padded[shift : shift + len(values)])
    return largest


def _clipped(values: np.ndarray, above: float) -> np.ndarray:
    """(T,) bool: two equal readings in a row, at the top of what the axis reads and above a limit."""
    top = np.abs(values).max(axis=0)
    flat = (np.diff(values, axis=0, prepend=np.nan) == 0.0) & (np.abs(values) >= 0.999 * top) & (top > above)
    flat[:-1] |= flat[1:]
    return flat.any(axis=1)


def _mean_over_interval(values: np.ndarray) -> np.ndarray:
    return np.concatenate([values[:1], 0.5 * (values[1:] + values[:-1])])


def _foot(
    imu: Imu, time: np.ndarray, name: str, detector: str
) -> tuple[FootSignals, list[Note], tuple[int, int] | None]:
    """One foot's signals and decisions, what was noticed, and its longest rest."""
    notes: list[Note] = []
    mask = np.asarray(imu.mask, bool)
    gyr, acc = (_filled(np.asarray(values, np.float64), mask) for values in (imu.gyr, imu.acc))
    step = np.diff(time, prepend=time[0])
    nominal = float(np.median(step[1:]))
    hz = 1.0 / nominal
    at_rest = rest(gyr, acc, mask, hz)
    scale, acc_bias = _errors(at_rest, name, notes)
    acc = acc * scale
    found = events.stances(gyr - at_rest.gyr_bias, acc, hz)
    if not len(found.start):
        lowest = float(events.moving_rate(gyr - at_rest.gyr_bias, hz).min())
        raise RecordingError(
            f"'{name}' never stands: a foot on the ground turns at less than {events.STANCE:g} rad/s between two "
            f"swings; its lowest rate is {lowest:.2f} rad/s"
        )
    lost = ~mask | (step > 1.5 * nominal)
    stands = _standing(gyr - at_rest.gyr_bias, acc, mask, found, hz, detector) & ~lost
    read_gyr, read_acc = (np.where(mask[:, None], np.asarray(v, np.float64), 0.0) for v in (imu.gyr, imu.acc))
    clips, turned = _clipped(read_acc, CLIPS_ABOVE_FORCE), _clipped(read_gyr, CLIPS_ABOVE_RATE)
    for what, flags in (("accelerometer", clips), ("gyroscope", turned)):
        if flags.any():
            notes.append(CLIPPED(signal=what, placement=name, samples=flags.sum()))
    found = _more_footholds(found, hz)
    whole, known = _whole(found, np.where(lost, step, 0.0))
    if lost.any():
        notes.append(STRIDES_UNCERTAIN(samples=lost.sum(), placement=name))
    if not whole.all():
        notes.append(STRIDES_MISSING(strides=np.sum(~whole), placement=name, seconds=LONGEST_LOSS))
    first = int(np.flatnonzero(stands)[0]) if stands.any() else int(found.stillest[0])
    until = min(max(found.end[0], first + 1), first + int(hz))
    up = acc[first:until].mean(axis=0)
    size = max(3, 2 * round(0.0075 * hz) + 1)
    jumps = [_largest(np.linalg.norm(np.gradient(values, axis=0), axis=1), size) for values in (gyr, acc)]
    dt = np.where(np.arange(len(time)) > first, step, 0.0)
    restart = np.zeros(len(time) + 1)
    restart[found.stillest + 1] = 1.0
    signals = FootSignals(
        gyr=_mean_over_interval(gyr),
        acc=_mean_over_interval(acc),
        gyr_jump=jumps[0],
        acc_jump=jumps[1],
        gyr_doubt=np.maximum(LOST_RATE * lost, CLIPPED_RATE * turned),
        acc_doubt=np.maximum(LOST_FORCE * lost, CLIPPED_FORCE * clips),
        rate=np.linalg.norm(gyr - at_rest.gyr_bias, axis=1),
        stands=stands,
        restart=restart[: len(time)],
        dt=dt,
        valid=np.arange(len(time)) >= first,
        attitude=level(up),
        gyr_bias=at_rest.gyr_bias,
        acc_bias=acc_bias * up / np.linalg.norm(up),
        up=up / np.linalg.norm(up),
        still_time=np.asarray(max(at_rest.time, 0.05)),
        whole=np.pad(whole, (0, capacity(len(time)) - len(whole))),
        known=known,
        **_footholds(gyr - at_rest.gyr_bias, found, hz, len(time)),
    )
    longest = max(at_rest.windows, key=lambda window: window[1] - window[0], default=None)
    return signals, notes, longest


def _errors(at_rest: Rest, name: str, notes: list[Note]) -> tuple[float, float]:
    """What the accelerometer is multiplied by, and its bias along the vertical [m/s²].

    One attitude cannot tell a scale from a bias; the difference is shared out by what is usual.
    """
    if not at_rest.windows:
        notes.append(NEVER_RESTS(placement=name))
        return 1.0, 0.0
    off = at_rest.force / GRAVITY - 1.0
    if abs(off) > OFF_SCALE:
        raise RecordingError(
            f"acc of '{name}' must read {GRAVITY:.2f} m/s² at rest; it reads {at_rest.force:.3g}: another unit, or a "
            "sensor that was moved while the rate was low"
        )
    if abs(off) > 0.01:
        notes.append(SCALE_CORRECTED(placement=name, percent=100.0 * off))
    share = SCALE_SPREAD**2 / (SCALE_SPREAD**2 + (BIAS_SPREAD / GRAVITY) ** 2)
    scale = 1.0 / (1.0 + share * off)
    return scale, scale * at_rest.force - GRAVITY


def _standing(
    gyr: np.ndarray, acc: np.ndarray, mask: np.ndarray, found: events.Stances, hz: float, detector: str
) -> np.ndarray:
    """(T,) bool: where the foot's velocity is taken to be zero."""
    if detector == "adaptive":
        return events.inside(found, len(gyr))
    flags = zero_velocity.zero_velocity(gyr, acc, hz, detector=detector, mask=mask)
    return np.asarray(flags)


def level(up: np.ndarray) -> np.ndarray:
    """(4,) the shortest rotation q_ws that takes a direction in the sensor's axes to the world's z."""
    x, y, z = up / np.linalg.norm(up)
    if z < -0.999999:
        return np.array([0.0, 1.0, 0.0, 0.0])
    q = np.array([1.0 + z, y, -x, 0.0])
    return q / np.linalg.norm(q)


def _more_footholds(found: events.Stances, hz: float) -> events.Stances:
    """A foot that stands for minutes has a foothold every `REST_STEP`: strides of no length, which are none."""
    step = int(REST_STEP * hz)
    rows = []
    for start, end, stillest, rate in zip(*found, strict=True):
        more = [k for k in range(start + step, end - step, step) if abs(k - stillest) >= step]
        places = sorted({int(stillest), *more})
        cuts = [start, *(int(0.5 * (a + b)) for a, b in itertools.pairwise(places)), end]
        rows += [(a, b, at, rate) for a, b, at in zip(cuts[:-1], cuts[1:], places, strict=True)]
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    return events.Stances(*columns)


def _whole(found: events.Stances, lost: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """After which footholds (n,) a stride can be told, and the samples (T,) that lie in none that cannot."""
    total = np.concatenate([[0.0], np.cumsum(lost)])
    ends = np.append(found.stillest[1:], len(lost) - 1)
    whole = total[ends + 1] - total[found.stillest + 1] <= LONGEST_LOSS
    known = np.ones(len(lost), bool)
    for at, end in zip(found.stillest[~whole], ends[~whole], strict=True):
        known[at + 1 : end] = False
    return whole, known


def _footholds(gyr: np.ndarray, found: events.Stances, hz: float, samples: int) -> dict[str, np.ndarray]:
    """Samples of footholds and contacts, filled up to `capacity` with the last."""
    rows, reach = capacity(samples), int(REACH * hz)
    final, initial = events.contacts(gyr, found, hz)
    last = found.end - 1

    def filled(values: np.ndarray) -> np.ndarray:
        return np.pad(values.astype(np.int32), (0, rows - len(values)), mode="edge")

    return {
        "foothold": filled(found.stillest),
        "leaves": filled(np.maximum(found.stillest, last - reach)),
        "arrives": filled(np.minimum(found.stillest, found.start + reach)),
        "final_contact": filled(np.append(final, samples - 1)),
        "initial_contact": filled(np.append(initial, samples - 1)),
        "count": np.asarray(len(found.stillest), np.int32),
    }
