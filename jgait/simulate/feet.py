"""One foot: stance on a foothold, roll over heel, sole, ball and toes, and swing to the next foothold.

Time is counted in steps since the foot landed: in the first step it is the foot that landed last, in the second step it
pushes off and swings. Rotations about heel, ball and toes move the ankle; the centre of rotation on the foot rests.
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
    """Motion of the ankle forward and up [m] when the foot is pitched up about its heel."""
    s, c = jnp.sin(pitch), jnp.cos(pitch) - 1.0
    return c * body.heel_length - s * body.ankle_height, s * body.heel_length + c * body.ankle_height


def ball_turn(body: Body, pitch: Values) -> tuple[Values, Values]:
    """Motion of the ankle forward and up [m] when the heel is lifted by a pitch about the ball of the foot."""
    s, c = jnp.sin(pitch), jnp.cos(pitch) - 1.0
    return -c * body.ball_length + s * body.ankle_height, s * body.ball_length + c * body.ankle_height


def toe_turn(body: Body, pitch: Values) -> tuple[Values, Values]:
    """Motion of the ball of the foot forward and up [m] when it is lifted by a pitch about the tip of the toes."""
    return (1.0 - jnp.cos(pitch)) * body.toe_length, jnp.sin(pitch) * body.toe_length


def heel_rise(off: Values, leave: Values, s: Values) -> tuple[Values, Values]:
    """Pitch of the leaving foot and of its toes, as shares of their final pitch [1], s steps after the foot landed.

    The heel rises slowly in single support and fast at the contact of the other foot; then the ball of the foot rises
    about the tip of the toes. In swing both pitches return to 0.

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
"""[1] Share of the slow rise of the heel. [steps] Start of the fast rise before toe-off, its end after toe-off, and the
time before landing at which the heel is down again; the heel begins to come down at toe-off."""

LINGER = 0.1
"""[steps] Time in which the tip of the toes leaves the ground: in this time it moves by a few millimetres."""

TOES_RISE, TOES = 0.14, 0.95
"""[steps] Time from the ball's leaving the ground to toe-off. [1] Pitch of the toes over the pitch of the heel."""


def landing_pitch(gait: Gait, s: Values) -> Values:
    """Pitch of a foot over its pitch at landing [1], s steps after its contact; s is negative before the contact."""
    up = glide((s + TOES_UP) / (TOES_UP - TOES_TURN + 0.1), 0.5, 0.5)
    return up - glide((s + TOES_TURN) / (TOES_TURN + 2.0 * gait.foot_flat), 0.5, 0.5)


TOES_UP, TOES_TURN = 0.45, 0.16
"""[steps] Times before landing at which the toes begin to rise above the heel, and to come down again."""


def standing_foot(body: Body, gait: Gait, at: Foothold, s: Values) -> Foot:
    """The foot in stance: it took the last foothold s steps ago, s in [0, 1]."""
    down = kept(at.toe_up * landing_pitch(gait, s))
    rise, ahead, up = _rockers(body, at, down, s)
    ankle = _over(body, (at.x, at.y, at.z), at.foot_yaw, at.slope, ahead, up)
    return kept(Foot(ankle, at.slope + down - rise, at.foot_yaw))


def _rockers(body: Body, origin: Foothold, down: Values, s: Values) -> tuple[Values, Values, Values]:
    """Pitch of the heel [rad], and motion of the ankle forward and up [m] by rotation about heel, ball and toes."""
    rises, toes = kept(heel_rise(origin.off, origin.leave, s))
    rise = origin.heel_up * rises
    turns = (heel_turn(body, down), ball_turn(body, rise), toe_turn(body, TOES * origin.heel_up * toes))
    return rise, sum(ahead for ahead, _ in turns), sum(up for _, up in turns)


def _over(
    body: Body, place: tuple[Values, Values, Values], yaw: Values, incline: Values, ahead: Values, up: Values
) -> Vector:
    """The ankle over a place on the ground, moved forward along the ground and up perpendicular to the ground [m]."""
    x, y, z = place
    s, c = sincos(incline)
    height = body.ankle_height + up
    ahead, up = ahead * c - height * s, ahead * s + height * c
    s, c = sincos(yaw)
    return Vector(x + c * ahead, y + s * ahead, z + up)


def _swing(gait: Gait, leave: Values, s: Values) -> tuple[Values, Values]:
    """Share of the way from foothold to foothold and of the lift of the foot, s in [1, 2] steps after landing."""
    tau = (s - leave) / (2.0 - leave)
    lift = bump(tau / 0.5) + LATE_LIFT * (step((tau - 0.1) / 0.5) - step((tau - LOWERS) / (1.0 - LOWERS)))
    hard = gait.landing_speed
    return hard * glide(tau, GATHER, HARD) + (1.0 - hard) * glide(tau, GATHER, SOFT), lift


GATHER, LATE_LIFT, LOWERS = 0.42, 0.5, 0.74
"""[1] Share of swing in which the foot accelerates; late lift over early lift; share of swing after which it falls."""

HARD, SOFT = 0.15, 0.44
"""[1] Shares of swing in which the ground decelerates the foot, and in which the leg does."""


def moving_foot(body: Body, gait: Gait, origin: Foothold, target: Foothold, s: Values) -> Foot:
    """The foot in push-off and swing: it took the last but one foothold s steps ago, s in [1, 2]."""
    way, arc = kept(_swing(gait, origin.leave, s))
    down = kept(target.toe_up * landing_pitch(gait, s - 2.0))
    rise, ahead, up = _rockers(body, origin, down, s)
    x, y, z, yaw, incline = (a + way * (b - a) for a, b in zip(origin[:5], target[:5], strict=True))
    ankle = _over(body, (x, y, z), yaw, incline, ahead, up + origin.lift * arc)
    return kept(Foot(ankle, incline + down - rise, yaw))
