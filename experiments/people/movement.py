"""The fit of simulated strides to those of recorded people: their mean, its slopes, and in what people differ.

Compared are the rates of thigh, shank and foot and their specific forces ahead and up, over a stride in harmonics
(`waves`): a difference counts over the standard deviation between people. Above `JITTER` harmonics people differ more
in phase than in size, so the size of single strides counts there. Peaks that are figures of gait count as well,
angles of hip and knee, which rates leave open, and how fast thigh and shank turn above the harmonics that are compared,
which a perfect sensor at 200 Hz must follow. Free are parameters of the gait, times in the motion of the feet, the
table of the feet, what sensors do over the bone, and the lowest harmonics of the pelvis. These stay near those of lower
backs (`pelvis`), whose landings are labelled by hand and not exact in time; the height of the pelvis at a landing
decides how straight legs are. Tables have slopes over the length and the rate of the stride, some parameters grow with
a power of its length. The mean and the slopes are found by Gauss-Newton's method; a last step for each person alone
gives what this person differs by. The principal directions of these differences are the styles.

`python -m experiments.people.movement` changes these parts of the file; `shapes` runs it twice. In the first run the
pelvis stays as lower backs move, in the second one the times in the motion of the feet stay.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.polynomial import chebyshev

from experiments.common.sets import datasets
from experiments.people.legs import legs_of
from experiments.people.tables import tables, write
from experiments.people.waves import HARMONICS, POINTS, SEGMENTS, harmonics, late, mean_stride
from experiments.simulator.gait import Truth, figures, pool, summary
from experiments.simulator.simulated import SETS, Set, names_of, sensors_of
from jgait import simulate
from jgait.geometry.segments import Motion, Segments
from jgait.simulate import RECORDED, Body, Gait, Person, shapes
from jgait.simulate.person import TABLES
from jgait.simulate.population import manner
from jgait.simulate.shapes import WORN, Instants, Movement
from jgait.simulate.walker import Frames, moved, planned, ticks
from jgait.simulate.worn import ideal_readings
from jgait.types import SIDES, Values

GAIT = {
    "toe_up": 0.08, "heel_up": 0.2, "foot_flat": 0.25, "heel_off": 0.12, "swing_lift": 0.5, "landing_speed": 0.4,
    "hip_ahead": 0.6,
}  # fmt: skip
"""Free parameters of the gait → prior standard deviation of their logarithm."""
WHEN = {
    "heel_early": 0.3, "heel_rises": 0.15, "heel_after": 0.15, "heel_down": 0.3, "toes_rise": 0.2, "toes": 0.1,
    "toes_up": 0.15, "toes_turn": 0.5, "gather": 0.15, "late_lift": 0.4, "lowers": 0.08, "hard": 0.3, "soft": 0.2,
}  # fmt: skip
"""The same of times in the motion of a foot, see `shapes.Instants`."""
GROWS = ("toe_up", "heel_up", "landing_speed")
"""Those that grow with the length of the stride."""
FEET, TERMS = (0.15, 0.3, 0.05, 0.5), 11
"""[1] Prior standard deviations of the four rows of the table of the feet, and the number of their polynomials."""
CURVES = tuple((segment, name) for segment in SEGMENTS for name in WORN[:3])
"""Segment, and pitch rate or specific force ahead or up."""
PEAKS = ("shank_swing", "shank_back", "thigh_forward", "thigh_back", "foot_swing", "foot_push_off", "shank_strike",
         "foot_strike")  # fmt: skip
POSTURE = ((5.0, 4.0), (20.0, 4.0), (20.0, 4.0), (63.0, 4.0), (-16.0, 4.0))
"""[°] Angles of knee, thigh and foot at landing, the knee's largest and the thigh's least, and how far people are from
it. Thigh and foot count from the vertical and the ground, not from the pelvis, which leans forward (textbooks: the
thigh 20° ahead at landing, 10 to 20° behind at the end of stance)."""
JITTER = 6
STEADY = (0.15, 2.0, 2.0)
"""[1] Prior precision of the mean and of both slopes, in the priors above."""
MOST, ENOUGH = 40, 5e-4
"""Iterations at most; relative gain of the cost below which they end."""

FOLLOWED, ORDER = 0.03, 7
"""[rad/s] Size of the first harmonic above `LAST` of a rate of thigh or shank that counts one; [1] power of its number
with which a harmonic above counts: the order with which sums over samples converge (`experiments.simulator.checks`)."""

KNOWN = SETS[-1]
"""A set of people to whom the tables are fitted."""
LEG = Body().thigh_length + Body().shank_length
SKIN, SHANK = (0.4, 2.0, 2.0), 0.25
"""[rad/s, m/s², m/s²] Prior deviations of the rate and the accelerations of skin over bone, in each harmonic, at one
stride a second; [1] part of it at the shank in its first harmonics: by motion capture (`neura_sparse`), sensors on
shanks turn much less over the bone than those on thighs."""
FIRST, BONE, LAST = 2, 7, 24
"""[1] First free harmonic of the skin; the first in which it moves as freely at the shank as at the thigh; the last."""
HIPS, SWINGS = 0.002, 3
"""[m] Prior deviation of the motion of the pelvis forward and up from that of lower backs, in its first harmonic; in a
next one it is this over its number; [1] number of harmonics."""
COUNTS = (len(GAIT), len(WHEN), 4 * SWINGS, len(FEET) * TERMS, 12 * (LAST - FIRST + 1))
"""[1] Numbers of the gait, of times, and of the tables of pelvis, feet and skin."""
COUNT = sum(COUNTS)


class Target(NamedTuple):
    """A recorded person: stride time [s] and length [m], length of the leg [m], harmonics of the curves and their sizes
    in single strides, peaks, and weights (0: missing)."""

    stride_time: Any
    stride_length: Any
    leg: Any
    waves: Any
    sizes: Any
    weights: Any
    peaks: Any
    peak_weights: Any


class Recorded(NamedTuple):
    """What a walk has: harmonics of the mean stride and their sizes in single strides (curves, harmonics), medians of
    the figures of gait, length of the leg [m]."""

    waves: np.ndarray
    sizes: np.ndarray
    medians: dict[str, float]
    leg: float


def recorded(given: Set) -> dict[str, Recorded]:
    """Of each walk of a set with sensors on both segments and the foot."""
    found = {}
    for walk in datasets.load(given.name, names_of(given)):
        legs = list(legs_of(walk, given)) if walk.reference is not None else []
        each = [one for leg in legs if (one := mean_stride(leg, given.rate_hz)) is not None]
        known = Truth(None if walk.reference is None else walk.reference.distance)
        medians = summary(pool([
            figures(leg.sensors, given.rate_hz, leg.windows, known, trim=leg.trim, good=leg.good) for leg in legs
        ]))  # fmt: skip
        if each and "stride_length" in medians:
            lengths = walk.info.get("lengths")
            mean, size = (
                np.mean([part[:, :3] for part in parts], axis=0).reshape(len(CURVES), -1)
                for parts in ([one.mean for one in each], [one.size**2 for one in each])
            )
            found[walk.recording.name] = Recorded(
                mean, np.sqrt(size), medians,
                LEG if lengths is None else float(np.mean([sum(lengths[side]) for side in SIDES])),
            )  # fmt: skip
    return found


def known() -> dict[str, tuple[Recorded, Set]]:
    """Walk → what it has, and its set: of every second person of `walking5m`, to whom the tables are fitted."""
    sets = [given for given in SETS if given.name == KNOWN.name]
    every = {name: (one, given) for given in sets for name, one in recorded(given).items()}
    return {name: every[name] for name in list(every)[::2]}


def targets(people: list[Recorded]) -> list[Target]:
    """What the fit compares; weights are one over the deviation between people.

    Sizes of harmonics are those of single strides without what people differ by, which the styles add; at least half.
    """
    every = np.array([one.waves for one in people])
    spread, size = every.std(axis=0), np.sqrt(np.mean(np.sum(np.abs(every) ** 2, axis=2), axis=0))
    share = np.array([[1.0 if name == "pitch" or segment == "foot" else 0.7] for segment, name in CURVES])
    weights = share / (spread + 0.02 * size[:, None])
    peak_weights = np.array([1.2 / np.std([one.medians[name] for one in people]) for name in PEAKS])
    return [
        Target(
            one.medians["stride_time"], one.medians["stride_length"], one.leg, one.waves,
            np.sqrt(np.maximum(one.sizes**2 - spread**2, (0.5 * one.sizes) ** 2)), weights,
            np.array([one.medians[name] for name in PEAKS]), peak_weights,
        )
        for one in people
    ]  # fmt: skip


MONOMIALS = np.array([
    np.pad(chebyshev.cheb2poly(np.eye(TERMS)[i]), (0, TERMS - 1 - i)) for i in range(TERMS)
])  # fmt: skip
"""Coefficients of 1, x, x² … of each of Chebyshev's polynomials, in which the fit counts."""


