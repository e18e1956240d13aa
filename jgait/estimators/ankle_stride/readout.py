"""Strides and their flags from the ankle's filter, or from a method of `ankle_stride.length`; JAX, differentiable
given the events.
"""

from typing import Any, NamedTuple

from jaxtyping import PyTree

from jgait.estimators.ankle_stride.model import AnkleState
from jgait.estimators.ankle_stride.params import AnkleParams
from jgait.estimators.ankle_stride.prepare import AnkleSignals
from jgait.estimators.foot_ins.readout import SHORTEST_STRIDE_M, TIMING
from jgait.estimators.stride_flags import LARGEST_TURN, STAIRS_M
from jgait.filtering import Covariance
from jgait.geometry.arrays import picked, xp
from jgait.geometry.rotation import quaternion, rotated
from jgait.geometry.vectors import Vector, entries, root, vector, wrapped
from jgait.signal import marks
from jgait.types import Counts, Strides, Values

FARTHEST_OFF = 0.08
"""[m] Largest distance of an estimated lever from that of the parameters, see `off`; chosen above public walks."""

FLAGS = ("turning", "stairs", "clipped", "half")
"""Names of the flags in `diagnostics`, each (n,) bool in the order of the strides."""


def from_filter(
    p: AnkleParams, leg: AnkleSignals, state: AnkleState, cov: Covariance, side: Counts
) -> tuple[Strides, Strides, dict[str, Values]]:
    """Strides of one leg (0 right, 1 left) from the states of the filter, their standard deviations, and flags."""
    yaw = heading(state, cov)
    way = Way(*picked(leg.end, *measured(state, cov)))
    here, there = (Heading(*picked(at, *yaw)) for at in (leg.begin, leg.end))
    strides, duration = from_events(leg, side, way.length, way.height, wrapped(there.angle - here.angle))
    stddev = deviations(p, strides, way, here, there, duration)
    return strides, stddev, flags(strides, clipped=leg.clips, half=leg.half)


class Way(NamedTuple):
    """Horizontal and vertical displacement of the ankle [m], and the variances of both [m²]."""

    length: Values
    height: Values
    length_variance: Values
    height_variance: Values


class Heading(NamedTuple):
    """Heading of the sensor's forward axis [rad], and the variance of the heading [rad²]."""

    angle: Values
    variance: Values


def measured(state: AnkleState, cov: Covariance) -> Way:
    """The stride that would end at each sample: the ankle's position, which counts from the stride's begin."""
    way, (xx, xy, yy, zz) = vector(state.position), entries(cov["position", "position"], "xx", "xy", "yy", "zz")
    length = root(way.x * way.x + way.y * way.y)
    x, y = (part / xp.maximum(length, 1e-6) for part in (way.x, way.y))
    return Way(length, way.z, xp.maximum(x * x * xx + 2.0 * x * y * xy + y * y * yy, 0.0), zz)


def heading(state: AnkleState, cov: Covariance) -> Heading:
    """The heading of states."""
    attitude = quaternion(state.attitude)
    ones, zeros = xp.ones_like(attitude.w), xp.zeros_like(attitude.w)
    forward = rotated(attitude, Vector(ones, zeros, zeros))
    return Heading(xp.arctan2(forward.y, forward.x), *entries(cov["attitude", "attitude"], "zz"))


def deviations(p: AnkleParams, strides: Strides, way: Way, here: Heading, there: Heading, duration: Values) -> Strides:
    """Standard deviations of strides, given the headings at their begin and end and their duration [s]."""
    # a sensor beside the ankle moves, relative to the ankle, by the chord of the leg's turn
    chord = p.lever_turn_sd * 2.0 * xp.sin(0.5 * strides.turn)
    length_sd = root(way.length_variance + p.stride_noise**2 + chord**2)
    speed_sd = root((length_sd / duration) ** 2 + (way.length * TIMING / duration**2) ** 2)
    return strides._replace(
        start=None, final_contact=None, end=None, length=length_sd, width=xp.full_like(way.length, xp.nan),
        height=root(way.height_variance + p.stride_noise**2), speed=speed_sd, standing=None, standing_end=None,
        turn=root(xp.abs(there.variance - here.variance)),
    )  # fmt: skip


