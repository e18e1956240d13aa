"""Walking bouts from initial contacts and standing, their nodes (see `WaistInputs`), and walking without contacts.

NumPy, on the host. Walking without contacts is detected from the size of the specific force alone, which depends
neither on axes nor on the gyroscope: steps are missing if these are wrong.
"""

from typing import NamedTuple

import numpy as np

from jgait.estimators.checks import lost_between
from jgait.estimators.notes import LONGEST_LOSS, NO_STEPS
from jgait.estimators.waist.notes import BOUTS_WITHOUT_STANDING
from jgait.estimators.walking import LEAST_CUT_STRIDES, MOST, cut_notes
from jgait.events import trunk as trunk_events
from jgait.notes import Note
from jgait.quality import SensorQuality
from jgait.signal.windows import held_mean, window_size
from jgait.types import Values, as_float

PAUSE_STEPS, PAUSE_S = 2.2, 2.0
"""[steps], [s] Two successive contacts belong to different bouts if the time between them exceeds both limits."""

START_S = 2.5
"""[s] Upper limit on the time from standing to the first contact if a bout begins from standing; also at its end."""

CLOSING, SETTLING = 0.9, (1.25, 1.6)
"""[steps] Duration of the closing step, whose foot comes to rest beside the other almost without an impact; and time
after which a last impact is the settling of the trunk after that step. On 36 walks of `ipol_gait` the time is 0.9 with
a standard deviation of 0.15."""

UNCLOSED = 2.0
"""[steps] If standing begins later than this after the last detected contact, there was a closing step in between."""

SETTING_OFF_S = 0.5
"""[s] Least time from standing to the first contact, in which a foot swings; an earlier detection is a shift of weight.
First contacts of `ipol_gait` and of simulated people come later, except in very slow walks."""

MOVES, STEP = 0.5, 0.6
"""[1] Spread of the specific force, over that in walking, above which a person walks on after the last contact; and
[strides] window of the spread, which contains a whole step."""


class Node(NamedTuple):
    """One node, see `WaistInputs`."""

    at: float  #: instant of the node [samples, and parts of them].
    contact: bool  #: the node is an initial contact.
    side: int  #: foot of the contact, 0 right, 1 left; 0 if the node is no contact.
    likely: float  #: probability of that side; 0 if the node is no contact.
    moves: bool  #: the person walks from the node before to this node.
    step: bool  #: the interval from the node before is a step, from contact to contact.
    stands: bool  #: the person stands still at the node.
    fresh: bool  #: a bout begins at the node.


def bouts(
    contacts: trunk_events.Contacts, still: list[tuple[int, int]], rate: float, forward: np.ndarray
) -> list[list[Node]]:
    """Nodes of every bout: its contacts, the end of standing before them and the beginning of standing after them.

    `still` has half-open ranges of samples in which the person stands, `forward` (T,) the forward acceleration.
    """
    at, side = as_float(contacts.time) * rate, np.asarray(contacts.side)
    likely = 0.5 + 0.5 * as_float(contacts.certainty)
    if not len(at):
        return []
    begun, ended = (np.searchsorted([run[k] for run in still], at, side="right") for k in (0, 1))
    pause = np.maximum(PAUSE_STEPS / np.maximum(as_float(contacts.step_frequency), 0.5), PAUSE_S) * rate
    cut = np.flatnonzero((np.diff(at) > pause[1:]) | (ended[1:] > begun[:-1])) + 1
    of_bouts: list[list[Node]] = []
    stood = -1.0
    for rows in np.split(np.arange(len(at)), cut):
        first, last = at[rows[0]], at[rows[-1]]
        before = max((b - 1.0 for a, b in still if b - 1.0 < first), default=-1.0)
        behind = min((float(a) for a, b in still if a > last), default=np.inf)
        nodes: list[Node] = []
        from_rest = before >= stood and before >= 0.0 and first - before <= START_S * rate
        to_rest = behind - last <= START_S * rate
        step = rate / as_float(contacts.step_frequency)[rows[-1]]
        if from_rest and len(rows) > 1 and first - before < SETTING_OFF_S * rate:
            rows = rows[1:]
        if to_rest and len(rows) > 2 and forward[round(last) : int(behind)].sum() > 0.0:
            rows, last = rows[:-1], at[rows[-2]]  # no step: integrated back from standing, the trunk sways backward
        closed = to_rest and len(rows) > 1 and SETTLING[0] < (last - at[rows[-2]]) / step < SETTLING[1]
        if closed:
            last = at[rows[-1]] = at[rows[-2]] + CLOSING * step
        if from_rest:
            nodes.append(Node(before, False, 0, 0.0, False, False, True, True))
        for number, row in enumerate(rows):
            fresh = number == 0 and not from_rest
            nodes.append(Node(at[row], True, int(side[row]), likely[row], not fresh, number > 0, False, fresh))
        if to_rest and not closed and behind - last > UNCLOSED * step:
            last += CLOSING * step
            nodes.append(nodes[-1]._replace(at=last, side=1 - nodes[-1].side, moves=True, step=True, fresh=False))
        if to_rest:
            nodes.append(Node(behind, False, 0, 0.0, True, False, True, False))
            stood = behind
        else:
            stood = last
        of_bouts.append(nodes)
    return of_bouts


