"""Walking bouts from initial contacts and standing, and their nodes (see `WaistInputs`); NumPy, on the host."""

from typing import NamedTuple

import numpy as np

from jgait.estimators.checks import lost_between
from jgait.estimators.notes import LONGEST_LOSS, NO_STEPS
from jgait.estimators.waist.notes import BOUTS_WITHOUT_STANDING
from jgait.estimators.walking import LEAST_CUT_STRIDES, MOST, cut_notes
from jgait.events import trunk as trunk_events
from jgait.notes import Note
from jgait.quality import SensorQuality
from jgait.types import Values, as_float

START_S = 2.5
"""[s] Upper limit on the time from standing to the first contact if a bout begins from standing; also at its end."""

CLOSING, SETTLING = 0.9, (1.25, 1.6)
"""[steps] Duration of the closing step, whose foot comes to rest beside the other almost without an impact; and time
after which a last impact is the settling of the trunk after that step. On 36 walks of `ipol_gait` the time is 0.9 with
a standard deviation of 0.15."""


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
    `still` has half-open ranges of samples in which the person stands, `forward` (T,) is the forward acceleration.
    """
    at, side = as_float(contacts.time) * rate, np.asarray(contacts.side)
    likely = 0.5 + 0.5 * as_float(contacts.certainty)
    if not len(at):
        return []
    begun, ended = (np.searchsorted([run[k] for run in still], at, side="right") for k in (0, 1))
    pause = np.maximum(2.2 / np.maximum(as_float(contacts.step_frequency), 0.5), 2.0) * rate
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
        # [s] a foot swings in it; before it, weight shifts
        if from_rest and len(rows) > 1 and first - before < 0.5 * rate:
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
        if to_rest and not closed and behind - last > 2.0 * step:  # [steps] there was a closing step in between
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
    """Take strides out of `nodes` that begin or end in a loss (T,), or lose more than `LONGEST_LOSS`; their number."""
    rows = np.flatnonzero(nodes["stride"])
    begin, end = nodes["at"][rows - 2], nodes["at"][rows]
    gone = lost[begin] | lost[end] | (lost_between(lost, time, begin, end) > LONGEST_LOSS)
    nodes["stride"][rows[gone]] = False
    return int(gone.sum())


def notes_of(
    nodes: dict[str, np.ndarray], contacts: int, placement: str, time: np.ndarray, acc: np.ndarray
) -> tuple[SensorQuality, list[Note]]:
    """Walking that the recording cuts off, and notes about it and about the bouts of a sensor; `time` (T,) is in s,
    `acc` (T, 2) the trunk's acceleration forward and up.
    """
    if not contacts:
        return SensorQuality(unusable=True), [NO_STEPS(placement=placement)]
    fresh = np.flatnonzero(nodes["fresh"])
    moving = fresh[~nodes["stands"][fresh].astype(bool)]
    notes: list[Note] = []
    if len(moving):
        notes.append(BOUTS_WITHOUT_STANDING(some=len(moving), begin_s=nodes["contact"][moving[0]]))
    ends = np.flatnonzero(nodes["stride"])
    if not len(ends):
        return SensorQuality(), notes
    at, stands = nodes["contact"], nodes["stands"]
    stride_s = float(np.median(at[ends] - at[ends - 2]))
    rows, steps = nodes["at"], np.flatnonzero(nodes["steps"])
    before, after = (
        float(seconds)
        if not still and LEAST_CUT_STRIDES < seconds / stride_s < MOST and not _calm(acc, edge, begins)
        else 0.0
        for seconds, still, edge, begins in (
            (at[0] - time[0], stands[0], (0, rows[0]), rows[steps] - rows[0]),
            (time[-1] - at[-1], stands[-1], (rows[-1], len(time)), rows[steps - 1]),
        )
    )  # fmt: skip
    cut = SensorQuality(walks_before=before, walks_after=after)
    return cut, notes + cut_notes({placement: cut})


def _calm(acc: np.ndarray, edge: tuple[int, int], begins: np.ndarray) -> bool:
    """Whether the acceleration (T, 2) varies less in `edge`, first sample and sample after the last, than in every
    stretch as long that begins, or ends, with a step; `begins` are the first samples of these stretches.
    """
    size = edge[1] - edge[0]
    of_steps = [acc[row : row + size].var(axis=0).sum() for row in begins if 0 <= row <= len(acc) - size]
    return bool(acc[slice(*edge)].var(axis=0).sum() < min(of_steps, default=0.0))