def by_method(
    p: AnkleParams, leg: AnkleSignals, gyr: Values, acc: Values, side: Counts, method: str
) -> tuple[Strides, dict[str, Values]]:
    """Strides of one leg (0 right, 1 left) by a method of `ankle_stride.length` ("3d", "sl1" or "sl2"), and flags.

    `gyr` [rad/s], with the gyroscope bias, and specific force `acc` [m/s²] are filtered, (T, 3), in the segment's axes.
    """
    from jgait.estimators.ankle_stride import length as stride_length

    samples, there = gyr.shape[0], xp.arange(leg.begin.shape[0], dtype=xp.int32) < leg.count
    lever = lever_of(p, leg)
    known = stride_length.StrideLengthParams(
        p.leg_length, p.angle_gain, p.time_gain, Vector(*(xp.asarray(v, gyr.dtype) for v in lever))
    )
    gyr, raw = gyr - leg.gyr_bias[None, :], leg.gyr - leg.gyr_bias[None, :]
    dt = 1.0 / leg.rate_hz
    between = marks.marks(leg.begin, leg.end, samples, there)
    spatial = stride_length.inertial(known, gyr, acc, between, dt)
    if method == "3d":
        length = spatial.level[leg.end]
    else:
        swings = stride_length.pendulum(known, raw, leg.swing_begin, leg.swing_end, dt)
        length = swings.chord if method == "sl1" else swings.arc
    strides, _ = from_events(leg, side, length, spatial.rise[leg.end], spatial.turn[leg.end])
    return strides, flags(strides, clipped=leg.clips, half=leg.half)


def off(lever: Vector, known: Vector) -> Values:
    """Distance of the estimated lever from that of the parameters [m]: the largest component, with half of that along
    the segment, where the places of sensors differ more.
    """
    forward, left, up = (xp.abs(part - value) for part, value in zip(lever, known, strict=True))
    return xp.maximum(xp.maximum(forward, left), 0.5 * up)


def lever_of(p: AnkleParams, leg: PyTree) -> Vector:
    """The lever from the ankle to the sensor, in the segment's axes [m], before the filter corrects it; `leg` has the
    `mid_shank` of `AnkleSignals`.
    """
    return Vector(p.lever_forward, p.lever_left, p.lever_ankle + leg.mid_shank * (p.lever_shank - p.lever_ankle))


def from_events(
    leg: AnkleSignals, side: Counts, length: Values, height: Values, turn: Values
) -> tuple[Strides, Values]:
    """The table of strides from the measured quantities and the decided events, and the duration [s] of each.

    A stride starts with the contact that ends the stride before, and lasts from contact to contact. If no stride comes
    before, the stride starts with the shank's swing, and its speed is over the time from standing to standing.
    """
    there = xp.arange(leg.begin.shape[0], dtype=xp.int32) < leg.count
    start = xp.where(leg.follows, xp.concatenate([leg.leaves[:1], leg.lands[:-1]]), leg.leaves)
    stood = (leg.end - leg.begin).astype(leg.lands.dtype) / leg.rate_hz
    duration = xp.maximum(xp.where(leg.follows, leg.lands - start, stood), 1e-3)
    return table(side, (start, leg.leaves, leg.lands), duration, length, height, turn, there), duration


def table(
    side: Counts, times: tuple[Values, Values, Values], duration: Values, length: Values, height: Values,
    turn: Values, there: PyTree,
) -> Strides:  # fmt: skip
    """Strides of one leg from start, final contact and end [s] and the measured quantities."""
    start, leaves, lands = times
    return Strides(
        side=xp.full(length.shape, side, xp.int32), start=start, final_contact=leaves, end=lands, length=length,
        width=xp.full_like(length, xp.nan), height=height, valid=there & (length > SHORTEST_STRIDE_M),
        speed=length / duration, turn=turn,
    )  # fmt: skip


def flags(strides: Strides, **decided: PyTree) -> dict[str, Any]:
    """Flags of each stride, those of `decided` included; True only if the stride is valid."""
    flagged = {"turning": xp.abs(strides.turn) > LARGEST_TURN, "stairs": xp.abs(strides.height) > STAIRS_M, **decided}
    return {name: flag & strides.valid for name, flag in flagged.items()}
