r"""Waking a gyroscope when the filler's own predicted error demands it; causal.

`gap_neighbours` fills the gaps and says beside each rate how wrong it thinks it is, in two ways:

    its disagreement now             v_t = Σ_j w_{t,j} (ω_{t−j} − ω̂_t)² + η q_t s_ω²,       q_t the nearest distance
    what followed the neighbours     f_t = Σ_j w_{t,j} (mean square error from t − j + l to t − j + l + b)

l the wake-up, b the stretch that an on-time is meant for. An error in f is the found one (ω − ω̂)² where the gyroscope
was on, whose filler ran in shadow, and the predicted c v elsewhere; c is the calibration, found over predicted square
error of the samples that were measured. The predicted error, relative to the rate's root mean square r, is

    e_t² = (g f_t + (1 − g) c v̄_t) / r²,       v̄ the mean of v over the last b.

The gyroscope is switched on when e ≥ θ. It stays on for a minimum time, and then until e < θ and the shadow's error
fell below κ θ r, for as long as `calm_s`. A token bucket may bound the energy: it gains the budgeted power, pays what
the sensor draws, and neither lets it be switched on when a wake-up and minimum on-time cannot be paid, nor stay on
when it is empty. What is decided after one sample holds for the next.
"""

import math
from functools import partial
from typing import Any, NamedTuple

import jax.numpy as jnp
from jax import Array, jit, lax
from jax.typing import ArrayLike

from jgait import gap_neighbours, power
from jgait.gap_filling import RATE_SCALE, Filled, Signals, Thigh, check_signals, finished, in_type, pushed
from jgait.gap_neighbours import NEIGHBOURS, Neighbours
from jgait.params import fixed, interval, positive
from jgait.power import GYROSCOPE, Masks, Sensor


class Trigger(NamedTuple):
    """Parameters of `triggered`.

    Attributes:
        wake: θ, predicted error over the rate's root mean square at which the gyroscope is switched on [1].
        calm: κ, error of the filler in shadow under which it may be switched off, over θ [1].
        on_s: least time that it is usable once it was switched on [s].
        calm_s: for which both errors must be small before it is switched off [s].
        shadow_s: time constant of the shadow's mean square error [s].
        foresight: g, weight of what followed the neighbours, against their disagreement [1].
        novelty: η, square error per distance of the nearest neighbours [1].
        calibrate_s: time constant of the calibration, in time measured [s].
        budget: mean power that may be drawn once it need not be on [W]; None: any.
        bucket: energy that can be saved up [J].
    """

    wake: Any = 0.1
    calm: Any = 0.85
    on_s: Any = 0.6
    calm_s: Any = 0.4
    shadow_s: Any = 0.2
    foresight: Any = 0.85
    novelty: Any = 0.001
    calibrate_s: Any = 3.0
    budget: Any = None
    bucket: Any = 0.06


TRIGGER = Trigger()
TRANSFORMS = Trigger(
    wake=positive, calm=positive, on_s=positive, calm_s=positive, shadow_s=positive, foresight=interval(0.0, 1.0),
    novelty=positive, calibrate_s=positive, budget=fixed, bucket=fixed,
)  # fmt: skip


class Triggered(NamedTuple):
    """What came of it.

    Attributes:
        filled: the rate without gaps.
        used: (T,) when the gyroscope was powered and usable; `power.mask_energy` tells the energy.
        predicted: (T,) e, the predicted relative error [1]; what is decided from it holds from the next sample on.
    """

    filled: Filled
    used: Masks
    predicted: Any


class _State(NamedTuple):
    """From one sample to the next; times in samples, and squares relative to nothing [rad²/s²]."""

    filler: gap_neighbours.State
    on: Any  # whether the next sample is powered
    age: Any  # for how many samples it has been
    calm: Any  # for how many samples errors have been small
    shadow: Any  # mean square error of the filler in shadow
    found: Any  # sums of found and of predicted square errors, and of the measured rate's square, with forgetting
    stated: Any
    square: Any
    count: Any
    errors: Any  # (b,) latest square errors
    doubts: Any  # (b,) latest disagreements
    followed: Any  # (n,) mean square error over the b samples up to each, newest first
    tokens: Any  # [J]


def triggered(
    rate: ArrayLike, acc: ArrayLike, sampling_rate_hz: float, params: Trigger = TRIGGER, *, must: ArrayLike,
    thigh: Thigh | None = None, sensor: Sensor = GYROSCOPE, filler: Neighbours = NEIGHBOURS, ahead_s: float = 0.7,
) -> Triggered:  # fmt: skip
    """Run the policy over a recording whose gyroscope was always on; it sees only what it switched on for.

    Args:
        rate: (T,) sagittal rate of the shank [rad/s].
        acc: (T, 3) specific force of the shank [m/s²], never switched off.
        sampling_rate_hz: of the samples [Hz]; static.
        params: of the policy.
        must: (T,) bool, when the gyroscope is on whatever the policy says: a warm-up of two strides, from the first
            sample on. It is not charged to the budget. The sensor is awake at the first sample.
        thigh: signals of the thigh, if worn.
        sensor: that is switched.
        filler: parameters of the neighbours; `least_strides` is not used, since `must` says when to trust them.
        ahead_s: b, over which errors are foreseen [s]; static.

    Returns:
        The filled rate, the masks and the predicted error.

    Raises:
        ValueError: as `check_signals`, without accelerometer, or if `ahead_s` is not positive.
    """
    s = check_signals(rate, must, acc, sampling_rate_hz, thigh)
    if s.acc is None:
        raise ValueError("the filler is told from the accelerometer; acc is None")
    power.check_sensor(sensor)
    if not (math.isfinite(ahead_s) and ahead_s > 0.0):
        raise ValueError(f"ahead_s must be positive [s]; got {ahead_s!r}")
    s = s._replace(rate=jnp.asarray(rate))
    lead, ahead = power.wake_samples(sensor, sampling_rate_hz), max(1, round(ahead_s * sampling_rate_hz))
    prices = jnp.asarray([sensor.on, sensor.waking, sensor.off], s.rate.dtype)
    return _run(s, in_type(params, s), in_type(filler, s), prices, sampling_rate_hz, lead, ahead)


