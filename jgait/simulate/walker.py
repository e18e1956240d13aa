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

from jgait.geometry.jets import Jet, outer, part, parts, reciprocal, root, sin_cos, stacked, summed, turned, turned_axes
from jgait.geometry.segments import Frame, Motion, Segments
from jgait.geometry.vectors import Vector, kept
from jgait.simulate.feet import Foothold, FootPair, feet
from jgait.simulate.footsteps import FIRST, Plan, footholds, reach, standing_ahead
from jgait.simulate.person import DEGREE, Body, Person
from jgait.simulate.routes import Route
from jgait.simulate.shapes import SENSED, Movement, oscillation, softness, swings, waves, worn
from jgait.simulate.smooth import coefficients, pieces, polynomial, smooth_bump, smooth_curve
from jgait.types import AnyArray, Values

type Frames = Float[Array, "row component segment time"]
"""Frames of segments, or their derivatives: origin and axes, by components and segments; see `with_skin`."""


def ticks(plan: Plan, time: Float[AnyArray, "*shape"]) -> tuple[Int[Array, "*shape"], Motion[Float[Array, "*shape"]]]:
    """The entry of the last foothold (T,), and the share of its step that has passed (T,) [1], as a `Motion` in time.

    The curve of time over the clock is inverted by Newton's method; two steps that are differentiated make the first
    three derivatives exact.
    """
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


def _legs(body: Body, hip: Jet, ankle: Jet, yaw: Jet) -> tuple[Jet, Jet]:
    """Frames (4, 3, 2, T) of thighs and shanks.

    Between hips and ankles (3, 2, T), the knees are bent forward in the direction of a yaw (2, T).
    """
    a, b = body.thigh_length, body.shank_length
    line = kept(hip - ankle)
    d2 = kept(summed(line * line))
    d = root(d2, 1e-12)
    over = reciprocal(d)
    up = kept(line * part(over, None))
    # Left is across the leg and the yaw's direction; ahead is this direction less its part along the leg.
    s, c = sin_cos(yaw)
    (xc, xs), (yc, ys), (zc, zs) = map(parts, parts(kept(outer(up, stacked([c, s])))))
    leaning = xc + ys
    axes = stacked([stacked([c, s, c * 0.0]) - part(leaning, None) * up, stacked([-zs, zc, xs - yc])])
    narrow = reciprocal(root(-(leaning * leaning) + 1.0, 1e-12))
    ahead, left = parts(kept(axes * part(narrow, None, None)))
    # Distance of the knee from the hip along the line from hip to ankle, and distance of the knee ahead of this line.
    along = kept((d2 + (a * a - b * b)) * over * 0.5)
    out = root(-(along * along) + a * a, 1e-9)
    # Thigh and shank lean ahead of the line by angles with these cosines and sines.
    leans = part(stacked([along / a, -out / a, (d - along) / b, out / b]), slice(None), None)
    thigh_cosine, thigh_sine, shank_cosine, shank_sine = map(parts, parts(kept(outer(leans, stacked([ahead, up])))))

    def frame(origin: Jet, cosine: list[Jet], sine: list[Jet]) -> Jet:
        return stacked([origin, cosine[0] - sine[1], left, cosine[1] + sine[0]])

    thigh = frame(hip, thigh_cosine, thigh_sine)
    return thigh, frame(hip - part(thigh, 3) * a, shank_cosine, shank_sine)


class Carried(NamedTuple):
    """Feet, pelvis and hips."""

    feet: FootPair  #: both feet.
    pelvis: Jet  #: (4, 3, T) frame of the pelvis, from the middle of the hips.
    hips: Jet  #: (3, 2, T) both hips, right and left.
    turn: Jet  #: (T,) yaw of the plane of the legs.
    soft: Jet  #: (6, 6, T) motion of sensors on thighs, shanks and feet, see `shapes.softness`.


PLACE = ("x", "y", "z", "foot_yaw", "slope")
"""Fields of a plan that are a foothold's place."""


