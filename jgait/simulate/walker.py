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

from jgait.geometry.segments import Frame, Motion, Segments, differentiated
from jgait.geometry.trigonometry import sincos
from jgait.geometry.vectors import Vector, add, cross, dot, kept, scale, subtract
from jgait.simulate.feet import Foot, Foothold, moving_foot, standing_foot
from jgait.simulate.footsteps import FIRST, Plan, footholds, reach, standing_ahead
from jgait.simulate.person import Body, Gait, Person
from jgait.simulate.routes import Route
from jgait.simulate.smooth import CURVE, bump, curve_at, pieces, polynomial, slope
from jgait.types import AnyArray, Values


def clock(plan: Plan, time: Float[AnyArray, "*shape"]) -> tuple[Int[Array, "*shape"], Float[Array, "*shape"]]:
    """The entry of the last foothold (T,) int, and the share of the current step that has passed (T,) [1].

    The curve of time over the clock is inverted by Newton's method; two steps that are differentiated make the first
    three derivatives exact.
    """
    last = plan.end.astype(jnp.int32) - 1 + FIRST
    entry = jnp.searchsorted(plan.contact, time, side="right") - 1
    entry = jnp.clip(entry, FIRST, last)
    curve = [plan.time_curve[:, i][entry] for i in range(CURVE)]
    begin, end = plan.contact[entry], plan.contact[entry + 1]
    fixed = [lax.stop_gradient(c) for c in curve]
    held = lax.stop_gradient(jnp.clip(time, begin, end))
    r = (held - lax.stop_gradient(begin)) / lax.stop_gradient(end - begin)
    for _ in range(3):
        r = r - (polynomial(fixed, r) - held) / slope(fixed, r)
    now = jnp.clip(time, plan.contact[FIRST], plan.contact[last + 1])
    r = lax.stop_gradient(r)
    for _ in range(2):
        r = r - (polynomial(curve, r) - now) / slope(curve, r)
    return entry, kept(r)


def _hip_height(body: Body, hip: Vector, ankle: Vector, knee: Values) -> Values:
    """Height of the middle of the hips [m] over this leg; `hip`: x and y in the world, z relative to that middle."""
    ahead, aside = hip.x - ankle.x, hip.y - ankle.y
    r = reach(body, knee)
    return ankle.z - hip.z + jnp.sqrt(jnp.maximum(r * r - ahead * ahead - aside * aside, 1e-4))


def _axes(yaw: Values, pitch: Values, roll: Values) -> tuple[Vector, Vector, Vector]:
    """Forward, left and up axis of a segment turned by yaw, then pitched (forward end up), then rolled (left up)."""
    (sy, cy), (sp, cp), (sr, cr) = kept((sincos(yaw), sincos(pitch), sincos(roll)))
    x = Vector(cy * cp, sy * cp, sp)
    y = Vector(-sy * cr - cy * sp * sr, cy * cr - sy * sp * sr, cp * sr)
    return x, y, cross(x, y)


def _leg(body: Body, hip: Vector, ankle: Vector, yaw: Values) -> tuple[Frame, Frame]:
    """Thigh and shank between a hip and an ankle, the knee bent forward in the direction of a yaw."""
    a, b = body.thigh_length, body.shank_length
    line = subtract(hip, ankle)
    d2 = dot(line, line)
    d = jnp.sqrt(d2)
    up = scale(1.0 / d, line)
    s, c = sincos(yaw)
    left = cross(up, Vector(c, s, jnp.zeros_like(c)))
    up, left = kept((up, scale(1.0 / jnp.sqrt(dot(left, left)), left)))
    ahead = kept(cross(left, up))
    # Distance of the knee from the hip along the line from hip to ankle, and distance of the knee ahead of this line.
    along = (d2 + a * a - b * b) / (2.0 * d)
    out = jnp.sqrt(jnp.maximum(a * a - along * along, 1e-9))
    d, along, out = kept((d, along, out))
    thigh_up = add(scale(along / a, up), scale(-out / a, ahead))
    shank_up = add(scale((d - along) / b, up), scale(out / b, ahead))
    thigh_up, shank_up = kept((thigh_up, shank_up))
    knee = subtract(hip, scale(a, thigh_up))
    return (
        Frame(hip, cross(left, thigh_up), left, thigh_up),
        Frame(knee, cross(left, shank_up), left, shank_up),
    )


