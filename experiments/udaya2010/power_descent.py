r"""The descent behind `power_tradeoff`: errors under on-times with soft edges, and schedules found by gradient.

Under on-fractions u between 0 and 1 (`relaxed.relaxed_masks`) a neighbour counts by its fraction,
and a sample is measured with probability u,

    w_{t,j} = u_j exp(−½ max(q_{t,j} − m_t, 0) / (h² (m_t + ε))),   m_t = min_j q_{t,j} / u_j,
    e² = Σ_t (1 − u_t) (Σ_j w_{t,j} ω_j / Σ_j w_{t,j} − ω_t)² / Σ_t ω_t²,

which at u of 0 and 1 is the error of the filler itself. With the mean power p of `relaxed.relaxed_power` over that of
always on, and a price λ,

    J = (E^n + (λ p)^n)^{1/n},   E² = mean of e² over the walks

is followed downhill from several starts while the edges of the on-times sharpen. n = 1 is the weighted sum, which
reaches only the convex part of a front; a large n reaches all of it: at its optimum E ≈ λ p.
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax
from jax import Array, lax

from experiments.udaya2010.relaxed import relaxed_masks, relaxed_power
from jgait import params
from jgait.duty_cycle import fillers as gap_fillers
from jgait.duty_cycle.fillers import Neighbours
from jgait.duty_cycle.power import Sensor

SHARPNESS = (0.12, 0.02)
"""[s] Width of the on-times' edges at the start of a descent and at its end."""


class Plan(NamedTuple):
    """On-time and off-time in units of each person [1]."""

    on: Any
    off: Any


class Settings(NamedTuple):
    """How the descent goes; static.

    Attributes:
        steps: of each descent.
        batch: walks looked at in a step, drawn at random.
        every: every so many samples' errors are looked at.
        rate: of Adam at the start, falling to 0, in free coordinates.
        norm: n of the objective [1].
        periods: on-time and off-time together at the starts [units].
        longest: on-time and off-time that are allowed [units].
        fit_filler: whether the neighbours' kernel and history are found with the plan.
    """

    steps: int = 80
    batch: int = 4
    every: int = 3
    rate: float = 0.1
    norm: float = 8.0
    periods: tuple[float, ...] = (0.8, 1.4, 2.6)
    longest: float = 5.0
    fit_filler: bool = False


class Stack(NamedTuple):
    """Walks of one length: (L, T) signals, (L, g, T, T) square differences of each group of signals, (L,) the rest."""

    rate: Any
    apart: Any
    begin: Any
    end: Any
    unit: Any


class Free(NamedTuple):
    """What is found."""

    plan: Plan
    filler: Neighbours


def distances(apart: Array, p: Neighbours, dt: Any) -> Array:
    """Distances q of `duty_cycle.fillers` between the histories of all samples, from square differences of
    signals.

    Args:
        apart: (g, T, T) of the accelerometer alone, or of it, the thigh's rate and the thigh's accelerometer.
        p: parameters of the neighbours.
        dt: interval of the samples [s].

    Returns:
        (T, T); only entries left of the diagonal mean something.
    """
    scales = (p.acc_scale, p.thigh_rate_scale, p.thigh_acc_scale)
    now = sum(group / scale**2 for group, scale in zip(apart, scales, strict=False))
    keep = jnp.exp(-dt / p.history_s)

    def step(before: Array, row: Array) -> tuple[Array, Array]:
        sums = row + keep * jnp.concatenate([jnp.zeros_like(before[:1]), before[:-1]])
        return sums, sums

    sums = lax.scan(step, jnp.zeros_like(now[0]), now)[1]
    # A history is as long as the earlier of the two samples has samples before it.
    count = jnp.arange(1, len(now) + 1, dtype=now.dtype)
    weight = -jnp.expm1(-dt / p.history_s * count) / -jnp.expm1(-dt / p.history_s)
    return sums / weight[None] + p.short * (1.0 - (1.0 - keep) * weight[None])


def relaxed_error(usable: Array, rate: Array, far: Array, rows: Array, judged: Array, p: Neighbours) -> Array:
    """e² of the neighbours under on-fractions.

    Args:
        usable: (T,) on-fractions [1]; 1 before the schedule begins.
        rate: (T,) [rad/s].
        far: (T, T) from `distances`.
        rows: (n,) samples that are looked at.
        judged: (n,) bool, which of them count.
        p: parameters of the neighbours.

    Returns:
        Mean square error over mean square rate [1].
    """
    before = jnp.arange(len(rate))[None] < rows[:, None]
    kept = jnp.maximum(usable, 1e-6)
    apart = far[rows]
    nearest = jnp.min(jnp.where(before, apart / kept[None], 1e6), axis=1, keepdims=True)
    further = jnp.maximum(apart - nearest, 0.0) / (p.bandwidth**2 * (nearest + p.floor))
    kernel = jnp.where(before, kept[None] * jnp.exp(-0.5 * further), 0.0)
    told = kernel @ rate / jnp.maximum(kernel.sum(axis=1), 1e-30)
    count = judged.astype(rate.dtype)
    off = (1.0 - usable[rows]) * (told - rate[rows]) ** 2
    return (count * off).sum() / (count * rate[rows] ** 2).sum()


