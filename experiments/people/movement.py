"""The fit of simulated strides to those of recorded people: their mean, its slopes, and in what people differ.

Compared are the rates of shank, thigh and foot and the sizes of their specific forces over a stride, in harmonics: a
difference counts over the standard deviation between people. Above `JITTER` harmonics people differ more in phase than
in size, so the size of single strides counts there. Peaks that are figures of gait count as well, and hip and knee at
landing, which rates leave open. Free are parameters of the gait, the table of the feet and the low harmonics of the
pelvis, around those of recorded lower backs; all have a slope over the length of the stride, and the tables over its
rate. The mean and the slopes are found by Gauss-Newton's method; a last step for each person alone gives what this
person differs by. The principal directions of these differences are the styles.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.polynomial import chebyshev

from experiments.people.legs import legs_of
from experiments.simulator.gait import Truth, figures
from experiments.simulator.simulated import SETS, Set, curves, names_of, sensors_of
from jgait import datasets, simulate
from jgait.geometry.segments import Motion, Segments
from jgait.simulate import RECORDED, Body, Gait, Person, shapes
from jgait.simulate.population import manner
from jgait.simulate.shapes import Movement
from jgait.simulate.walker import Frames, moved, planned, ticks
from jgait.simulate.worn import felt
from jgait.types import SIDES, Values

GAIT = {
    "toe_up": 0.25, "heel_up": 0.2, "foot_flat": 0.25, "heel_off": 0.12, "swing_lift": 0.5, "landing_speed": 0.4,
    "hip_ahead": 0.6, "knee_stance": 0.12, "pelvis_rise": 0.2,
}  # fmt: skip
"""Free parameters of the gait → prior standard deviation of their logarithm."""
FEET, TERMS = (0.15, 0.3, 0.05, 0.5), 11
"""[1] Prior standard deviations of the four rows of the table of the feet, and the number of their polynomials."""
PELVIS = {0: 7, 1: 7}
"""Row → number of free harmonics of the table of the pelvis; its turns and its sway are those of lower backs."""
LOOSE = 1.0
"""[1] Prior deviation of a number of the pelvis over the deviation between people."""
CURVES = ("shank", "thigh", "foot", "shank_acc", "thigh_acc", "foot_acc")
PEAKS = ("shank_swing", "shank_back", "thigh_forward", "thigh_back", "foot_swing", "foot_push_off", "shank_strike",
         "foot_strike")  # fmt: skip
LANDING = ((5.0, 4.0), (27.0, 6.0), (20.0, 4.0))
"""[°] Flexion of knee and hip and pitch of the foot at landing, and how far people are from it."""
POINTS, HARMONICS, JITTER = 100, 24, 6
STEADY = {"feet": (0.15, 2.0, 2.0), "pelvis": (1.5, 4.0, 4.0), "skin": (0.15, 2.0, 2.0)}
"""[1] Prior precision of mean and slopes, in the priors above; the feet's is also that of the gait."""
MOST, ENOUGH = 10, 3e-3
"""Iterations at most; relative gain of the cost below which they end."""

KNOWN = SETS[-1]
"""A set of people to whom the tables are fitted."""
LEG = Body().thigh_length + Body().shank_length
SKIN = (0.4, 2.0, 2.0)
"""[rad/s, m/s², m/s²] Prior deviations of the rate and the accelerations of skin over bone, in each harmonic, at one
stride a second."""
FIRST, LAST = 2, 24
"""[1] First and last free harmonic of the skin."""
COUNT = len(GAIT) + len(FEET) * TERMS + 2 * sum(PELVIS.values()) + 12 * (LAST - FIRST + 1)


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


class Base(NamedTuple):
    """Tables around which the fit begins: of feet and pelvis, and the deviation between people of the latter."""

    feet: np.ndarray
    pelvis: np.ndarray
    spread: np.ndarray


class Recorded(NamedTuple):
    """What a walk has: number of strides, harmonics of the mean stride, their sizes in single strides, medians of the
    figures of gait, length of the leg [m]."""

    strides: int
    waves: dict[str, np.ndarray]
    sizes: dict[str, np.ndarray]
    medians: dict[str, float]
    leg: float


def recorded(given: Set) -> dict[str, Recorded]:
    """Of each walk of a set."""
    found = {}
    for walk in datasets.load(given.name, names_of(given)):
        legs = list(legs_of(walk, given)) if walk.reference is not None else []
        known = Truth(None if walk.reference is None else walk.reference.distance)
        pooled: dict[str, list[np.ndarray]] = {}
        for leg in legs:
            about = (leg.sensors, given.rate_hz, leg.windows, known)
            own = curves(*about, trim=leg.trim, good=leg.good)
            of = {**own, **{f"of_{k}": v for k, v in figures(*about, trim=leg.trim, good=leg.good)._asdict().items()}}
            for name, values in of.items():
                pooled.setdefault(name, []).append(values)
        joined = {name: np.concatenate(values) for name, values in pooled.items()}
        medians = {name[3:]: float(np.median(v)) for name, v in joined.items() if name.startswith("of_") and len(v)}
        each = {
            name: np.fft.rfft(joined[name][:, :-1], axis=1)[:, : HARMONICS + 1] / POINTS
            for name in CURVES if name in joined and len(joined[name])
        }  # fmt: skip
        if "shank" in each and "stride_length" in medians:
            lengths = walk.info.get("lengths")
            found[walk.recording.name] = Recorded(
                len(each["shank"]), {name: one.mean(axis=0) for name, one in each.items()},
                {name: np.sqrt(np.mean(np.abs(one) ** 2, axis=0)) for name, one in each.items()}, medians,
                LEG if lengths is None else float(np.mean([sum(lengths[side]) for side in SIDES])),
            )  # fmt: skip
    return found


