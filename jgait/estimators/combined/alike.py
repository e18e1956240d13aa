"""Stride lengths of both sides by one source: both feet of a person who walks straight go as far."""

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

SIDES_ALIKE, UNLIKE = 0.05, 0.1
"""[1] Difference of the stride lengths of both sides over their mean up to which sensors that turn differently are not
wrong, as on a stiff leg; and above which one side is wrong. Chosen: between walks of `tripod`, `gaitmap_example`,
`ipol_gait` and `walking5m`, and simulated hemiparetic walks with shanks whose distance is off by more than three stated
deviations. A foot whose rates are too small by the least ratio that is noted has a larger difference."""

FEWEST_PAIRS = 6
"""Least number of pairs of a right and a left stride."""


def pairs(source: SourceEstimate) -> np.ndarray:
    """(n, 2) lengths of a right and a left stride at the same time [m], neither in a turn or in doubt."""
    strides = source.estimate.strides
    if strides is None or source.name == "width":
        return np.zeros((0, 2))
    side, start, end, length = (as_float(getattr(strides, name)) for name in ("side", "start", "end", "length"))
    straight = np.asarray(strides.valid, bool)
    if strides.turn is not None:
        straight = straight & (np.abs(as_float(strides.turn)) <= LARGEST_TURN)
    if (doubted := DOUBTFUL.read(source.estimate)) is not None:
        straight = straight & ~doubted
    right, left = (np.flatnonzero(straight & (side == number)) for number in range(len(SIDES)))
    if not len(left):
        return np.zeros((0, 2))
    middle = 0.5 * (start + end)
    near = left[np.argmin(np.abs(middle[right, None] - middle[left]), axis=1)]
    at_once = (start[right] < end[near]) & (start[near] < end[right])
    return np.stack([length[right], length[near]], axis=1)[at_once]


def apart(lengths: np.ndarray) -> float:
    """The difference between the sides of `pairs` over their mean [1]; NaN for few pairs."""
    if len(lengths) < FEWEST_PAIRS:
        return np.nan
    return abs(float(np.median(lengths[:, 0] - lengths[:, 1]))) / float(np.median(lengths, axis=0).mean())


def alike(sources: Sequence[SourceEstimate], placements: frozenset[str]) -> bool:
    """Whether a source with these two sensors measures strides of the same length on both sides."""
    return any(apart(pairs(source)) < SIDES_ALIKE for source in sources if placements.issubset(source.placements))


def with_sides_unlike(
    sources: Sequence[SourceEstimate], wrong: frozenset[str]
) -> tuple[list[SourceEstimate], list[Note]]:
    """The sources, with larger deviations where both sides' strides differ in length, and a note for each such source.

    Sources with a sensor in `wrong`, which another note explains, do not change.
    """
    changed, notes = list(sources), []
    for number, source in enumerate(sources):
        lengths = pairs(source)
        differs = apart(lengths)
        if len(source.placements) == len(SIDES) and not wrong.intersection(source.placements) and differs > UNLIKE:
            share = np.full(np.shape(source.estimate.strides.side), 0.5 * differs)
            changed[number] = source._replace(estimate=widened(source.estimate, share))
            right, left = np.median(lengths, axis=0)
            notes.append(SIDES_UNLIKE(source=source.name, right=right, left=left, strides=len(lengths)))
    return changed, notes
