r"""Energy of a sensor that is switched off part of the time: power, schedules, masks, battery life.

A schedule repeats m units on and n units off, each of u seconds. Before it measures, the sensor is powered for its
wake-up time w. If w is part of the off-time, as in the paper, the mean power over the period c = (m + n) u is

    p̄ = [p_on (m u + min(w, n u)) + p_off (n u − min(w, n u))] / c.

The paper's Table 2, duty cycle p/q in lowest terms, is p of q units of 1.4 s on: ten units, 10/q wake-ups in 14 s, a
saving of 100 − duty − 100 · (0.2 s / 14 s) · 10/q percent of the gyroscope's energy. This gives all nine printed
values.

Source: P. S. Udaya Shankar, N. Raveendranathan, N. R. Gans, R. Jafari, "Towards power optimized Kalman filter for
gait assessment using wearable sensors", Wireless Health 2010, sections 1 and 5, Table 2. Test:
tests/duty_cycle/test_power.py.
"""

import math
from fractions import Fraction
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Shaped

from jgait.types import AnyArray

PAPER_UNIT = 1.4
"""Unit of the paper's schedules [s]: a tenth of the paper's period of 14 s, about the duration of a stride."""

MOST_UNITS = 10
"""[1] Largest number of units in the period of a schedule from a duty cycle; the paper's tenths need as many."""


class Sensor(NamedTuple):
    """The power of a sensor."""

    on: float  #: power while the sensor measures [W].
    off: float = 0.0  #: power while the sensor is off [W].
    wake_up: float = 0.0  #: time from power on to the first usable sample, in which it draws as much [s].


GYROSCOPE = Sensor(on=30e-3, wake_up=0.2)
"""The paper's gyroscope: 30 mW, 200 ms to power up and settle."""

ACCELEROMETER = Sensor(on=2.7e-3)
"""The paper's accelerometer: 2.7 mW, never off."""


class Battery(NamedTuple):
    """A battery with its usable energy [J]."""

    energy: float

    @classmethod
    def from_watt_hours(cls, energy: float) -> "Battery":
        """A battery with its energy in watt-hours [Wh]."""
        return cls(3600.0 * energy)

    def life(self, *powers: float) -> float:
        """The time that the battery lasts under the sum of mean powers [W], in seconds."""
        return self.energy / sum(powers[1:], powers[0])


class Schedule(NamedTuple):
    """A periodic schedule: an on-time, all of it measured, and an off-time, at whose end the sensor wakes up."""

    on: int  #: units on in each period [1].
    off: int  #: units off in each period [1]; 0: the sensor is always on.
    unit: float = PAPER_UNIT  #: length of a unit [s].

    @property
    def period(self) -> float:
        """Duration of on-time and off-time together [s]."""
        return (self.on + self.off) * self.unit

    @property
    def duty(self) -> float:
        """On-time over period [1]."""
        return self.on / (self.on + self.off)


class Masks(NamedTuple):
    """The state of a sensor at each sample."""

    powered: Shaped[AnyArray, "*batch time"]  #: (T,) True where the sensor draws power, measuring or waking up.
    usable: Shaped[AnyArray, "*batch time"]  #: (T,) True where the sample can be used.


def check_duty(duty: float) -> None:
    """Raise ValueError if a duty cycle lies outside (0, 1]; 40 % is 0.4."""
    if not (math.isfinite(duty) and 0.0 < duty <= 1.0):
        hint = f"; {duty:g} % is {duty / 100:g}" if math.isfinite(duty) and 1.0 < duty <= 100.0 else ""
        raise ValueError(f"duty must lie in (0, 1]: the part of the time that is measured; got {duty!r}{hint}")


def check_sensor(sensor: Sensor) -> None:
    """Raise ValueError if a power or a time of a sensor is negative or not finite."""
    for name, value in (("on", sensor.on), ("off", sensor.off), ("wake_up", sensor.wake_up)):
        if not (math.isfinite(value) and value >= 0.0):
            unit = "s" if name == "wake_up" else "W"
            raise ValueError(f"{name} of a sensor must be finite and not negative [{unit}]; got {value!r}")


