"""Events and strides of an estimate matched with those of a reference, and scores of the match."""

import numpy as np

OVERLAP = 0.5
"""An estimated stride is the reference's if their times share this much of what they cover together [1]."""


def nearest(ours: np.ndarray, theirs: np.ndarray, tolerance: float) -> list[tuple[int, int]]:
    """Rows of events (n,) and (m,) that belong together: not farther apart than the tolerance, each used once."""
    apart = np.abs(ours[:, None] - theirs[None, :])
    joined: list[tuple[int, int]] = []
    used_ours: set[int] = set()
    used_theirs: set[int] = set()
    for flat in np.argsort(apart, axis=None, kind="stable"):
        i, j = (int(k) for k in np.unravel_index(flat, apart.shape))
        if apart[i, j] > tolerance:
            break
        if i not in used_ours and j not in used_theirs:
            joined.append((i, j))
            used_ours.add(i)
            used_theirs.add(j)
    return sorted(joined)


def overlapping(reference: np.ndarray, found: np.ndarray) -> np.ndarray:
    """(n, 2) rows of strides that are the same, by their times (·, 2) [s]."""
    if not len(found) or not len(reference):
        return np.zeros((0, 2), int)
    start, end = ((reference[:, None, k], found[None, :, k]) for k in (0, 1))
    share = (np.minimum(*end) - np.maximum(*start)) / (np.maximum(*end) - np.minimum(*start))
    rows = np.flatnonzero(share.max(axis=1) > OVERLAP)
    return np.stack([rows, share.argmax(axis=1)[rows]], axis=1)


def f1(hit: int, missed: int, extra: int) -> float:
    """F1 of detections [1]."""
    return 2.0 * hit / max(2 * hit + missed + extra, 1)


def aligned_rmse(here: np.ndarray, there: np.ndarray) -> float:
    """Root mean square distance of two ways (T, 2), one of them turned about the vertical and shifted [m]."""
    a, b = here - here.mean(axis=0), there - there.mean(axis=0)
    u, _, v = np.linalg.svd(a.T @ b)
    turn = u @ np.diag([1.0, np.sign(np.linalg.det(u @ v))]) @ v
    return float(np.sqrt(np.mean(np.sum((a @ turn - b) ** 2, axis=1))))
