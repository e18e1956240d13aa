"""One foot: stance on a foothold, roll over heel, sole, ball and toes, and swing to the next foothold.

Time is counted in steps since the foot landed: for one step it is the foot that landed last, for the next it pushes
off and swings. Turns about heel, ball and toes move the ankle; the point of the foot about which it turns rests.
"""

from typing import NamedTuple

import jax.numpy as jnp

from jgait.geometry.trigonometry import sincos
from jgait.geometry.vectors import Vector, kept
from jgait.simulate.person import Body, Gait
from jgait.simulate.smooth import bump, glide, step
from jgait.types import Values


class Foothold(NamedTuple):
    """Fields of the `Plan` at one foothold, (T,)."""

    x: Values
    y: Values
    z: Values
    foot_yaw: Values
    slope: Values
    toe_up: Values
    heel_up: Values
    off: Values
    leave: Values
    lift: Values


class Foot(NamedTuple):
    """One foot at times (T,): ankle [m], pitch [rad] toes up, yaw [rad]."""

    ankle: Vector
    pitch: Values
    yaw: Values


def heel_turn(body: Body, pitch: Values) -> tuple[Values, Values]:
    """How far the ankle moves forward and up [m] when the foot is pitched up about its heel."""
    s, c = jnp.sin(pitch), jnp.cos(pitch) - 1.0
    return c * body.heel_length - s * body.ankle_height, s * body.heel_length + c * body.ankle_height


def ball_turn(body: Body, pitch: Values) -> tuple[Values, Values]:
    """How far the ankle moves forward and up [m] when the heel is lifted by a pitch about the ball of the foot."""
    s, c = jnp.sin(pitch), jnp.cos(pitch) - 1.0
    return -c * body.ball_length + s * body.ankle_height, s * body.ball_length + c * body.ankle_height


def toe_turn(body: Body, pitch: Values) -> tuple[Values, Values]:
    """How far the ball of the foot moves forward and up [m] when it is lifted by a pitch about the tip of the toes."""
    return (1.0 - jnp.cos(pitch)) * body.toe_length, jnp.sin(pitch) * body.toe_length


def heel_rise(off: Values, leave: Values, s: Values) -> tuple[Values, Values]:
    """How much of its final pitch the leaving foot has, and the toes of theirs [1], s steps after it landed.

    The heel comes off slowly while this leg bears alone, and fast about when the other lands; then the ball follows
    over the tip of the toes. In swing both go back to 0.

    Args:
        off: steps after landing at which the heel begins to rise [1].
        leave: steps after landing at which the toes leave [1].
        s: steps since landing [1].
    """
    slow = step((s - off) / (leave - off))
    fast = glide((s - leave + HEEL_RISES) / (HEEL_RISES + HEEL_AFTER), 0.6, 0.4)
    toes = glide((s - leave + TOES_RISE) / (TOES_RISE + HEEL_AFTER), 0.5, 0.5)
    back = glide((s - leave) / (2.0 - leave - HEEL_DOWN), 0.5, 0.5)
    return HEEL_EARLY * slow + (1.0 - HEEL_EARLY) * fast - back, toes - back


HEEL_EARLY, HEEL_RISES, HEEL_AFTER, HEEL_DOWN = 0.08, 0.34, 0.24, 0.16
"""Share of the slow rise. In steps: from how long before the toes leave to how long after them the heel rises fast, and
how long before landing it is down again; it begins to come down when the toes leave."""

LINGER = 0.1
"""Steps that the tip of the toes takes to come off: till then it moves by a few millimetres."""

TOES_RISE, TOES = 0.14, 0.95
"""Steps before the toes leave at which the ball leaves; pitch of the toes in that of the heel."""


def landing_pitch(gait: Gait, s: Values) -> Values:
    """How much of its pitch at landing a foot has [1], s steps after its contact; negative: before it."""
    up = glide((s + TOES_UP) / (TOES_UP - TOES_TURN + 0.1), 0.5, 0.5)
    return up - glide((s + TOES_TURN) / (TOES_TURN + 2.0 * gait.foot_flat), 0.5, 0.5)


TOES_UP, TOES_TURN = 0.45, 0.16
"""Steps before landing at which the toes begin to come up over the heel, and to come down again."""


def standing_foot(body: Body, gait: Gait, at: Foothold, s: Values) -> Foot:
    """The foot that took the last foothold, s in [0, 1] steps ago."""
    down = kept(at.toe_up * landing_pitch(gait, s))
    rise, ahead, up = _rockers(body, at, down, s)
    ankle = _over(body, (at.x, at.y, at.z), at.foot_yaw, at.slope, ahead, up)
    return kept(Foot(ankle, at.slope + down - rise, at.foot_yaw))


def _rockers(body: Body, origin: Foothold, down: Values, s: Values) -> tuple[Values, Values, Values]:
    """Pitch of the heel [rad], and how far heel, ball and toes turning move the ankle forward and up [m]."""
    rises, toes = kept(heel_rise(origin.off, origin.leave, s))
    rise = origin.heel_up * rises
    turns = (heel_turn(body, down), ball_turn(body, rise), toe_turn(body, TOES * origin.heel_up * toes))
    return rise, sum(ahead for ahead, _ in turns), sum(up for _, up in turns)


def _over(
    body: Body, place: tuple[Values, Values, Values], yaw: Values, incline: Values, ahead: Values, up: Values
) -> Vector:
    """The ankle over a place on the ground, moved ahead and up [m] along the ground's own directions."""
    x, y, z = place
    s, c = sincos(incline)
    height = body.ankle_height + up
    ahead, up = ahead * c - height * s, ahead * s + height * c
    s, c = sincos(yaw)
    return Vector(x + c * ahead, y + s * ahead, z + up)


def _swing(gait: Gait, leave: Values, s: Values) -> tuple[Values, Values]:
    """How much of the way from foothold to foothold is done, and of the lift, s in [1, 2] steps after landing."""
    tau = (s - leave) / (2.0 - leave)
    lift = bump(tau / 0.5) + LATE_LIFT * (step((tau - 0.1) / 0.5) - step((tau - LOWERS) / (1.0 - LOWERS)))
    hard = gait.landing_speed
    return hard * glide(tau, GATHER, HARD) + (1.0 - hard) * glide(tau, GATHER, SOFT), lift


GATHER, LATE_LIFT, LOWERS = 0.42, 0.5, 0.74
"""Share of swing in which the foot gathers speed; how high it is lifted late in swing, in the early lift."""

HARD, SOFT = 0.15, 0.44
"""Shares of swing in which the ground stops the foot, and in which the leg does."""


def moving_foot(body: Body, gait: Gait, origin: Foothold, target: Foothold, s: Values) -> Foot:
    """The foot that took the last but one foothold s in [1, 2] steps ago, pushes off, and swings to the next."""
    way, arc = kept(_swing(gait, origin.leave, s))
    down = kept(target.toe_up * landing_pitch(gait, s - 2.0))
    rise, ahead, up = _rockers(body, origin, down, s)
    x, y, z, yaw, incline = (a + way * (b - a) for a, b in zip(origin[:5], target[:5], strict=True))
    ankle = _over(body, (x, y, z), yaw, incline, ahead, up + origin.lift * arc)
    return kept(Foot(ankle, incline + down - rise, yaw))
