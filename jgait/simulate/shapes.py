"""Shapes of the movement over a stride, fitted to recorded people: pelvis, feet, and what sensors are worn on.

The pelvis is a Fourier series over the stride, from sensors on lower backs. The feet follow the phases of
`feet`, which keep them at rest on the ground, and smooth functions in addition, from sensors on legs. Joint angles
follow from feet and pelvis. The shapes of feet and skin are linear in the length and the rate of the stride and in the
person's style. `movement.json` holds the numbers and names its source; `experiments.people.shapes` derives them from
recordings.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import lax

from jgait.geometry.jets import Jet, chained, part, parts, sin_cos, stacked, turned_axes
from jgait.geometry.vectors import kept
from jgait.simulate.person import RECORDED, TABLES, Body, Gait, Person
from jgait.simulate.smooth import polynomial, smooth_bump
from jgait.types import Flags, Values

PELVIS, FEET, SKIN = (np.asarray(TABLES[name]) for name in ("pelvis", "feet", "skin"))
"""Tables of `Movement`: of the usual pelvis; of feet and skin at the usual stride, their slopes over length and rate of
the stride, and those of each style (1 + 2 + styles, rows, columns)."""

HARMONICS = PELVIS.shape[-1] // 2
"""[1] Number of harmonics of each motion of the pelvis."""

STYLES = tuple(name for name in Gait._fields if name.startswith("style_"))
"""Parameters of the gait that are coordinates of the person's style."""

SIZES = ("pelvis_surge", "pelvis_rise", "pelvis_nod", "pelvis_sway", "pelvis_rotation", "pelvis_drop")
"""Parameters of the gait that scale the rows of the table of the pelvis."""

USUAL_STRIDE = RECORDED.stride_length / (Body().thigh_length + Body().shank_length)
"""[1] Usual length of the stride over that of the leg."""

UNIT = 0.12
"""[1] Relative change of a stride's length or rate that counts as one in the tables."""

WORN = ("pitch", "ahead", "along", "roll", "yaw", "aside")
"""Motions of what sensors are worn on: pitch, its forward end down [rad], forward and up along the segment [m]; and
out of the leg's plane, outwards positive: roll, its upper end outwards, yaw, its forward end outwards [rad], and to the
side [m]."""


class Instants(NamedTuple):
    """Times and shares in the motion of a foot, see `feet.phases`; the defaults are those by the rules."""

    heel_early: Values = 0.08  #: share of the slow rise of the heel [1].
    heel_rises: Values = 0.34  #: start of the heel's fast rise before toe-off [steps].
    heel_after: Values = 0.24  #: its end after toe-off [steps]; the heel begins to come down at toe-off.
    heel_down: Values = 0.16  #: time before landing at which the heel is down again [steps].
    toes_rise: Values = 0.14  #: time from the ball's leaving the ground to toe-off [steps].
    toes: Values = 0.95  #: pitch of the toes over the pitch of the heel [1].
    toes_up: Values = 0.45  #: time before landing at which the toes begin to rise above the heel [steps].
    toes_turn: Values = 0.16  #: the same at which they begin to come down again [steps].
    gather: Values = 0.42  #: share of swing in which the foot accelerates [1].
    late_lift: Values = 0.5  #: late lift over early lift [1].
    lowers: Values = 0.74  #: share of swing after which the foot falls [1].
    hard: Values = 0.15  #: share of swing in which the ground decelerates the foot [1].
    soft: Values = 0.44  #: share of swing in which the leg does [1].


class Movement(NamedTuple):
    """Shapes of a person's movement, see `shape_of`."""

    #: (6, 2 HARMONICS) cosines, then sines, of the motion of the pelvis forward, up [m] and of its pitch [rad] at the
    #: even harmonics of the stride, and of its motion left [m], its yaw and roll [rad] at the odd ones.
    pelvis: Values
    feet: Values  #: (4, terms) what is added to the phases of a foot, see `added`.
    #: (18, 4 HARMONICS) cosines, then sines, of how what sensors are worn on moves over the bone of the thigh, of the
    #: shank and of the foot, in the stride of their leg; six rows each, see `WORN`.
    skin: Values
    when: Instants  #: times in the motion of a foot, between the rules and recorded people.


def pace(person: Person) -> tuple[Values, Values]:
    """Length and rate of a person's stride beside the usual ones, in `UNIT`, at most three of them."""
    body, gait = person
    long = gait.stride_length / (body.thigh_length + body.shank_length) / USUAL_STRIDE
    quick = RECORDED.stride_time / gait.stride_time
    long, quick = (jnp.clip((jnp.asarray(share) - 1.0) / UNIT, -3.0, 3.0) for share in (long, quick))
    return long, quick


