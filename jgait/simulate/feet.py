"""Both feet: stance on a foothold, roll over heel, sole, ball and toes, and swing to the next foothold.

Time is counted in steps since the foot landed: in the first step it is the foot that landed last; in the second step it
swings. In walking it pushes off in the second step, in running in the first. Rotations about heel, ball and toes move
the ankle; the centre of rotation on the foot rests.
"""

from typing import NamedTuple

import jax.numpy as jnp

from jgait.geometry.jets import Jet, outer, part, parts, sin_cos, stacked
from jgait.geometry.vectors import kept
from jgait.simulate.person import Body, Gait
from jgait.simulate.shapes import Movement, added
from jgait.simulate.smooth import glide, smooth_bump, smooth_step
from jgait.types import Flags, Values


class Foothold(NamedTuple):
    """Fields of the `Plan` at one foothold of each foot, (2, T); `place` (5, 2, T): x, y, z, `foot_yaw` and `slope`."""

    place: Values
    toe_up: Values
    early: Values
    heel_up: Values
    off: Values
    leave: Values
    lift: Values
    out: Values


class FootPair(NamedTuple):
    """Right and left foot."""

    frame: Jet  #: (4, 3, 2, T) frames whose origin is the ankle, see `walker.with_skin`.
    yaw: Jet  #: (2, T) [rad].
    free: Jet  #: (2, T) 0 while the sole is on the ground, 1 in swing [1].


LINGER = 0.1
"""[steps] Time in which the tip of the toes leaves the ground: in this time it moves by a few millimetres."""


class Phases(NamedTuple):
    """Shares [1] of the motions of a foot, (2, T)."""

    rise: Jet  #: pitch of the heel, over its largest pitch.
    toes: Jet  #: pitch of the toes, over their largest pitch.
    down: Jet  #: pitch of the foot before and after landing, over its pitch at landing.
    way: Jet  #: share of the way from foothold to foothold.
    lift: Jet  #: lift in swing, over the early lift.
    more_lift: Jet  #: what recorded feet lift besides, over the early lift on level ground.
    free: Jet  #: 0 while the sole is on the ground, 1 in swing.


def phases(gait: Gait, shape: Movement, off: Values, leave: Values, early: Values, lands: Values, s: Jet) -> Phases:
    """Progress of stance and swing.

    The heel rises slowly in single support and fast at the contact of the other foot; then the ball of the foot rises
    about the tip of the toes. In swing both pitches return to 0. To each motion what recorded feet do beside that is
    added, while the foot is free to do it; see `shapes.added`. Numbers are (2, T): `off`, `leave` and `early` as in a
    `Plan`, the landing `lands`, last or next, to which the foot is pitched, and s, in steps since the last landing [1].
    """
    # Heel up, toes up, both back; toes up before landing, down after it; on the way, stopped by the ground or the leg;
    # and the times in which recorded feet move besides.
    when, flat = shape.when, 2.0 * gait.foot_flat
    # The way to a landing on a flat foot ends 0.05 steps before it, and the heel comes down until the landing, as in
    # closing steps of recorded people (`experiments.people.shoes`).
    down, stops = early * when.heel_down, 2.0 - leave - (1.0 - early) * 0.05
    rises = jnp.maximum(leave - when.heel_rises, off)
    begins = (
        rises, leave - when.toes_rise, leave, lands - when.toes_up, lands - when.toes_turn, leave,
        leave, off, lands - when.toes_up, leave, leave,
    )  # fmt: skip
    lasts = (
        leave + when.heel_after - rises, when.toes_rise + when.heel_after, 2.0 - leave - down,
        when.toes_up - when.toes_turn + 0.1, when.toes_turn + flat, stops, stops,
        2.0 - off - down, when.toes_up + flat, stops, 2.0 - leave,
    )  # fmt: skip
    over = 1.0 / jnp.stack([jnp.broadcast_to(last, leave.shape) for last in lasts])
    u = (part(s, None) - jnp.stack(begins)) * over

    def column(*values: Values) -> Values:
        return jnp.stack([jnp.asarray(value, leave.dtype) for value in values]).reshape((-1,) + (1,) * leave.ndim)

    gather = column(0.6, 0.5, 0.5, 0.5, 0.5, when.gather, when.gather)
    lose = column(0.4, 0.5, 0.5, 0.5, 0.5, when.hard, when.soft)
    fast, toes, back, up, turn, hard, soft = parts(glide(part(u, slice(0, 7)), gather, lose))
    tau = part(u, -1)
    more_rise, more_down, more_way, more_lift = parts(added(shape, part(u, slice(7, None))))
    steps = ((s - off) / (leave - off), (tau - 0.1) / 0.5, (tau - when.lowers) / (1.0 - when.lowers), s / flat)
    slow, late, lowers, lies = parts(smooth_step(stacked(steps)))
    rise = slow * when.heel_early + fast * (1.0 - when.heel_early) - back
    return Phases(
        rise=rise + more_rise,
        toes=toes - back,
        down=up - turn + more_down,
        way=hard * gait.landing_speed + soft * (1.0 - gait.landing_speed) + more_way,
        lift=smooth_bump(tau / 0.5) + (late - lowers) * when.late_lift,
        more_lift=more_lift,
        free=slow - lies + 1.0,
    )


