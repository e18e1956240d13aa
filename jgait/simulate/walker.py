"""The body at one time: feet on the planned footholds, the pelvis above them, and legs of constant lengths between.

The feet and the pelvis are smooth functions of the walk's clock, which shows k when foothold k is taken. The pelvis is
as high as both legs allow with their knees bent by at least `knee_stance`; knees, thighs and shanks follow from the
lengths of the legs. No signal is integrated or differenced.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float, Int, PRNGKeyArray

from jgait.geometry.segments import Frame, Motion, Segments, differentiated, separated
from jgait.geometry.vectors import Vector, add, cross, dot, kept, scale, subtract
from jgait.simulate.feet import Foothold, FootPair, feet
from jgait.simulate.footsteps import FIRST, Plan, footholds, reach, standing_ahead
from jgait.simulate.person import Body, Gait, Person
from jgait.simulate.routes import Route
from jgait.simulate.smooth import bump, coefficients, curve_at, pieces, polynomial
from jgait.types import AnyArray, Values


def clock(plan: Plan, time: Float[AnyArray, "*shape"]) -> tuple[Int[Array, "*shape"], Float[Array, "*shape"]]:
    """The entry of the last foothold (T,) int, and the share of the current step that has passed (T,) [1].

    The curve of time over the clock is inverted by Newton's method; two steps that are differentiated make the first
    three derivatives exact.
    """
    entry, moving = ticks(plan, time)
    return entry, moving.pose


def ticks(plan: Plan, time: Float[AnyArray, "*shape"]) -> tuple[Int[Array, "*shape"], Motion[Float[Array, "*shape"]]]:
    """As `clock`, the share with its first and second derivative with respect to time."""
    last = plan.end.astype(jnp.int32) - 1 + FIRST
    entry = jnp.searchsorted(plan.contact, time, side="right", method="compare_all") - 1
    entry = jnp.clip(entry, FIRST, last)
    curve = coefficients(plan.time_curve, entry)
    begin, end = plan.contact[FIRST], plan.contact[last + 1]
    now = jnp.clip(time, begin, end)

    def nearer(r: Values, curve: Values, now: Values) -> Values:
        value, pace, _ = polynomial(curve, r)
        return r - (value - now) / pace

    fixed, held = lax.stop_gradient((curve, now))
    # Over a step, the curve rises by the sum of its other coefficients.
    r = lax.fori_loop(0, 3, lambda _, r: nearer(r, fixed, held), (held - fixed[0]) / jnp.sum(fixed[1:], axis=0))
    for _ in range(2):
        r = nearer(r, curve, now)
    r = kept(r)
    _, pace, bend = polynomial(curve, r)
    rate = jnp.where((begin < time) & (time < end), 1.0 / pace, 0.0)
    return entry, Motion(r, rate, -bend * rate * rate * rate)


def _axes(yaw: Values, pitch: Values, roll: Values) -> tuple[Vector, Vector, Vector]:
    """Forward, left and up axis of a segment turned by yaw, then pitched (forward end up), then rolled (left up)."""
    angles = jnp.stack([yaw, pitch, roll])
    (sy, sp, sr), (cy, cp, cr) = jnp.sin(angles), jnp.cos(angles)
    x = Vector(cy * cp, sy * cp, sp)
    y = Vector(-sy * cr - cy * sp * sr, cy * cr - sy * sp * sr, cp * sr)
    return x, y, cross(x, y)


def _legs(body: Body, hip: Vector, ankle: Vector, yaw: Values) -> tuple[Frame, Frame]:
    """Thighs and shanks between hips and ankles, the knees bent forward in the direction of a yaw."""
    a, b = body.thigh_length, body.shank_length
    line = subtract(hip, ankle)
    d2 = dot(line, line)
    d = jnp.sqrt(d2)
    up = scale(1.0 / d, line)
    s, c = jnp.sin(yaw), jnp.cos(yaw)
    left = cross(up, Vector(c, s, jnp.zeros_like(c)))
    up, left = kept((up, scale(1.0 / jnp.sqrt(dot(left, left)), left)))
    ahead = kept(cross(left, up))
    # Distance of the knee from the hip along the line from hip to ankle, and distance of the knee ahead of this line.
    along = (d2 + a * a - b * b) / (2.0 * d)
    square = a * a - along * along
    out = jnp.sqrt(jnp.where(square > 1e-9, square, 1e-9))
    d, along, out = kept((d, along, out))

    def turned(c: Values, s: Values) -> tuple[Vector, Vector, Vector]:
        """Axes of a segment that leans ahead of the line by an angle with this sine and cosine."""
        return subtract(scale(c, ahead), scale(s, up)), left, add(scale(c, up), scale(s, ahead))

    thigh, shank = turned(along / a, -out / a), turned((d - along) / b, out / b)
    return Frame(hip, *thigh), Frame(subtract(hip, scale(a, thigh[2])), *shank)


class Carried(NamedTuple):
    """FootPair, pelvis and hips.

    Attributes:
        feet: both feet.
        pelvis: the pelvis, from the middle of the hips.
        hips: both hips, right and left.
        turn: yaw of the plane of the legs.
    """

    feet: FootPair
    pelvis: Frame
    hips: Vector
    turn: Values


def carried(person: Person, plan: Plan, entry: Int[Array, "..."], r: Values) -> Carried:
    """FootPair and pelvis at the share r (T,) of a step after the contact of foothold `entry` (T,)."""
    body, gait = person.body, person.gait
    sides = jnp.asarray((-1.0, 1.0), r.dtype).reshape((2,) + (1,) * r.ndim)
    side = plan.side[entry]  # of the foot that landed last
    moves = sides * side[None] < 0.0
    before = moves.astype(entry.dtype)
    table = jnp.stack([getattr(plan, field) for field in Foothold._fields])
    origin, target = (Foothold(*kept(table[:, at])) for at in (entry[None] - before, entry[None] + before))
    both = feet(body, gait, origin, target, moves, r[None] + before.astype(r.dtype))
    curves = jnp.stack([plan.x_curve, plan.y_curve, plan.z_curve, plan.heading_curve, plan.walking_curve])
    x, y, z, heading, walking = kept(curve_at(curves, entry, r))
    (ahead, aside, up), (yaw, pitch, roll) = _pelvis_oscillation(gait, side, walking, r)
    s, c = jnp.sin(heading), jnp.cos(heading)
    height = z - plan.dip[entry] * _dip(r) + up
    place = Vector(x + c * ahead - s * aside, y + s * ahead + c * aside, height)
    pelvis = Frame(place, *_axes(heading + yaw, pitch, roll))
    middle, left = (Vector(*(part[None] for part in axis)) for axis in kept((pelvis.origin, pelvis.y)))
    hips = add(middle, scale(0.5 * body.hip_width * sides, left))
    return Carried(both, pelvis, hips, heading + 0.5 * yaw)


class Slack(NamedTuple):
    """Distance of the legs from their limits, the least over a walk.

    Attributes:
        aside: largest horizontal distance between hip and ankle, over the length of the leg [1].
        stretched: least ratio of leg length to the distance from hip to ankle, minus 1 [1]; negative: leg too short.
    """

    aside: Values
    stretched: Values


def plan(key: PRNGKeyArray, person: Person, along: Route, capacity: int) -> Plan:
    """Plan a walk: footholds and pelvis.

    The pelvis is as high as both legs allow at every instant, with their knees bent by at least `knee_stance`.

    Args:
        key: PRNG key of the variability from step to step.
        person: the person; `steps` must not be more than `capacity`.
        along: the route of the walk.
        capacity: largest number of steps that the arrays hold.

    Returns:
        The plan, K = capacity + 4.
    """
    return planned(key, person, along, capacity)[0]


def planned(key: PRNGKeyArray, person: Person, along: Route, capacity: int) -> tuple[Plan, Slack]:
    """As `plan`, and the distance of the legs from their limits."""
    body, gait = person.body, person.gait
    laid = footholds(key, person, along, capacity)
    entries, dtype = jnp.arange(FIRST, capacity + 3), laid.x.dtype
    inside, checked = ((jnp.arange(n, dtype=dtype) + 0.5) / n for n in (SAMPLES, CHECKED))
    r = jnp.concatenate([inside, checked])
    now = carried(person, laid, *jnp.broadcast_arrays(entries[:, None], r[None, :]))
    line = subtract(now.hips, now.feet.frame.origin)  # (2, K, phase)
    level = line.x * line.x + line.y * line.y
    knee = reach(body, jnp.asarray(gait.knee_stance))
    # How much higher a leg of full length lets the hips be.
    at = (jnp.sqrt(jnp.maximum(knee * knee - level, 1e-4)) - line.z)[..., :SAMPLES]
    least = -SHARP * jax.nn.logsumexp(-at / SHARP, axis=(0, 2))
    k = jnp.arange(-1, capacity + 3, dtype=dtype)
    walks = (k > 0.5) & (k < gait.steps + 1.5)
    # At the border of two steps the pelvis has the lower of the two heights.
    steps = jnp.concatenate([least[:1], least[:1], least, least[-1:]])
    walking = -SHARP * jnp.logaddexp(-steps[:-1] / SHARP, -steps[1:] / SHARP)
    high = jnp.where(walks, walking, laid.z + body.ankle_height + _standing_leg(person))
    curve = pieces(high, walks.astype(high.dtype), monotone=True)
    # Where the curve between two heights is higher than the legs allow, the pelvis dips.
    weight = _dip(inside)
    deep = weight > 0.05
    path, _, _ = polynomial(jnp.moveaxis(curve[FIRST:, None], -1, 0), r[None, :])
    over = path[:, :SAMPLES] - jnp.min(at, axis=0)
    needed = jnp.where(deep[None, :], over / jnp.where(deep, weight, 1.0)[None, :], -1.0)
    needed = jnp.concatenate([needed, jnp.zeros_like(needed[:, :1])], axis=1)
    dip = SHARP * jax.nn.logsumexp(needed / SHARP, axis=1)
    height = line.z + (path - dip[:, None] * _dip(r)[None, :])[None]
    taken = (entries < laid.end.astype(entries.dtype) + FIRST)[None, :, None]
    leg = body.thigh_length + body.shank_length
    far, long = (
        jnp.sqrt(jnp.max(jnp.where(taken, square[..., SAMPLES:], 0.0))) / leg
        for square in (level, level + height * height)
    )
    laid = laid._replace(z_curve=curve, dip=jnp.concatenate([jnp.zeros_like(dip[:1]), dip]))
    return laid, Slack(far, 1.0 / long - 1.0)


def _standing_leg(person: Person) -> Values:
    """Height of the hips over the ankles in standing [m]."""
    body, gait = person
    ahead, aside = standing_ahead(person), 0.5 * (body.hip_width - gait.step_width)
    r = reach(body, gait.standing_knee)
    return jnp.sqrt(r * r - ahead * ahead - aside * aside)


SAMPLES, SHARP, CHECKED = 24, 0.0005, 32
"""[1] Instants of a step at which the legs' reach is computed; [m] width of the soft minimum over these instants; [1]
instants of a step at which the legs' limits are checked."""