def free(values: Any, feet: Any) -> tuple[dict[str, Any], dict[str, Any], Any, Any, Any]:
    """Factors of the gait, of times in the motion of a foot, and the tables of pelvis, feet and skin, from numbers in
    prior standard deviations; the table of the feet is around a given one."""
    of_gait, of_when, of_pelvis, of_feet, of_skin = jnp.split(values, np.cumsum(COUNTS[:-1]))
    moves = of_pelvis.reshape(2, 2, SWINGS) * HIPS / np.arange(1.0, SWINGS + 1.0)
    moves = jnp.pad(moves, ((0, 4), (0, 0), (0, shapes.HARMONICS - SWINGS)))
    pelvis = shapes.PELVIS + moves.reshape(shapes.PELVIS.shape)
    factors, times = (
        {name: jnp.exp(own[i] * spread) for i, (name, spread) in enumerate(spreads.items())}
        for own, spreads in ((of_gait, GAIT), (of_when, WHEN))
    )
    fine = np.asarray(FEET)[:, None] / (1.0 + 0.15 * np.arange(TERMS))
    feet = feet + (of_feet.reshape(fine.shape) * fine) @ MONOMIALS
    number = np.arange(FIRST, LAST + 1)
    turn, tight = 2.0 * np.pi * number, np.stack([np.ones(number.size), np.where(number < BONE, SHANK, 1.0)])
    one = np.stack([SKIN[0] / turn, SKIN[1] / turn**2, SKIN[2] / turn**2]) * tight[:, None]
    skin = of_skin.reshape(2, 3, 2, -1) * one[:, :, None]
    whole = jnp.pad(skin, ((0, 0), (0, 0), (0, 0), (FIRST - 1, 2 * shapes.HARMONICS - LAST)))
    table = jnp.asarray(shapes.SKIN[0]).reshape(3, len(shapes.WORN), -1)
    table = table.at[:2, : len(SKIN)].set(whole.reshape(2, len(SKIN), -1))
    return factors, times, pelvis, feet, table.reshape(shapes.SKIN[0].shape)


