"""Energy against error: schedules found by gradient, for one person or a cohort, and the front of the best ones.

A plan is an on-time and an off-time, in units of each person (a stride, or seconds). It is unknown where in the
gait a schedule begins, so it begins anywhere in its period. For each price of energy `power_descent` follows an
objective downhill; the plan is rounded to whole samples and judged on other walks, by the filler
itself under boolean masks. A plan that another plan beats in both power and error is left out.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from experiments.udaya2010.power_descent import Plan, Settings, Stack, descents
from jgait.duty_cycle import fillers as gap_fillers
from jgait.duty_cycle import power
from jgait.duty_cycle.fillers import NEIGHBOURS, Neighbours
from jgait.duty_cycle.filling import Filler, Thigh
from jgait.duty_cycle.power import GYROSCOPE, Masks, Schedule, Sensor

USUAL = Settings()
"""The default settings of a descent."""


class Shank(NamedTuple):
    """A walk of one shank, its gyroscope always on.

    Attributes:
        rate: (T,) sagittal rate [rad/s].
        acc: (T, 3) specific force [m/s²].
        begin: sample at which a schedule begins, and errors and energy count; before it all is measured.
        unit: of a plan's times [s]: the person's stride, or 1.
        thigh: its signals, if worn.
    """

    rate: Any
    acc: Any
    begin: int
    unit: float = 1.0
    thigh: Thigh | None = None


class Point(NamedTuple):
    """A plan, judged.

    Attributes:
        price: λ it was found with [1].
        plan: found.
        filler: parameters of the neighbours, found with it or as given.
        duty: part of the time that is measured [1].
        power: mean power on the walks that judge, wake-ups included [W].
        saving: part of the power of always on that is saved [1].
        error: root mean square of the judging walks' relative errors [1].
        seen: the same on the walks of the descent [1].
    """

    price: float
    plan: Plan
    filler: Neighbours
    duty: float
    power: float
    saving: float
    error: float
    seen: float


def alone(neighbours: Neighbours) -> Filler:
    """The neighbours alone, trusted as soon as one stride was measured: a schedule begins behind `Shank.begin`."""
    return Filler(
        gap_fillers.neighbours, neighbours._replace(least_strides=1.0), gap_fillers.FILLERS["neighbours"].transforms
    )


def undominated(power: Any, error: Any) -> np.ndarray:
    """(n,) bool: which points no other one beats in power and in error both; of equal ones the first."""
    cost, off = np.asarray(power, np.float64), np.asarray(error, np.float64)
    better = (cost[None] <= cost[:, None]) & (off[None] <= off[:, None])
    strictly = better & ((cost[None] < cost[:, None]) | (off[None] < off[:, None]))
    same = better & better.T & (np.arange(len(cost))[None] < np.arange(len(cost))[:, None])
    return ~(strictly | same).any(axis=1)


def rounded(plan: Plan, unit: float, sampling_rate_hz: float, sensor: Sensor = GYROSCOPE) -> Schedule:
    """The schedule of whole samples next to a plan; on-time and off-time are at least the wake-up.

    Args:
        plan: in units.
        unit: of the person [s].
        sampling_rate_hz: of the samples [Hz].
        sensor: that has to follow it.
    """
    least = max(1, power.wake_samples(sensor, sampling_rate_hz))
    on, off = (max(least, round(float(part) * unit * sampling_rate_hz)) for part in plan)
    return Schedule(on, off, 1.0 / sampling_rate_hz)


def masks_of(
    plan: Plan, shank: Shank, sampling_rate_hz: float, phase: float = 0.0, sensor: Sensor = GYROSCOPE
) -> Masks:
    """(T,) of the rounded plan: all is measured up to `begin`, where so much of the period [1] is already over."""
    schedule = rounded(plan, shank.unit, sampling_rate_hz, sensor)
    late = round(phase * (schedule.on + schedule.off))
    found = power.masks(schedule, late + len(shank.rate) - shank.begin, sampling_rate_hz, sensor)
    return Masks(*(np.concatenate([np.ones(shank.begin, bool), mask[late:]]) for mask in found))


def judge(
    plan: Plan, shanks: Sequence[Shank], sampling_rate_hz: float, filler: Filler, *, phases: int = 4,
    sensor: Sensor = GYROSCOPE,
) -> tuple[float, float]:  # fmt: skip
    """Error and power of the rounded plan, by boolean masks and the filler itself.

    Args:
        plan: to be judged.
        shanks: walks.
        sampling_rate_hz: of the samples [Hz].
        filler: any; its parameters state how many strides must be measured before it fills.
        phases: places of its period, evenly apart, at which it begins.
        sensor: that follows it.

    Returns:
        Root mean square of the relative errors [1], and mean power [W], over walks and phases.
    """
    errors, powers = [], []
    worn = _alike(shanks)
    used = [[masks_of(plan, shank, sampling_rate_hz, k / phases, sensor) for k in range(phases)] for shank in shanks]
    stack = _signals(shanks)
    for k in range(phases):
        usable = _padded([own[k].usable for own in used])
        filled = _filled(*stack, usable, filler.params, fill=filler.fill, rate_hz=sampling_rate_hz, thigh=worn)
        for row, shank, own in zip(np.asarray(filled), shanks, used, strict=True):
            true = np.asarray(shank.rate)[shank.begin :]
            off = row[shank.begin : len(shank.rate)] - true
            errors.append(np.mean(off**2) / np.mean(true**2))
            part = Masks(*(mask[shank.begin :] for mask in own[k]))
            powers.append(float(power.mask_energy(part, sampling_rate_hz, sensor)) * sampling_rate_hz / len(true))
    return float(np.sqrt(np.mean(errors))), float(np.mean(powers))


def pareto(
    shanks: Sequence[Shank], judged: Sequence[Shank], prices: Sequence[float], sampling_rate_hz: float,
    filler: Callable[[Neighbours], Filler] = alone, *, neighbours: Neighbours = NEIGHBOURS,
    settings: Settings = USUAL, phases: int = 4, sensor: Sensor = GYROSCOPE, seed: int = 0,
) -> list[Point]:  # fmt: skip
    """The best plans of a person or a cohort, one for each price, judged on other walks; dominated ones left out.

    Args:
        shanks: walks that plans are found on, of one person or of many; all with a thigh's signals, or none.
        judged: walks that judge them.
        prices: λ: what all of the gyroscope's power is worth, in error [1]. Of the order of 0.02 to 2.
        sampling_rate_hz: of the samples [Hz].
        filler: the one that judges, given the neighbours' parameters of a plan: they alone, or
            `ridge.blend` with them, or any other.
        neighbours: parameters of the neighbours, which fill while plans are looked for; where
            `settings.fit_filler` is set, what they start from.
        settings: of the descent.
        phases: see `judge`.
        sensor: that is switched.
        seed: of the walks and phases that each step looks at.

    Returns:
        Points by rising power.

    Raises:
        ValueError: if there are no walks or prices, a price is not positive, or `begin` is not inside a walk.
    """
    check(shanks, judged, prices)
    stack = _stacked(shanks)
    least = 1.02 * sensor.wake_up / min(shank.unit for shank in shanks)
    found = jax.tree.map(
        np.asarray,
        descents(
            stack, jnp.asarray(prices), jax.random.key(seed), neighbours,
            sampling_rate_hz=sampling_rate_hz, settings=settings, sensor=sensor, least=max(least, 1e-3),
        ),
    )  # fmt: skip
    points = []
    for k, price in enumerate(prices):
        best = int(np.nanargmin(found[1][k]))
        free = jax.tree.map(lambda leaf, k=k, best=best: leaf[k, best].item(), found[0])
        own = free.filler if settings.fit_filler else neighbours
        by = filler(own)
        seen, _ = judge(free.plan, shanks, sampling_rate_hz, by, phases=phases, sensor=sensor)
        error, drawn = judge(free.plan, judged, sampling_rate_hz, by, phases=phases, sensor=sensor)
        duty = free.plan.on / (free.plan.on + free.plan.off)
        points.append(Point(price, free.plan, own, duty, drawn, 1.0 - drawn / sensor.on, error, seen))
    keep = undominated([p.power for p in points], [p.error for p in points])
    return sorted((p for p, good in zip(points, keep, strict=True) if good), key=lambda p: p.power)


def check(shanks: Sequence[Shank], judged: Sequence[Shank], prices: Sequence[float]) -> None:
    """Refuse what no plan can be found or judged on; raises as `pareto`."""
    if not shanks or not judged or not prices:
        raise ValueError("pareto needs walks to find plans on, walks to judge them, and prices; one of them is empty")
    if not all(np.isfinite(price) and price > 0.0 for price in prices):
        raise ValueError(f"a price must be positive and finite; got {list(prices)}")
    for shank in (*shanks, *judged):
        if not 0 < shank.begin < len(shank.rate):
            raise ValueError(f"begin must lie inside the walk of {len(shank.rate)} samples, after 0; got {shank.begin}")
        if not (np.isfinite(shank.unit) and shank.unit > 0.0):
            raise ValueError(f"unit must be a positive number of seconds; got {shank.unit!r}")


def _alike(shanks: Sequence[Shank]) -> bool:
    """Whether thighs are worn: on all walks, or on none."""
    worn = {shank.thigh is not None for shank in shanks}
    if len(worn) != 1:
        raise ValueError("either all walks have a thigh's signals, or none; some have")
    return worn.pop()


def _padded(parts: Sequence[Any]) -> Array:
    longest = max(len(part) for part in parts)
    rows = [np.asarray(part) for part in parts]
    return jnp.stack([jnp.asarray(np.pad(r, [(0, longest - len(r))] + [(0, 0)] * (r.ndim - 1), "edge")) for r in rows])


def _signals(shanks: Sequence[Shank]) -> tuple[Array, Array, Thigh | None]:
    """Rate, accelerometer and thigh, padded to one length."""
    above = [shank.thigh for shank in shanks if shank.thigh is not None]
    thigh = Thigh(_padded([t.rate for t in above]), _padded([t.acc for t in above])) if above else None
    return _padded([s.rate for s in shanks]), _padded([s.acc for s in shanks]), thigh


@partial(jax.jit, static_argnames=("fill", "rate_hz", "thigh"))
def _filled(
    rate: Array, acc: Array, above: Thigh | None, usable: Array, p: Any, *, fill: Any, rate_hz: float, thigh: bool
) -> Array:
    del thigh  # whether there is one is in `above`

    def one(r: Array, u: Array, a: Array, t: Thigh | None) -> Array:
        return fill(jnp.where(u, r, 0.0), u, a, rate_hz, p, thigh=t).rate

    return jax.vmap(one)(rate, usable, acc, above)


def _stacked(shanks: Sequence[Shank]) -> Stack:
    """Walks of one length, and how far apart their samples are in each group of signals, scales left out."""
    _alike(shanks)
    rate, acc, above = _signals(shanks)
    groups = [acc] if above is None else [acc, above.rate[:, :, None], above.acc]
    dtype = rate.dtype
    return Stack(
        rate,
        jnp.stack([jax.vmap(_squares)(group) for group in groups], axis=1).astype(dtype),
        jnp.asarray([shank.begin for shank in shanks]),
        jnp.asarray([len(shank.rate) for shank in shanks]),
        jnp.asarray([shank.unit for shank in shanks], dtype),
    )


def _squares(signals: Array) -> Array:
    """(T, T) square differences between the samples of (T, k)."""
    own = (signals**2).sum(axis=1)
    return jnp.maximum(own[:, None] + own[None, :] - 2.0 * signals @ signals.T, 0.0)
