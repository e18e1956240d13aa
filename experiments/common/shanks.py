"""One sensor at the ankle or on the shank, and the strides of its leg by a reference: three public sets.

`tripod`: shanks; OptoGait, from 10 s after the first contact until the belt slows down; its clock is off by some 0.1 s,
differently for each leg and trial. `neura_sparse`: ankles and mid shanks; contacts come from
Vicon's heel, lengths from its ankle. `walking5m`: shanks; contacts come from insoles, lengths from foot trajectories,
with a standard deviation of 4 to 6 cm. The sensor on the shank is detected by its swing, not by its name.
"""

from typing import Any, NamedTuple

import numpy as np

from experiments.common.recordings import walks
from experiments.common.signals import low_pass
from jgait.mounting import shank as shank_axes
from jgait.mounting.shank import Axes
from jgait.notes import Note
from jgait.types import SIDES, Imu, Walk, as_float

FULL = 0.65  # of the recording's median: a shorter stride is a half-step
SHIFTED = 0.15  # [m] a shorter stride is a foot that was shifted


class Reference(NamedTuple):
    """Strides of a leg by a reference.

    Attributes:
        contact: (n,) initial contact that ends each stride [s].
        length: (n,) of each stride [m]; NaN where it is not known.
        begin: (n,) [s] since when the stride may have begun: its swing's middle lies between this and the contact.
        positions: (T, 2) horizontal ankle in the laboratory on the sensor's samples [m], or None.
        window: (first, last) [s] of the recording that is judged.
    """

    contact: np.ndarray
    length: np.ndarray
    begin: np.ndarray
    positions: np.ndarray | None
    window: tuple[float, float]

    @property
    def full(self) -> np.ndarray:
        """(n,) bool, which are whole strides rather than half-steps from or to standing."""
        return self.length > FULL * float(np.nanmedian(self.length))


class Leg(NamedTuple):
    """A sensor, its axes, and the reference.

    Attributes:
        group: "tripod", "neura_ankle", "neura_shank", "walking5m_young", "walking5m_elderly".
        walk: name of the recording.
        subject: identifier of the person.
        side: "right" or "left".
        imu: the sensor, in its own axes, without the bias that its gyroscope has while standing.
        axes: computed from the walk.
        rate_hz: of the samples.
        leg_length: [m], or None.
        reference: strides.
        notes: facts that the code noticed.
    """

    group: str
    walk: str
    subject: str
    side: str
    imu: Imu
    axes: Axes
    rate_hz: float
    leg_length: float | None
    reference: Reference
    notes: tuple[Note, ...]


def legs(name: str, only: tuple[str, ...] | None = None) -> list[Leg]:
    """Every leg of a data set whose reference has strides.

    Args:
        name: "tripod", "neura_sparse" or "walking5m".
        only: names of recordings; None: all.

    Raises:
        DatasetUnavailable: if the set is not there.
    """
    found = []
    for walk in walks(name, only):
        for side in SIDES:
            for placement, group in _placements(name, walk, side):
                note = None
                if placement.startswith("shank"):
                    placement, note = shank_axes.worn_on_shank(walk.recording, side)
                imu = rested(walk.recording.sensors[placement], walk.recording.sampling_rate_hz)
                axes = shank_axes.functional_axes(imu)
                reference = _REFERENCES[name](walk, side)
                if axes is None or reference is None or not len(reference.contact):
                    continue
                lengths = walk.info.get("lengths")
                tall = sum(lengths[side]) if lengths else walk.info.get("leg_length")
                who = walk.recording
                notes = () if note is None else (note,)
                rate_hz = who.sampling_rate_hz
                found.append(Leg(group, who.name, who.subject, side, imu, axes, rate_hz, tall, reference, notes))
    return found


def rested(imu: Imu, rate_hz: float) -> Imu:
    """The sensor without gaps, and without the bias that it has while the leg stands, where it does."""
    imu, bias = shank_axes.filled(imu), shank_axes.rest_bias(imu, rate_hz)
    return imu if bias is None else imu._replace(gyr=as_float(imu.gyr) - bias)


def _placements(name: str, walk: Walk, side: str) -> list[tuple[str, str]]:
    if name == "neura_sparse":
        return [(f"ankle_{side}", "neura_ankle"), (f"shank_{side}", "neura_shank")]
    group = name if name == "tripod" else f"{name}_{walk.info['group']}"
    return [(f"shank_{side}", group)] if f"shank_{side}" in walk.recording.sensors else []


