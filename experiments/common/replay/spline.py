"""Smoothing splines through the path of a point: position, velocity and acceleration at any time, with gaps marked."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from jaxtyping import Float, PyTree

from jgait.geometry.segments import Motion
from jgait.types import AnyArray, Values, as_float

CUTOFF_HZ = 10.0
"""Frequency at which the splines halve the amplitude [Hz]; for filtered points. For raw markers, give their `noise`."""

MAX_GAP = 0.1
"""Longest gap that the spline interpolates [s]; longer gaps are masked."""

_FILLED = 1e-4  # weight of a straight line laid through long gaps, only to keep the equations well-conditioned


class Trajectory(NamedTuple):
    """A smoothed point.

    Attributes:
        spline: of degree 5, time [s] → (3,) [m].
        gaps: (n, 2) [s] open intervals in which the spline is invalid.
        cutoff_hz: frequency at which the spline halves the amplitude [Hz].
        residual: root mean square distance of the spline from the points, per coordinate [m].
    """

    spline: PyTree
    gaps: np.ndarray
    cutoff_hz: float
    residual: float


def smooth(
    time: Float[AnyArray, "time"],
    values: Values,
    *,
    cutoff_hz: float = CUTOFF_HZ,
    noise: float | None = None,
    max_gap: float = MAX_GAP,
) -> Trajectory:
    """Smoothing spline of degree 5 through one point's path.

    min over s:  Σ |yᵢ − s(tᵢ)|² Δt + (2π f)⁻⁶ ∫ |s‴|² dt,   which passes a frequency ν with gain 1 / (1 + (ν/f)⁶):
    a Butterworth filter of third order run forwards and backwards, without its transients at the ends.

    Args:
        time: (T,) [s], strictly increasing.
        values: (T, 3) [m]; NaN where not measured.
        cutoff_hz: f, the frequency at which the amplitude is halved [Hz].
        noise: standard deviation of the measurement's noise [m]; if given, the least f whose residual is no larger.
        max_gap: longest gap that is interpolated [s].

    Returns:
        The spline with its gaps.

    Raises:
        ValueError: if shapes or times are wrong, fewer than 6 rows are finite, or the cut-off lies outside 1/200 to
            1/2 of the sampling rate.

    Source: Woltring, Adv Eng Softw 8 (1986) 104 (the natural quintic spline and its gain).
    """
    time, values = checked_time(time), as_float(values)
    if values.shape != (*time.shape, 3):
        raise ValueError(f"values must be {(*time.shape, 3)} like time {time.shape}; got {values.shape}")
    visible = np.isfinite(values).all(axis=1)
    if visible.sum() < 6:
        raise ValueError(f"a spline needs 6 finite rows; there are {visible.sum()}")
    step = (time[-1] - time[0]) / (len(time) - 1)
    lowest, highest = 1.0 / (200.0 * step), 0.5 / step
    if noise is None and not lowest <= cutoff_hz <= highest:
        raise ValueError(f"cutoff_hz must lie in [{lowest:g}, {highest:g}] at {1 / step:g} Hz; got {cutoff_hz:g}")
    if noise is not None and not noise > 0.0:
        raise ValueError(f"noise must be positive; got {noise:g}")
    gaps = _gaps(time, visible, max_gap)
    filled = np.stack([np.interp(time, time[visible], column[visible]) for column in values.T], axis=1)
    weights = np.where(visible, 1.0, np.where(_inside(time, gaps), _FILLED, 0.0))
    fit = _fitter((time - time[0]) / step, filled, weights)

    def fitted(cutoff: float) -> tuple[PyTree, float]:
        spline, residuals = fit((2.0 * math.pi * cutoff * step) ** -6)
        return spline, float(np.sqrt(np.mean(residuals[visible] ** 2)))

    if noise is not None:  # the residual falls as the cut-off rises
        low, high = math.log(lowest), math.log(highest)
        for _ in range(20):
            middle = (low + high) / 2.0
            low, high = (low, middle) if fitted(math.exp(middle))[1] <= noise else (middle, high)
        cutoff_hz = math.exp(high)
    spline, residual = fitted(cutoff_hz)
    spline.t = time[0] + step * spline.t
    return Trajectory(spline, gaps, cutoff_hz, residual)


def checked_time(time: npt.ArrayLike) -> np.ndarray:
    """Times (T,) [s] as an array; refused with ValueError unless finite and strictly increasing."""
    time = as_float(time)
    if time.ndim != 1 or len(time) < 2:
        raise ValueError(f"time must be (T,) with T ≥ 2; got {time.shape}")
    if not (np.isfinite(time).all() and (np.diff(time) > 0.0).all()):
        raise ValueError("time must be finite and strictly increasing")
    return time


def _gaps(time: np.ndarray, visible: np.ndarray, max_gap: float) -> np.ndarray:
    """Open intervals without data longer than `max_gap`; missing data at either end is a gap of any length."""
    at = time[visible]
    long = np.flatnonzero(np.diff(at) > max_gap * (1.0 + 1e-9))
    inner = [(at[i], at[i + 1]) for i in long]
    ends = [(-math.inf, at[0])] * bool(time[0] < at[0]) + [(at[-1], math.inf)] * bool(at[-1] < time[-1])
    return as_float([*inner, *ends]).reshape(-1, 2)


def _inside(time: np.ndarray, gaps: np.ndarray) -> np.ndarray:
    return ((time[:, None] > gaps[:, 0]) & (time[:, None] < gaps[:, 1])).any(axis=1)


def _fitter(time: np.ndarray, values: np.ndarray, weights: np.ndarray) -> Callable[[float], tuple[PyTree, np.ndarray]]:
    """The penalised normal equations, banded; a function of λ: (BᵀWB + λP) c = BᵀWy, Pᵢⱼ = ∫ Bᵢ‴ Bⱼ‴ dt."""
    from scipy.interpolate import BSpline
    from scipy.linalg import solveh_banded
    from scipy.sparse import diags_array

    knots = np.concatenate([[time[0]] * 5, time, [time[-1]] * 5])
    basis = BSpline.design_matrix(time, knots, 5)
    inner, third = knots, diags_array(np.ones(len(knots) - 6), format="csr")
    for degree in (5, 4, 3):  # coefficients of the derivative, three times
        ratio = degree / (inner[degree + 1 : -1] - inner[1 : -degree - 1])
        shape = (len(ratio), len(ratio) + 1)
        third = diags_array([-ratio, ratio], offsets=[0, 1], shape=shape, format="csr") @ third
        inner = inner[1:-1]
    nodes, node_weights = np.polynomial.legendre.leggauss(3)  # exact for the square of a parabola
    half = np.diff(time)[:, None] / 2.0
    points = ((time[1:] + time[:-1])[:, None] / 2.0 + half * nodes).ravel()
    gauss = BSpline.design_matrix(points, inner, 2) @ third
    data = basis.T @ diags_array(weights) @ basis
    penalty = gauss.T @ diags_array((half * node_weights).ravel()) @ gauss
    right = basis.T @ (weights[:, None] * values)

    def bands(matrix: PyTree) -> np.ndarray:
        size = matrix.shape[0]
        return np.stack([np.concatenate([matrix.diagonal(-k), np.zeros(min(k, size))]) for k in range(6)])

    data_bands, penalty_bands = bands(data), bands(penalty)

    def fit(penalised: float) -> tuple[PyTree, np.ndarray]:
        coefficients = solveh_banded(data_bands + penalised * penalty_bands, right, lower=True)
        return BSpline(knots.copy(), coefficients, 5), values - basis @ coefficients

    return fit


def covered(trajectory: Trajectory, time: np.ndarray) -> np.ndarray:
    """(T,) bool: True where, at times (T,) [s], the point was measured or lies in a gap short enough to interpolate."""
    return ~_inside(time, trajectory.gaps)


def evaluate(trajectory: Trajectory, time: np.ndarray) -> Motion[np.ndarray]:
    """Position [m], velocity [m/s] and acceleration [m/s²] of a smoothed point, each (T, 3), at times (T,) [s]."""
    return Motion(*(trajectory.spline(time, nu) for nu in range(3)))