def nodes(bouts: list[list[Node]], time: Values = (0.0,)) -> dict[str, np.ndarray]:
    """The bouts as columns of `WaistInputs`, one row per node; `time` is that of the samples [s]."""
    flat = [node for bout in bouts for node in bout]
    stood = np.array([bout[0].stands for bout in bouts for _ in bout], bool)
    instant = np.array([node.at for node in flat], float)
    at = np.rint(instant).astype(np.int32)
    # if two nodes share a sample, the later node moves one sample on; at the recording's end the earlier moves back
    for row in range(1, len(at)):
        at[row] = max(at[row], at[row - 1] + 1)
    at = np.minimum(at, np.arange(len(time) - len(at), len(time))).astype(np.int32)
    columns = {
        name: np.array([getattr(node, name[:-1] if name in ("contacts", "steps") else name) for node in flat], kind)
        for name, kind in (("side", np.int32), ("likely", float), ("contacts", bool), ("steps", bool),
                           ("moves", bool), ("stands", bool), ("fresh", bool))
    }  # fmt: skip
    steps, side, contacts = columns["steps"], columns["side"], columns["contacts"]
    stride = np.zeros(len(flat), bool)
    stride[2:] = steps[2:] & steps[1:-1] & (side[2:] == side[:-2]) & (side[1:-1] != side[2:]) & contacts[:-2]
    index = np.arange(len(time), dtype=float)
    contact = np.interp(instant, index, as_float(time)) if len(flat) else np.zeros(0)
    foot = side[np.flatnonzero(stride)[0]] if stride.any() else 0
    ends = np.flatnonzero(stride & (side == foot))
    return {
        **columns, "at": at, "contact": contact, "stride": stride, "stood": stood,
        "cycle_begin": at[ends - 2], "cycle_end": at[ends],
    }  # fmt: skip


def leave_out(nodes: dict[str, np.ndarray], lost: np.ndarray, time: np.ndarray) -> int:
    """Take strides out of `nodes` that begin or end in a loss, or lose more than `LONGEST_LOSS`; returns their number.

    `lost` (T,) bool is True at lost samples.
    """
    rows = np.flatnonzero(nodes["stride"])
    begin, end = nodes["at"][rows - 2], nodes["at"][rows]
    gone = lost[begin] | lost[end] | (lost_between(lost, time, begin, end) > LONGEST_LOSS)
    nodes["stride"][rows[gone]] = False
    return int(gone.sum())


