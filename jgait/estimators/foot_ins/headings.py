r"""Headings of two feet of one person: both feet go the same way, so that their headings must not drift apart.

A foot by itself does not observe its heading. The errors of its gyroscope turn its way at a nearly constant rate b,
1 to 3 mrad/s: from the bias, which is measured in seconds of standing, and from errors of scale and axes while the foot
moves. Two feet of one person show the difference of their rates. With prior deviations $\sigma_r$, $\sigma_l$, the
rates are

    b_r = σ_r² / (σ_r² + σ_l²) δ,    b_l = −σ_l² / (σ_r² + σ_l²) δ,    δ = b_r − b_l.

δ comes from least squares: the way of the left foot, turned by δ t, by a constant angle and shifted, is that of the
right foot, but for the width between them and an error of `APART` at each foothold. What both feet have in common stays
unknown. `estimate` corrects the headings after the filters; `run`, cohorts and live filters do not.

Source: this library. A bound on the distance between both feet is used by I. Skog, J.-O. Nilsson, D. Zachariah and
P. Händel, "Fusing the information from two navigation systems using an upper bound on their maximum spatial
separation", IPIN 2012. Here only headings are corrected, so that strides do not depend on the other foot.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import numpy as np

from jgait.geometry.rotation import turned, yawed
from jgait.types import SIDES, Estimate, Feet, FootTrajectory

DRIFT = 1.2e-3
"""[rad/s] Standard deviation of b in addition to the filter's; the most likely value for 20 walks of `pyshoe_vicon`,
`footprints` and `neura_sparse` (running, fast walking and creeping left out)."""

APART = 0.2
"""[m] By how much a foothold is off the way of the other foot, width excepted. Errors of neighbours are alike, so it is
more than that of one foothold. Half or twice as much changes the rates of `gaitmap_example` by less than 5 %."""

WIDTH = 0.2
"""[m] Standard deviation of the width between the feet."""

FEWEST_FOOTHOLDS = 6
"""Fewest footholds of a foot."""


class Rates(NamedTuple):
    """Rates of the errors of both headings [rad/s], and the variance of their difference over its prior variance."""

    right: float
    left: float
    remaining: float


def rates(
    time: np.ndarray, ways: Sequence[np.ndarray], steps: Sequence[np.ndarray], sd: Sequence[float]
) -> Rates | None:
    """The rates of the errors of both headings; None if a foot has fewer than `FEWEST_FOOTHOLDS` footholds while the
    other one walks, or if the ways contradict each other.

    `ways` are horizontal positions x + iy (T,) of the right and of the left foot [m], each in a frame of its own,
    `steps` the samples of their footholds, and `sd` the prior standard deviations of both rates [rad/s].
    """
    since, until = (pick(steps[0][end], steps[1][end]) for pick, end in ((max, 0), (min, -1)))
    at = np.unique(np.concatenate(steps))
    at = at[(at >= since) & (at <= until)]
    if min(np.sum((stands >= since) & (stands <= until)) for stands in steps) < FEWEST_FOOTHOLDS:
        return None
    t = time[at] - time[at[0]]
    right, left = (np.interp(time[at], time[stands], way[stands]) for stands, way in zip(steps, ways, strict=True))
    ahead = np.gradient(right)
    beside = 1j * ahead / np.maximum(np.abs(ahead), 0.1)
    prior = sd[0] ** 2 + sd[1] ** 2
    weight = np.diag([1.0 / prior, 1.0, 0.0, 0.0, 1.0 / WIDTH**2])
    # the constant angle first, in closed form: it may be any; the steps after it are damped by 1 rad
    unknown = np.array([0.0, np.angle(np.sum((right - right.mean()) * np.conj(left - left.mean())))])
    for _ in range(4):  # Gauss–Newton steps; SciPy's optimisers take longer to import than a walk to estimate
        here = turned_way(left, unknown[0] * t + unknown[1])
        later = np.concatenate([[0.0], np.cumsum(0.5j * (t[1:] + t[:-1]) * np.diff(here))])
        ones = np.ones_like(t)
        columns = np.stack([later, 1j * here, ones, 1j * ones, -beside], axis=1)
        information = (columns.conj().T @ columns).real / APART**2 + weight
        right_side = (columns.conj().T @ (right - here)).real / APART**2
        right_side[0] -= unknown[0] / prior
        unknown = unknown + np.linalg.solve(information, right_side)[:2]
    remaining = float(np.linalg.inv(information)[0, 0]) / prior
    if abs(unknown[0]) > 3.0 * np.sqrt(prior):  # a foot's way is wrong for another reason
        return None
    share = sd[0] ** 2 / prior
    return Rates(share * unknown[0], (share - 1.0) * unknown[0], remaining)


def turned_way(way: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """A way x + iy (T,) from its start, each part of it turned by an angle (T,) [rad]."""
    return np.concatenate([[0.0], np.cumsum(np.diff(way) * np.exp(0.5j * (angle[1:] + angle[:-1])))])


def together(result: Estimate) -> Estimate:
    """The estimate of two feet whose headings do not drift apart; lengths and heights stay as they are.

    Ways, velocities, attitudes and turns change by the rates of `rates`, and so do deviations of the headings.
    """
    feet, spread = (
        [FootTrajectory(*(np.asarray(part, np.float64) for part in foot)) for foot in both or () if foot is not None]
        for both in (result.feet, result.feet_stddev)
    )
    strides = result.strides
    assert strides is not None
    time = np.asarray(result.time, np.float64)
    steps = [np.asarray(result.diagnostics[f"footholds_{side}"]) for side in SIDES]
    if min(len(stands) for stands in steps) < FEWEST_FOOTHOLDS:
        return result
    ends = [float(foot.orientation[stands[-1], 2]) for foot, stands in zip(spread, steps, strict=True)]
    # [rad] beyond, one rate for the whole recording is not enough
    if not max(ends) <= 0.3 or not all(np.isfinite(foot.position).all() for foot in feet):
        return result
    sd = [np.hypot(end / (time[stands[-1]] - time[stands[0]]), DRIFT) for end, stands in zip(ends, steps, strict=True)]
    drift = rates(time, [_horizontal(foot) for foot in feet], steps, sd)
    if drift is None:
        return result
    moved, known, turn = [], [], np.array(strides.turn, np.float64)
    for side, (foot, deviation, stands) in enumerate(zip(feet, spread, steps, strict=True)):
        since = np.maximum(time - time[stands[0]], 0.0)
        moved.append(_turned_back(foot, drift[side] * since))
        less = 1.0 - sd[side] ** 2 / (sd[0] ** 2 + sd[1] ** 2) * (1.0 - drift.remaining)
        known.append(deviation._replace(orientation=deviation.orientation * [1.0, 1.0, np.sqrt(less)]))
        rows = np.asarray(strides.side) == side
        turn[rows] -= (drift[side] * (np.asarray(strides.standing_end) - np.asarray(strides.standing)))[rows]
    changed = (Feet(*moved), Feet(*known), strides._replace(turn=turn))
    old = (result.feet, result.feet_stddev, strides)
    feet_now, spread_now, strides_now = jax.tree.map(lambda new, was: np.asarray(new, was.dtype), changed, old)
    return result._replace(feet=feet_now, feet_stddev=spread_now, strides=strides_now)


def _horizontal(foot: FootTrajectory) -> np.ndarray:
    """(T,) position x + iy [m]."""
    return np.asarray(foot.position)[:, :2] @ np.array([1.0, 1.0j])


def _turned_back(foot: FootTrajectory, angle: np.ndarray) -> FootTrajectory:
    """A trajectory from its start, turned back by an angle (T,) [rad]."""
    x, y, z = np.asarray(foot.position).T
    way = turned_way(_horizontal(foot), -angle)
    placed = np.column_stack([x[0] + way.real, y[0] + way.imag, z])
    return FootTrajectory(placed, turned(foot.velocity, -angle), yawed(foot.orientation, -angle))
