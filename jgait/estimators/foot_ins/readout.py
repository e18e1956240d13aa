r"""Strides of one foot with standard deviations, from its smoothed states; differentiable for given footholds.

Headings of two feet: both feet of a person go the same way, so that their headings must not drift apart. A foot by
itself does not observe its heading. The errors of its gyroscope turn its way at a nearly constant rate b, 1 to 3
mrad/s: from the bias, which is measured in seconds of standing, and from errors of scale and axes while the foot moves.
Two feet show the difference of their rates. With prior deviations $\sigma_r$, $\sigma_l$, the rates are

    b_r = σ_r² / (σ_r² + σ_l²) δ,    b_l = −σ_l² / (σ_r² + σ_l²) δ,    δ = b_r − b_l.

δ comes from least squares: the way of the left foot, turned by δ t, by a constant angle and shifted, is that of the
right foot, but for the width between them and an error of `APART` at each foothold. What both feet have in common stays
unknown. `estimate` corrects the headings after the filters; `run`, cohorts and live filters do not.

Source of the headings: this library. A bound on the distance between both feet is used by I. Skog, J.-O. Nilsson,
D. Zachariah and P. Händel, "Fusing the information from two navigation systems using an upper bound on their maximum
spatial separation", IPIN 2012. Here only headings are corrected, so that strides do not depend on the other foot.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import PyTree

from jgait.estimators.foot_ins.params import FootParams
from jgait.estimators.foot_ins.prepare import FootSignals
from jgait.estimators.walking import along, of_turns
from jgait.events.shank_stance import PAUSE_S
from jgait.filtering import Covariance, Inferred
from jgait.geometry.arrays import interpolated, picked, put, xp
from jgait.geometry.rotation import Quaternion, conjugate, quaternion, rotated, turned, yawed
from jgait.geometry.vectors import Vector, entries, root, vector, wrapped
from jgait.quality.evidence import nis_between
from jgait.types import SIDES, Estimate, Feet, Flags, FootTrajectory, Strides, Values

SHORTEST_STRIDE_M = 0.1
"""[m] Smallest length of a stride; a shorter one is a foot that is lifted and set down in place."""

TIMING = 0.02
"""[s] Standard deviation of the duration of a stride, from 15 ms for each of its two contacts."""

APART = 0.2
"""[m] Standard deviation of a foothold from the way of the other foot, and of the width between the feet. Errors of
neighbours are alike, so it is more than that of one foothold. Half or twice as much changes the rates of
`gaitmap_example` by less than 5 %."""


class Path(NamedTuple):
    """Trajectory and strides of one foot."""

    trajectory: FootTrajectory  #: position from the first foothold, velocity, attitude; x along the first stride.
    #: standard deviations of position since the last foothold, velocity, and attitude (a rotation vector).
    stddev: FootTrajectory
    strides: Strides  #: one row for each pair of consecutive footholds.
    strides_stddev: Strides
    pitch: Values  #: (T,) pitch of the foot relative to stance, toes up positive [rad].
    nis: Values  #: mean normalised innovation squared of each stride [1], see `quality.evidence.nis_between`.


def path_of(p: FootParams, foot: FootSignals, time: Values, inferred: Inferred, *, flatten: bool) -> Path:
    """Trajectory and strides, of side 0, of one foot from states whose positions are those since the last foothold.

    `flatten` gives successive footholds of the trajectory one height where the ground is level, see `level_ground`.
    """
    state, cov = inferred.mean, inferred.cov
    position, attitude = vector(state.position), quaternion(state.attitude)
    here, there = foot.foothold[:-1], foot.foothold[1:]
    real = xp.arange(here.shape[0], dtype=xp.int32) < foot.count - 1
    way = Vector(*picked(there, *position))
    length = root(way.x * way.x + way.y * way.y)
    valid = real & (length > SHORTEST_STRIDE_M) & foot.whole[:-1]
    forward = _forward(attitude, way, length, here, valid)
    first = xp.argmax(valid)  # the first row if none is valid
    heading = xp.arctan2(way.y[first], way.x[first])
    nis = nis_between(inferred.filtered.nis, inferred.filtered.count, here, there)
    ahead = rotated(attitude, Vector(*(xp.broadcast_to(part, time.shape) for part in forward)))
    strides, deviations = _strides(p, foot, time, (position.z, ahead), cov, way, length, valid, nis)
    relative = xp.stack(position, axis=1)
    # positions count from the last foothold; their sum, from the start of the recording
    begun = xp.cumsum(xp.where(foot.restart[1:, None] > 0.5, relative[:-1], 0.0), axis=0)
    since = relative + xp.pad(begun, ((1, 0), (0, 0)))
    if flatten:
        since = since - xp.stack([xp.zeros_like(time)] * 2 + [_climbed(foot, time, strides)], axis=1)
    orientation = yawed(state.attitude, -heading)
    since = turned(since, -heading)
    since = since + xp.stack(rotated(quaternion(orientation), p.tracked_point), axis=1)
    start = since[foot.foothold[0]]
    placed = xp.where(foot.valid[:, None], since - start[None, :], xp.zeros_like(since))
    trajectory = FootTrajectory(placed, turned(state.velocity, -heading), orientation)
    deviation = FootTrajectory(*(_rotated_stddev(cov, part, heading) for part in ("position", "velocity", "attitude")))
    return Path(trajectory, deviation, strides, deviations, xp.arcsin(xp.clip(ahead.z, -1.0, 1.0)), nis)


def walked(strides: Strides, rows: PyTree, time: Values) -> Values:
    """Distance along the footholds of a foot (T,) [m], in turns by `of_turns`; it grows evenly over each swing.

    `rows` is the number of strides that are not padding.
    """
    if not strides.length.shape[0]:
        return xp.zeros_like(time)
    real = xp.arange(strides.length.shape[0], dtype=xp.int32) < rows
    end = xp.maximum(strides.end, strides.final_contact + 1e-6)
    lengths = xp.where(strides.valid, of_turns(strides.length, strides.turn)[0], 0.0)
    return along(time, strides.final_contact, end, real, lengths[:, None])[:, 0]


def _strides(
    p: FootParams, foot: FootSignals, time: Values, state: tuple[Values, Vector], cov: Covariance,
    way: Vector, length: Values, valid: Flags, nis: Values,
) -> tuple[Strides, Strides]:  # fmt: skip
    """Strides of one foot and their standard deviations, from the way and its length between footholds.

    `state` are heights (T,) [m] and forward directions of the foot in the world.
    """
    height, axis = state
    here, there = foot.foothold[:-1], foot.foothold[1:]
    spread = entries(cov["position", "position"], "xx", "xy", "yy", "zz")
    pitch, yaw = xp.arcsin(xp.clip(axis.z, -1.0, 1.0)), xp.arctan2(axis.y, axis.x)
    norm = xp.sqrt(axis.x**2 + axis.y**2 + 1e-12)
    x, y = -axis.y / norm, axis.x / norm  # of the horizontal axis to the left of the foot's front
    xx, yy, xy, zz = entries(cov["attitude", "attitude"], "xx", "yy", "xy", "zz")
    signals = (pitch, yaw, zz, root(x * x * xx + 2.0 * x * y * xy + y * y * yy), time)
    standing_pitch, yaw_here, variance_here, *_ = picked(here, *signals)
    *between, next_pitch, yaw_there, variance_there, _, _ = picked(there, *spread, *signals)
    push_off, _, _, push_off_sd, leaves = picked(foot.final_contact[:-1], *signals)
    contact, _, _, contact_sd, touches = picked(foot.initial_contact[:-1], *signals)
    nothing = xp.full_like(length, xp.nan)
    known = Strides(
        side=xp.zeros(length.shape, xp.int32), start=None, final_contact=leaves, end=touches, length=length,
        width=nothing, height=way.z, valid=valid, standing=time[foot.leaves[:-1]],
        standing_end=time[foot.arrives[1:]], turn=wrapped(yaw_there - yaw_here),
        lift=_lift(height, foot, way.z), contact_angle=contact - next_pitch,
        push_off_angle=push_off - standing_pitch, step_length=nothing,
    )  # fmt: skip
    landed = xp.concatenate([leaves[:1], touches[:-1]])
    follows = xp.concatenate([xp.zeros_like(valid[:1]), valid[:-1]])
    follows &= walks_on(landed, leaves, touches)
    yaw = variance_there - variance_here
    strides, deviations = timed(p, known, way, between, landed, follows, yaw, nis, _unmeasured(foot, time))
    return strides, deviations._replace(contact_angle=contact_sd, push_off_angle=push_off_sd, step_length=nothing)


def walks_on(landed: Values, leaves: Values, touches: Values) -> Flags:
    """True if the stance from `landed` until the foot `leaves`, before it `touches` again [s], is part of walking.

    A stance longer than `PAUSE_S` and four swings is standing; a shuffling foot stands for three swings.
    """
    return leaves - landed <= xp.maximum(PAUSE_S, 4.0 * (touches - leaves))


def timed(
    p: FootParams, known: Strides, way: Vector, spread: Sequence[Values], landed: Values, follows: Flags,
    yaw: Values, nis: Values, unmeasured: Values,
) -> tuple[Strides, Strides]:  # fmt: skip
    """Strides with their starts and speeds, and their standard deviations; offline and online.

    The displacement `way` from foothold to foothold [m] has the covariances xx, xy, yy and zz of `spread`. A stride
    that `follows` another starts where that `landed` [s], a first one at its final contact. `yaw` is the change of the
    heading's variance [rad²]; `nis` and `unmeasured` are those of `stated`.
    """
    length, (xx, xy, yy, zz) = known.length, spread
    x, y = way.x / xp.maximum(length, 1e-6), way.y / xp.maximum(length, 1e-6)
    along_way = x * x * xx + 2.0 * x * y * xy + y * y * yy
    unknown = (p.stride_noise * length) ** 2
    start = xp.where(follows, landed, known.final_contact)
    duration = xp.maximum(xp.where(follows, known.end - start, known.standing_end - known.standing), 1e-3)
    stddev = stated(along_way + unknown, nis, known.turn, unmeasured)
    return known._replace(start=start, speed=length / duration), Strides(
        side=known.side, start=None, final_contact=None, end=None, length=stddev, width=known.width,
        height=root(zz + unknown), valid=known.valid, turn=root(xp.abs(yaw)),
        speed=root((stddev / duration) ** 2 + (length / duration**2 * TIMING) ** 2),
    )  # fmt: skip


def _unmeasured(foot: FootSignals, time: Values) -> Values:
    """Variance of the length of each stride (K − 1,) [m²] by forces in its swing that were lost or clipped: changes of
    velocity of variance q at times t, which sum to zero from stance to stance, give Σ q t² − (Σ q t)² / Σ q.
    """
    rows = foot.foothold.shape[0]
    stride = xp.clip(xp.cumsum(foot.restart).astype(xp.int32), 0, rows)
    since = time - time[foot.foothold][xp.maximum(stride - 1, 0)]
    q = (foot.acc_doubt * foot.dt) ** 2
    moments = xp.stack([q, q * since, q * since**2], axis=1)
    sums = put(xp.zeros((rows + 1, 3), q.dtype), stride, moments, "add")[1:rows]
    return xp.maximum(sums[:, 2] - sums[:, 1] ** 2 / xp.maximum(sums[:, 0], 1e-12), 0.0)


def stated(variance: Values, nis: Values, turn: Values, unmeasured: Values) -> Values:
    """Standard deviation of the length of strides (n,) [m]: √(v NIS + (0.04 m · turn)²), or with √NIS below 1; v is the
    variance of the filter and of `FootParams.stride_noise` [m²], and the turn is in rad: the place about which a foot
    turns on the ground is not known.

    The noise of the zero velocity is that of errors which stay the same over a stance. Most stances are better, so that
    the filter's variance v is too large. NIS shows by how much: of 1024 strides of four sets, the squared error over v
    goes as √NIS, from 0.05 to 2; exponents fitted without one of the sets are .52 to .69. The part of v above
    (0.07 m)², the largest of these strides, as after seconds without a stance, and the part by forces that were
    `unmeasured` [m²] are not reduced, because stances do not show them.
    """
    less = 1.0 - xp.sqrt(xp.clip(nis, 0.05, 1.0))
    corrected = variance * xp.maximum(nis, 1.0) - xp.clip(variance - unmeasured, 0.0, 0.07**2) * less
    return root(corrected + (0.04 * turn) ** 2)


def _climbed(foot: FootSignals, time: Values, strides: Strides) -> Values:
    """Height (T,) that the strides over level ground seem to climb; it grows evenly from foothold to foothold [m]."""
    flat = level_ground(strides.height, strides.valid)
    real = xp.arange(flat.shape[0], dtype=xp.int32) < foot.count - 1
    wrong = xp.pad(xp.cumsum(xp.where(flat & real, strides.height, 0.0)), (1, 0))
    # padding repeats the last foothold, but an interpolation needs increasing times
    behind = xp.maximum(xp.arange(foot.foothold.shape[0], dtype=xp.int32) - foot.count + 1, 0)
    knots = time[foot.foothold] + behind.astype(time.dtype)
    climbed: Values = interpolated(time, knots, wrong[:, None])[:, 0]
    return climbed


def level_ground(rise: Values, valid: Flags) -> Flags:
    """(n,) bool, whether the ground below each stride is level, from the rises of the `valid` strides [m].

    The ground is level where the median rise of a stride and of the two before and after it is below 4 cm: a few bad
    rises do not make it a slope, and four steps of a stair are none. A standing foot that rolls moves its sensor up or
    down by the distance from the sensor to the point below which it rolls, so that the strides of a whole walk rise by
    one error: in the level corridor of `ipol_gait` by 1.2 cm (median of 72 feet of 12 people), below 3 cm in 97 %. The
    ground below strides that are not valid is taken as level.
    """
    order = xp.argsort(~valid, stable=True)
    last = xp.maximum(xp.sum(valid) - 1, 0)
    index = xp.arange(rise.shape[0])
    # at the ends of a walk the neighbours are the first or the last of it
    middle = xp.clip(index, xp.minimum(2, last // 2), xp.maximum(last - 2, last // 2))
    around = xp.clip(middle[:, None] + xp.arange(-2, 3)[None, :], 0, last)
    flat = xp.abs(xp.median(rise[order][around], axis=1)) < 0.04
    return flat[xp.argsort(order)] | ~valid


def _lift(height: Values, foot: FootSignals, rise: Values) -> Values:
    """Largest height of the sensor above the higher foothold of each stride (K − 1,) [m]."""
    rows = foot.foothold.shape[0]
    stride = xp.cumsum(foot.restart).astype(xp.int32)
    above = xp.where(foot.valid, height, 0.0)
    highest = put(xp.zeros(rows + 1, height.dtype), xp.clip(stride, 0, rows), above, "max")
    return highest[1:rows] - xp.maximum(rise, 0.0)


def _forward(attitude: Quaternion, way: Vector, length: Values, here: PyTree, valid: Flags) -> Vector:
    """Forward direction of the foot in sensor axes: mean direction of its strides, at the stance before each stride.

    Strides of 0.4 m and more show it; all do, if none is as long. Without a valid stride it is the sensor's x axis.
    """
    unit = xp.maximum(length, SHORTEST_STRIDE_M)
    ahead = Vector(way.x / unit, way.y / unit, xp.zeros_like(way.x))
    forward = rotated(conjugate(Quaternion(*picked(here, *attitude))), ahead)
    straight = valid & (length > 0.4)
    used = xp.where(xp.any(straight), straight, valid)
    mean = Vector(*(xp.sum(xp.where(used, part, 0.0)) for part in forward))
    mean = mean._replace(x=xp.where(xp.any(used), mean.x, 1.0))
    norm = xp.sqrt(mean.x**2 + mean.y**2 + mean.z**2 + 1e-12)
    return Vector(mean.x / norm, mean.y / norm, mean.z / norm)


def _rotated_stddev(cov: Covariance, part: str, heading: Values) -> Values:
    """Standard deviations (T, 3) along axes of the world that are turned by the heading."""
    c, s = xp.cos(heading), xp.sin(heading)
    xx, yy, xy, zz = entries(cov[part, part], "xx", "yy", "xy", "zz")
    cross = 2 * c * s * xy
    return root(xp.stack([c * c * xx + cross + s * s * yy, s * s * xx - cross + c * c * yy, zz], axis=-1))


# --- headings of two feet ---


class Rates(NamedTuple):
    """Rates of the errors of both headings [rad/s], and the variance of their difference over its prior variance."""

    right: float
    left: float
    remaining: float


def heading_rates(
    time: np.ndarray, ways: Sequence[np.ndarray], steps: Sequence[np.ndarray], sd: Sequence[float]
) -> Rates | None:
    """The rates of the errors of both headings; None if a foot has fewer than six footholds while the other one walks,
    or if the ways contradict each other.

    `ways` are horizontal positions x + iy (T,) of the right and of the left foot [m], each in a frame of its own,
    `steps` the samples of their footholds, and `sd` the prior standard deviations of both rates [rad/s].
    """
    since, until = (pick(steps[0][end], steps[1][end]) for pick, end in ((max, 0), (min, -1)))
    at = np.unique(np.concatenate(steps))
    at = at[(at >= since) & (at <= until)]
    if min(np.sum((stands >= since) & (stands <= until)) for stands in steps) < 6:
        return None
    t = time[at] - time[at[0]]
    right, left = (np.interp(time[at], time[stands], way[stands]) for stands, way in zip(steps, ways, strict=True))
    ahead = np.gradient(right)
    beside = 1j * ahead / np.maximum(np.abs(ahead), 0.1)
    prior = sd[0] ** 2 + sd[1] ** 2
    weight = np.diag([1.0 / prior, 1.0, 0.0, 0.0, 1.0 / APART**2])
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


def with_headings_together(result: Estimate) -> Estimate:
    """The estimate of two feet whose headings do not drift apart; lengths and heights stay as they are.

    Ways, velocities, attitudes and turns change by the rates of `heading_rates`, and so do deviations of the headings.
    """
    feet, spread = (
        [FootTrajectory(*(np.asarray(part, np.float64) for part in foot)) for foot in both or () if foot is not None]
        for both in (result.feet, result.feet_stddev)
    )
    strides = result.strides
    assert strides is not None
    time = np.asarray(result.time, np.float64)
    steps = [np.asarray(result.diagnostics[f"footholds_{side}"]) for side in SIDES]
    if min(len(stands) for stands in steps) < 2:
        return result
    ends = [float(foot.orientation[stands[-1], 2]) for foot, stands in zip(spread, steps, strict=True)]
    # [rad] beyond, one rate for the whole recording is not enough
    if not max(ends) <= 0.3 or not all(np.isfinite(foot.position).all() for foot in feet):
        return result
    # 1.2e-3 rad/s beside the filter's deviation: the most likely value for 20 walks of `pyshoe_vicon`, `footprints` and
    # `neura_sparse` (running, fast walking and creeping left out)
    sd = [np.hypot(end / (time[at[-1]] - time[at[0]]), 1.2e-3) for end, at in zip(ends, steps, strict=True)]
    drift = heading_rates(time, [_horizontal(foot) for foot in feet], steps, sd)
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