def _tripod(walk: Walk, side: str) -> Reference | None:
    """A row has the stride that begins at its contact; the stride ends at the contact of the next row."""
    told = walk.info["optogait"]
    if not told:
        return None
    of = told[side]
    kept = np.flatnonzero(of["kept"])
    # Rows follow each other as long as the belt runs evenly; then OptoGait loses feet.
    kept = kept[: int(np.argmax(np.append(np.diff(kept) != 1, True))) + 1]
    begin, ends = of["time"][kept], of["time"][kept] + of["stride_time"][kept]
    return Reference(ends, of["stride_length"][kept], begin, None, (float(begin[0]) + 0.4, float(ends[-1]) + 0.4))


def _neura(walk: Walk, side: str) -> Reference | None:
    """Swings are where the ankle moves; the contact is the heel's low at their end."""
    rate = walk.recording.sampling_rate_hz
    centres = walk.info["joint_centres"][side]
    ankle = low_pass(as_float(centres["ankle"]), 6.0, rate)
    heel = low_pass(as_float(centres["heel"]), 10.0, rate)[:, 2]
    speed = np.linalg.norm(np.gradient(ankle[:, :2], axis=0), axis=1) * rate
    edges = np.flatnonzero(np.diff(np.concatenate([[0], (speed > 0.5).astype(np.int8), [0]])))
    rows = []
    for start, end in zip(edges[::2], edges[1::2], strict=True):
        if end - start < 0.2 * rate:
            continue
        low, high = end - int(0.15 * rate), min(end + int(0.1 * rate), len(heel) - 1)
        stood = [int(np.argmin(speed[max(start - int(0.4 * rate), 0) : start])) + max(start - int(0.4 * rate), 0)]
        stood.append(end + int(np.argmin(speed[end : end + int(0.4 * rate)])))
        length = float(np.linalg.norm(ankle[stood[1], :2] - ankle[stood[0], :2]))
        rows.append((low + int(np.argmin(heel[low:high])), length, start))
    if not rows:
        return None
    contact, length, begin = (np.array(column, float) for column in zip(*rows, strict=True))
    first, last = walk.info["windows"]["whole"]
    return Reference(contact / rate, length, begin / rate - 0.1, ankle[:, :2], (first / rate - 0.5, last / rate + 0.5))


def _walking5m(walk: Walk, side: str) -> Reference | None:
    """Lengths come from the sensor on the foot, the instants of contact within a stride from the insole."""
    if walk.reference is None or side not in walk.info["feet"] or side not in walk.info["insoles"]:
        return None
    rate, feet = walk.recording.sampling_rate_hz, walk.info["feet"]
    foot = feet[side]
    pressure = low_pass(np.sum([as_float(part) for part in walk.info["insoles"][side]], axis=0), 15.0, rate)
    turning = np.linalg.norm(as_float(walk.recording.sensors[f"foot_{side}"].gyr), axis=1)
    # The foot turns fastest as its toes leave.
    middle = [a + int(np.argmax(turning[a:b])) for a, b in zip(foot.start, foot.end, strict=True)]
    contact = np.array([_landing(pressure, foot.standing, k, rate) for k in middle]) / rate
    first, last = (min(f.start[0] for f in feet.values()), max(f.end[-1] for f in feet.values()))
    window = (float(first) / rate - 0.3, float(last) / rate + 0.3)
    return Reference(contact, foot.length, foot.start / rate, None, window)


def _landing(pressure: np.ndarray, standing: np.ndarray, middle: int, rate_hz: float) -> int:
    """The sample at which a sole begins to bear weight, next to where its foot comes to stand after a swing's middle.

    There the pressure rises fastest; it begins to where its slope was less than a sixth of that.
    """
    stands = middle + int(np.argmax(standing[middle:]))
    first, last = max(stands - int(0.35 * rate_hz), middle), min(stands + int(0.12 * rate_hz), len(pressure) - 1)
    slope = np.gradient(pressure)
    at = first + int(np.argmax(slope[first:last]))
    slow = np.flatnonzero(slope[first:at] < slope[at] / 6.0)
    return first + (int(slow[-1]) + 1 if len(slow) else 0)


_REFERENCES: dict[str, Any] = {"tripod": _tripod, "neura_sparse": _neura, "walking5m": _walking5m}
