"""Shapes of the movement over a stride, fitted to recorded people: pelvis, feet, and what sensors are worn on.

The pelvis is a Fourier series over the stride, from sensors on lower backs and legs. The feet follow the phases of
`feet`, which keep them at rest on the ground, and smooth functions in addition, from sensors on legs. Joint angles
follow from feet and pelvis. All shapes are linear in the length and the rate of the stride and in the person's style.
`movement.json` holds the numbers and names its source; `experiments.people.shapes` derives them from recordings.
"""

import json
from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import lax

from jgait.geometry.jets import Jet, chained, part, parts, sin_cos, stacked
from jgait.geometry.vectors import kept
from jgait.simulate.person import RECORDED, Body, Gait, Person
from jgait.simulate.smooth import polynomial, smooth_bump
from jgait.types import Flags, Values

TABLES = json.loads(Path(__file__).with_name("movement.json").read_text(encoding="utf-8"))
PELVIS, FEET, SKIN = (np.asarray(TABLES[name]) for name in ("pelvis", "feet", "skin"))
"""Tables of `Movement` at the usual stride, their slopes over length and rate of the stride, and those of each style:
(1 + 2 + styles, rows, columns)."""

HARMONICS = PELVIS.shape[-1] // 2
"""[1] Number of harmonics of each motion of the pelvis."""

STYLES = tuple(name for name in Gait._fields if name.startswith("style_"))
"""Parameters of the gait that are coordinates of the person's style."""

SIZES = ("pelvis_surge", "pelvis_rise", "pelvis_nod", "pelvis_sway", "pelvis_rotation", "pelvis_drop")
"""Parameters of the gait that scale the rows of the table of the pelvis."""

USUAL_STRIDE = RECORDED.stride_length / (Body().thigh_length + Body().shank_length)
"""[1] Usual length of the stride over that of the leg."""

UNIT, MOST = 0.12, 3.0
"""[1] Relative change of a stride's length or rate that counts as one in the tables, and largest count."""


class Movement(NamedTuple):
    """Shapes of a person's movement, see `shape_of`."""

    #: (6, 2 HARMONICS) cosines, then sines, of the motion of the pelvis forward, up [m] and of its pitch [rad] at the
    #: even harmonics of the stride, and of its motion left [m], its yaw and roll [rad] at the odd ones.
    pelvis: Values
    feet: Values  #: (4, terms) what is added to the phases of a foot, see `added`.
    #: (6, 4 HARMONICS) cosines, then sines, of the pitch [rad] and the motion forward and up [m] of what sensors are
    #: worn on, over the bone of the thigh and of the shank, in the stride of their leg.
    skin: Values


def pace(person: Person) -> tuple[Values, Values]:
    """Length and rate of a person's stride beside the usual ones, in `UNIT`."""
    body, gait = person
    long = gait.stride_length / (body.thigh_length + body.shank_length) / USUAL_STRIDE
    quick = RECORDED.stride_time / gait.stride_time
    long, quick = (jnp.clip((jnp.asarray(share) - 1.0) / UNIT, -MOST, MOST) for share in (long, quick))
    return long, quick


def sizes(person: Person) -> Values:
    """(6, 1) size of each row of the table of the pelvis, over the usual one."""
    gait = person.gait
    return jnp.stack([jnp.asarray(getattr(gait, name) / getattr(RECORDED, name)) for name in SIZES])[:, None]


SURGE = (0.99, 0.135)
"""Shape of the surge by the rules: sine and cosine of one wave a step; its amplitude is 1."""

RISE = (-0.475, -0.111, -0.056, -0.027)
"""Shape of the rise by the rules: cosine and sine of one and of two waves a step; its range is 1."""


def ruled(gait: Gait) -> Values:
    """The table of the pelvis by the rules (6, 2 HARMONICS).

    Once a stride the pelvis sways to the stance leg, turns with the leading leg and drops on the side of the swing leg;
    twice a stride it rises and falls, moves forward and back relative to constant speed, and tilts forward and back.
    """
    amplitudes = (gait.pelvis_surge, gait.pelvis_rise, gait.pelvis_nod, gait.pelvis_sway, gait.pelvis_rotation)
    cosines = ((SURGE[1],), (RISE[0], RISE[2]), (1.0,), (0.0,), (-1.0,), (0.588,))
    sines = ((SURGE[0],), (RISE[1], RISE[3]), (0.0,), (1.0,), (0.0,), (0.809,))  # drops a fifth of a half turn earlier
    shape = np.zeros((6, 2, HARMONICS))
    for row, pair in enumerate(zip(cosines, sines, strict=True)):
        for half, values in enumerate(pair):
            shape[row, half, : len(values)] = values
    size = jnp.stack([jnp.asarray(amplitude) for amplitude in (*amplitudes, gait.pelvis_drop)])
    return jnp.asarray(shape.reshape(6, -1), size.dtype) * size[:, None]


