"""Estimation of linear models all at once, in plain NumPy, without what was not seen. It imports nothing of jgait."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Sample(NamedTuple):
    """The interval x ← F x + b + N(0, Q) and the measurement y = H x + c + N(0, R) at its end."""

    F: Array
    b: Array
    Q: Array
    H: Array
    c: Array
    R: Array
    y: Array
    seen: NDArray[np.bool_]


def least_squares(mean: Array, cov: Array, samples: Sequence[Sample]) -> tuple[Array, Array]:
    """All states at once: the joint Gaussian of prior, linear transitions and measurements, as one linear system.

    Returns:
        Means and covariances of the states at the samples; the state before the first is left out.
    """
    n = mean.size
    size = n * (len(samples) + 1)
    information, right = np.zeros((size, size)), np.zeros(size)

    def block(k: int) -> Array:
        return np.eye(size)[n * k : n * (k + 1)]

    def add(rows: Array, value: Array, spread: Array) -> None:
        weight = np.linalg.inv(spread)
        information[:] += rows.T @ weight @ rows
        right[:] += rows.T @ weight @ value

    add(block(0), mean, cov)
    for k, s in enumerate(samples):
        add(block(k + 1) - s.F @ block(k), s.b, s.Q)
        rows = np.flatnonzero(s.seen)
        if rows.size:
            add(s.H[rows] @ block(k + 1), (s.y - s.c)[rows], s.R[np.ix_(rows, rows)])
    spread = np.linalg.inv(information)
    solution = spread @ right
    ends = range(n, size, n)
    return np.array([solution[i : i + n] for i in ends]), np.array([spread[i : i + n, i : i + n] for i in ends])


def joint_log_density(mean: Array, cov: Array, samples: Sequence[Sample]) -> float:
    """The density of all seen measurements stacked into one Gaussian vector, linear models only."""
    carried, across = mean, np.zeros((0, mean.size))
    centre, spread = np.zeros(0), np.zeros((0, 0))
    stacked = np.zeros(0)
    for s in samples:
        F, rows = s.F, np.flatnonzero(s.seen)
        carried, cov, across = F @ carried + s.b, F @ cov @ F.T + s.Q, across @ F.T
        H = s.H[rows]
        old_with_new = across @ H.T
        own = H @ cov @ H.T + s.R[np.ix_(rows, rows)]
        spread = np.block([[spread, old_with_new], [old_with_new.T, own]])
        centre = np.append(centre, H @ carried + s.c[rows])
        stacked = np.append(stacked, s.y[rows])
        across = np.vstack([across, H @ cov])
    error = stacked - centre
    return float(-0.5 * (error @ np.linalg.solve(spread, error) + np.linalg.slogdet(2.0 * np.pi * spread)[1]))
