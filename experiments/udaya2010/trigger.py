r"""Waking a gyroscope when the filler's own predicted error is worth the energy; causal.

`duty_cycle.fillers` fills the gaps. Beside each rate its error is predicted, now and for the stride to come,

    e²_{t,k} = s_t ρ(φ_t + k/P) + c_v g_t v_t e^{−k/τ_v} + c_x x_t e^{−k/τ_x}

in squares relative to the rate's mean square r², at the sample t + k. The parts are

    ρ(φ) = exp(a_0 + Σ_m a_m cos 2πmφ + b_m sin 2πmφ)    error of fillers at a phase of the stride: much in late swing
                                                          and as the foot lands, little while it stands
    s = ((Σ found + σ) / (Σ ρ + σ))^α                     whether this wearer's filler errs more, where it was measured
    v = Σ_j w_{t,j} (ω_{t−j} − ω̂_t)² / r²                 the neighbours' disagreement
    g = Σ found / Σ v                                     its calibration, with forgetting, where it was measured
    x                                                     the latest errors that were found: the filler runs in shadow

The phase φ runs from one begin of a swing to the next: where the filled rate, which was below zero, reaches r. P is
the mean period between. Of all ways to be on or off over the horizon the one that costs least is chosen, a measured
sample at θ², an unmeasured one at its e²: with l samples of wake-up, in which is paid and nothing measured, backwards

    on_k  = min(θ² + on_{k+1},  e²_k + off_{k+1})
    off_k = min(e²_k + off_{k+1},  l θ² + Σ_{i<l} e²_{k+i} + on_{k+l}),

and its first step is taken: what is decided after one sample holds for the next. A token bucket may bound the energy:
it gains the budgeted power, pays what the sensor draws, and neither lets it be switched on when a wake-up and as long
of measuring cannot be paid, nor stay on when it is empty.
"""

from functools import partial
from typing import Any, NamedTuple

import jax.numpy as jnp
from jax import Array, jit, lax, tree
from jax.typing import ArrayLike

from jgait.duty_cycle import fillers as gap_fillers
from jgait.duty_cycle import power
from jgait.duty_cycle.fillers import NEIGHBOURS, Neighbours
from jgait.duty_cycle.filling import PERIODS, Filled, Signals, Thigh, check_signals, finished, pushed
from jgait.duty_cycle.power import GYROSCOPE, Masks, Sensor
from jgait.params import fixed, interval, positive, real

REFRACTORY_S = 0.5
"""[s] For which no swing follows the begin of another."""


RISK = (-4.35, 0.35, 0.82, -0.51, -0.47)
"""Of walking over ground."""


class Trigger(NamedTuple):
    """Parameters of `triggered`.

    Attributes:
        wake: θ, error over the rate's root mean square from which on a sample is worth its energy [1].
        risk: (5,) a_0, a_1, b_1, a_2, b_2: logarithm of the square error over the phase of the stride [1].
        own: α, how far the risk is scaled to what this wearer's filler erred [1].
        trust: σ, of the usual scale, in sums of square errors [1].
        doubt: c_v [1].
        doubt_s: τ_v [s].
        shadow: c_x [1].
        shadow_s: τ_x [s].
        calibrate_s: time constant of g, in time measured [s].
        budget: mean power that may be drawn once it need not be on [W]; None: any.
        bucket: energy that can be saved up [J].
    """

    wake: Any = 0.2
    risk: Any = RISK
    own: Any = 0.25
    trust: Any = 0.6
    doubt: Any = 0.6
    doubt_s: Any = 0.134
    shadow: Any = 0.75
    shadow_s: Any = 0.23
    calibrate_s: Any = 2.8
    budget: Any = None
    bucket: Any = 0.06


TRIGGER = Trigger()
TRANSFORMS = Trigger(
    wake=positive, risk=(real,) * 5, own=interval(0.0, 2.0), trust=positive, doubt=positive, doubt_s=positive,
    shadow=positive, shadow_s=positive, calibrate_s=positive, budget=fixed, bucket=fixed,
)  # fmt: skip