def feet(body: Body, gait: Gait, shape: Movement, origin: Foothold, target: Foothold, moves: Flags, s: Jet) -> FootPair:
    """Both feet, from the foothold `origin` that each took last to its next one, `target`.

    `moves` (2, T) is False for the foot that landed last; s (2, T) are the steps since the last landing, in [0, 1] for
    that foot, in [1, 2] for the other one.
    """
    lands = jnp.where(moves, 2.0, 0.0).astype(origin.off.dtype)
    share = kept(phases(gait, shape, origin.off, origin.leave, target.early, lands, s))
    place = part(share.way, None) * (target.place - origin.place) + origin.place
    yaw, incline = part(place, 3), part(place, 4)
    down, rise = share.down * jnp.where(moves, target.toe_up, origin.toe_up), share.rise * origin.heel_up
    angles = kept(
        stacked([down, rise, share.toes * (origin.heel_up * shape.when.toes), incline, yaw, incline + down - rise])
    )
    sines, cosines = sin_cos(angles)
    s_down, s_rise, s_toes, s_slope, sy, sp = parts(sines)
    c_down, c_rise, c_toes, c_slope, cy, cp = parts(cosines)
    c_down, c_rise, c_toes = c_down - 1.0, c_rise - 1.0, c_toes - 1.0
    # Rotations about heel, ball and tip of the toes move the ankle along the ground and perpendicular to it.
    heel, ball, toe, high = body.heel_length, body.ball_length, body.toe_length, body.ankle_height
    ahead = c_down * heel - s_down * high - c_rise * ball + s_rise * high - c_toes * toe
    up = s_down * heel + c_down * high + s_rise * ball + c_rise * high + s_toes * toe
    # The lift over a riser is in addition.
    height = up + high + share.lift * origin.lift + share.more_lift * jnp.minimum(origin.lift, gait.swing_lift)
    by_ahead, by_height = map(parts, parts(outer(stacked([ahead, height]), stacked([c_slope, s_slope]))))
    level, rises = kept((by_ahead[0] - by_height[1], by_ahead[1] + by_height[0]))
    by_cosine, by_sine = map(parts, parts(outer(stacked([cy, sy]), stacked([level, cp, sp]))))
    aside = share.lift * origin.out
    ankle = part(place, slice(0, 3)) + stacked([by_cosine[0] - sy * aside, by_sine[0] + cy * aside, rises])
    axes = (by_cosine[1], by_sine[1], sp), (-sy, cy, cy * 0.0), (-by_cosine[2], -by_sine[2], cp)
    return FootPair(kept(stacked([ankle, *map(stacked, axes)])), yaw, share.free)
