"""Rows that are missing in blocks although time goes on: strides repeat one another, and some of them leave out a part.

Before and after each row, the rates of all sensors are looked for in other strides. Where rows are missing, what comes
before and what comes after are found there with a part between them; where none is missing, one follows the other.
"""

from collections.abc import Sequence

import numpy as np

from jgait.notes import Kind, Note

WINDOW_S = 0.12
"""[s] Length of what is compared before a step, and after it; chosen, a tenth of a stride."""

LONGEST_S = 0.08
"""[s] Longest part that is looked for; strides differ by more than longer ones. Chosen."""

APART_S = 0.3
"""[s] Least time to another stride; chosen, below that of two steps in running."""

STRIDES = 4
"""[1] Number of other places that are compared, those that are most alike; half of them must agree. Chosen."""

BETTER = 0.2
"""[1] Least logarithm of the misfit without a part between, over that with one; chosen, see `LEAST`."""

SUDDEN = 0.3
"""[1] Least logarithm of the change of the rates over a step, over the changes beside it; chosen."""

LEAST, OVER = 4, 3
"""[1], [1] Least number of places where rows are missing, and its least ratio to that of places where rows would be too
many, which shows how well strides repeat. Chosen: hardly any undamaged public recording reaches both."""

MOST_ROWS = 2048
"""[1] Number of rows of the stretch that is examined, the one that moves most: the time goes with its square."""

LEAST_HZ = 80.0
"""[Hz] Least sampling rate; with fewer rows, a landing is as short as a step."""

MOVING, SAME = 0.2, 1e-3
"""[1], [1] Least squared change from before a step to after it, over the mean one, for the step to count; and what is
added to misfits, over the same, so that strides without any difference do not count. Chosen."""

TINY = 1e-4
"""[1] Added to sizes that divide."""


ROWS_SKIPPED = Kind(
    "rows_skipped",
    "check",
    "at {places} places within {seconds:.0f} s, first at {begin_s:.2f} s, all sensors leave out a part that other "
    "strides have: rows seem to be missing although time goes on, at least {percent:.1f} % of the rows",
    "Where rows are missing without time stamps, as a radio loses them, movements come out too fast and too small; "
    "lengths, durations and distance are too small by more than this share. Export time stamps or numbers of packets.",
)


def skip_notes(rates: Sequence[np.ndarray], whole: np.ndarray, rate_hz: float) -> tuple[Note, ...]:
    """A note if strides often leave out blocks of rows.

    Args:
        rates: (T, 3) angular rate of each sensor.
        whole: (T − 1,) bool, steps that count.
        rate_hz: sampling rate.
    """
    window, most = round(WINDOW_S * rate_hz), round(LONGEST_S * rate_hz)
    if rate_hz < LEAST_HZ or len(whole) < 20 * window:
        return ()
    scaled = np.concatenate([one / (np.sqrt(np.mean(one**2)) + TINY) for one in rates], axis=1)
    first = _busiest(scaled)
    part = scaled[first : first + MOST_ROWS].astype(np.float32)
    steps, logs = _advantages(part, window, most, round(APART_S * rate_hz))
    size = np.linalg.norm(np.diff(part, axis=0), axis=1) + TINY
    sudden = np.log(2.0 * size[steps] / (size[steps - 1] + size[steps + 1])) > SUDDEN
    counts = sudden & whole[first + steps]
    more, fewer = logs[:, most + 1 :].max(axis=1), logs[:, :most].max(axis=1)
    missing = counts & (more > BETTER) & (more > fewer)
    at = _firsts(steps[missing], window)
    many = _firsts(steps[counts & (fewer > BETTER) & (fewer > more)], window)
    if len(at) < max(LEAST, OVER * len(many)):
        return ()
    between = 1 + np.argmax(logs[missing][:, most + 1 :], axis=1)
    rows = float(between[at].sum())
    begin_s = (first + int(steps[missing][at[0]]) + 1) / rate_hz
    return (
        ROWS_SKIPPED(
            places=len(at), seconds=len(part) / rate_hz, begin_s=begin_s, percent=100.0 * rows / (rows + len(part))
        ),
    )


def _busiest(values: np.ndarray) -> int:
    """The first row of the `MOST_ROWS` rows that change most."""
    if len(values) <= MOST_ROWS:
        return 0
    change = np.concatenate([[0.0], np.cumsum(np.sum(np.diff(values, axis=0) ** 2, axis=1))])
    return int(np.argmax(change[MOST_ROWS - 1 :] - change[: len(change) - MOST_ROWS + 1]))


def _firsts(steps: np.ndarray, window: int) -> np.ndarray:
    """Positions of the first step of each group of neighbours."""
    return np.flatnonzero(np.diff(steps, prepend=-window) > window // 3)


def _misfits(part: np.ndarray, window: int) -> np.ndarray:
    """(n, n) sum of the squared differences of the windows that begin at each two rows."""
    size = np.sum(part * part, axis=1)
    each = np.maximum(size[:, None] + size - 2.0 * part @ part.T, 0.0)
    n = len(part) - window + 1
    total, rows = np.zeros((n, n), np.float32), 0
    while rows < window:  # sums over 1, 2, 4, … rows
        length = 1
        doubled = each
        while 2 * length <= window - rows:
            doubled = doubled[:-length, :-length] + doubled[length:, length:]
            length *= 2
        total += doubled[rows : rows + n, rows : rows + n]
        rows += length
    return total


def _advantages(part: np.ndarray, window: int, most: int, apart: int) -> tuple[np.ndarray, np.ndarray]:
    """Steps (k,) in movement, by the row before, and (k, 2 · most + 1) for −most … most rows between, the logarithm of
    the misfit of other strides with none between, over that with so many.
    """
    misfit = _misfits(part, window)
    starts = np.arange(len(misfit) - window)
    moved = misfit[starts, starts + window]
    starts, same = starts[moved > MOVING * moved.mean()], SAME * moved.mean()
    others = np.arange(2 * most, len(misfit) - window - 2 * most)
    joint = misfit[starts][:, others] + misfit[starts + window][:, others + window]
    joint[np.abs(others - starts[:, None]) < apart] = np.inf
    inner = joint[:, 1:-1]
    nearest = (inner <= joint[:, :-2]) & (inner < joint[:, 2:])
    inner = np.where(nearest, inner, np.inf)
    chosen = np.argpartition(inner, STRIDES, axis=1)[:, :STRIDES]
    known = np.isfinite(np.take_along_axis(inner, chosen, axis=1))
    at = others[chosen + 1][:, :, None]
    shifts = np.arange(-most, most + 1)
    before = misfit[starts[:, None, None], at + shifts]
    after = misfit[(starts + window)[:, None, None], at + window + np.arange(-2 * most, 2 * most + 1)]
    least = [(before + after[:, :, shifts + between + 2 * most]).min(axis=2) for between in shifts]
    fits = np.stack(least, axis=2) + same
    logs = np.where(known[:, :, None], 0.5 * np.log(fits[:, :, most, None] / fits), np.nan)
    logs = np.nan_to_num(np.nanmedian(np.where(known.any(axis=1)[:, None, None], logs, 0.0), axis=1))
    return starts + window - 1, logs
