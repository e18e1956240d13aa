"""Flags of strides, for all estimators: turns, stairs, clipped swings, half and uneven strides, uncertain numbers."""

from collections.abc import Callable, Mapping
from types import ModuleType

import numpy as np

from jgait.estimators.about import StrideFlag
from jgait.estimators.columns import COLUMNS
from jgait.estimators.walking import durations
from jgait.notes import Kind, Note
from jgait.types import SIDES, Estimate, Flags, Strides, Values, as_float

LARGEST_TURN = 0.35
"""[rad] Largest change of heading of a straight stride (20°), for estimators that do not detect turns."""

STAIRS_M = 0.12
"""[m] Threshold on the rise or fall over a stride; a stride above it is flagged as one on stairs or a kerb."""

SHORT_STRIDE = 0.8
"""[1] At an end of a walking bout, a stride below this share of the usual length starts or ends in standing."""

FEWEST_STRIDES = 3
"""Least number of strides whose median is a usual duration; chosen."""

FEW_REGULAR = Kind(
    "few_regular_strides", "check", "only {strides} regular {strides:stride|strides}",
    "Means and standard deviations of few strides vary from walk to walk; a longer walk makes them firm.",
)  # fmt: skip


def stated(estimate: Estimate, name: str) -> np.ndarray | None:
    """(strides,) bool, the flag of this name in the diagnostics; None if the diagnostics do not contain it."""
    values = estimate.diagnostics.get(name)
    if values is None or estimate.strides is None or np.shape(values) != np.shape(estimate.strides.side):
        return None
    return np.asarray(values, bool)


def in_order(estimate: Estimate) -> np.ndarray:
    """(rows,) int, the valid strides in the order of their starts, as in the table of strides."""
    strides = estimate.strides
    valid = np.flatnonzero(np.asarray(strides.valid, bool))
    first = as_float(strides.standing if strides.start is None else strides.start)
    return valid[np.argsort(first[valid], kind="stable")]


def marks(estimate: Estimate, flags: tuple[StrideFlag, ...]) -> dict[str, np.ndarray]:
    """Name of the flag → (rows,) bool for the rows of the table of strides; without flags that are not available."""
    if estimate.strides is None:
        return {}
    order = in_order(estimate)
    read = {flag.name: flag.read(estimate) for flag in flags}
    return {name: np.asarray(values, bool)[order] for name, values in read.items() if values is not None}


def regular(estimate: Estimate, flags: tuple[StrideFlag, ...], column: str = "stride_length_m") -> np.ndarray:
    """(rows,) bool, strides that count in means of a column, for the rows of the table of strides."""
    return without(marks(estimate, flags), flags, in_order(estimate).size, column)


def stride_notes(marked: Mapping[str, np.ndarray], counted: np.ndarray) -> list[Note]:
    """Notes about uneven strides, and about few that count in means, from flags of strides and which count (rows,)."""
    kept = int(counted.sum())
    uneven = int(marked[UNEVEN_DURATION.name].sum()) if UNEVEN_DURATION.name in marked else 0
    notes = [STRIDES_UNEVEN(uneven=uneven, strides=len(counted))] if uneven else []
    return [*notes, FEW_REGULAR(strides=kept)] if 0 < kept < 10 else notes


def without(
    marked: Mapping[str, np.ndarray], flags: tuple[StrideFlag, ...], count: int, column: str = "stride_length_m"
) -> np.ndarray:
    """(count,) bool, strides without flags that leave them out of means of a column, see `StrideFlag.leaves_out`."""
    special = [marked[flag.name] for flag in flags if flag.name in marked and column in flag.leaves_out]
    return ~np.logical_or.reduce([np.zeros(count, bool), *special])


STRIDE_COLUMNS: dict[str, tuple[str, float]] = {
    "stride_length_m": ("length", 1.0),
    "stride_width_m": ("width", 1.0),
    "step_length_m": ("step_length", 1.0),
    "stride_duration_s": ("", 1.0),
    "walking_speed_mps": ("speed", 1.0),
    "stride_height_m": ("height", 1.0),
    "lift_m": ("lift", 1.0),
    "turn_deg": ("turn", 180.0 / np.pi),
    "contact_angle_deg": ("contact_angle", 180.0 / np.pi),
    "push_off_angle_deg": ("push_off_angle", 180.0 / np.pi),
}
"""Column of a table of strides → field of `Strides` ("" for the duration), and factor from the SI unit."""

