"""Distance walked from leg kinematics, from the displacement of the foot or of the hip over the stance foot.

Source: Bennett et al. (2013), section V, for the accumulated displacement of the foot.
"""

from collections.abc import Sequence

import jax

from jgait.estimators.ankle_stride.prepare import AnkleSignals
from jgait.geometry.arrays import xp
from jgait.types import Flags, Legs, LegTrajectory, Values

MOVES_M, LEAST_SHARE = 1e-3, 0.2
"""[m] Displacement in an interval above which a foot moves; [1] least share of walking in which it moves backward.
Chosen by hand."""


def accumulated(leg: LegTrajectory, *, vertical: bool = True) -> Values:
    """The paper's read-out (T,) [m]: D = Σ max(Δx, 0) + Σ |Δy|, forward displacement and vertical path of the foot
    (deviation 6). It omits the movement of the hip during the swing of the foot.
    """
    x, y = (xp.diff(values, prepend=values[:1]) for values in (leg.x, leg.y))
    forward = xp.maximum(x, 0.0)
    return xp.cumsum(forward + xp.abs(y) if vertical else forward)


def backward(leg: LegTrajectory, before: LegTrajectory, rollover_radius: Values) -> Values:
    """Movement of the hip over this foot since the sample before, if this foot is in stance [m].

    The foot rolls: its ankle moves forward by r per radian that the shank leans forward, so the hip gains
    −Δx − r Δ(shank angle), shank angle positive with the ankle in front.
    """
    shank, shank_before = (trajectory.hip_angle - trajectory.knee_angle for trajectory in (leg, before))
    return before.x - leg.x - rollover_radius * (shank - shank_before)


def stance_carried(legs: Legs, rollover_radius: Values, still: Flags) -> Values:
    """Σ max(−Δx_right, −Δx_left, 0) (T,) [m]: the foot that moves backward fastest is in stance; who stands gets no
    farther.

    With sensors on one leg, its backward displacement is divided by the share of walking time in which the foot moves
    backward: the mean speed of the hip in the swing of the foot is taken to be the same. `rollover_radius` is the
    displacement of the ankle per radian of shank rotation in stance [m].
    """
    worn = [leg for leg in (legs.right, legs.left) if leg is not None]
    earlier = [jax.tree.map(lambda v: xp.concatenate([v[:1], v[:-1]]), leg) for leg in worn]
    ways = [backward(leg, before, rollover_radius) for leg, before in zip(worn, earlier, strict=True)]
    if len(ways) == 2:
        return xp.cumsum(xp.where(still, 0.0, xp.maximum(xp.maximum(ways[0], ways[1]), 0.0)))
    back = xp.where(still, 0.0, xp.maximum(ways[0], 0.0))
    moving = ~still & (xp.abs(ways[0]) > MOVES_M)
    count = xp.maximum(xp.sum(moving.astype(back.dtype)), 1.0)
    share = xp.sum((moving & (ways[0] > 0.0)).astype(back.dtype)) / count
    return xp.cumsum(back) / xp.maximum(share, LEAST_SHARE)


def rescaled(way: Values, still: Flags, shanks: Sequence[AnkleSignals], total: Values) -> Values:
    """A kinematic distance (T,) [m], scaled so that it agrees with strides whose sum `total` [m] is known.

    Kinematics show at which moments a person advances, strapdown shows only whole strides: those of each shank lie
    between its first and its last foothold. If the person does not stand before or after them, the recording begins or
    ends in walking, and what is walked there is in the distance too. `still` (T,) is True where the person stands.
    """
    covered, stood = [], xp.cumsum(still)
    for shank in shanks:
        begin, end = shank.begin[0], shank.end[shank.count - 1]
        before = xp.where((stood[begin] > 0) | shank.half[0], 0.0, way[begin])
        after = xp.where((stood[-1] > stood[end]) | shank.half[shank.count - 1], 0.0, way[-1] - way[end])
        covered.append(way[-1] - before - after)
    return way * (total / xp.maximum(xp.mean(xp.stack(covered)), 1e-6))
