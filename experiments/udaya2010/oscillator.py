r"""Filling a gyroscope's gaps with a filter's prediction: three models of a stride, run under the mask.

All run in `jgait.filtering`; where the gyroscope is off the filter predicts, and the mean is the filled rate.

`extrapolate`: a rate and its slope, both of which die away; linear. `resonate`: a mean and `HARMONICS` pairs that turn
at multiples of the estimated stride frequency f (a control); linear:

    ω = c_0 + Σ_k c_k,   (c_k, s_k) ← (c_k cos φ_k − s_k sin φ_k, c_k sin φ_k + s_k cos φ_k),   φ_k = 2π k f Δt.

`oscillate`: phase θ and angular frequency ν are states, and every signal i is a Fourier series of the phase,

    θ ← θ + ν Δt,   y_i = b_{i0} + Σ_k (b_{ik} cos kθ + b'_{ik} sin kθ),

an extended Kalman filter. With the accelerometer, which is always on, its series hold the phase through a gap; without
it the phase runs on at the last frequency. The estimated stride period is one more, weak observation, of ν: the one at
the first gap starts the filter, for before it there is no series and no other information on the frequency. (No sample
before the gap is filled, so the filled rate stays causal; a device would run the filter over the first strides when the
gap begins.)
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jgait.duty_cycle.filling import (
    Filled,
    Filler,
    Force,
    On,
    Rate,
    Thigh,
    finished,
    measured_enough,
    pace,
    started,
)
from jgait.filtering import EKF, KF, Belief, Covariance, Model, kalman_filter
from jgait.params import fixed, positive

HARMONICS = 5
"""Multiples of the stride frequency; five carry 95 % of the power of a shank's rate on a treadmill."""

TWO_PI = 6.283185307179586


class Gyroscope(NamedTuple):
    """What the gyroscope observes: the sagittal rate [rad/s]."""

    rate: Any


class Extrapolation(NamedTuple):
    """Parameters of `extrapolate`.

    Attributes:
        rate_decay_s: time constant with which the rate dies away [s].
        slope_decay_s: the same of its slope [s].
        slope_noise: process noise of the slope [rad/s² per √s].
        gyro_noise: of a sample [rad/s].
        least_strides: that must have been measured before anything but holding is trusted [strides].
    """

    rate_decay_s: Any = 0.3
    slope_decay_s: Any = 0.08
    slope_noise: Any = 100.0
    gyro_noise: Any = 0.05
    least_strides: Any = 2.0


EXTRAPOLATION = Extrapolation()
EXTRAPOLATION_TRANSFORMS = Extrapolation(*(positive,) * 4, least_strides=fixed)


class Motion(NamedTuple):
    """A rate [rad/s] and its slope [rad/s²]."""

    rate: Any
    slope: Any


def _motion_initial(p: Extrapolation) -> Belief:
    zero = jnp.zeros_like(p.gyro_noise)
    return Belief(Motion(zero, zero), Covariance.from_variances(Motion(zero + 4.0, zero + 400.0)))


def _motion_transition(p: Extrapolation, s: Motion, control: Any, dt: Any) -> Motion:
    return Motion(jnp.exp(-dt / p.rate_decay_s) * s.rate + dt * s.slope, jnp.exp(-dt / p.slope_decay_s) * s.slope)


def _motion_noise(p: Extrapolation, s: Motion, control: Any, dt: Any) -> Covariance:
    q = p.slope_noise**2
    parts = {("rate", "rate"): q * dt**3 / 3.0, ("rate", "slope"): q * dt**2 / 2.0, ("slope", "slope"): q * dt}
    return Covariance.from_variances(Motion(q * dt**3 / 3.0, q * dt)).with_entries(parts)


def _motion_observation(p: Extrapolation, s: Motion, control: Any) -> Gyroscope:
    return Gyroscope(s.rate)


def _gyro_noise(p: Any, s: Any, control: Any) -> Gyroscope:
    return Gyroscope(p.gyro_noise**2)


MOTION = Model(_motion_initial, _motion_transition, _motion_noise, _motion_observation, _gyro_noise)
"""A rate that continues and decays."""


def extrapolate(
    rate: Rate, usable: On, acc: Force | None, sampling_rate_hz: float,
    params: Extrapolation = EXTRAPOLATION, *, thigh: Thigh | None = None,
) -> Filled:  # fmt: skip
    """The rate continues with its slope, and both decay: prediction by a constant-velocity filter.

    Arguments and errors: see `jgait.duty_cycle.filling`.
    """
    s, p = started(rate, usable, acc, sampling_rate_hz, params, thigh)
    told = pace(s, sampling_rate_hz)
    found = kalman_filter(
        MOTION, p, Gyroscope(s.rate), dt=1.0 / sampling_rate_hz, mask=s.usable, method=KF(), keep=("mean",)
    )
    return finished(s, found.mean.rate, measured_enough(told, p.least_strides))