def sizes(person: Person) -> Values:
    """(6, 2 HARMONICS) size of each harmonic of the table of the pelvis, over the usual one.

    The size of a motion is that of its first harmonic. The higher ones are jolts that follow the length of the stride:
    in recorded people most of them grow little with the first (`experiments.people.shapes` prints how much).
    """
    gait = person.gait
    first = jnp.stack([jnp.asarray(getattr(gait, name) / getattr(RECORDED, name)) for name in SIZES])
    others = jnp.broadcast_to(1.0 + UNIT * pace(person)[0], (len(SIZES), HARMONICS - 1)).astype(first.dtype)
    return jnp.tile(jnp.concatenate([first[:, None], others], axis=1), (1, 2))


SURGE = (0.99, 0.135)
"""Shape of the surge by the rules: sine and cosine of one wave a step; its amplitude is 1."""

RISE = (-0.475, -0.111, -0.056, -0.027)
"""Shape of the rise by the rules: cosine and sine of one and of two waves a step; its range is 1."""


def ruled(gait: Gait) -> Values:
    """The table of the pelvis by the rules (6, 2 HARMONICS).

    Once a stride the pelvis sways to the stance leg, turns with the leading leg and drops on the side of the swing leg;
    twice a stride it rises and falls, moves forward and back relative to constant speed, and tilts forward and back,
    later by `pelvis_lag`.
    """
    amplitudes = (gait.pelvis_surge, gait.pelvis_rise, gait.pelvis_nod, gait.pelvis_sway, gait.pelvis_rotation)
    cosines = ((SURGE[1],), (RISE[0], RISE[2]), (1.0,), (0.0,), (-1.0,), (0.588,))
    sines = ((SURGE[0],), (RISE[1], RISE[3]), (0.0,), (1.0,), (0.0,), (0.809,))  # drops a fifth of a half turn earlier
    shape = np.zeros((2, 6, HARMONICS))
    for row, pair in enumerate(zip(cosines, sines, strict=True)):
        for half, values in enumerate(pair):
            shape[half, row, : len(values)] = values
    size = jnp.stack([jnp.asarray(amplitude) for amplitude in (*amplitudes, gait.pelvis_drop)])
    cosine, sine = jnp.asarray(shape, size.dtype)
    # The wave of a pelvis that is lowest in mid stance is as flat above as below: in flight the body falls freely.
    running = (np.arange(6)[:, None] == 1) & (np.arange(HARMONICS) > 0) & (size[1] < 0.0)
    cosine, sine = jnp.where(running, 0.0, cosine), jnp.where(running, 0.0, sine)
    late = 2.0 * np.pi * gait.pelvis_lag * jnp.arange(1.0, HARMONICS + 1, dtype=size.dtype)
    late = jnp.where(np.arange(6)[:, None] < 3, late, 0.0)
    c, s = jnp.cos(late), jnp.sin(late)
    return jnp.concatenate([cosine * c - sine * s, cosine * s + sine * c], axis=1) * size[:, None]


def weights(person: Person) -> Values:
    """(1 + 2 + styles,) what each block of a table counts: usual stride, slopes over length and rate, styles."""
    long, quick = pace(person)
    return jnp.stack([jnp.ones_like(long), long, quick, *(jnp.asarray(getattr(person.gait, name)) for name in STYLES)])


def shape_of(person: Person) -> Movement:
    """The shapes of a person's movement."""
    gait, counts = person.gait, weights(person)
    feet, skin = (
        jnp.tensordot(counts, jnp.asarray(table, counts.dtype), 1, precision=lax.Precision.HIGHEST)
        for table in (FEET, SKIN)
    )
    recorded = gait.recorded
    mixed = ruled(gait) * (1.0 - recorded) + jnp.asarray(PELVIS, counts.dtype) * sizes(person) * recorded
    pairs = zip(Instants(), Instants(**TABLES["instants"]), strict=True)
    when = Instants(*(rule + recorded * (table_value - rule) for rule, table_value in pairs))
    return Movement(mixed, feet * recorded, skin * gait.soft_tissue, when)


def waves(r: Jet) -> Jet:
    """Cosines, then sines, of odd and of even harmonics of a stride (2, 2 HARMONICS, T) at a share of the step."""
    numbers = np.arange(1, 2 * HARMONICS + 1).reshape(-1, 2).T * np.pi
    angles = part(r, None, None) * numbers.reshape(numbers.shape + (1,) * (r.orders.ndim - 1)).astype(r.orders.dtype)
    sines, cosines = sin_cos(angles)
    return Jet(jnp.concatenate([cosines.orders, sines.orders], axis=2))


