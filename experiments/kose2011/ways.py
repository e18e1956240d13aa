"""The waist's distance by ways that the library leaves out: integration without the velocity update, and alone.

"frozen": direct and reverse integration, every cycle begun and ended with the speed at the bout's first contact.
"integrated": forward integration of the whole bout.
"""

from typing import Any

import jax.numpy as jnp
from jax import lax
from jax.typing import ArrayLike

from jgait.estimators.waist import motion, readout, steps
from jgait.estimators.waist.estimator import stated
from jgait.estimators.waist.ofdri import Cycles, since
from jgait.estimators.waist.params import DEFAULT, WaistParams
from jgait.estimators.waist.velocity_update import (
    Covered,
    VelocityUpdateParams,
    changes,
    covered,
    listed,
    sampled,
    way_of,
)
from jgait.types import Estimate


def frozen(
    p: VelocityUpdateParams, acc: ArrayLike, cycles: Cycles, dt: ArrayLike, start: ArrayLike = 0.0, *,
    optimum: bool = True, mask: ArrayLike | None = None, known: ArrayLike | None = None,
) -> Covered:  # fmt: skip
    """OFDRI without the update: every cycle begins and ends with the velocity at the first heel strike of its bout.

    Arguments, result and errors as of `updated`; `updated` is False everywhere.
    """
    seen = sampled(p, acc, cycles, dt, start, mask, known)
    number = jnp.arange(seen.anew.shape[0])
    begun = (seen.begin + changes(seen)[1])[lax.cummax(jnp.where(seen.anew, number, 0))]
    return covered(p, seen, begun, jnp.ones_like(begun), optimum=optimum)


def integrated(
    p: VelocityUpdateParams, acc: ArrayLike, cycles: Cycles, dt: ArrayLike, start: ArrayLike = 0.0, *,
    mask: ArrayLike | None = None, known: ArrayLike | None = None,
) -> Covered:  # fmt: skip
    """OFI over each bout, without a restart of its filter in the bout; cycles only define where lengths are read.

    Arguments, result and errors as of `updated`; `updated` is True for every cycle.
    """
    seen = sampled(p, acc, cycles, dt, start, mask, known)
    velocity = seen.start + since(seen.acc, seen.steps, p.cutoff_hz, seen.given).change
    left = jnp.concatenate([jnp.where(seen.given[:-1], seen.start[1:], velocity[:-1]), velocity[-1:]])
    way, begun = way_of(left, velocity, seen), left[cycles.begin]
    return listed(seen, velocity, way, begun, velocity[cycles.end] - begun, jnp.zeros_like(begun))


WAYS = {"frozen": frozen, "integrated": integrated}


def run(p: WaistParams, inputs: Any, kind: str) -> Estimate:
    """As `waist.run` with default options, its distance by one of `WAYS`."""
    seen = motion.motion(p, inputs, smooth=DEFAULT.smooth)
    found = steps.intervals(p, inputs, seen)
    speed, held = readout.integrated_speed(p, inputs, seen, found, WAYS[kind])
    # at the first contact the person is still setting off, and that speed is held
    known = inputs.stood & (kind != "frozen")
    held = jnp.ones_like(held) if kind == "frozen" else jnp.zeros_like(held)
    start_sd = p.start_speed_sd * jnp.where(known, 0.0, 1.0)
    return stated(inputs, seen, found, readout.by_integration(p, inputs, found, speed, held, start_sd))