def shape_of(person: Person) -> Movement:
    """The shapes of a person's movement."""
    gait = person.gait
    long, quick = pace(person)
    weights = jnp.stack([jnp.ones_like(long), long, quick, *(jnp.asarray(getattr(gait, name)) for name in STYLES)])
    pelvis, feet, skin = (
        jnp.tensordot(weights, jnp.asarray(table, weights.dtype), 1, precision=lax.Precision.HIGHEST)
        for table in (PELVIS, FEET, SKIN)
    )
    recorded = gait.recorded
    mixed = ruled(gait) * (1.0 - recorded) + pelvis * sizes(person) * recorded
    return Movement(mixed, feet * recorded, skin * gait.soft_tissue)


def waves(r: Jet) -> Jet:
    """Cosines, then sines, of all harmonics of the stride (4 HARMONICS, T) at the share r (T,) of the step."""
    numbers = np.arange(1, 2 * HARMONICS + 1) * np.pi
    angles = part(r, None) * numbers.reshape((-1,) + (1,) * (r.orders.ndim - 1)).astype(r.orders.dtype)
    sines, cosines = sin_cos(angles)
    return Jet(jnp.concatenate([cosines.orders, sines.orders], axis=1))


EVEN = np.tile([0.0, 1.0], 2 * HARMONICS)
"""1 for the columns of even harmonics of a table with all harmonics."""


def swings(shape: Movement, waves: Jet) -> Jet:
    """Sums of waves (18, T): of the rows of the pelvis, and of those of the skin in even, then in odd harmonics."""
    none = jnp.zeros_like(shape.pelvis[:3])
    even, odd = jnp.stack([none, shape.pelvis[:3]], axis=-1), jnp.stack([shape.pelvis[3:], none], axis=-1)
    pelvis = jnp.concatenate([even, odd]).reshape(6, -1)
    even_ones = jnp.asarray(EVEN, shape.skin.dtype)[None]
    table = jnp.concatenate([pelvis, shape.skin * even_ones, shape.skin * (1.0 - even_ones)])
    # One product for all: each takes the compiler its time.
    return kept(Jet(jnp.einsum("ch,oh...->oc...", table, waves.orders, precision=lax.Precision.HIGHEST)))


def oscillation(swings: Jet, side: Values, shock: Jet) -> Jet:
    """Displacement of the pelvis forward, left and up from its even path [m], its yaw, pitch and roll [rad]: (6, T).

    Args:
        swings: see `swings`.
        side: (T,) 1 where the left foot landed last, −1 where the right foot did.
        shock: (T,) additional motion downwards [m].
    """
    ahead, up, pitch = parts(part(swings, slice(0, 3)))
    left, yaw, roll = parts(part(swings, slice(3, 6)) * side[None])
    return stacked([ahead, left, up - shock, yaw, pitch, roll])


def softness(swings: Jet, moves: Flags) -> Jet:
    """How sensors move on thighs and shanks: pitch [rad], forward and up along the segment [m], (3, 4, T).

    The second axis is the right and the left thigh, the right and the left shank.

    Args:
        swings: see `swings`.
        moves: (2, T) whether a foot is the one that did not land last: its leg is half a stride ahead.
    """
    even, odd = part(swings, slice(6, 12), None), part(swings, slice(12, 18), None)
    orders = (odd * jnp.where(moves, -1.0, 1.0)[None] + even).orders
    return Jet(jnp.concatenate([orders[:, :3], orders[:, 3:]], axis=2))


def worn(legs: Jet, soft: Jet, half: Values) -> Jet:
    """Frames (4, 3, 4, T) of what sensors are worn on, from those of the bones of thighs and shanks.

    Args:
        legs: (4, 3, 4, T) frames of right and left thigh, right and left shank.
        soft: (3, 4, T) see `softness`.
        half: (1, 4, 1) half the length of each, the distance of the middle, about which they pitch, from the joint [m].
    """
    origin, x, y, z = parts(legs)
    pitch, ahead, along = parts(soft)
    s, c = sin_cos(pitch)
    nods, turned = x * part(c, None) - z * part(s, None), z * part(c, None) + x * part(s, None)
    place = origin + x * part(ahead, None) + z * part(along, None) + (turned - z) * half
    return kept(stacked([place, nods, y, turned]))


def added(shape: Movement, u: Jet) -> Jet:
    """What recorded feet add to each phase (4, 2, T), at the shares u (4, 2, T) of the times in which they do.

    bump(u) Σ cᵢ (2u − 1)ⁱ; 0 outside (0, 1), four times continuously differentiable.
    """
    x = u * 2.0 - 1.0
    table = jnp.moveaxis(shape.feet, -1, 0)
    table = table.reshape(table.shape + (1,) * (x.value.ndim - 1))
    return kept(chained(*polynomial(table, x.value), x) * smooth_bump(u, 5))