def known() -> dict[str, tuple[Recorded, Set]]:
    """Walk → what it has, and its set: of every second person of `walking5m`, to whom the tables are fitted."""
    sets = [given for given in SETS if given.name == KNOWN.name]
    every = {name: (one, given) for given in sets for name, one in recorded(given).items()}
    return {name: every[name] for name in list(every)[::2]}


def targets(people: list[Recorded]) -> list[Target]:
    """What the fit compares; weights are one over the deviation between people."""
    weights, peak_weights = {}, {}
    for name in CURVES:
        own = np.array([one.waves[name] for one in people if name in one.waves])
        size = np.sqrt(np.mean(np.sum(np.abs(own[:, 1:]) ** 2, axis=1)))
        weights[name] = (0.7 if name.endswith("acc") else 1.0) / (own.std(axis=0) + 0.02 * size)
        weights[name][0] = 0.5 / own.std(axis=0)[0] if name.endswith("acc") else 0.0
    for name in PEAKS:
        peak_weights[name] = 1.2 / np.std([one.medians[name] for one in people if name in one.medians])
    none = np.zeros(HARMONICS + 1)
    return [
        Target(
            one.medians["stride_time"], one.medians["stride_length"], one.leg,
            np.stack([one.waves.get(name, none + 0j) for name in CURVES]),
            np.stack([one.sizes.get(name, none) for name in CURVES]),
            np.stack([weights[name] if name in one.waves else none for name in CURVES]),
            np.array([one.medians.get(name, 0.0) for name in PEAKS]),
            np.array([peak_weights[name] if name in one.medians else 0.0 for name in PEAKS]),
        )
        for one in people
    ]  # fmt: skip


MONOMIALS = np.array([
    np.pad(chebyshev.cheb2poly(np.eye(TERMS)[i]), (0, TERMS - 1 - i)) for i in range(TERMS)
])  # fmt: skip
"""Coefficients of 1, x, x² … of each of Chebyshev's polynomials, in which the fit counts."""


def free(values: Any, base: Base) -> tuple[dict[str, Any], Any, Any, Any]:
    """Factors of the gait, and the tables of feet, pelvis and skin, from numbers in prior standard deviations."""
    ends = np.cumsum([len(GAIT), len(FEET) * TERMS])
    ends = np.append(ends, ends[-1] + 2 * sum(PELVIS.values()))
    of_gait, of_feet, of_pelvis, of_skin = jnp.split(values, ends)
    factors = {name: jnp.exp(of_gait[i] * spread) for i, (name, spread) in enumerate(GAIT.items())}
    fine = np.asarray(FEET)[:, None] / (1.0 + 0.15 * np.arange(TERMS))
    feet = base.feet + (of_feet.reshape(fine.shape) * fine) @ MONOMIALS
    pelvis, number = jnp.asarray(base.pelvis), 0
    for row, harmonics in PELVIS.items():
        for column in range(harmonics):
            for at in (column, column + shapes.HARMONICS):
                pelvis = pelvis.at[row, at].add(of_pelvis[number] * LOOSE * base.spread[row, column])
                number += 1
    turn = 2.0 * np.pi * np.arange(FIRST, LAST + 1)
    one = np.stack([SKIN[0] / turn, SKIN[1] / turn**2, SKIN[2] / turn**2])
    skin = of_skin.reshape(2, 3, 2, -1) * one[:, None]
    whole = jnp.pad(skin, ((0, 0), (0, 0), (0, 0), (FIRST - 1, 2 * shapes.HARMONICS - LAST)))
    table = jnp.asarray(shapes.SKIN[0]).reshape(3, len(shapes.WORN), -1)
    table = table.at[:2, : len(SKIN)].set(whole.reshape(2, len(SKIN), -1))
    return factors, feet, pelvis, table.reshape(shapes.SKIN[0].shape)


def usual(leg: Values, stride_time: Values, stride_length: Values) -> Person:
    """The usual person with a length of the leg [m] at a stride [s], [m]."""
    gait = RECORDED._replace(
        steps=8.0, quiet_before=0.5, soft_tissue=1.0, stride_length=stride_length, stride_time=stride_time,
        **manner(stride_length / leg, RECORDED),
    )  # fmt: skip
    return Person(Body(*(length * leg / LEG for length in Body())), gait)


