"""Both feet: stance on a foothold, roll over heel, sole, ball and toes, and swing to the next foothold.

Time is counted in steps since the foot landed: in the first step it is the foot that landed last, in the second step it
pushes off and swings. Rotations about heel, ball and toes move the ankle; the centre of rotation on the foot rests.
"""

from typing import NamedTuple

import jax.numpy as jnp

from jgait.geometry.segments import Frame
from jgait.geometry.vectors import Vector, kept
from jgait.simulate.person import Body, Gait
from jgait.simulate.smooth import bump, glide, step
from jgait.types import Flags, Values


class Foothold(NamedTuple):
    """Fields of the `Plan` at one foothold of each foot, (2, T)."""

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


class FootPair(NamedTuple):
    """Right and left foot, (2, T): frame, whose origin is the ankle, and yaw [rad]."""

    frame: Frame
    yaw: Values


HEEL_EARLY, HEEL_RISES, HEEL_AFTER, HEEL_DOWN = 0.08, 0.34, 0.24, 0.16
"""[1] Share of the slow rise of the heel. [steps] Start of the fast rise before toe-off, its end after toe-off, and the
time before landing at which the heel is down again; the heel begins to come down at toe-off."""

LINGER = 0.1
"""[steps] Time in which the tip of the toes leaves the ground: in this time it moves by a few millimetres."""

TOES_RISE, TOES = 0.14, 0.95
"""[steps] Time from the ball's leaving the ground to toe-off. [1] Pitch of the toes over the pitch of the heel."""

TOES_UP, TOES_TURN = 0.45, 0.16
"""[steps] Times before landing at which the toes begin to rise above the heel, and to come down again."""

GATHER, LATE_LIFT, LOWERS = 0.42, 0.5, 0.74
"""[1] Share of swing in which the foot accelerates; late lift over early lift; share of swing after which it falls."""

HARD, SOFT = 0.15, 0.44
"""[1] Shares of swing in which the ground decelerates the foot, and in which the leg does."""


class Phases(NamedTuple):
    """Shares [1] of the motions of a foot, (2, T).

    Attributes:
        rise: pitch of the heel, over its largest pitch.
        toes: pitch of the toes, over their largest pitch.
        down: pitch of the foot before and after landing, over its pitch at landing.
        way: share of the way from foothold to foothold.
        lift: lift in swing, over the early lift.
    """

    rise: Values
    toes: Values
    down: Values
    way: Values
    lift: Values


def phases(gait: Gait, off: Values, leave: Values, lands: Values, s: Values) -> Phases:
    """Progress of stance and swing.

    The heel rises slowly in single support and fast at the contact of the other foot; then the ball of the foot rises
    about the tip of the toes. In swing both pitches return to 0.

    Args:
        gait: the gait.
        off: (2, T) steps after landing at which the heel begins to rise [1].
        leave: (2, T) steps after landing at which the toes leave [1].
        lands: (2, T) the landing, last or next, to which the foot is pitched, in steps since the last landing [1].
        s: (2, T) steps since the last landing [1].
    """
    # Heel up, toes up, both back; toes up before landing, down after it; on the way, stopped by the ground or the leg.
    begins = (leave - HEEL_RISES, leave - TOES_RISE, leave, lands - TOES_UP, lands - TOES_TURN, leave, leave)
    lasts = (
        HEEL_RISES + HEEL_AFTER, TOES_RISE + HEEL_AFTER, 2.0 - leave - HEEL_DOWN, TOES_UP - TOES_TURN + 0.1,
        TOES_TURN + 2.0 * gait.foot_flat, 2.0 - leave, 2.0 - leave,
    )  # fmt: skip
    u = (s[None] - jnp.stack(begins)) / jnp.stack([jnp.broadcast_to(last, leave.shape) for last in lasts])

    def column(*values: float) -> Values:
        return jnp.asarray(values, s.dtype).reshape((-1,) + (1,) * s.ndim)

    gather = column(0.6, 0.5, 0.5, 0.5, 0.5, GATHER, GATHER)
    lose = column(0.4, 0.5, 0.5, 0.5, 0.5, HARD, SOFT)
    fast, toes, back, up, turn, hard, soft = glide(u, gather, lose)
    tau = u[-1]
    steps = ((s - off) / (leave - off), (tau - 0.1) / 0.5, (tau - LOWERS) / (1.0 - LOWERS))
    slow, late, lowers = step(jnp.stack(steps))
    return Phases(
        rise=HEEL_EARLY * slow + (1.0 - HEEL_EARLY) * fast - back,
        toes=toes - back,
        down=up - turn,
        way=gait.landing_speed * hard + (1.0 - gait.landing_speed) * soft,
        lift=bump(tau / 0.5) + LATE_LIFT * (late - lowers),
    )


def feet(body: Body, gait: Gait, origin: Foothold, target: Foothold, moves: Flags, s: Values) -> FootPair:
    """Both feet.

    Args:
        body: lengths of the body.
        gait: the gait.
        origin: the foothold that each foot took last.
        target: the foothold that a foot takes next; of the foot that landed last, again its last foothold.
        moves: (2, T) whether the foot pushes off and swings; False for the foot that landed last.
        s: (2, T) steps since the last landing, in [0, 1] for the foot that landed last, in [1, 2] for the other foot.
    """
    share = kept(phases(gait, origin.off, origin.leave, jnp.where(moves, 2.0, 0.0).astype(s.dtype), s))
    x, y, z, yaw, incline = (a + share.way * (b - a) for a, b in zip(origin[:5], target[:5], strict=True))
    down, rise = target.toe_up * share.down, origin.heel_up * share.rise
    angles = kept(jnp.stack([down, rise, TOES * origin.heel_up * share.toes, incline, yaw, incline + down - rise]))
    s_down, s_rise, s_toes, s_slope, sy, sp = jnp.sin(angles)
    c_down, c_rise, c_toes, c_slope, cy, cp = jnp.cos(angles)
    c_down, c_rise, c_toes = c_down - 1.0, c_rise - 1.0, c_toes - 1.0
    # Rotations about heel, ball and tip of the toes move the ankle along the ground and perpendicular to it.
    heel, ball, toe, high = body.heel_length, body.ball_length, body.toe_length, body.ankle_height
    ahead = c_down * heel - s_down * high - c_rise * ball + s_rise * high - c_toes * toe
    up = s_down * heel + c_down * high + s_rise * ball + c_rise * high + s_toes * toe
    height = high + up + jnp.where(moves, origin.lift, 0.0) * share.lift
    ahead, up = kept((ahead * c_slope - height * s_slope, ahead * s_slope + height * c_slope))
    ankle = Vector(x + cy * ahead, y + sy * ahead, z + up)
    axes = Vector(cy * cp, sy * cp, sp), Vector(-sy, cy, jnp.zeros_like(cy)), Vector(-cy * sp, -sy * sp, cp)
    return FootPair(Frame(kept(ankle), *axes), yaw)
