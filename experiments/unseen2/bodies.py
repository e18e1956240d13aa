"""Bodies that move without walking: what sensors on seven segments read, in the axes of their segments. Simulated.

A body moves in its sagittal plane, and its trunk also rolls and turns. Each movement begins and ends in standing, and
draws its speed, size and style from a random generator. `CHOSEN` are those from which numbers may be learned, `JUDGED`
those on which they are judged alone.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from jgait.geometry.vectors import GRAVITY
from jgait.types import SIDES

FINE_HZ, RATE_HZ = 1000.0, 100.0
"""[Hz] Rate at which motion is computed, and rate of the readings, which are means over their intervals."""

THIGH, SHANK, ANKLE, HALF_HIP, CRANK = 0.42, 0.42, 0.08, 0.09, 0.17
"""[m] Lengths of thigh and shank, height of the ankle, half the distance of the hips, length of a pedal's crank."""

LEG = 0.995 * (THIGH + SHANK)
"""[m] Distance from hip to ankle in standing."""


class Pose(NamedTuple):
    """Motion of a body, one entry for each moment of the fine time."""

    hip: np.ndarray  #: (n, 3) middle of the hips [m], forward, left and up from the ground below it in standing.
    trunk: np.ndarray  #: (n, 3) roll, pitch and yaw of the pelvis [rad], pitch forward positive.
    legs: dict[str, np.ndarray]  #: side → (n, 3) angles of thigh, shank and foot [rad], their lower or front end ahead.
    shake: np.ndarray | float = 0.0  #: (n, 3) acceleration of what the body is on [m/s²].


def ramp(t: np.ndarray, begin: float, end: float) -> np.ndarray:
    """0 before `begin` and 1 after `end`, with three continuous derivatives."""
    s = np.clip((t - begin) / (end - begin), 0.0, 1.0)
    return s**4 * (35.0 - 84.0 * s + 70.0 * s**2 - 20.0 * s**3)


def bump(s: np.ndarray) -> np.ndarray:
    """0 at 0 and at 1, and 1 at 1/2, smooth."""
    s = np.clip(s, 0.0, 1.0)
    return (4.0 * s * (1.0 - s)) ** 3