class Carried(NamedTuple):
    """Feet and pelvis, without the height of the pelvis.

    Attributes:
        new: the foot that landed last.
        old: the other foot.
        middle: middle of the hips; z is relative to the even path of the pelvis.
        axes: forward, left and up axis of the pelvis.
        to_new: vector from the middle of the hips to the hip of the foot that landed last.
        to_old: vector from the middle of the hips to the other hip.
        turn: yaw of the plane of the legs.
    """

    new: Foot
    old: Foot
    middle: Vector
    axes: tuple[Vector, Vector, Vector]
    to_new: Vector
    to_old: Vector
    turn: Values


def carried(person: Person, plan: Plan, entry: Int[Array, "..."], r: Values) -> Carried:
    """Feet and pelvis at the share r (T,) of a step after the contact of foothold `entry` (T,)."""
    body, gait = person.body, person.gait

    def foothold(ahead: int) -> Foothold:
        return kept(Foothold(*(getattr(plan, field)[entry + ahead] for field in Foothold._fields)))

    def curve(table: Float[AnyArray, "interval coefficient"]) -> Values:
        return kept(curve_at(table, entry, r))

    side = plan.side[entry]  # of the foot that landed last
    new = standing_foot(body, gait, foothold(0), r)
    old = moving_foot(body, gait, foothold(-1), foothold(1), 1.0 + r)
    walking, heading = curve(plan.walking_curve), curve(plan.heading_curve)
    (ahead, aside, up), (yaw, pitch, roll) = kept(_pelvis_oscillation(gait, side, walking, r))
    s, c = kept(sincos(heading))
    middle = Vector(curve(plan.x_curve) + c * ahead - s * aside, curve(plan.y_curve) + s * ahead + c * aside, up)
    middle, axes = kept((middle, _axes(heading + yaw, pitch, roll)))
    half = 0.5 * body.hip_width * side
    return Carried(new, old, middle, axes, scale(half, axes[1]), scale(-half, axes[1]), heading + 0.5 * yaw)


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
    body, gait = person.body, person.gait
    laid = footholds(key, person, along, capacity)
    entries = jnp.arange(FIRST, capacity + 3)

    def height(entry: Int[Array, "..."], r: Values) -> Values:
        now = carried(person, laid, entry, r)
        knee = jnp.asarray(gait.knee_stance)
        both = [
            _hip_height(body, add(now.middle, to_hip)._replace(z=to_hip.z), foot.ankle, knee) - now.middle.z
            for foot, to_hip in ((now.new, now.to_new), (now.old, now.to_old))
        ]
        return jnp.stack(both)

    phases = (jnp.arange(SAMPLES, dtype=laid.x.dtype) + 0.5) / SAMPLES
    at = jax.vmap(lambda entry: jax.vmap(lambda r: height(entry, r))(phases))(entries)
    least = -SHARP * jax.nn.logsumexp(-at.reshape(at.shape[0], -1) / SHARP, axis=1)
    k = jnp.arange(-1, capacity + 3, dtype=laid.x.dtype)
    walks = (k > 0.5) & (k < gait.steps + 1.5)
    # At the border of two steps the pelvis has the lower of the two heights.
    steps = jnp.concatenate([least[:1], least[:1], least, least[-1:]])
    walking = -SHARP * jnp.logaddexp(-steps[:-1] / SHARP, -steps[1:] / SHARP)
    high = jnp.where(walks, walking, laid.z + body.ankle_height + _standing_leg(person))
    curve = pieces(high, walks.astype(high.dtype), monotone=True)
    # Where the curve between two heights is higher than the legs allow, the pelvis dips.
    weight = _dip(phases)
    inner = weight > 0.05
    over = jax.vmap(lambda c: polynomial(list(c), phases))(curve[FIRST:]) - jnp.min(at, axis=2)
    needed = jnp.where(inner[None, :], over / jnp.where(inner, weight, 1.0)[None, :], -1.0)
    needed = jnp.concatenate([needed, jnp.zeros_like(needed[:, :1])], axis=1)
    dip = SHARP * jax.nn.logsumexp(needed / SHARP, axis=1)
    return laid._replace(z_curve=curve, dip=jnp.concatenate([jnp.zeros_like(dip[:1]), dip]))


def _standing_leg(person: Person) -> Values:
    """Height of the hips over the ankles in standing [m]."""
    body, gait = person
    ahead, aside = standing_ahead(person), 0.5 * (body.hip_width - gait.step_width)
    r = reach(body, gait.standing_knee)
    return jnp.sqrt(r * r - ahead * ahead - aside * aside)


SAMPLES, SHARP = 24, 0.0005
"""[1] Instants of a step at which the legs' reach is computed; [m] width of the soft minimum over these instants."""


