"""The route of a walk: straight and curved pieces, with their slope and speed."""

import math
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jgait.estimators.programs import bucket
from jgait.notes import record
from jgait.types import AnyArray, Values, check_kind, check_number


@record
class Route(NamedTuple):
    """The line of the walk, midway between the feet, piece after piece, from the origin along x."""

    length: Values  #: (n,) length of each piece [m].
    turn: Values  #: (n,) change of the heading along the piece, counter-clockwise [rad].
    slope: Values  #: (n,) metres up for each metre forward [1].
    speed: Values  #: (n,) walking speed on the piece, over the speed of the gait [1].
    riser: Values  #: (n,) height of a stair, climbed (or, if negative, descended) at every step [m].
    #: (n,) 1 where the person turns on the spot: the length of the piece is then that of the usual steps which the turn
    #: takes, and nobody gets ahead; else 0 [1].
    on_spot: Values


def route(*pieces: dict[str, float]) -> Route:
    """A route from pieces: dictionaries with `length` [m] and the other fields; defaults are 0, for `speed` 1.

    Raises:
        ValueError: if there is no piece, a length is not positive, a speed is not positive, or a name is not known.
    """
    if not pieces:
        raise ValueError("a route needs at least one piece, for example {'length': 10.0}")
    rest = {"turn": 0.0, "slope": 0.0, "speed": 1.0, "riser": 0.0, "on_spot": 0.0}
    for piece in pieces:
        check_kind(piece, dict, "a piece of a route must be a dictionary, such as {'length': 10.0}")
        unknown = set(piece) - set(Route._fields)
        if unknown or "length" not in piece:
            raise ValueError(f"a piece of a route has a length and {', '.join(rest)}; got {piece}")
        for name in ("length", "speed"):
            check_number(piece.get(name, 1.0), f"{name} of a piece of a route must be a number")
            if not (math.isfinite(piece.get(name, 1.0)) and piece.get(name, 1.0) > 0.0):
                raise ValueError(f"{name} of a piece of a route must be positive; got {piece[name]!r}")
    filled = [{**rest, **piece} for piece in pieces]
    return Route(*(np.array([piece[name] for piece in filled]) for name in Route._fields))


def straight(length: float, speed: float = 1.0) -> Route:
    """Straight ahead, `length` [m]."""
    return route({"length": length, "speed": speed})


def corner(before: float, turn: float, after: float, radius: float = 0.8) -> Route:
    """A straight piece, a bend by `turn` [rad] (left positive) with a radius [m], a straight piece."""
    return route({"length": before}, {"length": abs(turn) * radius, "turn": turn}, {"length": after})


def u_turn(length: float, radius: float = 0.4) -> Route:
    """A straight piece, half a circle to the left, a straight piece back; `length` [m] each way."""
    return corner(length, math.pi, length, radius)


def about_turn(length: float, turn: float = math.pi, steps: float = 2.6) -> Route:
    """A straight piece, a turn on the spot [rad] (left positive), a straight piece; `length` [m] of each.

    The turn takes the time of `steps` metres of usual steps.
    """
    return route({"length": length}, {"length": steps, "turn": turn, "on_spot": 1.0}, {"length": length})


def rectangle(a: float, b: float, laps: int = 1, radius: float = 0.8) -> Route:
    """Laps round a rectangle with sides a and b [m], counter-clockwise, its corners rounded."""
    if min(a, b) <= 2.0 * radius:
        raise ValueError(f"sides must be longer than two radii of {radius:g} m; got {a:g} and {b:g} m")
    bend = {"length": 0.5 * math.pi * radius, "turn": 0.5 * math.pi}
    sides = ({"length": a - 2.0 * radius}, bend, {"length": b - 2.0 * radius}, bend)
    return route(*(piece for _ in range(2 * laps) for piece in sides))


def circle(radius: float, laps: float = 1.0) -> Route:
    """Laps round a circle with a radius [m], counter-clockwise."""
    return route({"length": 2.0 * math.pi * radius * laps, "turn": 2.0 * math.pi * laps})


def faster(length: float, *speeds: float) -> Route:
    """Straight ahead, `length` [m] at each of the speeds (1: the speed of the gait)."""
    return route(*({"length": length, "speed": speed} for speed in speeds))


def total_length(along: Route) -> Values:
    """Length of the whole route, with the steps of turns on the spot [m]."""
    return jnp.sum(along.length)


def walked_length(along: Route) -> Values:
    """Length of the whole route without turns on the spot [m]."""
    return jnp.sum(along.length * (1.0 - along.on_spot))


def padded(along: Route) -> Route:
    """The same route with more pieces, of length 0, so that walks on other routes use the same programs."""
    pieces = [np.asarray(values, float) for values in along]
    more = bucket(len(pieces[0]), 16) - len(pieces[0])
    edges = {"length": 0.0, "turn": 0.0, "on_spot": 0.0}
    return Route(*(
        np.concatenate([values, np.full(more, edges.get(name, values[-1]))])
        for name, values in zip(Route._fields, pieces, strict=True)
    ))  # fmt: skip


class Place(NamedTuple):
    """A point on the route: position [m], heading there [rad], and the way to it without turns on the spot [m]."""

    x: Values
    y: Values
    z: Values
    heading: Values
    walked: Values


def at(along: Route, distance: Float[AnyArray, "*shape"]) -> Place:
    """The point a distance (K,) [m] from the start; before it and after the end the route goes straight on.

    On an arc of length L that turns by θ:  chord = L sinc(θ/2), in the direction of the arc's middle.
    """
    length, turn, slope = (jnp.asarray(values)[None, :] for values in (along.length, along.turn, along.slope))
    ends = jnp.cumsum(jnp.asarray(along.length))
    total = ends[-1]
    covered = jnp.clip(distance[:, None] - (ends[None, :] - length), 0.0, length)
    bend = turn * covered / jnp.where(length > 0.0, length, 1.0)
    headings = jnp.cumsum(bend, axis=1)
    middle = headings - 0.5 * bend
    ahead = covered * (1.0 - jnp.asarray(along.on_spot)[None, :])
    chord = ahead * jnp.sinc(0.5 * bend / jnp.pi)
    outside = jnp.minimum(distance, 0.0) + jnp.maximum(distance - total, 0.0)
    heading = headings[:, -1]
    x = jnp.sum(chord * jnp.cos(middle), axis=1) + outside * jnp.cos(heading)
    y = jnp.sum(chord * jnp.sin(middle), axis=1) + outside * jnp.sin(heading)
    return Place(x, y, jnp.sum(ahead * slope, axis=1), heading, jnp.sum(ahead, axis=1) + outside)


def value_at(
    along: Route, field: Float[AnyArray, "piece"], distance: Float[AnyArray, "*shape"]
) -> Float[Array, "*shape"]:
    """A field of the route at distances (K,) [m]; at each border of pieces it changes over half a metre."""
    values = jnp.asarray(field)
    borders, jumps = jnp.cumsum(jnp.asarray(along.length))[None, :-1], jnp.diff(values)[None, :]
    share = jnp.clip((distance[:, None] - borders) / 0.5 + 0.5, 0.0, 1.0)
    return values[0] + jnp.sum(jumps * share * share * (3.0 - 2.0 * share), axis=1)