def carried(person: Person, plan: Plan, entry: Int[Array, "..."], r: Jet) -> Carried:
    """Feet and pelvis at the share r (T,) of a step after the contact of foothold `entry` (T,)."""
    body, gait, dtype = person.body, person.gait, plan.x.dtype
    sides = jnp.asarray((-1.0, 1.0), dtype).reshape((2,) + (1,) * entry.ndim)
    side = plan.side[entry]  # of the foot that landed last
    moves = sides * side[None] < 0.0
    before = moves.astype(entry.dtype)
    table = jnp.stack([getattr(plan, field) for field in (*PLACE, *Foothold._fields[1:])])
    last = entry[None] - before  # the foothold that each foot took last
    ends = (kept(table[:, at]) for at in (last, jnp.minimum(last + 2, table.shape[1] - 1)))
    origin, target = (Foothold(end[: len(PLACE)], *end[len(PLACE) :]) for end in ends)
    both = feet(body, gait, plan.shape, origin, target, moves, part(r, None) + before.astype(dtype))
    swing = swings(plan.shape, waves(r))
    curves = jnp.stack([plan.x_curve, plan.y_curve, plan.z_curve, plan.heading_curve, plan.walking_curve])
    x, y, z, heading, walking = parts(smooth_curve(curves, entry, r))
    shock = smooth_bump(r / 0.24) * gait.pelvis_shock  # for a quarter of a step after a contact
    ahead, aside, up, yaw, pitch, roll = parts(kept(part(walking, None) * oscillation(swing, side, shock)))
    soft = kept(part(walking, None, None) * softness(swing, moves, both.free))
    s, c = sin_cos(heading)
    height = z - _dip(r) * plan.dip[entry] + up
    sways = turned(stacked([c, s]), stacked([part(ahead, None), part(aside, None)]), part(height, None))
    place = sways + part(stacked([x, y, x * 0.0]), None)
    axes = turned_axes(heading + yaw, pitch, roll)
    pelvis = kept(Jet(jnp.concatenate([place.orders, axes.orders], axis=1)))
    apart = 0.5 * body.hip_width * sides
    hips = kept(part(pelvis, 0, slice(None), None) + part(pelvis, 2, slice(None), None) * apart[None])
    return Carried(both, pelvis, hips, heading + yaw * 0.5, soft)


class Slack(NamedTuple):
    """Distance of the legs from their limits, the least over a walk."""

    aside: Values  #: largest horizontal distance between hip and ankle, over the length of the leg [1].
    #: least ratio of leg length to the distance from hip to ankle, minus 1 [1]; negative: leg too short.
    stretched: Values


def plan(key: PRNGKeyArray, person: Person, along: Route, capacity: int) -> Plan:
    """Plan a walk, K = capacity + 4: footholds and pelvis.

    The pelvis is as high as both legs allow at every instant, with their knees bent by at least `knee_stance`. `key` is
    that of the variability from step to step; a person takes at most `capacity` steps.
    """
    return planned(key, person, along, capacity)[0]


def planned(
    key: PRNGKeyArray, person: Person, along: Route, capacity: int, shape: Movement | None = None
) -> tuple[Plan, Slack]:
    """As `plan`, and the distance of the legs from their limits; `shape` stands in for that of the gait."""
    body, gait = person.body, person.gait
    laid = footholds(key, person, along, capacity)
    laid = laid if shape is None else laid._replace(shape=shape)
    entries, dtype = jnp.arange(FIRST, capacity + 3), laid.x.dtype
    inside, checked = ((jnp.arange(n, dtype=dtype) + 0.5) / n for n in (SAMPLES, 32))
    # The legs of recorded people are longest at a landing, those by the rules are not.
    borders = jnp.asarray((0.0, 1.0), dtype)
    r = jnp.concatenate([inside, borders, checked])
    at_entry, at_share = jnp.broadcast_arrays(entries[:, None], r[None, :])
    now = carried(person, laid, at_entry, Jet(at_share[None]))
    line = now.hips.value - now.feet.frame.value[0]  # (3, 2, K, phase)
    level = line[0] * line[0] + line[1] * line[1]
    k = jnp.arange(-1, capacity + 3, dtype=dtype)
    walks = (k > 0.5) & (k < gait.steps + 1.5)
    # Between standing and walking, knees may be as straight as in usual walking.
    bent = jnp.where((walks[:-1] & walks[1:])[FIRST:], gait.knee_stance, jnp.minimum(gait.knee_stance, 10.0 * DEGREE))
    knee = reach(body, bent)[None, :, None]
    # How much higher a leg of full length lets the hips be.
    at = (jnp.sqrt(jnp.maximum(knee * knee - level, 1e-4)) - line[2])[..., : SAMPLES + 2]
    at = at + jnp.where(jnp.arange(SAMPLES + 2) < SAMPLES, 0.0, 1.0 - gait.recorded)[None, None]
    # Heights count from the ground, which rises evenly from step to step on stairs.
    ground = 0.5 * (laid.z + jnp.concatenate([laid.z[:1], laid.z[:-1]]))
    below = ground[FIRST:-1, None] + r[None, : SAMPLES + 2] * (ground[FIRST + 1 :] - ground[FIRST:-1])[:, None]
    least = -SHARP * jax.nn.logsumexp((below[None] - at) / SHARP, axis=(0, 2))
    # At the border of two steps the pelvis has the lower of the two heights.
    steps = jnp.concatenate([least[:1], least[:1], least, least[-1:]])
    walking = -SHARP * jnp.logaddexp(-steps[:-1] / SHARP, -steps[1:] / SHARP)
    ahead, aside = standing_ahead(person), 0.5 * (body.hip_width - gait.step_width)
    upright = reach(body, gait.standing_knee)
    upright = jnp.sqrt(upright * upright - ahead * ahead - aside * aside)
    high = jnp.where(walks, ground + walking, laid.z + body.ankle_height + upright)
    moving = walks.astype(high.dtype)
    # Where the curve between two heights is higher than the legs allow, the pelvis dips.
    weight = _dip(Jet(r[None])).value
    weight, whole = weight[: SAMPLES + 2], weight
    deep, early = weight > 0.05, r[: SAMPLES + 2] < 0.5
    lowest = jnp.min(at, axis=0)

    def path_of(curve: Values) -> Values:
        return polynomial(jnp.moveaxis(curve[FIRST:, None], -1, 0), r[None, :])[0]

    # It hardly dips near the border of two steps: where the ground rises or falls, the height there is less instead.
    near = jnp.where(deep[None, :], 0.0, path_of(pieces(high, moving, monotone=True))[:, : SAMPLES + 2] - lowest)
    climbs = ground[FIRST + 1 :] != ground[FIRST:-1]
    near = jnp.where(climbs[:, None], jnp.maximum(near, 0.0), 0.0)
    begins, ends = (jnp.max(jnp.where(part[None, :], near, 0.0), axis=1) for part in (early, ~early))
    lower = jnp.maximum(jnp.pad(begins, (FIRST, 1)), jnp.pad(ends, (FIRST + 1, 0)))
    # more than they are too high, for curves around them rise as well
    curve = pieces(high - jnp.where(walks, 1.5 * lower, 0.0), moving, monotone=True)
    path = path_of(curve)
    over = path[:, : SAMPLES + 2] - lowest
    needed = jnp.where(deep[None, :], over / jnp.where(deep, weight, 1.0)[None, :], -1.0)
    needed = jnp.concatenate([needed, jnp.zeros_like(needed[:, :1])], axis=1)
    dip = SHARP * jax.nn.logsumexp(needed / SHARP, axis=1)
    height = line[2] + (path - dip[:, None] * whole[None, :])[None]
    taken = (entries < laid.end.astype(entries.dtype) + FIRST)[None, :, None]
    leg = body.thigh_length + body.shank_length
    far, long = (
        jnp.sqrt(jnp.max(jnp.where(taken, square[..., SAMPLES + 2 :], 0.0))) / leg
        for square in (level, level + height * height)
    )
    laid = laid._replace(z_curve=curve, dip=jnp.concatenate([jnp.zeros_like(dip[:1]), dip]))
    return laid, Slack(far, 1.0 / long - 1.0)