def _error(free: Free, walk: Stack, phase: Any, softness: Any, dt: float, every: int, sensor: Sensor) -> Array:
    """e² of one walk of a stack under a plan."""
    samples = jnp.arange(len(walk.rate))
    on, period = free.plan.on * walk.unit, (free.plan.on + free.plan.off) * walk.unit
    time = (samples - walk.begin).astype(walk.rate.dtype) * dt + phase * period
    usable = relaxed_masks(time, on / period, period, sensor, softness=softness).usable
    usable = jnp.where(samples < walk.begin, 1.0, usable)
    rows = samples[::every]
    judged = (rows >= walk.begin) & (rows < walk.end)
    return relaxed_error(usable, walk.rate, distances(walk.apart, free.filler, dt), rows, judged, free.filler)


def _objective(
    free: Free, price: Any, walks: Stack, phases: Array, softness: Any, dt: float, settings: Settings, sensor: Sensor
) -> Array:
    """J over some walks, each with a phase of its own."""

    def one(walk: Stack, phase: Any) -> tuple[Array, Array]:
        period = (free.plan.on + free.plan.off) * walk.unit
        duty = free.plan.on / (free.plan.on + free.plan.off)
        drawn = relaxed_power(duty, period, sensor, softness=softness) / sensor.on
        return _error(free, walk, phase, softness, dt, settings.every, sensor), drawn

    squares, drawn = jax.vmap(one)(walks, phases)
    return traded(squares.mean(), drawn.mean(), price, settings.norm)


def traded(square: Any, drawn: Any, price: Any, norm: float) -> Array:
    """J of a mean square relative error [1] and a part of the power of always on [1]."""
    both = jnp.stack([jnp.sqrt(square + 1e-12), price * drawn])  # no infinite slope where nothing is filled
    top = both.max()
    return top * ((both / top) ** norm).sum() ** (1.0 / norm)


@partial(jax.jit, static_argnames=("sampling_rate_hz", "settings", "sensor", "least"))
def descents(
    stack: Stack, prices: Array, key: Any, neighbours: Neighbours, *, sampling_rate_hz: float, settings: Settings,
    sensor: Sensor, least: float,
) -> tuple[Free, Array]:  # fmt: skip
    """Every price from every start: (P, S) of what is found, and the objective over all walks."""
    dt, count = 1.0 / sampling_rate_hz, len(stack.rate)
    bounds = params.interval(least, settings.longest)
    fit = ("history_s", "bandwidth", "short", "thigh_rate_scale", "thigh_acc_scale") if settings.fit_filler else ()
    fixed = Neighbours(*(params.fixed,) * len(Neighbours._fields))
    transforms = Free(
        Plan(bounds, bounds),
        fixed._replace(**{name: getattr(gap_fillers.FILLERS["neighbours"].transforms, name) for name in fit}),
    )
    base = Free(Plan(jnp.ones_like(prices[0]), jnp.ones_like(prices[0])), neighbours)

    def pace(number: Any) -> Array:
        share = jnp.asarray(number).astype(prices.dtype) / settings.steps
        return 0.5 * settings.rate * (1.0 + jnp.cos(jnp.pi * share))

    optimiser = optax.adam(pace)
    looked = min(settings.batch, count)

    def natural(free: Any) -> Free:
        return params.constrain(free, transforms, base)

    def descend(price: Any, half: Any) -> tuple[Free, Array]:
        start = base._replace(plan=Plan(half, half))
        free = params.unconstrain(start, transforms)

        def step(carry: Any, sample: Any) -> tuple[Any, None]:
            now, state = carry
            number, own = sample
            chosen, where = jax.random.split(own)
            some = jax.tree.map(lambda leaf: leaf[jax.random.permutation(chosen, count)[:looked]], stack)
            phases = jax.random.uniform(where, (looked,), prices.dtype)
            softness = SHARPNESS[0] * (SHARPNESS[1] / SHARPNESS[0]) ** (number / settings.steps)
            slope = jax.grad(lambda f: _objective(natural(f), price, some, phases, softness, dt, settings, sensor))(now)
            slope = jax.tree.map(lambda g: jnp.where(jnp.isfinite(g), g, 0.0), slope)
            with jax.numpy_dtype_promotion("standard"):  # optax counts steps in integers
                change, state = optimiser.update(slope, state, now)
            return (optax.apply_updates(now, change), state), None

        steps = (jnp.arange(settings.steps, dtype=prices.dtype), jax.random.split(key, settings.steps))
        free, _ = lax.scan(step, (free, optimiser.init(free)), steps)[0]
        return natural(free), _whole(natural(free), price, stack, dt, settings, sensor)

    halves = jnp.clip(0.5 * jnp.asarray(settings.periods, prices.dtype), 1.01 * least, 0.99 * settings.longest)
    return jax.vmap(lambda price: jax.vmap(lambda half: descend(price, half))(halves))(prices)


def _whole(free: Free, price: Any, stack: Stack, dt: float, settings: Settings, sensor: Sensor) -> Array:
    """J over all walks and four phases, one walk after another."""
    phases = jnp.arange(4, dtype=stack.rate.dtype) / 4.0

    def one(walk: Stack) -> Array:
        return jax.vmap(lambda phase: _error(free, walk, phase, SHARPNESS[1], dt, settings.every, sensor))(
            phases
        ).mean()

    squares = lax.map(one, stack)
    total = free.plan.on + free.plan.off
    drawn = relaxed_power(free.plan.on / total, total * stack.unit, sensor, softness=SHARPNESS[1]) / sensor.on
    return traded(squares.mean(), drawn.mean(), price, settings.norm)