def swings(shape: Movement, waves: Jet) -> Jet:
    """Sums of waves (2, 21, T), of odd harmonics, then of even ones: three rows of the pelvis, then those of the skin.

    Of the pelvis, odd harmonics move it left, yaw and roll it; even ones move it forward and up and pitch it.
    """
    odd = jnp.concatenate([shape.pelvis[3:], shape.skin[:, 0::2]])
    even = jnp.concatenate([shape.pelvis[:3], shape.skin[:, 1::2]])
    # One product for all: each takes the compiler its time.
    orders = jnp.einsum("pch,oph...->opc...", jnp.stack([odd, even]), waves.orders, precision=lax.Precision.HIGHEST)
    return kept(Jet(orders))


def oscillation(swings: Jet, side: Values, shock: Jet) -> Jet:
    """Displacement of the pelvis forward, left and up from its even path [m], its yaw, pitch and roll [rad]: (6, T).

    `side` (T,) is 1 where the left foot landed last, −1 where the right foot did, `shock` (T,) additional motion
    downwards [m].
    """
    left, yaw, roll = parts(part(swings, 0, slice(0, 3)) * side[None])
    ahead, up, pitch = parts(part(swings, 1, slice(0, 3)))
    return stacked([ahead, left, up - shock, yaw, pitch, roll])


def softness(swings: Jet, moves: Flags, free: Jet) -> Jet:
    """How sensors move on thighs, shanks and feet (6, 6, T): the rows of `WORN`, outwards replaced by left.

    The second axis is the right and the left thigh, the right and the left shank, the right and the left foot. The leg
    of a foot that `moves` (2, T), which did not land last, is half a stride ahead; a sensor on a foot has the share
    `free` (2, T) of its motion, see `feet.Phases`.
    """
    odd, even = (part(swings, i, slice(3, None), None) for i in (0, 1))
    both = odd * jnp.where(moves, -1.0, 1.0)[None] + even
    rows = Jet(both.orders.reshape(-1, 3, len(WORN), *both.orders.shape[2:]))
    signs = np.stack([OUTWARDS["right"], OUTWARDS["left"]], axis=1)
    rows = kept(rows * signs.reshape((1, *signs.shape) + (1,) * (moves.ndim - 1)).astype(both.orders.dtype))
    thighs, shanks, foot = parts(rows)
    return Jet(jnp.concatenate([thighs.orders, shanks.orders, (foot * part(free, None)).orders], axis=2))


OUTWARDS = {"right": np.array([1.0, 1.0, 1.0, 1.0, -1.0, -1.0]), "left": np.array([1.0, 1.0, 1.0, -1.0, 1.0, 1.0])}
"""Sign of each of `WORN` on each side as motion to the left, and turns about the forward and the upward axis."""


SENSED = (0.86, 0.43)
"""How far down thigh and shank the recorded people wore their sensors [lengths of the segment]: the points about which
what sensors are worn on turns (`experiments.people.mounts`)."""


def worn(legs: Jet, soft: Jet, down: Values) -> Jet:
    """Frames (4, 3, 6, T) of what sensors are worn on, from those of the bones of thighs, shanks and feet.

    `soft` is from `softness`; `down` (1, 6, 1) is the distance of the point about which each turns from its upper
    joint [m], see `SENSED`.
    """
    origin, *bone = parts(legs)
    pitch, ahead, along, roll, yaw, aside = parts(soft)
    turns = kept(turned_axes(yaw, -pitch, roll))
    # Component j of a turned axis is along axis j of the bone.
    first, second, third = (part(turns, slice(None), j, None) * part(axis, None) for j, axis in enumerate(bone))
    axes = kept(first + second + third)
    x, y, z = bone
    place = origin + x * part(ahead, None) + y * part(aside, None) + z * part(along, None)
    place = place + (part(axes, 2) - z) * down
    return kept(Jet(jnp.concatenate([part(place, None).orders, axes.orders], axis=1)))


def added(shape: Movement, u: Jet) -> Jet:
    """What recorded feet add to each phase (4, 2, T), at the shares u (4, 2, T) of the times in which they do.

    bump(u) Σ cᵢ (2u − 1)ⁱ; 0 outside (0, 1), four times continuously differentiable.
    """
    x = u * 2.0 - 1.0
    table = jnp.moveaxis(shape.feet, -1, 0)
    table = table.reshape(table.shape + (1,) * (x.value.ndim - 1))
    return kept(chained(*polynomial(table, x.value), x) * smooth_bump(u, 5))
