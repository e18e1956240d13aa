"""The oracle: estimation in plain NumPy loops that delete what was not seen. It imports nothing of jgait."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Sample(NamedTuple):
    """One interval and the measurement at its end; functions and their Jacobians are of the state alone."""

    f: Callable[[Array], Array]
    F: Callable[[Array], Array]
    Q: Array
    h: Callable[[Array], Array]
    H: Callable[[Array], Array]
    R: Array
    y: Array
    seen: NDArray[np.bool_]


class Filtered(NamedTuple):
    """Means, covariances, log-likelihoods and normalised innovations squared over time."""

    mean: Array
    cov: Array
    log_likelihood: Array
    nis: Array


def linear_sample(F: Array, b: Array, Q: Array, H: Array, c: Array, R: Array, y: Array, seen: NDArray) -> Sample:
    """The interval x ← F x + b + N(0, Q) and the measurement y = H x + c + N(0, R)."""
    return Sample(lambda x: F @ x + b, lambda _: F, Q, lambda x: H @ x + c, lambda _: H, R, y, np.asarray(seen, bool))


def extended_filter(mean: Array, cov: Array, samples: Sequence[Sample]) -> Filtered:
    """The extended Kalman filter; with linear functions, the Kalman filter."""
    out: list[tuple] = []
    for s in samples:
        F = s.F(mean)
        mean, cov = s.f(mean), F @ cov @ F.T + s.Q
        rows = np.flatnonzero(s.seen)
        log_likelihood = nis = 0.0
        if rows.size:
            H = s.H(mean)[rows]
            error = s.y[rows] - s.h(mean)[rows]
            S = H @ cov @ H.T + s.R[np.ix_(rows, rows)]
            gain = cov @ H.T @ np.linalg.inv(S)
            mean, cov = mean + gain @ error, cov - gain @ S @ gain.T
            nis = error @ np.linalg.solve(S, error)
            log_likelihood = -0.5 * (nis + np.linalg.slogdet(2.0 * np.pi * S)[1])
        out.append((mean, cov, log_likelihood, nis))
    return Filtered(*(np.array(column) for column in zip(*out, strict=True)))


def smoother(filtered: Filtered, samples: Sequence[Sample]) -> tuple[Array, Array]:
    """Means and covariances of the Rauch–Tung–Striebel smoother, in its textbook form."""
    mean, cov = filtered.mean[-1], filtered.cov[-1]
    means, covs = [mean], [cov]
    for k in range(len(samples) - 2, -1, -1):
        s, m, P = samples[k + 1], filtered.mean[k], filtered.cov[k]
        F = s.F(m)
        predicted = F @ P @ F.T + s.Q
        gain = P @ F.T @ np.linalg.inv(predicted)
        mean, cov = m + gain @ (mean - s.f(m)), P + gain @ (cov - predicted) @ gain.T
        means.append(mean)
        covs.append(cov)
    return np.array(means[::-1]), np.array(covs[::-1])


def least_squares(mean: Array, cov: Array, samples: Sequence[Sample]) -> tuple[Array, Array]:
    """All states at once: the joint Gaussian of prior, linear transitions and measurements, as one linear system.

    Returns:
        Means and covariances of the states at the samples; the state before the first is left out.
    """
    n, zero = mean.size, np.zeros_like(mean)
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
        add(block(k + 1) - s.F(zero) @ block(k), s.f(zero), s.Q)
        rows = np.flatnonzero(s.seen)
        if rows.size:
            add(s.H(zero)[rows] @ block(k + 1), (s.y - s.h(zero))[rows], s.R[np.ix_(rows, rows)])
    spread = np.linalg.inv(information)
    solution = spread @ right
    ends = range(n, size, n)
    return np.array([solution[i : i + n] for i in ends]), np.array([spread[i : i + n, i : i + n] for i in ends])


def joint_log_density(mean: Array, cov: Array, samples: Sequence[Sample]) -> float:
    """The density of all seen measurements stacked into one Gaussian vector, linear models only."""
    zero = np.zeros_like(mean)
    carried, across = mean, np.zeros((0, mean.size))
    centre, spread = np.zeros(0), np.zeros((0, 0))
    stacked = np.zeros(0)
    for s in samples:
        F, rows = s.F(zero), np.flatnonzero(s.seen)
        carried, cov, across = F @ carried + s.f(zero), F @ cov @ F.T + s.Q, across @ F.T
        H = s.H(zero)[rows]
        old_with_new = across @ H.T
        own = H @ cov @ H.T + s.R[np.ix_(rows, rows)]
        spread = np.block([[spread, old_with_new], [old_with_new.T, own]])
        centre = np.append(centre, H @ carried + s.h(zero)[rows])
        stacked = np.append(stacked, s.y[rows])
        across = np.vstack([across, H @ cov])
    error = stacked - centre
    return float(-0.5 * (error @ np.linalg.solve(spread, error) + np.linalg.slogdet(2.0 * np.pi * spread)[1]))