def check_schedule(schedule: Schedule, sensor: Sensor) -> None:
    """Raise ValueError if the sensor cannot follow a schedule: if the numbers of units are not whole, or the wake-up is
    longer than the on-time (waking up would cost more than measuring) or the off-time that it is part of.
    """
    check_sensor(sensor)
    for name, units, least in (("on", schedule.on, 1), ("off", schedule.off, 0)):
        if units != int(units) or units < least:
            raise ValueError(f"{name} must be a whole number of units from {least} up; got {units!r}")
    if not (math.isfinite(schedule.unit) and schedule.unit > 0.0):
        raise ValueError(f"unit must be a positive number of seconds; got {schedule.unit!r}")
    if schedule.off == 0:
        return
    for name, units, why in (
        ("on", schedule.on, "would spend more on waking than on measuring; make the unit or the duty cycle longer"),
        ("off", schedule.off, "would never be off; make the unit longer or leave the sensor on"),
    ):
        if sensor.wake_up > units * schedule.unit:
            raise ValueError(
                f"the sensor takes {sensor.wake_up:g} s to wake up, longer than its {name}-time of "
                f"{units * schedule.unit:g} s: it {why}"
            )


def schedule_of_duty(duty: float, unit: float = PAPER_UNIT, *, sensor: Sensor = GYROSCOPE) -> Schedule:
    """The shortest schedule of whole units [s] with a given duty cycle [1]: p of q units on, p/q in lowest terms.

    Raises:
        ValueError: if `duty` is outside (0, 1] or no such fraction, or the sensor cannot follow the schedule.
    """
    check_duty(duty)
    fraction = Fraction(duty).limit_denominator(MOST_UNITS)
    if abs(float(fraction) - duty) > 1e-6 or fraction == 0:
        raise ValueError(
            f"no schedule of at most {MOST_UNITS} units has a duty cycle of {duty:g}; the nearest is {fraction}"
        )
    schedule = Schedule(fraction.numerator, fraction.denominator - fraction.numerator, unit)
    check_schedule(schedule, sensor)
    return schedule


def mean_power(schedule: Schedule, sensor: Sensor = GYROSCOPE) -> float:
    """Mean power under a periodic schedule [W], wake-ups included; raises as `check_schedule`."""
    check_schedule(schedule, sensor)
    wake = sensor.wake_up if schedule.off else 0.0
    on_time = schedule.on * schedule.unit
    asleep = schedule.period - on_time - wake
    return (sensor.on * (on_time + wake) + sensor.off * asleep) / schedule.period


def saving(schedule: Schedule, sensor: Sensor = GYROSCOPE) -> float:
    """Share of the sensor's energy that the schedule saves against always on [1]; the paper's Table 2 has it in %."""
    return 1.0 - mean_power(schedule, sensor) / sensor.on


def masks(schedule: Schedule, samples: int, rate_hz: float, sensor: Sensor = GYROSCOPE) -> Masks:
    """The (T,) masks of a schedule at the samples of a recording that starts with the on-time, its first sample usable.

    Raises:
        ValueError: if the sensor cannot follow the schedule, or the rate is not positive.
    """
    check_schedule(schedule, sensor)
    if not (math.isfinite(rate_hz) and rate_hz > 0.0):
        raise ValueError(f"rate_hz must be positive; got {rate_hz!r}")
    if schedule.off == 0:
        return Masks(np.ones(samples, bool), np.ones(samples, bool))
    # A sample belongs to the interval that it begins; a hundredth of a sample prevents rounding errors at the edges.
    late = 0.01 / rate_hz
    phase = np.mod(np.arange(samples) / rate_hz + late, schedule.period)
    on = phase < schedule.on * schedule.unit
    return Masks(on | (phase >= schedule.period - sensor.wake_up), on)


def wake_samples(sensor: Sensor, rate_hz: float) -> int:
    """Number of samples of a wake-up, rounded up."""
    return math.ceil(sensor.wake_up * rate_hz - 1e-6)


def powered_for(wanted: Bool[AnyArray, "time"], rate_hz: float, sensor: Sensor = GYROSCOPE) -> Bool[Array, "time"]:
    """When the sensor must be powered (T,) so that the wanted samples are usable: it wakes up before them."""
    wanted = jnp.asarray(wanted, bool)
    lead = wake_samples(sensor, rate_hz)
    on = jnp.cumsum(jnp.concatenate([wanted, jnp.zeros((lead,), bool)]).astype(jnp.int32))
    on = jnp.concatenate([jnp.zeros_like(on[:1]), on])
    return on[lead + 1 :] - on[: wanted.shape[0]] > 0


def mask_energy(used: Masks, rate_hz: float, sensor: Sensor = GYROSCOPE) -> Float[Array, ""]:
    """Energy over a recording [J] from masks, boolean or between 0 and 1; over T / rate_hz, the mean power."""
    # A boolean becomes the default floating type; a fraction keeps its floating type.
    xp = np if isinstance(used.powered, np.ndarray) else jnp
    powered = xp.where(used.powered, 1.0, 0.0) if xp.asarray(used.powered).dtype == bool else xp.asarray(used.powered)
    on = xp.sum(powered)
    return (sensor.on * on + sensor.off * (powered.shape[0] - on)) / rate_hz
