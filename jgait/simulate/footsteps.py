"""The plan of a walk: place and time of each foothold, and the path of the pelvis.

Footholds are counted k = −1, 0, 1 … in order of time. On footholds −1 and 0 the feet stand at the start; at the contact
of foothold k the clock of the walk shows k, and the foot comes from foothold k − 2. The last step is a closing step.
For a given number of steps the plan is differentiable in body, gait and route.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float, PRNGKeyArray, PyTree

from jgait.notes import record
from jgait.simulate import routes
from jgait.simulate.feet import LINGER
from jgait.simulate.person import Body, Gait, Person
from jgait.simulate.routes import Route
from jgait.simulate.shapes import Instants, Movement, shape_of
from jgait.simulate.smooth import CURVE, pieces
from jgait.types import Flags, Values

FIRST = 1
"""Foothold k is entry k + FIRST of every array."""


@record
class Plan(NamedTuple):
    """Footholds (K,) and, between one contact and the next, the curves of time and of the pelvis (K − 1, CURVE)."""

    x: Values  #: x of the point under the ankle [m].
    y: Values  #: y of the point under the ankle [m].
    z: Values  #: height of the ground at that point [m].
    foot_yaw: Values  #: yaw of the foot [rad].
    slope: Values  #: pitch of the ground along the foot [rad].
    side: Values  #: 1 for a foothold of the left foot, −1 for one of the right.
    toe_up: Values  #: pitch of the foot at landing [rad].
    #: 1 where the heel is down before the landing, 0 where it comes down with the landing, on a flat foot.
    early: Values
    heel_up: Values  #: pitch of the foot at toe-off, heel up [rad].
    off: Values  #: steps after landing at which the heel begins to rise [1].
    leave: Values  #: steps after landing at which the toes begin to leave [1]; they are off `feet.LINGER` later.
    lift: Values  #: lift of the foot in the swing to the next but one foothold [m].
    out: Values  #: motion of the foot to the left in that swing [m].
    stood: Values  #: 1 for the footholds on which the feet stand at the start, else 0.
    contact: Values  #: time of landing [s].
    time_curve: Values  #: time [s] over the clock.
    x_curve: Values  #: x of the pelvis [m].
    y_curve: Values  #: y of the pelvis [m].
    z_curve: Values  #: height of the pelvis, without its rise and fall within a step [m].
    dip: Values  #: additional fall of the pelvis within a step, where the legs are too short [m].
    heading_curve: Values  #: heading of the pelvis [rad].
    distance_curve: Values  #: distance along the route, walked by the hips [m].
    walking_curve: Values  #: 1 while walking, 0 while standing.
    end: Values  #: the clock at the end of the walk [1].
    shape: Movement  #: shapes of the movement.


def reach(body: Body, knee: Values) -> Values:
    """Hip to ankle [m] at a knee flexion [rad]: r² = a² + b² + 2 a b cos(knee)."""
    a, b = body.thigh_length, body.shank_length
    return jnp.sqrt(a * a + b * b + 2.0 * a * b * jnp.cos(knee))


def _lengths(
    key: PRNGKeyArray, gait: Gait, along: Route, k: Float[Array, "foothold"], side: Float[Array, "foothold"]
) -> tuple[Float[Array, "foothold"], Float[Array, "foothold"], Float[Array, "foothold"], Float[Array, "foothold"]]:
    """Of each foothold: distance along the route (K,), step time (K,), sideways error (K,), and speed (K,)."""
    walks = (k > 0.5) & (k < gait.steps + 0.5)
    draws = jnp.clip(jax.random.normal(key, (k.shape[0], 3), k.dtype), -2.5, 2.5)
    keeps = jnp.asarray(gait.persistence, k.dtype)

    def onward(now: tuple[Values, Values], step: tuple[Values, Values, Flags]) -> PyTree:
        (distance, usual), (draw, side, moves) = now, step
        usual = keeps * usual + jnp.sqrt(1.0 - keeps * keeps) * draw  # of length and time
        share = 1.0 - gait.length_asymmetry * side + gait.length_variability * usual[0]
        speed = routes.value_at(along, along.speed, distance[None])[0]
        distance = distance + jnp.where(moves, 0.5 * gait.stride_length * share * jnp.sqrt(speed), 0.0)
        return (distance, usual), (distance, speed, usual[1])

    start = jnp.zeros_like(k[0]), draws[-1, :2]
    _, (distance, speed, late) = lax.scan(onward, start, (draws[:, :2], side, walks))
    times = 0.5 * gait.stride_time * (1.0 - gait.time_asymmetry * side + gait.time_variability * late)
    times = times / jnp.sqrt(speed)
    # the first and the last step last longer
    times = jnp.where(jnp.abs(k - 1.0) < 0.5, 1.5 * times, jnp.where(k > gait.steps + 0.5, 1.2 * times, times))
    return distance, times, jnp.where(walks, gait.width_variability * draws[:, 2], 0.0), speed


def footholds(key: PRNGKeyArray, person: Person, along: Route, capacity: int) -> Plan:
    """Plan a walk without the height of the pelvis (`z_curve` and `dip` are 0); as `walker.plan`."""
    gait = person.gait
    k = jnp.arange(-1, capacity + 3, dtype=jnp.result_type(*jax.tree.leaves(person)))
    n = jnp.asarray(gait.steps, k.dtype)
    left = (jnp.mod(k, 2.0) > 0.5) != (jnp.asarray(gait.right_first) > 0.5)
    side = jnp.where(left, 1.0, -1.0).astype(k.dtype)
    along = jax.tree.map(lambda value: jnp.asarray(value, k.dtype), along)
    distance, times, aside, speed = _lengths(key, gait, along, k, side)
    place = routes.at(along, distance)
    offset = side * (0.5 * gait.step_width) + aside
    x, y = place.x - jnp.sin(place.heading) * offset, place.y + jnp.cos(place.heading) * offset
    takes = (k > 0.5) & (k < n + 0.5)
    riser = routes.value_at(along, along.riser, distance)
    ground = place.z + jnp.cumsum(jnp.where(takes, riser, 0.0))
    whole_foot = 1.0 / (1.0 + (riser / 0.05) ** 2)  # on stairs the foot lands flat
    ahead = 1.0 - routes.value_at(along, along.on_spot, distance)  # and where nobody gets ahead
    whole_foot, rolls = whole_foot * ahead, 0.3 + 0.7 * ahead
    draws = jnp.clip(jax.random.normal(jax.random.fold_in(key, 1), (2, k.shape[0]), k.dtype), -2.5, 2.5)
    lands, leaves = 1.0 + gait.pitch_variability * draws
    # At the start both feet stand: the first heel rises when the walk's clock starts, and less than in other steps.
    starts = k < -0.5
    contact = gait.quiet_before + jnp.cumsum(jnp.where(k > 0.5, times, 0.0))
    contact = jnp.where(starts, gait.quiet_before - 0.5 * gait.stride_time, contact)
    paths, moving = _pelvis(person, k, (x, y, place.heading, place.walked), jnp.sqrt(speed) * ahead)
    knots = jnp.stack([contact, takes.astype(k.dtype), *paths])
    moving = jnp.stack([jnp.ones_like(k), jnp.zeros_like(k), *[moving] * len(paths)])
    time_curve, walking_curve, x_curve, y_curve, heading_curve, distance_curve = pieces(knots, moving)
    stiff = jnp.maximum(-side * gait.stiff, 0.0)
    lasting = k < n - 0.5  # footholds from which the foot swings on
    flatter = jnp.where(starts, 0.6, 1.0) * (0.5 + 0.5 * whole_foot) * (1.0 - 0.6 * stiff)
    # who turns on the spot lifts the feet by 2 cm more
    lift = gait.swing_lift * (1.0 - 0.5 * stiff) + jnp.maximum(riser, 0.0) + 0.02 * (1.0 - ahead)
    return Plan(
        x=x,
        y=y,
        z=jnp.where(k > n + 0.5, jnp.roll(ground, 1), ground),
        foot_yaw=place.heading + side * gait.toe_out,
        slope=jnp.arctan(routes.value_at(along, along.slope, distance)),
        side=side,
        toe_up=jnp.where(takes, gait.toe_up * lands * whole_foot * jnp.sqrt(speed) * (1.0 - stiff), 0.0),
        early=jnp.where(takes, whole_foot, 0.0),
        heel_up=jnp.where(lasting, gait.heel_up * leaves * rolls * flatter, 0.0),
        off=jnp.where(starts, 1.0, 2.0 * gait.heel_off),
        leave=jnp.where(starts | (k > n + 0.5), 1.0 + Instants().heel_rises, 2.0 * gait.stance_fraction - LINGER),
        lift=jnp.where(lasting, lift, 0.0),
        out=jnp.where(lasting, side * 0.07 * stiff, 0.0),
        stood=(k < 0.5).astype(k.dtype),
        contact=contact,
        time_curve=time_curve,
        x_curve=x_curve,
        y_curve=y_curve,
        z_curve=jnp.zeros((capacity + 3, CURVE), k.dtype),
        dip=jnp.zeros((capacity + 3,), k.dtype),
        heading_curve=heading_curve,
        distance_curve=distance_curve,
        walking_curve=walking_curve,
        end=n + 2.0,
        shape=shape_of(person),
    )


def _pelvis(
    person: Person, k: Float[Array, "foothold"], feet: tuple[Float[Array, "foothold"], ...],
    pace: Float[Array, "foothold"],
) -> tuple[tuple[Float[Array, "foothold"], ...], Float[Array, "foothold"]]:  # fmt: skip
    """Path of the pelvis (x, y, heading, distance) at each contact, a little ahead of both feet; 1 where it moves."""
    gait = person.gait
    x, y, heading, distance = (0.5 * (values + jnp.concatenate([values[:1], values[:-1]])) for values in feet)
    standing, walking = standing_ahead(person), gait.hip_ahead * pace
    ahead = jnp.where((k > 0.5) & (k < gait.steps + 0.5), walking, standing)
    ahead = jnp.where(jnp.abs(k - gait.steps - 1.0) < 0.5, 0.5 * (walking + standing), ahead)
    passing = ((k > 0.5) & (k < gait.steps + 1.5)).astype(k.dtype)
    path = (x + ahead * jnp.cos(heading), y + ahead * jnp.sin(heading), heading, distance + ahead - standing)
    return path, passing


def standing_ahead(person: Person) -> Values:
    """Distance of the hips ahead of the ankles in standing [m]."""
    b, g = person.body, person.gait
    return -(b.thigh_length * jnp.sin(g.standing_hip) + b.shank_length * jnp.sin(g.standing_hip - g.standing_knee))