def reached(hip: np.ndarray, ankles: dict[str, np.ndarray], feet: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Angles of legs whose ankles (n, 3) are given; knees bend forward."""
    legs = {}
    for side, ankle in ankles.items():
        x, z = (ankle - hip)[:, 0], (hip - ankle)[:, 2]
        length = np.minimum(np.hypot(x, z), 0.9995 * (THIGH + SHANK))
        upper = np.arccos((THIGH**2 + length**2 - SHANK**2) / (2.0 * THIGH * length))
        lower = np.arccos((SHANK**2 + length**2 - THIGH**2) / (2.0 * SHANK * length))
        legs[side] = np.stack([np.arctan2(x, z) + upper, np.arctan2(x, z) - lower, feet[side]], axis=1)
    return legs


def standing(t: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray], dict[str, np.ndarray], np.ndarray]:
    """Hips, ankles, pitch of the feet, and angles of the trunk of a body that stands."""
    zero = np.zeros(len(t))
    hip = np.stack([zero, zero, zero + LEG + ANKLE], axis=1)
    ankles = {side: np.stack([zero, zero, zero + ANKLE], axis=1) for side in SIDES}
    return hip, ankles, {side: zero.copy() for side in SIDES}, np.zeros((len(t), 3))


class Span(NamedTuple):
    """The time of a movement, with standing before and after."""

    t: np.ndarray  #: fine time [s].
    begin: float  #: of the movement [s].
    end: float  #: of the movement [s].
    on: np.ndarray  #: 1 in the movement and 0 in standing, smooth.


def span(rng: np.random.Generator, seconds: float, fade: float = 0.8) -> Span:
    """A movement of so many seconds between two rests of 2 to 3.5 s."""
    begin = rng.uniform(2.0, 3.5)
    end = begin + seconds
    t = np.arange(int((end + rng.uniform(2.0, 3.5)) * FINE_HZ)) / FINE_HZ
    return Span(t, begin, end, ramp(t, begin, begin + fade) - ramp(t, end - fade, end))


def in_place(rng: np.random.Generator, seconds: float = 16.0) -> Pose:
    """Stepping in place, knees up in turn."""
    every, lift, back = rng.uniform(0.42, 0.85), rng.uniform(0.06, 0.32), rng.uniform(-0.12, 0.08)
    s = span(rng, seconds)
    hip, ankles, feet, trunk = standing(s.t)
    for number in range(int(seconds / every)):
        side = SIDES[number % 2]
        up = bump((s.t - s.begin - number * every) / (rng.uniform(0.7, 0.9) * every)) * rng.uniform(0.85, 1.1)
        ankles[side] += up[:, None] * [back, 0.0, lift]
        feet[side] -= rng.uniform(0.2, 0.6) * up
    step = np.pi * (s.t - s.begin) / every
    ahead = rng.uniform(0.0, 0.006) * s.on * np.sin(2.0 * step + rng.uniform(0.0, 2.0 * np.pi))
    hip[:, 0] += ahead
    hip[:, 1] += rng.uniform(0.01, 0.05) * s.on * np.sin(step)
    hip[:, 2] -= rng.uniform(0.005, 0.02) * s.on * (1.0 - np.cos(2.0 * step))
    trunk[:, 0] = np.deg2rad(rng.uniform(0.0, 4.0)) * s.on * np.sin(step)
    trunk[:, 1] = np.deg2rad(rng.uniform(0.0, 2.0)) * s.on * np.sin(2.0 * step + rng.uniform(0.0, 2.0 * np.pi))
    return Pose(hip, trunk, reached(hip, ankles, feet))


def leg_swings(rng: np.random.Generator, seconds: float = 9.0) -> Pose:
    """A stiff leg swings about its hip, and then the other one."""
    period, size = rng.uniform(1.0, 2.0), np.deg2rad(rng.uniform(15.0, 40.0))
    s = span(rng, 2.0 * seconds + 2.0)
    hip, ankles, feet, trunk = standing(s.t)
    legs = reached(hip, ankles, feet)
    for number, side in enumerate(SIDES):
        begin = s.begin + number * (seconds + 2.0)
        on = ramp(s.t, begin, begin + 0.8) - ramp(s.t, begin + seconds - 0.8, begin + seconds)
        swing = size * on * np.sin(2.0 * np.pi * (s.t - begin) / period)
        bent = np.deg2rad(rng.uniform(3.0, 15.0)) * on
        legs[side] += np.stack([swing + 0.5 * bent, swing - 0.5 * bent, 0.9 * swing], axis=1)
        trunk[:, 1] -= 0.1 * swing
    return Pose(hip, trunk, legs)


def knee_bends(rng: np.random.Generator, seconds: float = 9.0) -> Pose:
    """The heel goes to the back of the thigh and down again, first one leg, then the other."""
    period, size = rng.uniform(1.0, 2.2), np.deg2rad(rng.uniform(45.0, 100.0))
    s = span(rng, 2.0 * seconds + 2.0)
    hip, ankles, feet, trunk = standing(s.t)
    legs = reached(hip, ankles, feet)
    for number, side in enumerate(SIDES):
        since = s.t - s.begin - number * (seconds + 2.0)
        bent = sum(bump((since - k * period) / (0.9 * period)) for k in range(int(seconds / period)))
        legs[side] -= size * bent[:, None] * [rng.uniform(-0.1, 0.1), 1.0, rng.uniform(0.8, 1.2)]
    return Pose(hip, trunk, legs)


def squats(rng: np.random.Generator, seconds: float = 20.0) -> Pose:
    """Hips go down and up over feet that stand."""
    period, depth = rng.uniform(1.5, 4.0), rng.uniform(0.12, 0.45)
    s = span(rng, seconds)
    hip, ankles, feet, trunk = standing(s.t)
    down = sum(bump((s.t - s.begin - k * period) / (0.9 * period)) for k in range(int(seconds / period)))
    hip += down[:, None] * [-0.3 * depth, 0.0, -depth]
    trunk[:, 1] = rng.uniform(0.5, 1.5) * depth * down
    return Pose(hip, trunk, reached(hip, ankles, feet))


def band(rng: np.random.Generator, samples: int, low: float, high: float) -> np.ndarray:
    """Noise of deviation 1 between two frequencies [Hz]."""
    frequency = np.fft.rfftfreq(samples, 1.0 / FINE_HZ)
    inside = (frequency > low) & (frequency < high)
    waves = np.where(inside, rng.normal(size=(2, len(frequency))), 0.0)
    noise = np.fft.irfft(waves[0] + 1j * waves[1], samples)
    return np.asarray(noise / noise.std())


def ride(rng: np.random.Generator, seconds: float = 45.0) -> Pose:
    """A ride in a vehicle that starts, brakes and shakes, standing or sitting."""
    s = span(rng, seconds)
    hip, ankles, feet, trunk = standing(s.t)
    if rng.random() < 0.5:
        sits = ramp(s.t, s.begin, s.begin + 1.5) - ramp(s.t, s.end - 1.5, s.end)
        hip += sits[:, None] * [-0.4, 0.0, 0.5 - LEG - ANKLE]
    third = seconds / 3.0
    speed = sum(
        ramp(s.t, s.begin + k * third + 2.0, s.begin + (k + 0.4) * third + 1.0)
        - ramp(s.t, s.begin + (k + 0.6) * third, s.begin + (k + 0.9) * third)
        for k in range(3)
    )
    noises = [band(rng, len(s.t), low, high) for low, high in ((1.0, 15.0), (0.3, 10.0), (1.2, 12.0))]
    sizes = np.array([0.2, 0.3, 0.8]) * rng.uniform(0.5, 1.5)
    shake = np.stack([speed * noise * size for noise, size in zip(noises, sizes, strict=True)], axis=1)
    shake[:, 0] += rng.uniform(6.0, 15.0) * np.gradient(speed, 1.0 / FINE_HZ)

    def wobble(degrees: float) -> np.ndarray:
        return np.deg2rad(degrees) * speed * band(rng, len(s.t), 0.5, 4.0)

    trunk[:, 1] = wobble(rng.uniform(0.3, 1.5))
    legs = {
        side: leg + np.stack([wobble(0.6) for _ in range(3)], 1) for side, leg in reached(hip, ankles, feet).items()
    }
    return Pose(hip, trunk, legs, shake)


def cycling(rng: np.random.Generator, seconds: float = 20.0) -> Pose:
    """Pedals turn under a seated rider who gets on before and off after."""
    hz, lean = rng.uniform(0.7, 1.6), rng.uniform(0.2, 0.7)
    s = span(rng, seconds)
    hip, ankles, feet, trunk = standing(s.t)
    on = ramp(s.t, s.begin, s.begin + 1.5) - ramp(s.t, s.end - 1.5, s.end)
    turns = ramp(s.t, s.begin + 1.5, s.begin + 2.5) - ramp(s.t, s.end - 2.5, s.end - 1.5)
    angle = 2.0 * np.pi * hz * np.cumsum(turns) / FINE_HZ
    for number, side in enumerate(SIDES):
        at = angle + np.pi * number
        place = np.stack([0.2 + CRANK * np.cos(at), 0.0 * at, 0.3 + CRANK * np.sin(at) - ANKLE], axis=1)
        ankles[side] += on[:, None] * place
        feet[side] += on * (np.deg2rad(rng.uniform(5.0, 20.0)) * np.sin(at + 1.0) - 0.1)
    hip[:, 2] += 0.02 * on
    trunk[:, 0] = np.deg2rad(rng.uniform(0.5, 4.0)) * on * turns * np.sin(angle)
    trunk[:, 1] = lean * on
    shake = band(rng, len(s.t), 1.0, 20.0)[:, None] * turns[:, None] * np.array([0.1, 0.1, 0.5]) * rng.uniform(0.0, 1.0)
    return Pose(hip, trunk, reached(hip, ankles, feet), shake)


def chairs(rng: np.random.Generator, seconds: float = 24.0) -> Pose:
    """Sits down on a chair and gets up, again and again."""
    period, lean = rng.uniform(2.5, 6.0), rng.uniform(0.4, 0.9)
    s = span(rng, seconds)
    hip, ankles, feet, trunk = standing(s.t)
    for k in range(int(seconds / period)):
        begin = s.begin + k * period
        way = rng.uniform(0.3, 0.4) * period
        sat = ramp(s.t, begin, begin + way) - ramp(s.t, begin + 0.95 * period - way, begin + 0.95 * period)
        moves = 4.0 * sat * (1.0 - sat)
        hip += sat[:, None] * [-0.42, 0.0, 0.5 - LEG - ANKLE]
        trunk[:, 1] += lean * moves - 0.15 * sat
    return Pose(hip, trunk, reached(hip, ankles, feet))


def jumps(rng: np.random.Generator, seconds: float = 10.0) -> Pose:
    """Jumps on the spot, both feet together."""
    flight, contact = rng.uniform(0.15, 0.35), rng.uniform(0.25, 0.4)
    period = flight + contact
    s = span(rng, int(seconds / period) * period)
    hip, ankles, feet, trunk = standing(s.t)
    since, inside = (s.t - s.begin) % period, (s.t >= s.begin) & (s.t < s.end)
    depth = 0.5 * GRAVITY * flight * contact / np.pi
    rises = np.where(
        since < contact,
        -depth * np.sin(np.pi * since / contact),
        0.5 * GRAVITY * (since - contact) * (flight - since + contact),
    )
    height = np.convolve(np.where(inside, rises, 0.0), np.hanning(41) / np.hanning(41).sum(), mode="same")
    hip[:, 2] += height - 0.06 * s.on  # knees stay bent
    for side in SIDES:
        ankles[side][:, 2] += np.maximum(height, 0.0)
        feet[side] -= 6.0 * np.maximum(height, 0.0)
    trunk[:, 1] = rng.uniform(0.2, 1.0) * np.minimum(height, 0.0)
    return Pose(hip, trunk, reached(hip, ankles, feet))


def heel_rises(rng: np.random.Generator, seconds: float = 15.0) -> Pose:
    """Up on the toes and down again."""
    period, height = rng.uniform(0.8, 2.5), rng.uniform(0.03, 0.09)
    s = span(rng, seconds)
    hip, ankles, feet, trunk = standing(s.t)
    up = sum(bump((s.t - s.begin - k * period) / (0.9 * period)) for k in range(int(seconds / period)))
    hip[:, 0] += 0.03 * up
    hip[:, 2] += height * up
    for side in SIDES:
        ankles[side] += up[:, None] * [0.03, 0.0, height]
        feet[side] -= np.arcsin(height / 0.15) * up
    return Pose(hip, trunk, reached(hip, ankles, feet))


def bends(rng: np.random.Generator, seconds: float = 20.0) -> Pose:
    """Bends to the ground, picks something up, and turns to put it away."""
    period, size = rng.uniform(2.0, 4.0), rng.uniform(0.6, 1.5)
    s = span(rng, seconds)
    hip, ankles, feet, trunk = standing(s.t)
    down = sum(bump((s.t - s.begin - k * period) / (0.6 * period)) for k in range(int(seconds / period)))
    aside = sum(
        (-1.0) ** k * bump((s.t - s.begin - (k + 0.5) * period) / (0.5 * period)) for k in range(int(seconds / period))
    )
    hip += down[:, None] * [-0.1 * size, 0.0, -0.08 * size]
    trunk[:, 1], trunk[:, 2] = size * down, rng.uniform(0.1, 0.6) * aside
    return Pose(hip, trunk, reached(hip, ankles, feet))


type Movement = Callable[[np.random.Generator], Pose]

CHOSEN: dict[str, Movement] = {
    "stepping in place": in_place, "knee bends": knee_bends, "chairs": chairs, "cycling": cycling, "ride": ride,
}  # fmt: skip
"""Movements from which numbers may be learned."""

JUDGED: dict[str, Movement] = {
    "leg swings": leg_swings, "squats": squats, "jumps": jumps, "heel rises": heel_rises, "bends": bends,
}  # fmt: skip
"""Movements on which numbers are judged alone."""


def turned(angles: np.ndarray) -> np.ndarray:
    """(n, 3, 3) rotations from the axes of a segment to the world, from roll, pitch and yaw (n, 3)."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(angles).T, np.sin(angles).T
    return np.stack([
        np.stack([cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr], -1),
        np.stack([sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr], -1),
        np.stack([-sp, cp * sr, cp * cr], -1),
    ], -2)  # fmt: skip


def readings(pose: Pose) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Placement → angular rates [rad/s] and specific forces [m/s²] of ideal sensors, in the axes of the segment."""
    trunk, zero = turned(pose.trunk), np.zeros(len(pose.hip))
    parts = {"pelvis": (pose.hip + trunk @ np.array([-0.1, 0.0, 0.1]), trunk)}
    for side, angles in pose.legs.items():
        thigh, shank, foot = (turned(np.stack([zero, -angle, zero], axis=1)) for angle in angles.T)
        joint = pose.hip + trunk @ np.array([0.0, HALF_HIP if side == "left" else -HALF_HIP, 0.0])
        knee = joint + thigh @ np.array([0.0, 0.0, -THIGH])
        ankle = knee + shank @ np.array([0.0, 0.0, -SHANK])
        parts[f"thigh_{side}"] = joint + thigh @ np.array([0.07, 0.0, -0.5 * THIGH]), thigh
        parts[f"shank_{side}"] = knee + shank @ np.array([0.04, 0.0, -0.5 * SHANK]), shank
        parts[f"foot_{side}"] = ankle + foot @ np.array([0.06, 0.0, 0.02]), foot
    every = int(FINE_HZ / RATE_HZ)

    def averaged(values: np.ndarray) -> np.ndarray:
        return values[: len(values) // every * every].reshape(-1, every, 3).mean(axis=1)

    read = {}
    for placement, (place, axes) in parts.items():
        force = np.gradient(np.gradient(place, axis=0), axis=0) * FINE_HZ**2 + [0.0, 0.0, GRAVITY] + pose.shake
        spin = np.einsum("tji,tjk->tik", axes, np.gradient(axes, axis=0)) * FINE_HZ
        gyr = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1)
        read[placement] = averaged(gyr), averaged(np.einsum("tji,tj->ti", axes, force))
    return read
