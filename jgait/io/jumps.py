"""Clocks that were set while they recorded, and rows of two times between one another: the readings show both.

Where only the clock jumped, the readings go on as from any row to the next one; where samples are missing, hardly two
rows of the recording fit each other so well in all channels.
"""

import numpy as np

JUMP_S = 0.3
"""[s] Shortest step forward of a clock that is examined. Readings hardly change within shorter ones; chosen."""

LATEST = 5.0
"""[samples] Largest step backwards that the jitter of times explains; chosen, a few times the sample time."""

MOST_JUMPS = 20
"""[1] Largest number of jumps that are examined: nobody sets a clock more often. Chosen."""

STEADY_ROWS, STEADY_SAMPLES = 8, 2.0
"""[rows], [samples] Rows before and after a jump that must be evenly spaced, and how evenly: samples that arrive late,
and then quickly, are no jump of the clock. Chosen."""

SPAN_S, APART_S = 10.0, 0.15
"""[s], [s] Farthest and nearest rows that are joined to those at a jump, for comparison; chosen."""

AS_SMOOTH, ALMOST = 1e-3, 0.03
"""[1], [1] Largest share of joints of other rows that are as smooth as that at a jump of a clock, and where a jump is
possible. Chosen as the shares of missing stretches that may be taken for a jump."""

ROOM, BEFORE, AFTER, MORE_ROWS = 8, 1000, 64, 3.0
"""[rows], [samples] Where more rows than fit into the time are looked for: so many rows around a place, compared with
so many before it and after it, and by how many samples. Samples that arrive late come earlier than these, never
before their time. Chosen, for overlaps of some tenths of a second at 100 Hz."""

NEARER, PAIRS = 0.9, 0.4
"""[1], [1] Largest change over two rows, in that over one, where rows of two times alternate, between that of noise, 1,
and that of walking; and least share of rows that repeat a time where each time comes twice. Chosen."""


def jumps(stamps: np.ndarray, readings: np.ndarray, step: float, step_s: float) -> dict[int, float]:
    """Row after a step of the clock, forward or back, that no jitter explains → share of joints of other rows that are
    as smooth as the one there: near zero if the readings go on.

    Args:
        stamps: (n,) times, finite, in any unit.
        readings: (n, channels), NaN where missing.
        step: usual step of the stamps, in their unit.
        step_s: the same step [s].
    """
    steps = np.diff(stamps)
    rows = np.flatnonzero((steps * step_s > JUMP_S * step) | (steps < -LATEST * step)) + 1
    if len(rows) > MOST_JUMPS:
        return {}
    tolerance = STEADY_SAMPLES * step

    def steady(first: int) -> bool:
        last = first + STEADY_ROWS
        if first < 0 or last >= len(stamps):
            return False
        return bool(abs(stamps[last] - stamps[first] - STEADY_ROWS * step) <= tolerance)

    kept = [row for row in map(int, rows) if steady(row - 1 - STEADY_ROWS) and steady(row)]
    return {row: _as_smooth(readings, row, step_s) for row in kept}


def _as_smooth(readings: np.ndarray, row: int, step_s: float) -> float:
    """Share of joints, of a row or the row before it to others near, that are as smooth as the two; 1 if unknown."""
    near, far = int(np.ceil(APART_S / step_s)), int(SPAN_S / step_s)
    part = readings[max(row - far, 0) : row + far]
    at = row - max(row - far, 0)
    part = part[:, np.isfinite(part[at - 2 : at + 2]).all(axis=0)]
    every = np.arange(2, len(part) - 1)
    usual = _misfit(part, every - 1, every)
    known = (usual > 0.0).any(axis=0)
    if not known.any():
        return 1.0
    part, usual = part[:, known], usual[:, known]
    scale = np.nanmedian(np.where(usual > 0.0, usual, np.nan), axis=0)
    others = every[np.abs(every - at) > near]
    before = np.concatenate([[at - 1], np.full(len(others), at - 1), others - 1])
    after = np.concatenate([[at], others, np.full(len(others), at)])
    sizes = np.log1p(_misfit(part, before, after) / scale).mean(axis=1)
    joints = sizes[1:][np.isfinite(sizes[1:])]
    return float(np.mean(joints <= sizes[0])) if len(joints) * AS_SMOOTH >= 1.0 else 1.0


def _misfit(readings: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """(m, channels) by how much the change from rows to other rows (m,) is outside the two changes beside it."""
    change = readings[after] - readings[before]
    one, other = readings[before] - readings[before - 1], readings[after + 1] - readings[after]
    return np.abs(change - np.clip(change, np.minimum(one, other), np.maximum(one, other)))


def interleaved(stamps: np.ndarray, readings: np.ndarray, step: float) -> tuple[int, int] | None:
    """First and last row of those where rows of two times alternate; None if there are none.

    They do where more rows come than fit into the time, and a reading is nearer to the one before the last, or each
    time comes twice, unlike in the rest of the recording.

    Args:
        stamps: (n,) times, finite, none before the one above it.
        readings: (n, channels), NaN where missing.
        step: usual step of the stamps.
    """
    late = stamps / step - np.arange(len(stamps))
    places = np.arange(ROOM, len(late) - ROOM - AFTER)
    places = places[late[places - ROOM] - late[places + ROOM] > MORE_ROWS]
    if not len(places):
        return None
    from scipy.ndimage import maximum_filter1d, minimum_filter1d  # takes time to import

    # of a row and those before it; of a row and those after it
    earliest = minimum_filter1d(late, BEFORE + 1, origin=BEFORE // 2, mode="constant", cval=np.inf)
    latest = maximum_filter1d(late, AFTER, origin=-(AFTER // 2))
    places = places[earliest[places - ROOM] - latest[places + ROOM] > MORE_ROWS]
    if not len(places):
        return None
    first, last = int(places[0]), int(places[-1])
    part, same = readings[first - ROOM : last + ROOM], np.diff(stamps[first : last + 2]) == 0
    copies = np.all(part[1:] == part[:-1], axis=1).any()
    if same.mean() > PAIRS and not (same[1:] & same[:-1]).any() and not copies and last - first < len(stamps) / 2:
        return first, last
    one, two = (np.nansum(np.abs(part[by:] - part[:-by]), axis=0) for by in (1, 2))
    known = one > 0.0
    return (first, last) if known.any() and float(np.median(two[known] / one[known])) < NEARER else None
