"""What the waist's estimator takes: a sensor's signals and decisions, as arrays that pad, stack and map."""

from typing import Any, NamedTuple

from jgait.estimators.interface import grown, lengthened

SHORTEST_STEP = 5
"""[samples] Less than from one node to the next at the lowest rate; see `capacity`."""


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

    time: Any
    gyr: Any
    acc: Any
    still: Any
    measured: Any
    valid: Any
    dt: Any
    last: Any
    rate_hz: Any
    gyr_bias: Any
    attitude: Any
    start_variance: Any
    at: Any
    contact: Any
    side: Any
    contacts: Any
    steps: Any
    moves: Any
    stands: Any
    fresh: Any
    stride: Any
    cycle_begin: Any
    cycle_end: Any
    cycles: Any
    stood: Any
    alone: Any
    count: Any


PER_NODE = (
    "at", "contact", "side", "contacts", "steps", "moves", "stands", "fresh", "stride", "cycle_begin", "cycle_end",
    "stood", "alone",
)  # fmt: skip
_PER_SAMPLE = ("gyr", "acc", "still", "measured", "valid", "dt")


def capacity(samples: int) -> int:
    """How many nodes there is room for in a recording of some samples."""
    return samples // SHORTEST_STEP + 4


def pad(inputs: WaistInputs, samples: int) -> WaistInputs:
    """The same recording with invalid samples behind it, so that recordings of different length stack.

    Args:
        inputs: of T samples.
        samples: length wanted, T or more.

    Returns:
        Inputs of `samples` samples; the estimate at the first T is unchanged.

    Raises:
        ValueError: if `samples` is less than T.
    """
    have = inputs.time.shape[0]
    time = lengthened(inputs.time, samples)
    longer = grown(
        inputs, samples - have, capacity(samples) - capacity(have), per_sample=_PER_SAMPLE, per_row=PER_NODE,
        held=("gyr", "acc", "at", "contact"),
    )  # fmt: skip
    return longer._replace(time=time)