OF_PATH = tuple(column for column in STRIDE_COLUMNS if column != "stride_duration_s")
"""Columns of a table of strides that follow from the path of the foot or the trunk."""

OF_STANCE = ("final_contact_s", "stance_duration_s", "swing_duration_s")
"""Columns of a table of strides that follow from how long the foot stands."""

OF_ANGLES = tuple(name for name, column in COLUMNS.items() if "_flexion_" in column.quantity)
"""Columns of a table of strides that follow from joint angles."""

EVERY = (*OF_PATH, *OF_STANCE, *OF_ANGLES, "stride_duration_s", "cadence_spm")
"""Columns of a table of strides that can be left out of means."""


BREAK = 3.0
"""[s] Longest break between two strides of one walking bout, mobgap's default."""


def pauses(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """(n − 1,) [s] from the latest end of the strides before to each next start, for strides in the order of starts."""
    return np.asarray(start[1:] - np.fmax.accumulate(end)[:-1])


def as_far(strides: Strides, gained: Values, xp: ModuleType = np) -> Flags:
    """(strides,) bool, the valid strides from contact to contact in which the body advances as far as the foot.

    In these strides the reference's distance grows by the stride's length, within a tenth; `gained` (strides,) [m] is
    that growth. Where it is NaN, strides that are short, as from and to standing, are left out. `xp` is NumPy, or
    `jax.numpy` under jit.
    """
    length, known = xp.asarray(strides.length), xp.asarray(strides.valid)
    usual = xp.nanmedian(xp.where(known, length, xp.nan))
    alike = xp.where(xp.isfinite(gained), abs(gained - length) <= 0.1 * length, length >= SHORT_STRIDE * usual)
    if strides.final_contact is None:
        return known & alike
    return known & alike & ~(xp.asarray(strides.final_contact) <= xp.asarray(strides.start))


def _turning(estimate: Estimate) -> Flags:
    known = stated(estimate, "turning")
    if known is not None or estimate.strides.turn is None:
        return known
    return np.abs(np.nan_to_num(as_float(estimate.strides.turn))) > LARGEST_TURN


def _stairs(estimate: Estimate) -> Flags:
    """Strides on stairs as stated, or that rise or fall by more than `STAIRS_M`, and than their deviation."""
    height, deviations = estimate.strides.height, estimate.strides_stddev
    climbs, doubtful = stated(estimate, "stairs"), stated(estimate, "doubtful")
    if height is None or not np.isfinite(as_float(height)).any():
        return climbs
    rises = np.abs(np.nan_to_num(as_float(height)))
    spread = 0.0 if deviations is None or deviations.height is None else np.nan_to_num(as_float(deviations.height))
    climbs = (rises > STAIRS_M if climbs is None else climbs) & (rises > spread)
    return climbs if doubtful is None else climbs & ~doubtful


def _with_stated(
    estimate: Estimate, name: str, detected: Callable[[Strides, np.ndarray], np.ndarray]
) -> np.ndarray | None:
    """(strides,) bool, the flag as stated, and as a function of the strides and their order detects it in the rows."""
    known, strides = stated(estimate, name), estimate.strides
    if strides.start is None or strides.end is None:
        return known
    flags, order = np.zeros(np.size(strides.side), bool), in_order(estimate)
    flags[order] = detected(strides, order)
    return flags if known is None else known | flags


def half_strides(strides: Strides, order: np.ndarray) -> np.ndarray:
    """(rows,) bool, strides from or to standing: without initial contact before, or short at an end of a bout.

    They are short beside the median of the strides between others, of both legs; if there are none, beside the longest.
    """
    start, end, length = (as_float(values)[order] for values in (strides.start, strides.end, strides.length))
    side = np.asarray(strides.side)[order]
    half = np.zeros(order.size, bool)
    if strides.final_contact is not None:
        half |= np.nan_to_num(as_float(strides.final_contact)[order] - start, nan=1.0) <= 0.0
    ends = np.zeros(order.size, bool)
    for leg in range(len(SIDES)):
        if (rows := np.flatnonzero(side == leg)).size:
            apart = start[rows][1:] - end[rows][:-1] > 0.5 * np.median(end[rows] - start[rows])
            ends[rows] = np.concatenate([[True], apart]) | np.concatenate([apart, [True]])
    if (known := np.isfinite(length)).any():
        inner = length[known & ~ends]
        usual = np.median(inner) if inner.size else length[known].max()
        half |= ends & (length < SHORT_STRIDE * usual)
    return half


def uneven_strides(lasts: np.ndarray) -> np.ndarray:
    """(n,) bool, strides of another duration than those around them, from durations in order; NaN where not known.

    The duration is above 1.5 times the median of the three strides before and after, of both legs, or below 1 / 1.5 of
    it. Chosen: steady strides differ by some hundredths, a stride with a pause by far more.
    """
    uneven = np.zeros(len(lasts), bool)
    for i, duration in enumerate(lasts):
        others = np.concatenate([lasts[max(i - 3, 0) : i], lasts[i + 1 : i + 4]])
        others = others[np.isfinite(others)]
        if np.isfinite(duration) and len(others) >= FEWEST_STRIDES:
            usual = float(np.median(others))
            uneven[i] = not usual / 1.5 <= duration <= usual * 1.5
    return uneven


def _unsure(estimate: Estimate) -> Flags:
    # a model that estimates the bias weighs integration with the pendulum; its deviations hold for all strides alike
    return None if "acc_bias" in estimate.diagnostics else stated(estimate, "unsure")


def _width(estimate: Estimate) -> Values:
    trusted = stated(estimate, "width_valid")
    return None if trusted is None else ~trusted & np.isfinite(as_float(estimate.strides.width))


TURNING = StrideFlag(
    "turning", "turning", "in a turn",
    "Turns shorten the path of one foot and lengthen the path of the other. The turn may be in a part of the stride. "
    "These strides count in no mean or median.",
    _turning, EVERY, "info",
)  # fmt: skip
STAIRS = StrideFlag(
    "stairs", "stairs", "on stairs", "Lengths on stairs are horizontal; these strides count in no mean or median.",
    _stairs, EVERY, "info",
)  # fmt: skip
CLIPPED = StrideFlag(
    "clipped", "clipped", "swing clipped",
    "The swing was faster than the sensor's range, so the stride length is too small. Lengths and angles "
    "count in no mean or median, times do.",
    lambda estimate: stated(estimate, "clipped"), (*OF_PATH, *OF_ANGLES),
)  # fmt: skip
HALF = StrideFlag(
    "half", "half-step", "half-step",
    "Strides from standing, which no initial contact begins, and short ones from or to standing. They count in no mean "
    "or median.",
    lambda estimate: _with_stated(estimate, "half", half_strides), EVERY, "info",
)  # fmt: skip
UNEVEN_DURATION = StrideFlag(
    "uneven", "uneven", "uneven",
    "The stride lasts much longer or less long than those around it: it contains a pause, a turn on the spot or two "
    "strides, or it is a part of a stride. It counts in no mean or median.",
    lambda estimate: _with_stated(estimate, "uneven", lambda strides, rows: uneven_strides(durations(strides)[rows])),
    EVERY,
)  # fmt: skip
UNSURE = StrideFlag(
    "unsure", "speed by integration unsure", "speed unsure",
    "The integrated speed is unsure, because the error of the accelerometer's bias had time to grow.", _unsure,
)  # fmt: skip
SIDE_UNKNOWN = StrideFlag(
    "side_unknown", "side not known", "side not known",
    "It is not known which foot took these strides: the signs of left and right are weak or contradict each other.",
    lambda estimate: stated(estimate, "side_unknown"),
)  # fmt: skip
DOUBTFUL = StrideFlag(
    "doubtful", "doubtful", "in doubt",
    "The signals do not fit a step of walking: the foot slid, knelt or ran, or the sensor is loose or wrong. The "
    "length can be off by far more than its stated deviation. Lengths, speeds, stances and foot angles count in no "
    "mean or median; times from contact to contact and joint angles do.",
    lambda estimate: stated(estimate, "doubtful"), (*OF_PATH, *OF_STANCE),
)  # fmt: skip
WIDTH = StrideFlag(
    "width", "width unsure", "width unsure",
    "The distance between the feet is not known well enough there; these widths count in no mean or median.",
    _width, ("stride_width_m", "step_length_m"),
)  # fmt: skip

STRIDES_UNEVEN = Kind("strides_uneven", "check", "{uneven} of {strides} strides: uneven", UNEVEN_DURATION.meaning)

STRIDE_FLAGS = (TURNING, STAIRS, CLIPPED, HALF, UNEVEN_DURATION, UNSURE, SIDE_UNKNOWN, DOUBTFUL, WIDTH)
"""All flags, for estimates of an unknown estimator."""
