r"""Mean power and masks of a schedule with soft edges, smooth in duty and period: what a descent can follow.

With softness towards 0 they are those of `jgait.duty_cycle.power`.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jgait.duty_cycle.power import GYROSCOPE, Masks, Sensor, check_duty


def _soft_minimum(a: Any, b: Any, softness: Any) -> Any:
    """The smaller of two, rounded over `softness`; below both."""
    return -softness * jnp.logaddexp(-a / softness, -b / softness)


def relaxed_power(duty: Any, period: Any, sensor: Sensor = GYROSCOPE, *, softness: Any = 0.02) -> Any:
    """Mean power as a smooth function of duty and period [W], woken ahead.

        p̄ = p_on d + p_off (1 − d) + (p_wake − p_off) s(w, (1 − d) c) / c

    where the soft minimum s lets the wake-up vanish with the off-time, so that nothing jumps at d = 1.

    Args:
        duty: d, part of the time that is measured [1], in (0, 1].
        period: c, on-time and off-time together [s].
        sensor: that is switched.
        softness: over what time the minimum is rounded [s]; towards 0 the power is that of `mean_power`.

    Returns:
        Mean power [W], in the shape of duty and period.

    Raises:
        ValueError: if a concrete duty lies outside (0, 1], or a period or the softness is not positive.
    """
    _check_relaxed(duty, period, softness)
    off_time = (1.0 - duty) * period
    # What the rounding leaves where there is no off-time is taken off again.
    floor = _soft_minimum(sensor.wake_up, 0.0 * off_time, softness)
    woken = _soft_minimum(sensor.wake_up, off_time, softness) - floor
    return sensor.on * duty + sensor.off * (1.0 - duty) + (sensor.on - sensor.off) * woken / period


def relaxed_masks(time: Any, duty: Any, period: Any, sensor: Sensor = GYROSCOPE, *, softness: Any = 0.02) -> Masks:
    """On-fractions between 0 and 1 in place of a mask, smooth in duty and period: sigmoids at the edges.

        usable(t) = σ(δ(t) / s),   δ the time to the nearest edge of the on-time, positive inside.

    Halfway between two edges the slope turns over, which shows where they are but a few s apart.

    Args:
        time: (T,) [s]; an on-time begins at 0.
        duty: part of the time that is measured [1], in (0, 1].
        period: on-time and off-time together [s].
        sensor: that is switched, woken ahead.
        softness: s, width of an edge [s]; towards 0 the masks are those of `masks`.

    Returns:
        (T,) fractions. A filter takes one as a weight: the variance of its sample over the fraction.

    Raises:
        ValueError: if a concrete duty lies outside (0, 1], or a period or the softness is not positive.
    """
    _check_relaxed(duty, period, softness)
    time = jnp.asarray(time)
    on_time = duty * period
    awake = jnp.minimum(on_time + sensor.wake_up, period)

    def fraction(start: Any, length: Any) -> Any:
        middle = start + 0.5 * length
        away = time - middle
        inside = 0.5 * length - jnp.abs(away - period * jnp.round(away / period))
        # Where there is no off-time there is no edge: the fraction goes to 1 as the off-time closes.
        return 1.0 - jax.nn.sigmoid(-inside / softness) * jnp.tanh(0.5 * (period - length) / softness)

    usable = fraction(0.0, on_time)
    return Masks(fraction(on_time - awake, awake), usable)


def _check_relaxed(duty: Any, period: Any, softness: Any) -> None:
    for value in (v for v in (duty,) if not isinstance(v, jax.core.Tracer)):
        for one in np.ravel(np.asarray(value)):
            check_duty(float(one))
    for name, value in (("period", period), ("softness", softness)):
        if not isinstance(value, jax.core.Tracer) and not np.all(np.asarray(value) > 0.0):
            raise ValueError(f"{name} must be a positive number of seconds; got {value!r}")