def walked_stride(who: Person, shape: Movement) -> tuple[tuple[Values, Values], Motion[Frames]]:
    """Rates and forces at shank, thigh and foot, and the motion, in a stride of the right leg."""
    laid, _ = planned(jax.random.key(0), who, simulate.straight(30.0), 8, shape)
    time = laid.contact[4] + who.gait.stride_time * jnp.arange(POINTS) / POINTS
    moving = moved(who, laid, *ticks(laid, time))
    placements = ("shank_right", "thigh_right", "foot_right")
    return felt(moving, sensors_of(who.body, placements, jnp.asarray([KNOWN.thigh, KNOWN.shank]))), moving


def stride(values: Any, base: Base, given: Target) -> tuple[Any, Any]:
    """(6, POINTS) curves of a simulated stride of the right leg from its landing; (3,) knee, hip, foot there [rad]."""
    factors, feet, pelvis, skin = free(values, base)
    body, gait = usual(given.leg, given.stride_time, given.stride_length)
    who = Person(body, gait._replace(**{name: getattr(gait, name) * factor for name, factor in factors.items()}))
    (gyr, acc), moving = walked_stride(who, Movement(pelvis * shapes.sizes(who), feet, skin))
    rates = -gyr[..., 1]
    thigh, shank = (moving.pose[3, :, Segments._fields.index(name), 0] for name in ("thigh_right", "shank_right"))
    hip, tilt = (jnp.arctan2(-up[0], up[2]) for up in (thigh, shank))
    foot = jnp.arcsin(moving.pose[1, 2, Segments._fields.index("foot_right"), 0])
    return jnp.concatenate([rates, jnp.sqrt(jnp.sum(acc**2, axis=-1))]), jnp.stack([hip - tilt, hip, foot])


NUMBER = np.arange(HARMONICS + 1)
PHASED = np.interp(NUMBER, [JITTER - 2, 2 * JITTER - 2], [1.0, 0.1])
SIZED = np.interp(NUMBER, [JITTER - 2, 2 * JITTER - 2], [0.0, 1.2])
"""[1] What a difference counts, and a difference in size, in each harmonic."""


def residuals(values: Any, base: Base, given: Target) -> Any:
    """Weighted differences of a simulated stride from a recorded one; the last of the values is its phase [rad]."""
    made, landing = stride(values[:-1], base, given)
    waves = jnp.fft.rfft(made, axis=1)[:, : HARMONICS + 1] / POINTS * jnp.exp(1j * NUMBER * values[-1])
    apart = (waves - given.waves) * given.weights * PHASED
    size = jnp.sqrt(jnp.abs(waves) ** 2 + 1e-12) - given.sizes
    size = size * given.weights * SIZED
    turns = jnp.exp(2j * jnp.pi * NUMBER[:, None] * jnp.arange(POINTS) / POINTS)
    smooth = 2.0 * jnp.real(waves[:3, :19].at[:, 0].multiply(0.5) @ turns[:19])
    around = jnp.concatenate([made[:, -9:], made[:, :10]], axis=1)
    ends = [extreme(smooth[i]) for i in range(3) for extreme in (jnp.max, jnp.min)]
    peaks = (jnp.stack([*ends, around[3].max(), around[5].max()]) - given.peaks) * given.peak_weights
    usual = jnp.asarray(LANDING)
    posture = (jnp.degrees(landing) - usual[:, 0]) / usual[:, 1]
    return jnp.concatenate([apart.real.ravel(), apart.imag.ravel(), size.ravel(), peaks, posture])


def phase(values: np.ndarray, base: Base, given: Target) -> float:
    """The phase [rad] at which the shank's simulated rate is most like the recorded one."""
    made = np.fft.rfft(np.asarray(_stride(jnp.asarray(values), base, given)[0][0]))
    grid = np.linspace(-np.pi, np.pi, 400)
    alike = np.exp(1j * grid[:, None] * NUMBER) @ (made[: HARMONICS + 1] * np.conj(given.waves[0]))
    return float(grid[np.argmax(alike.real)])


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


def fit(people: list[Target], base: Base, start: np.ndarray | None = None) -> np.ndarray:
    """(3, COUNT) mean and slopes, in prior standard deviations of `free`."""
    values = np.zeros((3, COUNT)) if start is None else start
    counts = len(GAIT) + len(FEET) * TERMS, 2 * sum(PELVIS.values()), 12 * (LAST - FIRST + 1)
    precision = np.repeat(np.array(list(STEADY.values())).T, counts, axis=1)
    precision[2, : len(GAIT)] = 1e6  # parameters of the gait follow the length of the stride alone, and not all do
    precision[1, [list(GAIT).index(name) for name in ("foot_flat", "heel_off", "knee_stance")]] = 1e6
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


def styles(people: list[Target], base: Base, values: np.ndarray, count: int) -> np.ndarray:
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