def notes_of(
    nodes: dict[str, np.ndarray], contacts: int, placement: str, time: np.ndarray, force: np.ndarray
) -> tuple[SensorQuality, list[Note]]:
    """Walking that the recording cuts off, and notes about it and about the bouts of a sensor; `time` (T,) is in s,
    `force` (T,) the size of the specific force.
    """
    if not contacts:
        return SensorQuality(unusable=True), [NO_STEPS(placement=placement)]
    fresh = np.flatnonzero(nodes["fresh"])
    moving = fresh[~nodes["stands"][fresh].astype(bool)]
    notes: list[Note] = []
    if len(moving):
        notes.append(BOUTS_WITHOUT_STANDING(some=len(moving), bouts=len(fresh), begin_s=nodes["contact"][moving[0]]))
    ends = np.flatnonzero(nodes["stride"])
    if not len(ends):
        return SensorQuality(), notes
    at, stands = nodes["contact"], nodes["stands"]
    stride_s = float(np.median(at[ends] - at[ends - 2]))
    walking = force[(time >= at[0]) & (time <= at[-1])].std()
    cuts = []
    for seconds, beyond, still in (
        (at[0] - time[0], time < at[0] - LEAST_CUT_STRIDES * stride_s, stands[0]),
        (time[-1] - at[-1], time > at[-1] + LEAST_CUT_STRIDES * stride_s, stands[-1]),
    ):
        moves = seconds < STEP * stride_s or force[beyond].std() > MOVES * walking
        cuts.append(float(seconds) if moves and not still and LEAST_CUT_STRIDES < seconds / stride_s < MOST else 0.0)
    cut = SensorQuality(walks_before=cuts[0], walks_after=cuts[1])
    return cut, notes + cut_notes({placement: cut})


REDUCED_HZ = 25.0
"""[Hz] About the rate to which the force is averaged; a step has at least eight samples."""

WINDOW_S = 2.0
"""[s] Window of the force's standard deviation and of its correlation with itself one step later."""

SHAKES, RHYTHM, LAGS = 0.7, 0.4, (0.75, 1.3)
"""[1], [1], [steps] Standard deviation of the force over its median near contacts, and largest correlation with itself
at one of these lags, above which the trunk moves as in walking: a sensor that is handled has no rhythm."""

BESIDE, FAR = 1.0, 1.5
"""[steps] Time to the nearest contact: up to `BESIDE` the trunk walks, above `FAR` no contact is near."""

LEAST_S = 2.0
"""[s] Duration above which walking counts as missing. Undamaged recordings of `ipol_gait`, `mobgap_lab`, `neura_sparse`
and `tripod` have none; a sensor that is handled before the walk has up to 1.2 s; where a walk of them disappears behind
a turn, most have 3.5 s and more."""


def missed(acc: np.ndarray, measured: np.ndarray, time: np.ndarray, contact: np.ndarray) -> np.ndarray:
    """(T,) bool, samples in which the trunk moves as in walking, far from every contact.

    Args:
        acc: (T, 3) specific force [m/s²], finite.
        measured: (T,) bool, False at lost samples.
        time: (T,) of the samples [s].
        contact: instants of contacts, in order [s].
    """
    nowhere = np.zeros(len(time), bool)
    rate = (len(time) - 1) / float(time[-1] - time[0])
    every = max(1, int(rate / REDUCED_HZ))
    count = len(time) // every
    if len(contact) < 2 or count < 2:
        return nowhere
    force = np.linalg.norm(as_float(acc), axis=1)[: count * every].reshape(count, every).mean(axis=1)
    step, hz, at = float(np.median(np.diff(contact))), rate / every, time[: count * every : every]
    size = window_size(WINDOW_S, hz)
    swings = force - held_mean(force, size)
    strength = np.sqrt(held_mean(swings**2, size))
    rhythm = np.zeros(count)
    for lag in range(int(LAGS[0] * step * hz), min(int(LAGS[1] * step * hz) + 1, count - 1)):
        now, later = swings[: count - lag], swings[lag:]
        power = held_mean(now**2, size) * held_mean(later**2, size)
        alike = held_mean(now * later, size) / np.sqrt(np.maximum(power, 1e-12))
        middle = rhythm[lag // 2 : lag // 2 + count - lag]
        np.maximum(middle, alike, out=middle)
    after = np.searchsorted(contact, at)
    ends = (contact[np.clip(after + k, 0, len(contact) - 1)] for k in (-1, 0))
    apart = np.min([np.abs(at - end) for end in ends], axis=0) / step
    near = apart < BESIDE
    if not near.any():
        return nowhere
    walks = (apart > FAR) & (strength > SHAKES * np.median(strength[near])) & (rhythm > RHYTHM)
    nowhere[: count * every] = np.repeat(walks, every)
    return nowhere & measured
