"""The waist's distance by ways that the library leaves out: integration without the velocity update, and alone.

"frozen": direct and reverse integration, every cycle begun and ended with the speed at the bout's first contact.
"integrated": forward integration of the whole bout.
"""

from typing import Any

import jax.numpy as jnp

from jgait.estimators.waist import motion, readout, steps, velocity_update
from jgait.estimators.waist.estimator import stated
from jgait.estimators.waist.params import DEFAULT, WaistParams
from jgait.types import Estimate

WAYS = {"frozen": velocity_update.frozen, "integrated": velocity_update.integrated}


def run(p: WaistParams, inputs: Any, kind: str) -> Estimate:
    """As `waist.run` with default options, its distance by one of `WAYS`."""
    seen = motion.motion(p, inputs, smooth=DEFAULT.smooth)
    found = steps.intervals(p, inputs, seen)
    speed, held = readout.integrated_speed(p, inputs, seen, found, WAYS[kind])
    # at the first contact the person is still setting off, and that speed is held
    known = inputs.stood & (kind != "frozen")
    held = jnp.ones_like(held) if kind == "frozen" else jnp.zeros_like(held)
    start_sd = p.start_speed_sd * jnp.where(known, 0.0, 1.0)
    return stated(inputs, found, readout.by_integration(p, inputs, found, speed, held, start_sd))