def _dip(r: Values) -> Values:
    """From 0 to 1 in the middle of a step and back to 0, four times continuously differentiable at the ends."""
    return (4.0 * r * (1.0 - r)) ** 5


def _height(plan: Plan, entry: Int[Array, "..."], r: Values) -> Values:
    """The even path of the pelvis [m] within a step."""
    return curve_at(plan.z_curve, entry, r) - plan.dip[entry] * _dip(r)


def pose(person: Person, plan: Plan, time: Values) -> Segments[Frame]:
    """A `Frame` of each segment at times (T,) [s]; the origins of the feet are the ankles."""
    body = person.body
    entry, r = clock(plan, time)
    now = carried(person, plan, entry, r)
    middle = now.middle._replace(z=kept(_height(plan, entry, r) + now.middle.z))
    new_thigh, new_shank = _leg(body, add(middle, now.to_new), now.new.ankle, 0.5 * (now.turn + now.new.yaw))
    old_thigh, old_shank = _leg(body, add(middle, now.to_old), now.old.ankle, 0.5 * (now.turn + now.old.yaw))
    new_foot, old_foot = (Frame(f.ankle, *_axes(f.yaw, f.pitch, jnp.zeros_like(r))) for f in (now.new, now.old))
    left = plan.side[entry] > 0.0

    def pick(one: Frame, two: Frame) -> tuple[Frame, Frame]:
        """Right and left frame from the frames of the foot that landed last and of the other foot."""
        pairs = [(jnp.where(left, b, a), jnp.where(left, a, b)) for a, b in zip(_flat(one), _flat(two), strict=True)]
        return _frame([right for right, _ in pairs]), _frame([left for _, left in pairs])

    thighs, shanks, feet = pick(new_thigh, old_thigh), pick(new_shank, old_shank), pick(new_foot, old_foot)
    return Segments(Frame(middle, *now.axes), *thighs, *shanks, *feet)


def _flat(frame: Frame) -> list[Values]:
    return [component for vector in frame for component in vector]


def _frame(flat: list[Values]) -> Frame:
    return Frame(*(Vector(*flat[i : i + 3]) for i in range(0, 12, 3)))


def _pelvis_oscillation(
    gait: Gait, side: Values, walking: Values, r: Values
) -> tuple[tuple[Values, Values, Values], tuple[Values, Values, Values]]:
    """Displacement of the pelvis forward, left and up from its even path [m], and its yaw, pitch and roll [rad].

    Once a stride the pelvis sways to the stance leg, turns with the leading leg and drops on the side of the swing leg;
    twice a stride it rises and falls, moves forward and back relative to constant speed, and tilts forward and back.
    """
    s, c = sincos(jnp.pi * r)
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


class Slack(NamedTuple):
    """Distance of the legs from their limits, the least over a walk.

    Attributes:
        aside: largest horizontal distance between hip and ankle, over the length of the leg [1].
        stretched: least ratio of leg length to the distance from hip to ankle, minus 1 [1]; negative: leg too short.
    """

    aside: Values
    stretched: Values


def slack(person: Person, plan: Plan) -> Slack:
    """Distance of the legs from their limits, computed 32 times a step."""
    body = person.body
    entries = jnp.arange(FIRST, plan.x.shape[0] - 1)
    r = (jnp.arange(32, dtype=plan.x.dtype) + 0.5) / 32
    entry, r = (v.reshape(-1) for v in jnp.broadcast_arrays(entries[:, None], r[None, :]))
    now = carried(person, plan, entry, r)
    z = _height(plan, entry, r) + now.middle.z
    walks = entry < plan.end.astype(entry.dtype) + FIRST
    leg = body.thigh_length + body.shank_length
    aside, length = [], []
    for foot, to_hip in ((now.new, now.to_new), (now.old, now.to_old)):
        line = subtract(add(now.middle._replace(z=z), to_hip), foot.ankle)
        aside.append(jnp.sqrt(line.x * line.x + line.y * line.y))
        length.append(jnp.sqrt(dot(line, line)))
    far = jnp.max(jnp.where(walks, jnp.maximum(*aside), 0.0)) / leg
    long = jnp.max(jnp.where(walks, jnp.maximum(*length), 0.0)) / leg
    return Slack(far, 1.0 / long - 1.0)


def motion(person: Person, plan: Plan, time: Float[AnyArray, "time"]) -> Motion[Segments[Frame]]:
    """The body at times (T,) [s], its rates and its accelerations: a `Motion` of `Segments`, exact."""
    return differentiated(lambda t: pose(person, plan, t), time)