def usual(leg: Values, stride_time: Values, stride_length: Values) -> Person:
    """The usual person with a length of the leg [m] at a stride [s], [m]."""
    gait = RECORDED._replace(
        steps=8.0, quiet_before=0.5, soft_tissue=1.0, stride_length=stride_length, stride_time=stride_time,
        **manner(stride_length / leg, RECORDED),
    )  # fmt: skip
    return Person(Body(*(length * leg / LEG for length in Body())), gait)


def walked_stride(who: Person, shape: Movement) -> tuple[tuple[Values, Values], Motion[Frames]]:
    """Rates and forces at thigh, shank and foot, and the motion, in a stride of the right leg."""
    laid, _ = planned(jax.random.key(0), who, simulate.straight(30.0), 8, shape)
    time = laid.contact[4] + who.gait.stride_time * jnp.arange(POINTS) / POINTS
    moving = moved(who, laid, *ticks(laid, time))
    placements = [f"{segment}_right" for segment in SEGMENTS]
    return ideal_readings(
        moving, sensors_of(who.body, placements, jnp.asarray([KNOWN.thigh, KNOWN.shank, KNOWN.foot]))
    ), moving


class Made(NamedTuple):
    """A simulated stride of the right leg from its landing: the curves (curves, POINTS), the size of the specific force
    at shank and foot (2, POINTS) [m/s²], and angles as in `POSTURE` (5,) [rad]."""

    curves: Any
    force: Any
    posture: Any


def stride(values: Any, base: Any, given: Target) -> Made:
    """The simulated stride at numbers as of `free`."""
    factors, times, pelvis, feet, skin = free(values, base)
    when = Instants(**TABLES["instants"])
    when = when._replace(**{name: getattr(when, name) * factor for name, factor in times.items()})
    body, gait = usual(given.leg, given.stride_time, given.stride_length)
    who = Person(body, gait._replace(**{name: getattr(gait, name) * factor for name, factor in factors.items()}))
    (gyr, acc), moving = walked_stride(who, Movement(pelvis * shapes.sizes(who), feet, skin, when))
    mean = jnp.mean(acc[..., ::2], axis=1)
    ahead, up = jnp.moveaxis(mean / jnp.linalg.norm(mean, axis=1, keepdims=True), 1, 0)[..., None]
    forces = acc[..., 0] * up - acc[..., 2] * ahead, acc[..., 0] * ahead + acc[..., 2] * up
    thigh, shank = (moving.pose[3, :, Segments._fields.index(name)] for name in ("thigh_right", "shank_right"))
    hip, tilt = (jnp.arctan2(-up[0], up[2]) for up in (thigh, shank))
    foot = jnp.arcsin(moving.pose[1, 2, Segments._fields.index("foot_right"), 0])
    return Made(
        jnp.stack([gyr[..., 1], *forces], axis=1).reshape(len(CURVES), POINTS),
        jnp.sqrt(jnp.sum(acc[1:] ** 2, axis=-1)),
        jnp.stack([hip[0] - tilt[0], hip[0], foot, jnp.max(hip - tilt), jnp.min(hip)]),
    )


