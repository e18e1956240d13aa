"""Sources with a sensor on each side whose stride lengths differ between the sides."""

from collections.abc import Sequence

import numpy as np

from jgait.estimators.combined.sources import SourceEstimate
from jgait.estimators.stride_flags import DOUBTFUL, LARGEST_TURN
from jgait.notes import Kind, Note
from jgait.quality import widened
from jgait.types import SIDES, as_float

SIDES_UNLIKE = Kind(
    "lengths_of_sides_apart", "check", "stride length by {source}: {right:.2f} m on the right, {left:.2f} m on the "
    "left (medians of {strides} pairs of strides at the same time)",
    "Both feet of a person who walks straight go as far. At least one side is measured wrongly, as of a stiff leg "
    "whose shank hardly swings, a sensor of another scale, or one that moves on the leg. Which one is not known: the "
    "deviations of stride lengths and of the distance contain half of the difference. Do not read it as asymmetry.",
)  # fmt: skip

UNLIKE_SHARE = 0.1
"""[1] Difference of the stride lengths of both sides, over their mean, above which one side is wrong. Chosen: above
walks of `tripod`, `gaitmap_example`, `ipol_gait` and `walking5m`, and below simulated hemiparetic walks with shanks
whose distance is off by more than three stated deviations."""

APART_M = 0.3
"""[m] Largest distance of the feet's paths: by it the outer foot goes farther per radian of turn."""

FEWEST_PAIRS = 6
"""Least number of pairs of a right and a left stride."""


def with_sides_unlike(
    sources: Sequence[SourceEstimate], wrong: frozenset[str]
) -> tuple[list[SourceEstimate], list[Note]]:
    """The sources, with larger deviations where both sides' strides differ in length, and a note for each such source.

    A stride is paired with the stride of the other side whose middle is nearest, if both share time and neither is in a
    turn or in doubt. Sources with a sensor in `wrong`, which another note explains, do not change.
    """
    changed, notes = list(sources), []
    for number, source in enumerate(sources):
        if len(source.placements) != len(SIDES) or source.name == "width" or wrong.intersection(source.placements):
            continue
        pairs = _pairs(source)
        if len(pairs) < FEWEST_PAIRS:
            continue
        right, left = (float(value) for value in np.median(pairs[:, :2], axis=0))
        curve = APART_M * float(np.median(pairs[:, 2]))
        apart, mean = abs(float(np.median(pairs[:, 0] - pairs[:, 1]))), 0.5 * (right + left)
        if apart - curve > UNLIKE_SHARE * mean:
            share = np.full(np.shape(source.estimate.strides.side), 0.5 * apart / mean)
            changed[number] = source._replace(estimate=widened(source.estimate, share))
            notes.append(SIDES_UNLIKE(source=source.name, right=right, left=left, strides=len(pairs)))
    return changed, notes


def _pairs(source: SourceEstimate) -> np.ndarray:
    """(pairs, 3) lengths of a right and a left stride at the same time [m], and their mean turn, not negative [rad]."""
    strides = source.estimate.strides
    if strides is None or source.estimate.strides_stddev is None:
        return np.zeros((0, 3))
    turn = np.zeros(np.shape(strides.side)) if strides.turn is None else np.abs(as_float(strides.turn))
    start, end, length = as_float(strides.start), as_float(strides.end), as_float(strides.length)
    doubted = DOUBTFUL.read(source.estimate)
    straight = np.asarray(strides.valid, bool) & (turn <= LARGEST_TURN) & (True if doubted is None else ~doubted)
    right, left = (np.flatnonzero(straight & (np.asarray(strides.side) == side)) for side in range(len(SIDES)))
    if not len(left):
        return np.zeros((0, 3))
    middle = 0.5 * (start + end)
    near = left[np.argmin(np.abs(middle[right, None] - middle[left]), axis=1)]
    at_once = (start[right] < end[near]) & (start[near] < end[right])
    right_rows, left_rows = right[at_once], near[at_once]
    return np.stack([length[right_rows], length[left_rows], 0.5 * (turn[right_rows] + turn[left_rows])], axis=1)