class Triggered(NamedTuple):
    """What came of it.

    Attributes:
        filled: the rate without gaps.
        used: (T,) when the gyroscope was powered and usable; `power.mask_energy` computes the energy.
        predicted: (T,) root of the mean e² over the horizon, the expected relative error if the gyroscope stays off
            [1];
            what is decided from it holds from the next sample on.
    """

    filled: Filled
    used: Masks
    predicted: Any


class _Stride(NamedTuple):
    """Where in the stride it is; times in samples."""

    swings: Any  # whether it is in swing
    since: Any  # samples since the swing began
    period: Any
    count: Any  # swings that began


class _Sums(NamedTuple):
    """Sums over the samples that were measured; squares relative to nothing [rad²/s²] but for the last two."""

    square: Any  # of the rate
    count: Any
    found: Any  # square errors, with forgetting
    stated: Any  # disagreements, with forgetting
    erred: Any  # square errors over r², since a stride was measured
    risk: Any  # and what ρ had them


class Memory(NamedTuple):
    """The neighbours, newest first."""

    signals: Any  # (n, k) scaled
    rate: Any  # (n,) sagittal [rad/s]
    usable: Any  # (n,) whether each rate was measured
    there: Any  # (n,) False before the first sample
    distance: Any  # (n,) d of each lag
    weight: Any  # (n,) n of each lag


class _State(NamedTuple):
    """From one sample to the next."""

    filler: Memory
    on: Any  # whether the next sample is powered
    age: Any  # for how many samples it has been
    stride: _Stride
    sums: _Sums
    expected: Any  # ρ of the next sample
    shadow: Any  # x r², decaying while the gyroscope is off
    tokens: Any  # [J]


def triggered(
    rate: ArrayLike, acc: ArrayLike, sampling_rate_hz: float, params: Trigger = TRIGGER, *, must: ArrayLike,
    thigh: Thigh | None = None, sensor: Sensor = GYROSCOPE, filler: Neighbours = NEIGHBOURS, ahead_s: float = 0.96,
) -> Triggered:  # fmt: skip
    """Run the policy over a recording whose gyroscope was always on; the policy gets only samples for which it was on.

    Args:
        rate: (T,) sagittal rate of the shank [rad/s].
        acc: (T, 3) specific force of the shank [m/s²], never switched off.
        sampling_rate_hz: of the samples [Hz]; static.
        params: of the policy.
        must: (T,) bool, when the gyroscope is on regardless of the policy: a warm-up of two strides, from the first
            sample on. It is not charged to the budget. The sensor is awake at the first sample.
        thigh: signals of the thigh, if worn.
        sensor: that is switched.
        filler: parameters of the neighbours; `least_strides` is not used, since `must` states when they fill.
        ahead_s: the horizon, longer than the wake-up and about a stride [s]; static.

    Returns:
        The filled rate, the masks and the predicted error.

    Raises:
        ValueError: as `check_signals`, without accelerometer, or if `ahead_s` is not longer than the wake-up.
    """
    s = check_signals(rate, must, acc, sampling_rate_hz, thigh)
    if s.acc is None:
        raise ValueError("the filler is told from the accelerometer; acc is None")
    power.check_sensor(sensor)
    if not sensor.on > sensor.off:
        raise ValueError(f"to switch it off must save something; on takes {sensor.on!r} W, off {sensor.off!r} W")
    if not sensor.wake_up < ahead_s < 10.0:
        raise ValueError(f"ahead_s must lie between the wake-up, {sensor.wake_up:g} s, and 10 s; got {ahead_s!r}")
    s = s._replace(rate=jnp.asarray(rate))
    lead, ahead = power.wake_samples(sensor, sampling_rate_hz), round(ahead_s * sampling_rate_hz)
    prices = jnp.asarray([sensor.on, sensor.on, sensor.off], s.rate.dtype)
    params, filler = tree.map(lambda p: jnp.asarray(p).astype(s.rate.dtype), (params, filler))
    return _run(s, params, filler, prices, sampling_rate_hz, lead, ahead)