PHASED = np.interp(HARMONICS, [JITTER - 2, 2 * JITTER - 2], [1.0, 0.1])
SIZED = np.interp(HARMONICS, [JITTER - 2, 2 * JITTER - 2], [0.0, 1.2])
"""[1] What a difference counts, and a difference in size, in each harmonic."""
SLOW = 18
"""[1] Harmonics of a rate in which its peaks are looked for."""
FAST = np.arange(HARMONICS[-1] + 1, POINTS // 2)
"""[1] Numbers of the harmonics above those that are compared."""
RATES = [row for row, (_, name) in enumerate(CURVES) if name == "pitch"]


def residuals(values: Any, base: Any, given: Target) -> Any:
    """Weighted differences of a simulated stride from a recorded one; the last of the values is its phase [rad]."""
    made = stride(values[:-1], base, given)
    waves = jnp.fft.rfft(made.curves, axis=1)[:, HARMONICS] / POINTS * jnp.exp(1j * HARMONICS * values[-1])
    apart = (waves - given.waves) * given.weights * PHASED
    size = (jnp.sqrt(jnp.abs(waves) ** 2 + 1e-12) - given.sizes) * given.weights * SIZED
    turns = jnp.exp(2j * jnp.pi * HARMONICS[:SLOW, None] * jnp.arange(POINTS) / POINTS)
    smooth = -2.0 * jnp.real(waves[RATES, :SLOW] @ turns)
    around = jnp.concatenate([made.force[:, -9:], made.force[:, :10]], axis=1)
    ends = [extreme(smooth[SEGMENTS.index(segment)]) for segment in ("shank", "thigh", "foot")
            for extreme in (jnp.max, jnp.min)]  # fmt: skip
    peaks = (jnp.stack([*ends, *around.max(axis=1)]) - given.peaks) * given.peak_weights
    fast = jnp.abs(jnp.fft.rfft(made.curves[jnp.asarray(RATES[:2])], axis=1)[:, FAST] / POINTS) + 1e-9
    fast = fast * (FAST / FAST[0]) ** ORDER / FOLLOWED
    usual = jnp.asarray(POSTURE)
    posture = (jnp.degrees(made.posture) - usual[:, 0]) / usual[:, 1]
    return jnp.concatenate([apart.real.ravel(), apart.imag.ravel(), size.ravel(), peaks, fast.ravel(), posture])


def phase(values: np.ndarray, base: Any, given: Target) -> float:
    """The phase [rad] at which the shank's simulated rate is most like the recorded one."""
    row = CURVES.index(("shank", "pitch"))
    return late(given.waves[row], harmonics(np.asarray(_stride(jnp.asarray(values), base, given).curves[row])))


_stride = jax.jit(stride)
_apart = jax.jit(residuals)
_sloped = jax.jit(lambda x, *about: (residuals(x, *about), jax.jacfwd(residuals)(x, *about)))


def slopes_of(given: Target) -> np.ndarray:
    """(3,) one, and the length and the rate of the stride beside the usual ones."""
    who = Person(
        Body(*(length * given.leg / LEG for length in Body())),
        Gait(stride_length=given.stride_length, stride_time=given.stride_time),
    )
    return np.array([1.0, *map(float, shapes.pace(who))])


def fit(people: list[Target], base: Any) -> np.ndarray:
    """(3, COUNT) mean and slopes, in prior standard deviations of `free`.

    In the first run, with an empty table of the feet, the pelvis stays; in the second one the times in the motion of
    the feet do.
    """
    values = np.zeros((3, COUNT))
    precision = np.repeat(np.array(STEADY)[:, None], COUNT, axis=1)
    _, when, pelvis = (slice(end - count, end) for count, end in zip(COUNTS[:3], np.cumsum(COUNTS[:3]), strict=True))
    precision[1:, when.start : pelvis.stop] = 1e6
    precision[0, when if np.any(base) else pelvis] = 1e6
    precision[2, : len(GAIT)] = 1e6  # parameters of the gait follow the length of the stride alone, and not all do
    precision[1, [list(GAIT).index(name) for name in GAIT if name not in GROWS]] = 1e6
    precision = precision.ravel()
    shares = [slopes_of(one) for one in people]
    phases = np.array([phase(share @ values, base, one) for share, one in zip(shares, people, strict=True)])
    damping = 0.1

    def cost_of(values: np.ndarray, phases: np.ndarray) -> float:
        own = [
            np.asarray(_apart(np.append(share @ values, at), base, one))
            for share, at, one in zip(shares, phases, people, strict=True)
        ]
        return float(sum(r @ r for r in own) + precision @ values.ravel() ** 2)

    cost = cost_of(values, phases)
    for _ in range(MOST):
        curvature, slope, parts = np.diag(precision), -precision * values.ravel(), []
        for share, at, one in zip(shares, phases, people, strict=True):
            r, own = map(np.asarray, _sloped(np.append(share @ values, at), base, one))
            along, rest = own[:, -1], np.concatenate([own[:, :-1] * part for part in share], axis=1)
            parts.append((along, rest, r))
            # Each person's own phase is eliminated.
            curvature += rest.T @ (rest - np.outer(along, along @ rest) / (along @ along))
            slope -= rest.T @ (r - along * (along @ r) / (along @ along))
        while damping < 1e3:
            step = np.clip(np.linalg.solve(curvature + damping * np.diag(np.diag(curvature)), slope), -0.8, 0.8)
            turned = np.array([-(along @ (r + rest @ step)) / (along @ along) for along, rest, r in parts])
            tried = values + step.reshape(values.shape)
            after = cost_of(tried, phases + turned)
            if after < cost:
                break
            damping *= 4.0
        print(f"cost {cost:.1f}, after a step {after:.1f}", flush=True)
        if not after < cost:
            break
        gain, cost = (cost - after) / cost, after
        values, phases, damping = tried, phases + turned, max(damping / 4.0, 1e-3)
        if gain < ENOUGH:
            break
    return values


def styles(people: list[Target], base: Any, values: np.ndarray, count: int) -> np.ndarray:
    """(count, COUNT) principal directions in which people differ, one standard deviation long."""
    parts, apart = [], []
    for one in people:
        own = slopes_of(one) @ values
        r, slopes = map(np.asarray, _sloped(np.append(own, phase(own, base, one)), base, one))
        along, rest = slopes[:, -1], slopes[:, :-1]
        parts.append(rest.T @ (rest - np.outer(along, along @ rest) / (along @ along)))
        apart.append(np.linalg.solve(parts[-1] + np.eye(COUNT), -rest.T @ (r - along * (along @ r) / (along @ along))))
    # Directions are ordered by what they change in the signals.
    root = np.linalg.cholesky(sum(parts) / len(parts) + 1e-2 * np.eye(COUNT))
    differences = (np.array(apart) - np.mean(apart, axis=0)) @ root / np.sqrt(len(apart) - 1.0)
    _, size, directions = np.linalg.svd(differences, full_matrices=False)
    print("share of the differences between people:", (size**2 / np.sum(size**2))[: count + 2].round(2))
    return size[:count, None] * np.linalg.solve(root.T, directions[:count].T).T


def main() -> None:
    """Fit, and write the file."""
    people, now = targets([one for one, _ in known().values()]), tables()
    base = now["feet"][0]
    values = fit(people, base)
    directions = styles(people, base, values, len(shapes.STYLES))
    factors, times, pelvis, *mean = free(values[0], base)
    blocks = [mean] + [
        [moved - part for moved, part in zip(free(values[0] + one, base)[3:], mean, strict=True)]
        for one in (*values[1:], *directions)
    ]
    feet, skin = (np.array([np.asarray(block[i]) for block in blocks]) for i in range(2))
    gait = {name: float(f"{now['gait'][name] * float(factor):.4g}") for name, factor in factors.items()}
    grow = {name: values[1, list(GAIT).index(name)] * GAIT[name] / shapes.UNIT for name in GROWS}
    powers = {name: round(power + float(grow.get(name, 0.0)), 2) for name, power in now["powers"].items()}
    when = {name: float(f"{number * float(times.get(name, 1.0)):.4g}") for name, number in now["instants"].items()}
    print(gait, when, powers)
    derived = {"gait": gait, "instants": when, "powers": powers, "pelvis": np.asarray(pelvis)}
    write(now | derived | {"feet": feet, "skin": skin})


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    main()