SAMPLES, SHARP = 24, 0.0005
"""[1] Instants of a step at which the legs' reach is computed; [m] width of the soft minimum over these instants; both
chosen by hand."""


def _dip(r: Jet) -> Jet:
    """From 0 to 1 in the middle of a step and back to 0, four times continuously differentiable at the ends."""
    return smooth_bump(r, 5)


def with_skin(person: Person, plan: Plan, entry: Int[Array, "*shape"], r: Jet) -> Jet:
    """The frames of all segments at the share r of a step after the contact of foothold `entry`: (4, 3, 13, *shape).

    The first axis is the origin and the axes of a `Frame`, the second their components, the third the segments in the
    order of `Segments`, and after them what sensors are worn on at thighs, shanks and feet, right before left (`SKIN`).
    """

    def together(frames: list[Jet]) -> Jet:
        return Jet(jnp.concatenate([frame.orders for frame in frames], axis=3))

    now, body = carried(person, plan, entry, r), person.body
    foot = now.feet.frame
    thigh, shank = _legs(body, now.hips, part(foot, 0), (part(now.turn, None) + now.feet.yaw) * 0.5)
    bones = [part(now.pelvis, slice(None), slice(None), None), thigh, shank, foot]
    down = (SENSED[0] * body.thigh_length, SENSED[1] * body.shank_length, 0.0)
    about = jnp.repeat(jnp.stack([jnp.asarray(length, plan.x.dtype) for length in down]), 2)
    return together([*bones, worn(together(bones[1:]), now.soft, about.reshape((1, 6) + (1,) * entry.ndim))])


SKIN = {name: len(Segments._fields) + i for i, name in enumerate(Segments._fields[1:])}
"""Segment → index of what its sensors are worn on, in the frames of `with_skin`."""


def framed(frames: Values) -> Frame:
    """The `Frame` of arrays (4, 3, …) as `with_skin` has them; on the host or in JAX."""
    return Frame(*(Vector(*row) for row in frames))


def separated(frames: Values) -> Segments[Frame]:
    """A `Frame` of each segment from frames (4, 3, 7 or more, T)."""
    return Segments(*(framed(frames[:, :, i]) for i in range(len(Segments._fields))))


def moved(person: Person, plan: Plan, entry: Int[Array, "time"], r: Motion[Float[Array, "time"]]) -> Motion[Frames]:
    """The body, its rates and its accelerations, exact, from `ticks`, as arrays (4, 3, 13, T); see `with_skin`."""
    return Motion(*with_skin(person, plan, entry, Jet(jnp.stack(r))).orders)