def _dip(r: Values) -> Values:
    """From 0 to 1 in the middle of a step and back to 0, four times continuously differentiable at the ends."""
    return (4.0 * r * (1.0 - r)) ** 5


def segments(person: Person, plan: Plan, entry: Int[Array, "*shape"], r: Float[Array, "*shape"]) -> Frame:
    """The frames of all segments at the share r of a step after the contact of foothold `entry`: (7, *shape)."""
    now = carried(person, plan, entry, r)
    foot = now.feet.frame
    thigh, shank = _legs(person.body, now.hips, foot.origin, 0.5 * (now.turn[None] + now.feet.yaw))
    return jax.tree.map(lambda pelvis, *pairs: jnp.concatenate([pelvis[None], *pairs]), now.pelvis, thigh, shank, foot)


def pose(person: Person, plan: Plan, time: Float[AnyArray, "time"]) -> Segments[Frame]:
    """A `Frame` of each segment at times (T,) [s]; the origins of the feet are the ankles."""
    return separated(segments(person, plan, *clock(plan, time)))


def _pelvis_oscillation(
    gait: Gait, side: Values, walking: Values, r: Values
) -> tuple[tuple[Values, Values, Values], tuple[Values, Values, Values]]:
    """Displacement of the pelvis forward, left and up from its even path [m], and its yaw, pitch and roll [rad].

    Once a stride the pelvis sways to the stance leg, turns with the leading leg and drops on the side of the swing leg;
    twice a stride it rises and falls, moves forward and back relative to constant speed, and tilts forward and back.
    """
    s, c = jnp.sin(jnp.pi * r), jnp.cos(jnp.pi * r)
    late = s * 0.809 + c * 0.588  # a fifth of a half turn earlier
    s2, c2 = 2.0 * s * c, 1.0 - 2.0 * s * s
    s4, c4 = 2.0 * s2 * c2, 1.0 - 2.0 * s2 * s2
    rise = RISE[0] * c2 + RISE[1] * s2 + RISE[2] * c4 + RISE[3] * s4
    up = walking * (gait.pelvis_rise * rise - gait.pelvis_shock * bump(r / SHAKEN))
    ahead = gait.pelvis_surge * walking * (SURGE[0] * s2 + SURGE[1] * c2)
    aside = gait.pelvis_sway * walking * side * s
    yaw = -gait.pelvis_rotation * walking * side * c
    roll = gait.pelvis_drop * walking * side * late
    pitch = gait.pelvis_nod * walking * c2
    return (ahead, aside, up), (yaw, pitch, roll)


SHAKEN = 0.24
"""[steps] Duration of the impact motion of the pelvis after a contact."""

SURGE = (0.99, 0.135)
"""Shape of the surge: sine and cosine of one wave a step; its amplitude is 1."""

RISE = (-0.475, -0.111, -0.056, -0.027)
"""Shape of the rise: cosine and sine of one and of two waves a step; its range is 1."""


def moved(person: Person, plan: Plan, entry: Int[Array, "time"], r: Motion[Float[Array, "time"]]) -> Motion[Frame]:
    """As `motion`, from `ticks`, with the segments along the first axis of each array (7, T).

    All depends on time by the share of a step: time enters as p + v s + a s²/2, differentiated at s = 0.
    """
    return differentiated(
        lambda s: segments(person, plan, entry, r.pose + s * (r.rate + 0.5 * s * r.acceleration)),
        jnp.zeros_like(r.pose),
    )


def motion(person: Person, plan: Plan, time: Float[AnyArray, "time"]) -> Motion[Segments[Frame]]:
    """The body at times (T,) [s], its rates and its accelerations: a `Motion` of `Segments`, exact."""
    return Motion(*map(separated, moved(person, plan, *ticks(plan, time))))
