"""Consistency of a filter: chi-square tests of its innovations and of its errors, and whiteness of its innovations.

If model and noise are right, innovations are zero-mean and white, and the filter's innovation covariance is theirs.
If the filter's covariance is too small, the normalised squares lie above the band; if it is too large, below the band.
On the host, in NumPy and SciPy.

Source:
    Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation (Wiley 2001), section 5.4.
    Ljung and Box, On a measure of lack of fit in time series models, Biometrika 65 (1978).
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from jgait.evaluate.statistics import LEVEL
from jgait.types import as_float

LAGS = 20
"""[samples] Largest lag of an autocorrelation of innovations."""


class Consistency(NamedTuple):
    """Normalised squares against chi-square.

    Attributes:
        mean: sum of squares over degrees of freedom [1]; expected 1.
        low: lower end of the band that contains `mean` with probability `LEVEL`, if the filter is right [1].
        high: upper end of that band.
        share_inside: share of steps whose normalised square lies in the step's chi-square band [1]; expected `LEVEL`.
        n: number of steps used.
        freedom: degrees of freedom of these steps, summed.
        consistent: whether `mean` lies between `low` and `high`.
    """

    mean: float
    low: float
    high: float
    share_inside: float
    n: int
    freedom: int
    consistent: bool


class Whiteness(NamedTuple):
    """Autocorrelation of innovations against that of white noise.

    Attributes:
        autocorrelation: (LAGS, m) of each component at lag 1, 2, … [1]; NaN where no pair of samples has that lag.
        band: (LAGS, m) half-width z/√pairs of the band of the autocorrelation of white noise [1].
        share_inside: share of the autocorrelations inside the band [1]; expected `LEVEL`.
        statistic: statistic of Ljung and Box, summed over components.
        p_value: probability that white noise has a statistic as large or larger.
        n: (m,) number of samples of each component.
        consistent: whether `p_value` is at least 1 − `LEVEL`.
    """

    autocorrelation: np.ndarray
    band: np.ndarray
    share_inside: float
    statistic: float
    p_value: float
    n: np.ndarray
    consistent: bool


def nis_consistency(nis: npt.ArrayLike, count: npt.ArrayLike) -> Consistency:
    """Chi-square test of the innovations ν against the filter's covariance S: the sum of ν'S⁻¹ν is chi-square.

    Args:
        nis: (T,) normalised innovation squared, as in the posterior of `jgait.filtering`.
        count: (T,) or a number: number of components that were observed in each step.

    Steps with count 0 or a NaN are left out.

    Raises:
        ValueError: if shapes do not fit or no step remains.
    """
    squares = as_float(nis)
    if squares.ndim != 1 or np.shape(count) not in ((), squares.shape):
        raise ValueError(f"nis must be (T,) and count (T,) or a number; got {squares.shape} and {np.shape(count)}")
    freedom = np.broadcast_to(as_float(count), squares.shape)
    used = np.isfinite(squares) & (freedom > 0)
    return _chi_square(squares[used], freedom[used], "nis")


def nees_consistency(
    error: npt.ArrayLike,
    *,
    covariance: npt.ArrayLike | None = None,
    stddev: npt.ArrayLike | None = None,
) -> Consistency:
    """Chi-square test of the estimation errors e against the filter's covariance P: the sum of e'P⁻¹e is chi-square.

    The band is for independent rows: the same instant of many runs or people. Errors of successive samples of one run
    are correlated, and their mean leaves the band more often than 1 − `LEVEL`, even if the filter is right.

    Args:
        error: (N, n) estimate − truth, or (N,) of one state; rows with a NaN are left out.
        covariance: (N, n, n) the filter's covariance; give either `covariance` or `stddev`.
        stddev: (N, n), or (N,), the filter's standard deviations; errors of the states are then assumed independent.

    Raises:
        ValueError: if not exactly one of `covariance` and `stddev` is given, shapes do not fit, a covariance is not
            positive definite, or no row remains.
    """
    errors = as_float(error)
    errors = errors[:, None] if errors.ndim == 1 else errors
    if errors.ndim != 2:
        raise ValueError(f"error must be (N, n) or (N,); got {errors.shape}")
    if (covariance is None) == (stddev is None):
        raise ValueError("exactly one of covariance and stddev must be given")
    size, used = errors.shape[1], np.isfinite(errors).all(axis=1)
    if stddev is not None:
        spread = as_float(stddev)
        spread = spread[:, None] if spread.ndim == 1 else spread
        if spread.shape != errors.shape:
            raise ValueError(f"stddev must be {errors.shape} as the error; got {np.shape(stddev)}")
        used &= np.isfinite(spread).all(axis=1)
        if not (spread[used] > 0.0).all():
            raise ValueError(f"stddev must be positive; the smallest is {spread[used].min():g}")
        squares = np.sum((errors[used] / spread[used]) ** 2, axis=1)
    else:
        matrices = np.asarray(covariance, np.float64)
        if matrices.shape != (*errors.shape, size):
            raise ValueError(f"covariance must be {(*errors.shape, size)}; got {matrices.shape}")
        used &= np.isfinite(matrices).all(axis=(1, 2))
        try:
            factors = np.linalg.cholesky(matrices[used])
        except np.linalg.LinAlgError as broken:
            raise ValueError("covariance must be positive definite in every row that counts") from broken
        squares = np.sum(np.linalg.solve(factors, errors[used][..., None]) ** 2, axis=(1, 2))
    return _chi_square(squares, np.full(squares.shape, float(size)), "error")


def _chi_square(squares: np.ndarray, freedom: np.ndarray, name: str) -> Consistency:
    from scipy import stats

    if not squares.size:
        raise ValueError(f"no step of {name} counts: all are masked, not finite or without an observation")
    tails = np.array([0.5 - LEVEL / 2.0, 0.5 + LEVEL / 2.0])
    total = float(freedom.sum())
    low, high = stats.chi2.ppf(tails, total) / total
    each = stats.chi2.ppf(tails[:, None], freedom)
    share = float(np.mean((squares >= each[0]) & (squares <= each[1])))
    mean = float(squares.sum()) / total
    return Consistency(mean, float(low), float(high), share, squares.size, round(total), bool(low <= mean <= high))


def whiteness(innovations: npt.ArrayLike) -> Whiteness:
    """Whiteness of innovations: autocorrelations up to `LAGS`, and Ljung and Box's test of all of them.

    r_k = (Σ ν_t ν_{t+k} / n_k) / (Σ ν_t² / n), Q = (n + 2)/n Σ n_k r_k², with n_k the number of pairs of observed
    samples k apart; without gaps this is Ljung and Box's n (n + 2) Σ r_k²/(n − k). The mean is not subtracted: the
    innovations of a consistent filter have mean 0, and the test is to detect a bias.

    Args:
        innovations: (T, m) or (T,), evenly spaced, NaN where there was no observation; divide them by their standard
            deviations where these change. Components are tested as if independent: whiten components that are
            correlated within a step.

    Raises:
        ValueError: if shapes do not fit, a component has no more samples than lags, or is 0 throughout.
    """
    from scipy import stats

    values = as_float(innovations)
    finite = np.isfinite(values)
    if values.ndim not in (1, 2) or len(values) <= LAGS:
        raise ValueError(f"innovations must be (T, m) or (T,) with T > {LAGS}; got {values.shape}")
    values, finite = values.reshape(len(values), -1), finite.reshape(len(values), -1)
    values = np.where(finite, values, 0.0)
    count, power = finite.sum(axis=0), np.sum(values**2, axis=0)
    if not (power > 0.0).all():
        raise ValueError(
            f"every component needs samples other than 0; {np.flatnonzero(power <= 0.0).tolist()} has none"
        )
    pairs = np.stack([np.sum(finite[k:] & finite[:-k], axis=0) for k in range(1, LAGS + 1)])
    sums = np.stack([np.sum(values[k:] * values[:-k], axis=0) for k in range(1, LAGS + 1)])
    there = pairs > 0
    if not there.any():
        raise ValueError(f"no two samples are 1 to {LAGS} apart: nothing to correlate")
    known = np.where(there, pairs, 1)
    correlation = np.where(there, sums / known / (power / count), np.nan)
    band = np.where(there, stats.norm.ppf(0.5 + LEVEL / 2.0) / np.sqrt(known), np.nan)
    statistic = float(np.sum((count + 2.0) / count * np.nansum(pairs * correlation**2, axis=0)))
    p_value = float(stats.chi2.sf(statistic, int(there.sum())))
    inside = float(np.mean(np.abs(correlation[there]) <= band[there]))
    return Whiteness(correlation, band, inside, statistic, p_value, count, p_value >= 1.0 - LEVEL)