@partial(jit, static_argnames=("sampling_rate_hz", "lead", "ahead"))
def _run(
    s: Signals, p: Trigger, neighbours: Neighbours, prices: Array, sampling_rate_hz: float, lead: int, ahead: int
) -> Triggered:
    compared = gap_neighbours.scaled(s, neighbours)
    size = min(len(s.rate), round(gap_neighbours.MEMORY_S * sampling_rate_hz))
    nought, dt = jnp.zeros_like(s.rate[0]), jnp.asarray(1.0 / sampling_rate_hz, s.rate.dtype)
    least = p.on_s * sampling_rate_hz + lead
    gain = jnp.inf if p.budget is None else p.budget * dt
    known = jnp.arange(size) >= lead + ahead  # lags whose aftermath is over
    forget, fade = jnp.exp(-dt / p.calibrate_s), jnp.exp(-dt / p.shadow_s)

    def step(c: _State, sample: Any) -> tuple[_State, Any]:
        signals, rate, must = sample
        powered = c.on | must
        age = jnp.where(powered, c.age + 1.0, 0.0)
        usable = age > lead
        rate = jnp.where(usable, rate, 0.0)
        after, told = gap_neighbours.step(neighbours, dt, c.filler, signals, rate, usable)
        doubt = _disagreement(c.filler, after, told, neighbours, dt, signals, p.novelty)
        # What followed lag j is in the register since j − lead − ahead samples ago.
        aftermath = jnp.roll(c.followed, lead + ahead)
        of = c.filler._replace(rate=aftermath, usable=c.filler.usable & known)
        foreseen = gap_neighbours.step(neighbours, dt, of, signals, rate, usable)[1]
        seen = of.usable.any()

        new = (rate - told) ** 2
        ratio = (c.found + 1e-3) / (c.stated + 1e-3)
        error = jnp.where(usable, new, ratio * doubt)
        errors, doubts = pushed(c.errors, error), pushed(c.doubts, doubt)
        disagreement = ratio * doubts.mean()
        foreseen = jnp.where(seen, foreseen, disagreement)
        square = (c.square + 1e-6) / (c.count + 1e-6)
        predicted = (p.foresight * foreseen + (1.0 - p.foresight) * disagreement) / square

        shadow = jnp.where(usable, fade * c.shadow + (1.0 - fade) * new, c.shadow)
        quiet = (predicted < p.wake**2) & (shadow < (p.calm * p.wake) ** 2 * square)
        calm = jnp.where(quiet, c.calm + 1.0, 0.0)
        cost = dt * jnp.where(usable, prices[0], jnp.where(powered, prices[1], prices[2]))
        tokens = jnp.minimum(c.tokens + gain - jnp.where(must, 0.0, cost), p.bucket)
        price = dt * jnp.maximum(prices[0], prices[1])
        start = (predicted >= p.wake**2) & (tokens >= price * least)
        stay = ((age < least) | (calm < jnp.maximum(1.0, p.calm_s / dt))) & (tokens >= price)

        def updated(total: Any, value: Any) -> Any:
            return jnp.where(usable, forget * total + value, total)

        c = _State(
            after, jnp.where(powered, stay, start), age, calm, shadow, updated(c.found, new),
            updated(c.stated, doubt), updated(c.square, rate**2), updated(c.count, 1.0), errors, doubts,
            pushed(c.followed, errors.mean()), tokens,
        )  # fmt: skip
        return c, (told, powered, usable, jnp.sqrt(predicted))

    start = _State(
        gap_neighbours.begin(size, compared.shape[1], s.rate.dtype), jnp.asarray(True), nought + lead, nought, nought,
        nought, nought, nought, nought, jnp.zeros(ahead, s.rate.dtype), jnp.zeros(ahead, s.rate.dtype),
        jnp.zeros(size, s.rate.dtype), p.bucket + nought,
    )  # fmt: skip
    told, powered, usable, predicted = lax.scan(step, start, (compared, s.rate, s.usable))[1]
    enough = lax.cumsum(s.usable.astype(jnp.int32)) > 0
    filled = finished(s._replace(rate=jnp.where(usable, s.rate, 0.0), usable=usable), told, enough)
    return Triggered(filled, Masks(powered, usable), predicted)


def _disagreement(
    before: gap_neighbours.State, after: gap_neighbours.State, told: Array, p: Neighbours, dt: Any, signals: Array,
    novelty: Any,
) -> Array:  # fmt: skip
    """Weighted variance of the neighbours' rates, and what the nearest distance adds [rad²/s²]."""
    spread = before._replace(rate=(before.rate - told) ** 2)
    variance = gap_neighbours.step(p, dt, spread, signals, jnp.zeros_like(told), jnp.asarray(False))[1]
    nearest = gap_neighbours.distances(p, jnp.exp(-dt / p.history_s), before, after.distance, after.weight)[1]
    return variance + novelty * nearest * RATE_SCALE**2
