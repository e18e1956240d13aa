"""What the waist's estimator takes: a sensor's signals and decisions, as arrays that pad, stack and map."""

from typing import Annotated, NamedTuple

from jaxtyping import PyTree

from jgait.estimators.axes import Axis, Held, Sampled, Times, fields_of
from jgait.types import Counts, Values

SHORTEST_STEP = 5
"""[samples] Less than from one node to the next at the lowest rate; see `capacity`."""


def capacity(samples: int) -> int:
    """How many nodes there is room for in a recording of some samples."""
    return samples // SHORTEST_STEP + 4


type PerNode = Annotated[Values, Axis("zero", capacity)]
"""(K,), one entry a node; 0 or False behind the last."""

type HeldNode = Annotated[Values, Axis("hold", capacity)]
"""(K,), one entry a node; the last one goes on behind it."""


class WaistInputs(NamedTuple):
    """A sensor on the trunk, in the trunk's axes (forward, left, up), and what was decided about it.

    A node is an instant at which something is known: an initial contact, or the beginning or end of standing still
    before the first or behind the last of a bout. Row k tells of node k and of the interval that ends there.

    Attributes:
        time: (T,) [s].
        gyr: (T, 3) angular rate [rad/s].
        acc: (T, 3) specific force [m/s²], scaled to gravity at rest.
        still: (T,) bool, the person stands still.
        measured: (T,) bool; False where a sample was lost, and in padding.
        valid: (T,) bool; False in padding.
        dt: (T,) since the sample before [s]; 0 at the first and in padding.
        last: sample before the padding.
        rate_hz: of the samples.
        gyr_bias: (3,) while standing [rad/s].
        attitude: (4,) q_ws at the first sample, w first, its heading arbitrary.
        start_variance: of its error, beyond what the filter settles at [rad²].
        at: (K,) sample of each node; behind the last, that of the last.
        contact: (K,) time of the initial contact, between samples [s]; of a node that is none, that of its sample.
        side: (K,) 0 right, 1 left.
        contacts: (K,) bool, the node is an initial contact.
        steps: (K,) bool, the interval is a step, from a contact to the next one.
        moves: (K,) bool, the person walks over the interval: a step, or one from or to standing.
        stands: (K,) bool, the person stands still at the node.
        fresh: (K,) bool, a bout begins at the node.
        stride: (K,) bool, a stride ends at the node: two steps on from a contact of the same foot.
        cycle_begin: (K,) sample at which each cycle of the right foot, or of whichever began, begins.
        cycle_end: (K,) sample at which it ends.
        cycles: how many cycles there are.
        stood: (K,) bool, the node's bout began from standing.
        alone: (K,) over how many steps of the bout a bias of the velocity update is shared [1].
        count: how many nodes there are.
    """

    time: Times
    gyr: Held
    acc: Held
    still: Sampled
    measured: Sampled
    valid: Sampled
    dt: Sampled
    last: Counts
    rate_hz: Values
    gyr_bias: Values
    attitude: PyTree
    start_variance: Values
    at: HeldNode
    contact: HeldNode
    side: PerNode
    contacts: PerNode
    steps: PerNode
    moves: PerNode
    stands: PerNode
    fresh: PerNode
    stride: PerNode
    cycle_begin: PerNode
    cycle_end: PerNode
    cycles: Values
    stood: PerNode
    alone: PerNode
    count: Counts


PER_NODE = fields_of(WaistInputs, capacity)
"""Names of the fields with an entry for each node."""
