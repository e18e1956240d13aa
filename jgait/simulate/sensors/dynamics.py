"""Dynamics between motion and reading: the motion of a sensor on soft tissue, and the low-pass in the sensor."""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jgait.types import AnyArray, Values


def low_pass(values: Float[AnyArray, "time *rest"], frequency: Values, dt: Values) -> Float[Array, "time *rest"]:
    """Butterworth low-pass of second order, causal, by the bilinear transform prewarped to its −3 dB frequency [Hz].

    H(s) = 1 / (1 + √2 s/ω + (s/ω)²),  s = ω (1 − z⁻¹) / (K (1 + z⁻¹)),  K = tan(ω dt / 2)

    Before the recording the signal (T, C) is assumed constant at its first sample, so that standing still has no
    transient. A cut-off (C,) of 0.45 of the sampling rate or more leaves the signal unchanged; inf switches a channel's
    filter off.

    Source: the transform is that of any textbook on digital filters; tested against SciPy's `butter` and `lfilter`.
    """
    on = frequency * dt < 0.45
    k = jnp.tan(math.pi * jnp.where(on, frequency, 0.1 / dt) * dt)
    gain = 1.0 / (1.0 + math.sqrt(2.0) * k + k * k)
    b, a1, a2 = k * k * gain, 2.0 * (k * k - 1.0) * gain, (1.0 - math.sqrt(2.0) * k + k * k) * gain

    def step(carry: tuple[Values, Values], x: Values) -> tuple[tuple[Values, Values], Values]:
        first, second = carry
        y = b * x + first
        return (2.0 * b * x - a1 * y + second, b * x - a2 * y), y

    start = values[:1]  # the filtered signal begins at zero: no transient, and no precision lost by gravity
    _, filtered = jax.lax.scan(step, (jnp.zeros_like(start[0]), jnp.zeros_like(start[0])), values - start)
    return jnp.where(on[None, :], filtered + start, values)


class Wobble(NamedTuple):
    """Motion of a sensor on soft tissue relative to the bone, in the segment's axes: (T, C) [m], [m/s] and [m/s²]."""

    displacement: Values
    velocity: Values
    acceleration: Values


def soft_tissue(force: Float[AnyArray, "time *rest"], frequency: Values, damping: Values, dt: Values) -> Wobble:
    """Motion of a sensor on a mass on a spring, driven by the specific force of the bone under the sensor.

    d̈ + 2 ζ ω ḋ + ω² d = −(f − f₀),  ω = 2π frequency,  d = ḋ = 0 at the start

    f₀ is the first sample, assumed to be standing: the sag of the tissue under gravity is part of the mounting. The
    force is assumed linear between samples; the solution is then exact at any sampling rate. The segment's rotation is
    neglected: for displacements of millimetres its effect is smaller than the error of the model.

    Args:
        force: (T, C) specific force in the segment's axes [m/s²].
        frequency: natural frequency [Hz], one or one for each column; inf: the sensor is fixed to the bone.
        damping: damping ratio ζ [1], likewise; 1 is critical.
        dt: sampling interval [s].

    Returns:
        The motion at the times of the samples; zero if `frequency` is inf.
    """
    frequency, damping = (jnp.broadcast_to(jnp.asarray(v, force.dtype), force.shape[1:]) for v in (frequency, damping))
    on = jnp.isfinite(frequency)
    omega = 2.0 * math.pi * jnp.where(on, frequency, jnp.ones_like(frequency))
    push = force[:1] - force
    still, swing = _oscillation((1.0 - damping * damping) * (omega * dt) ** 2)
    fade = jnp.exp(-damping * omega * dt)
    keep, lift, rub = still * fade, swing * dt * fade, damping * omega * swing * dt * fade

    def step(
        carry: tuple[Values, Values], pushes: tuple[Values, Values]
    ) -> tuple[tuple[Values, Values], tuple[Values, Values]]:
        now, then = pushes
        slope = (then - now) / dt
        # the displacement follows a linearly growing force with a constant lag; the remainder is a free oscillation
        lag = 2.0 * damping * slope / omega**3
        d, v = carry[0] - (now / omega**2 - lag), carry[1] - slope / omega**2
        after = (
            (keep + rub) * d + lift * v + then / omega**2 - lag,
            (keep - rub) * v - omega**2 * lift * d + slope / omega**2,
        )
        return after, after

    zero = jnp.zeros_like(push[0])
    _, (d, v) = jax.lax.scan(step, (zero, zero), (push[:-1], push[1:]))
    d, v = (jnp.concatenate([zero[None, :], part]) for part in (d, v))
    motion = Wobble(d, v, push - (2.0 * damping * omega)[None] * v - (omega**2)[None] * d)
    return Wobble(*(jnp.where(on[None], part, jnp.zeros_like(part)) for part in motion))


def _oscillation(x: Values) -> tuple[Values, Values]:
    """The pair cos √x and sin √x / √x, smooth through zero to the hyperbolic functions at negative x."""
    near = jnp.abs(x) < 1e-3
    root = jnp.sqrt(jnp.where(near, jnp.ones_like(x), jnp.abs(x)))
    # the branch that is not selected must not overflow: its gradient would be NaN
    bounded = jnp.where(x < 0.0, root, jnp.ones_like(root))
    c = jnp.where(x < 0.0, jnp.cosh(bounded), jnp.cos(root))
    s = jnp.where(x < 0.0, jnp.sinh(bounded), jnp.sin(root)) / root
    return (
        jnp.where(near, 1.0 - x / 2.0 + x * x / 24.0 - x**3 / 720.0, c),
        jnp.where(near, 1.0 - x / 6.0 + x * x / 120.0 - x**3 / 5040.0, s),
    )
