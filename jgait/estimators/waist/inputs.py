"""Inputs of the waist's estimator: signals and decisions, as arrays that can be padded, stacked and mapped."""

from typing import Annotated, NamedTuple

from jaxtyping import PyTree

from jgait.estimators.interface import Axis, Held, Sampled, Times, axes_of
from jgait.notes import record
from jgait.types import Counts, Values

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


PER_NODE = tuple(name for name, axis in axes_of(WaistInputs).items() if axis is not None and axis.every > 1)
"""Names of the fields with one entry per node."""