@partial(jit, static_argnames=("sampling_rate_hz", "lead", "ahead"))
def _run(
    s: Signals, p: Trigger, neighbours: Neighbours, prices: Array, sampling_rate_hz: float, lead: int, ahead: int
) -> Triggered:
    compared = gap_fillers.scaled(s, neighbours)
    size = min(len(s.rate), round(gap_fillers.MEMORY_S * sampling_rate_hz))
    nought, dt = jnp.zeros_like(s.rate[0]), jnp.asarray(1.0 / sampling_rate_hz, s.rate.dtype)
    gain = jnp.inf if p.budget is None else p.budget * dt
    price = jnp.minimum(p.wake**2, 1e6)  # an infinite one would cancel another

    def step(c: _State, sample: Any) -> tuple[_State, Any]:
        signals, rate, must = sample
        powered = c.on | must
        age = jnp.where(powered, c.age + 1.0, 0.0)
        usable = age > lead
        rate = jnp.where(usable, rate, 0.0)
        after, told = remembered(neighbours, dt, c.filler, signals, rate, usable)
        doubt = _disagreement(c.filler, told, neighbours, dt, signals)
        filled, new = jnp.where(usable, rate, told), (rate - told) ** 2
        sums = _counted(c.sums, p, dt, rate, new, doubt, usable)
        square = (sums.square + 1e-3) / (sums.count + 1e-3)
        stride = _strode(c.stride, filled, jnp.sqrt(square), dt)
        # Before a stride was measured, the filler's errors do not predict later errors.
        told_by = usable & (stride.count >= 2.0)
        sums = sums._replace(
            erred=sums.erred + jnp.where(told_by, jnp.minimum(new / square, 1.0), 0.0),
            risk=sums.risk + jnp.where(told_by, c.expected, 0.0),
        )
        shadow = jnp.where(usable, new, c.shadow * jnp.exp(-dt / p.shadow_s))
        errors, risk = _foreseen(p, sums, stride, doubt, shadow, square, dt, ahead)

        off, wake = _planned(errors, price, lead, prices)
        cost = dt * jnp.where(usable, prices[0], jnp.where(powered, prices[1], prices[2]))
        tokens = jnp.minimum(c.tokens + gain - jnp.where(must, 0.0, cost), p.bucket)
        most = dt * jnp.maximum(prices[0], prices[1])
        start = wake & (tokens >= most * (2 * lead + 1))
        stay = (~usable | ~off) & (tokens >= most)
        on = jnp.where(powered, stay, start)
        after_all = _State(after, on, age, stride, sums, risk, shadow, tokens)
        return after_all, (told, powered, usable, jnp.sqrt(errors.mean()))

    none, no = jnp.zeros(size, s.rate.dtype), jnp.zeros(size, bool)
    begin = _State(
        Memory(jnp.zeros((size, compared.shape[1]), s.rate.dtype), none, no, no, none, none), jnp.asarray(True),
        nought + lead,
        _Stride(jnp.asarray(False), nought, nought + 1.1 / dt, nought), _Sums(*(nought,) * 6), nought, nought,
        p.bucket + nought,
    )  # fmt: skip
    told, powered, usable, predicted = lax.scan(step, begin, (compared, s.rate, s.usable))[1]
    enough = lax.cumsum(s.usable.astype(jnp.int32)) > 0
    filled = finished(s._replace(rate=jnp.where(usable, s.rate, 0.0), usable=usable), told, enough)
    return Triggered(filled, Masks(powered, usable), predicted)


def _counted(s: _Sums, p: Trigger, dt: Any, rate: Array, new: Array, doubt: Array, usable: Array) -> _Sums:
    """The sums with one more sample, if it was measured."""
    keep = jnp.exp(-dt / p.calibrate_s)
    more = s._replace(
        square=s.square + rate**2, count=s.count + 1.0, found=keep * s.found + new, stated=keep * s.stated + doubt
    )
    return _Sums(*(jnp.where(usable, a, b) for a, b in zip(more, s, strict=True)))