class Resonance(NamedTuple):
    """Parameters of `resonate`.

    Attributes:
        change: process noise of the harmonics, by how much they change in a second [rad/s per √s].
        gyro_noise: of a sample, and what the harmonics leave over [rad/s].
        least_strides: that must have been measured before anything but holding is trusted [strides].
    """

    change: Any = 0.2
    gyro_noise: Any = 0.3
    least_strides: Any = 2.0


RESONANCE = Resonance()
RESONANCE_TRANSFORMS = Resonance(*(positive,) * 2, least_strides=fixed)


class Harmonics(NamedTuple):
    """A mean, and `HARMONICS` pairs that turn [rad/s]."""

    mean: Any
    cosines: tuple[Any, ...]
    sines: tuple[Any, ...]


class Pulse(NamedTuple):
    """Control: the stride frequency over the interval [Hz]."""

    frequency: Any


def _alike(mean: Any, others: Any) -> Harmonics:
    """Harmonics of one value each."""
    return Harmonics(mean, (others,) * HARMONICS, (others,) * HARMONICS)


def _turn_initial(p: Resonance) -> Belief:
    zero = jnp.zeros_like(p.gyro_noise)
    return Belief(_alike(zero, zero), Covariance.from_variances(_alike(zero + 1.0, zero + 4.0)))


def _turn(p: Resonance, s: Harmonics, control: Pulse, dt: Any) -> Harmonics:
    angles = [TWO_PI * k * control.frequency * dt for k in range(1, HARMONICS + 1)]
    pairs = list(zip(s.cosines, s.sines, angles, strict=True))
    return Harmonics(
        s.mean,
        tuple(c * jnp.cos(a) - v * jnp.sin(a) for c, v, a in pairs),
        tuple(c * jnp.sin(a) + v * jnp.cos(a) for c, v, a in pairs),
    )


def _turn_noise(p: Resonance, s: Harmonics, control: Pulse, dt: Any) -> Harmonics:
    return _alike(p.change**2 * dt, p.change**2 * dt)


def _turn_observation(p: Resonance, s: Harmonics, control: Pulse) -> Gyroscope:
    return Gyroscope(s.mean + sum(s.cosines))


RESONATOR = Model(_turn_initial, _turn, _turn_noise, _turn_observation, _gyro_noise)
"""Harmonics that turn at multiples of a frequency that is given."""


def resonate(
    rate: Rate, usable: On, acc: Force | None, sampling_rate_hz: float,
    params: Resonance = RESONANCE, *, thigh: Thigh | None = None,
) -> Filled:  # fmt: skip
    """Harmonics of the estimated stride frequency turn on: prediction by a linear filter.

    Arguments and errors: see `jgait.duty_cycle.filling`.
    """
    s, p = started(rate, usable, acc, sampling_rate_hz, params, thigh)
    told = pace(s, sampling_rate_hz)
    found = kalman_filter(
        RESONATOR, p, Gyroscope(s.rate), controls=Pulse(1.0 / told.period), dt=1.0 / sampling_rate_hz, mask=s.usable,
        method=KF(), keep=("mean",),
    )  # fmt: skip
    mean = found.mean
    return finished(s, mean.mean + sum(mean.cosines), measured_enough(told, p.least_strides))


class Oscillation(NamedTuple):
    """Parameters of `oscillate`.

    Attributes:
        frequency_noise: process noise of the angular frequency [rad/s per √s].
        phase_noise: of the phase [rad per √s].
        change: of the series' coefficients, in the scales of `series` [1 per √s].
        gyro_noise: of a sample, and what the series leaves over [rad/s].
        acc_noise: the same of the accelerometer [m/s²].
        pace_noise: of the angular frequency by the stride period at one sample [rad/s].
        start_noise: of the angular frequency by the stride period at the first gap [rad/s].
        least_strides: that must have been measured before anything but holding is trusted [strides].
    """

    frequency_noise: Any = 0.1
    phase_noise: Any = 0.05
    change: Any = 0.15
    gyro_noise: Any = 0.3
    acc_noise: Any = 4.0
    pace_noise: Any = 1.0
    start_noise: Any = 0.15
    least_strides: Any = 2.0


OSCILLATION = Oscillation()
OSCILLATION_TRANSFORMS = Oscillation(*(positive,) * 7, least_strides=fixed)


ACC_UNIT = 3.0
"""[m/s²] Unit of the accelerometer's series, which makes them as large as those of the rate in rad/s."""


