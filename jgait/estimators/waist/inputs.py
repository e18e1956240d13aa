"""Inputs of the waist's estimator, as arrays that can be padded, stacked and mapped, and its nodes: walking bouts from
initial contacts and standing, in NumPy on the host.
"""

from typing import Annotated, NamedTuple

import numpy as np
from jaxtyping import PyTree

from jgait.estimators.checks import lost_between
from jgait.estimators.interface import Axis, Held, Sampled, Times, axes_of
from jgait.estimators.notes import LONGEST_LOSS, NO_STEPS
from jgait.estimators.waist.notes import BOUTS_WITHOUT_STANDING
from jgait.estimators.walking import LEAST_CUT_STRIDES, MOST, cut_notes
from jgait.events import trunk as trunk_events
from jgait.notes import Note, record
from jgait.quality import SensorQuality
from jgait.types import Counts, Values, as_float

NODES = Axis("zero", 5, 4)
"""The axis of nodes; a step at the lowest sampling rate has 5 samples."""

PerNode = Annotated[Values, NODES]
"""(K,), one entry per node; 0 or False after the last node."""

HeldNode = Annotated[Values, NODES._replace(fill="hold")]
"""(K,), one entry per node; the last node's entry is repeated after it."""


@record
class WaistInputs(NamedTuple):
    """Signals of a sensor on the trunk, in the trunk's axes (forward, left, up), and the decisions of `prepare`.

    A node is an initial contact, or the end of standing before the first contact of a bout, or the beginning of
    standing after its last contact. Row k describes node k and the interval that ends at node k.
    """

    time: Times  #: (T,) [s].
    gyr: Held  #: (T, 3) angular rate [rad/s].
    acc: Held  #: (T, 3) specific force [m/s²], scaled to gravity at rest.
    still: Sampled  #: (T,) bool, the person stands still.
    measured: Sampled  #: (T,) bool; False where a sample was lost, and in padding.
    valid: Sampled  #: (T,) bool; False in padding.
    dt: Sampled  #: (T,) time since the sample before [s]; 0 at the first sample and in padding.
    last: Counts  #: index of the last sample before the padding.
    rate_hz: Values  #: sampling rate.
    gyr_bias: Values  #: (3,) gyroscope bias while standing [rad/s].
    attitude: PyTree  #: (4,) q_ws at the first sample, w first, its heading arbitrary.
    start_variance: Values  #: variance of that attitude's error, in excess of the filter's settled variance [rad²].
    at: HeldNode  #: (K,) sample of each node; after the last node, the last node's sample.
    #: (K,) time of the initial contact, between samples [s]; if the node is no contact, its sample's time.
    contact: HeldNode
    side: PerNode  #: (K,) foot of the contact, 0 right, 1 left.
    likely: PerNode  #: (K,) probability of that side [1].
    contacts: PerNode  #: (K,) bool, the node is an initial contact.
    steps: PerNode  #: (K,) bool, the interval is a step, from a contact to the next one.
    moves: PerNode  #: (K,) bool, the person walks over the interval: a step, or one from or to standing.
    stands: PerNode  #: (K,) bool, the person stands still at the node.
    fresh: PerNode  #: (K,) bool, a bout begins at the node.
    stride: PerNode  #: (K,) bool, a stride ends at the node: two steps after a contact of the same foot.
    #: (K,) sample at which each gait cycle begins; cycles are strides of the foot of the first stride.
    cycle_begin: PerNode
    cycle_end: PerNode  #: (K,) sample at which each gait cycle ends.
    cycles: Values  #: number of gait cycles.
    stood: PerNode  #: (K,) bool, the node's bout began from standing.
    count: Counts  #: number of nodes.


PER_NODE = tuple(name for name, axis in axes_of(WaistInputs).items() if axis is not None and axis.every == NODES.every)
"""Names of the fields with one entry per node."""


START_S = 2.5
"""[s] Upper limit on the time from standing to the first contact if a bout begins from standing; also at its end.
Chosen by hand."""

CLOSING = 0.9
"""[steps] Duration of the closing step, whose foot comes to rest beside the other almost without an impact. On 36 walks
of `ipol_gait` it is 0.9 with a standard deviation of 0.15."""


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
    shift = 0.5 * rate  # [s] a foot swings in it; nearer to a rest, weight shifts
    stood = -1.0
    for rows in np.split(np.arange(len(at)), cut):
        first, last = at[rows[0]], at[rows[-1]]
        # a first contact just before the end of a rest is a weight shift
        before = max((b - 1.0 for a, b in still if a < first and b - 1.0 < min(first + shift, last)), default=-1.0)
        behind = min((float(a) for a, b in still if a > last), default=np.inf)
        nodes: list[Node] = []
        from_rest = before >= stood and before >= 0.0 and first - before <= START_S * rate
        to_rest = behind - last <= START_S * rate
        step = rate / as_float(contacts.step_frequency)[rows[-1]]
        if from_rest and len(rows) > 1 and first - before < shift:
            rows = rows[max(1, int(np.searchsorted(at[rows], before, side="right"))) :]
        if to_rest and len(rows) > 2 and forward[round(last) : int(behind)].sum() > 0.0:
            rows, last = rows[:-1], at[rows[-2]]  # no step: integrated back from standing, the trunk sways backward
        # a last impact so late after the step before is the settling of the trunk after the closing step
        closed = to_rest and len(rows) > 1 and 1.25 < (last - at[rows[-2]]) / step < 1.6
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