def _strode(s: _Stride, filled: Array, usual: Array, dt: Any) -> _Stride:
    """The place in the stride one sample later; a swing begins at the usual rate and ends at zero."""
    swings = jnp.where(s.swings, filled > 0.0, filled > usual)
    since = s.since + 1.0
    begins = swings & ~s.swings & ((since * dt > REFRACTORY_S) | (s.count == 0.0))
    found = jnp.clip(since, PERIODS[0] / dt, PERIODS[1] / dt)
    period = jnp.where(begins & (s.count > 0.0), 0.5 * (s.period + found), s.period)
    return _Stride(swings, jnp.where(begins, 0.0, since), period, s.count + jnp.where(begins, 1.0, 0.0))


def _foreseen(
    p: Trigger, sums: _Sums, stride: _Stride, doubt: Array, shadow: Array, square: Array, dt: Any,
    ahead: int,
) -> tuple[Array, Array]:  # fmt: skip
    """(ahead,) e² of the samples to come, and ρ of the next one [1]."""
    later = jnp.arange(1, ahead + 1).astype(square.dtype)
    angle = 2.0 * jnp.pi * (stride.since + later) / stride.period
    first, second = p.risk[1] * jnp.cos(angle), p.risk[2] * jnp.sin(angle)
    third, fourth = p.risk[3] * jnp.cos(2.0 * angle), p.risk[4] * jnp.sin(2.0 * angle)
    risk = jnp.exp(p.risk[0] + first + second + third + fourth)
    scale = ((sums.erred + p.trust) / (sums.risk + p.trust)) ** p.own
    ratio = (sums.found + 1e-2) / (sums.stated + 1e-2)
    errors = scale * risk
    errors += p.doubt * ratio * doubt / square * jnp.exp(-later * dt / p.doubt_s)
    errors += p.shadow * shadow / square * jnp.exp(-later * dt / p.shadow_s)
    return errors, risk[0]


def _planned(errors: Array, price: Array, lead: int, prices: Array) -> tuple[Array, Array]:
    """Whether to switch off if it is on, and on if it is off, for the next sample.

    Args:
        errors: (ahead,) e² of the samples to come if they are not measured [1].
        price: θ² [1].
        lead: samples of wake-up.
        prices: power while on, waking and off [W].
    """
    waking = price * lead * (prices[1] - prices[2]) / (prices[0] - prices[2])

    def back(c: Any, error: Array) -> tuple[Any, Any]:
        on, off, ons, unmeasured = c
        stay, leave = price + on, error + off
        unmeasured = jnp.concatenate([error[None], unmeasured])[:lead]
        on = jnp.minimum(stay, leave)
        ons = jnp.concatenate([on[None], ons])
        wake = waking + unmeasured.sum() + ons[lead]
        return (on, jnp.minimum(leave, wake), ons[:lead], unmeasured), (leave < stay, wake < leave)

    nought, later = jnp.zeros_like(price), jnp.zeros(lead, errors.dtype)
    first = lax.scan(back, (nought, nought, later, later), errors, reverse=True)[1]
    return first[0][0], first[1][0]


def remembered(
    p: Neighbours, dt: Any, s: Memory, signals: Array, rate: Array, usable: Array
) -> tuple[Memory, Array]:  # fmt: skip
    """The memory with one more sample, and the weighted mean of the neighbours' rates [rad/s], 0 without any."""
    keep = jnp.exp(-dt / p.history_s)
    there = s.there.astype(s.rate.dtype)
    distance = there * ((signals[None] - s.signals) ** 2).sum(axis=1) + keep * s.distance
    weight = there + keep * s.weight
    alike = distance / jnp.where(s.there, weight, 1.0) + p.short * (1.0 - (1.0 - keep) * weight)
    told = gap_fillers.mean_rate(p, alike, gap_fillers.nearest(alike, s.usable), s.rate, s.usable)
    after = Memory(
        pushed(s.signals, signals), pushed(s.rate, rate), pushed(s.usable, usable),
        pushed(s.there, jnp.ones_like(usable)), distance, weight,
    )  # fmt: skip
    return after, told


def _disagreement(before: Memory, told: Array, p: Neighbours, dt: Any, signals: Array) -> Array:
    """Weighted variance of the neighbours' rates [rad²/s²]."""
    spread = before._replace(rate=(before.rate - told) ** 2)
    return remembered(p, dt, spread, signals, jnp.zeros_like(told), jnp.asarray(False))[1]