class Oscillator(NamedTuple):
    """State: phase [rad], angular frequency [rad/s], and the Fourier series of one to four signals."""

    phase: Any
    frequency: Any
    series: tuple[Harmonics, ...]


class Seen(NamedTuple):
    """Observation: as many signals as there are series, and the angular frequency [rad/s] of the pace."""

    signals: tuple[Any, ...]
    frequency: Any


def _oscillator(phase: Any, frequency: Any, mean: Any, others: Any, count: int) -> Oscillator:
    return Oscillator(phase, frequency, (_alike(mean, others),) * count)


def _start(count: int, p: Oscillation) -> Belief:
    zero = jnp.zeros_like(p.gyro_noise)
    mean = _oscillator(zero, zero + TWO_PI / 1.2, zero, zero, count)
    # The phase's origin is arbitrary: the first sample has none.
    return Belief(
        mean,
        Covariance.from_variances(_oscillator(zero + 1e-6, zero + p.start_noise**2, zero + 9.0, zero + 2.0, count)),
    )


def _run_on(p: Oscillation, s: Oscillator, control: Any, dt: Any) -> Oscillator:
    return s._replace(phase=s.phase + dt * s.frequency)


def _wander(p: Oscillation, s: Oscillator, control: Any, dt: Any) -> Oscillator:
    q = p.change**2 * dt
    return _oscillator(p.phase_noise**2 * dt, p.frequency_noise**2 * dt, q, q, len(s.series))


def _sounds(p: Oscillation, s: Oscillator, control: Any) -> Seen:
    cosines = [jnp.cos(k * s.phase) for k in range(1, HARMONICS + 1)]
    sines = [jnp.sin(k * s.phase) for k in range(1, HARMONICS + 1)]

    def value(of: Harmonics) -> Any:
        pairs = zip((*of.cosines, *of.sines), (*cosines, *sines), strict=True)
        return of.mean + sum(b * wave for b, wave in pairs)

    return Seen(tuple(value(of) for of in s.series), s.frequency)


def _sound_noise(p: Oscillation, s: Oscillator, control: Any) -> Seen:
    felt = ((p.acc_noise / ACC_UNIT) ** 2,) * (len(s.series) - 1)
    return Seen((p.gyro_noise**2, *felt), p.pace_noise**2)


OSCILLATORS = {count: Model(partial(_start, count), _run_on, _wander, _sounds, _sound_noise) for count in (1, 4)}
"""By the number of signals: the rate alone, or with the accelerometer."""


def oscillate(
    rate: Rate, usable: On, acc: Force | None, sampling_rate_hz: float,
    params: Oscillation = OSCILLATION, *, thigh: Thigh | None = None,
) -> Filled:  # fmt: skip
    """A phase-locked oscillator with harmonics: an extended Kalman filter, with or without accelerometer.

    Arguments and errors: see `jgait.duty_cycle.filling`.
    """
    s, p = started(rate, usable, acc, sampling_rate_hz, params, thigh)
    told = pace(s, sampling_rate_hz)
    felt = () if s.acc is None else tuple(s.acc[:, axis] / ACC_UNIT for axis in range(3))
    always = jnp.ones_like(s.usable)
    model = OSCILLATORS[1 + len(felt)]
    believed = _start(1 + len(felt), p)
    at_first_gap = told.period[jnp.where(s.usable.all(), -1, jnp.argmin(s.usable))]
    believed = believed._replace(mean=believed.mean._replace(frequency=TWO_PI / at_first_gap))
    found = kalman_filter(
        model, p, Seen((s.rate, *felt), TWO_PI / told.period), dt=1.0 / sampling_rate_hz,
        mask=Seen((s.usable, *(always,) * len(felt)), told.known), method=EKF(), keep=("mean",), initial=believed,
    )  # fmt: skip
    filled = jax.vmap(lambda mean: _sounds(p, mean, None).signals[0])(found.mean)
    return finished(s, filled, measured_enough(told, p.least_strides))


def _rate_alone(
    rate: Rate, usable: On, acc: Force | None, sampling_rate_hz: float,
    params: Oscillation = OSCILLATION, *, thigh: Thigh | None = None,
) -> Filled:  # fmt: skip
    """`oscillate` without the accelerometer, whether there is one or not."""
    return oscillate(rate, usable, None, sampling_rate_hz, params)


FILLERS = {
    "extrapolate": Filler(extrapolate, EXTRAPOLATION, EXTRAPOLATION_TRANSFORMS),
    "resonate": Filler(resonate, RESONANCE, RESONANCE_TRANSFORMS),
    "oscillate_alone": Filler(_rate_alone, OSCILLATION, OSCILLATION_TRANSFORMS),
    "oscillate": Filler(oscillate, OSCILLATION, OSCILLATION_TRANSFORMS, needs_acc=True),
}
