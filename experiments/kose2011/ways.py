"""The waist's distance by ways that the library leaves out: integration without the velocity update, and alone.

"frozen": direct and reverse integration, every cycle begun and ended with the speed at the bout's first contact.
"integrated": forward integration of the whole bout.
"pendulum": the pendulum's steps alone.
"""

import math
from typing import Any

import jax.numpy as jnp

from jgait.estimators.waist import model, motion, velocity_update
from jgait.estimators.waist.estimator import stated
from jgait.estimators.waist.params import DEFAULT, VelocityUpdateParams, WaistParams
from jgait.estimators.waist.velocity_update import INITIAL, Covered, updated
from jgait.geometry.arrays import xp
from jgait.geometry.vectors import root
from jgait.types import Estimate


def frozen(p: VelocityUpdateParams, *arguments: Any, **settings: Any) -> Covered:
    """OFDRI without the update: every cycle begins and ends with the velocity at the first heel strike of its bout."""
    return updated(p._replace(threshold=math.inf), *arguments, **settings, initial=1)


def integrated(p: VelocityUpdateParams, *arguments: Any, **settings: Any) -> Covered:
    """OFI over each bout; cycles only define where lengths are read."""
    return updated(p._replace(threshold=0.0), *arguments, **settings)


def by_pendulum(p: WaistParams, inputs: Any, intervals: model.Intervals) -> model.WaistWalk:
    """Distance by the pendulum's steps alone; an interval from standing is half of the step after it."""
    constant, constant_spread = model.personal_constant(p, inputs, intervals)
    lengths = xp.where(inputs.steps, constant * intervals.pendulum, 0.0)
    beside = xp.maximum(xp.concatenate([lengths[1:], lengths[:1]]), xp.concatenate([lengths[:1], lengths[:-1]]))
    begins = inputs.moves & ~inputs.steps & ~inputs.stands
    step = xp.where(begins, 0.5 * beside, lengths)
    variance = xp.where(inputs.moves, model.step_variance(p, inputs, intervals), 0.0)
    distance, share = xp.cumsum(step), root(constant_spread)
    stride, white = step + model.earlier(step, 1), variance + model.earlier(variance, 1)
    return model.WaistWalk(
        distance=distance,
        distance_sd=root(xp.cumsum(variance) + (share * distance) ** 2),
        step=step,
        step_sd=root(variance + (share * step) ** 2),
        stride=stride,
        stride_sd=root(white + (share * stride) ** 2),
        unsure=xp.zeros_like(inputs.steps),
        diagnostics={"pendulum_constant": constant, "pendulum_constant_stddev": constant * share},
    )


WAYS = {"frozen": frozen, "integrated": integrated}
THRESHOLDS = {"frozen": (math.inf, 1), "integrated": (0.0, INITIAL)}
"""Way → threshold of the update [m/s], and the number of heel strikes by OFI."""


def run(p: WaistParams, inputs: Any, kind: str) -> Estimate:
    """As `waist.run` with default options, its distance by "pendulum" or one of `WAYS`."""
    seen = motion.motion(p, inputs, smooth=DEFAULT.smooth)
    found = model.intervals(p, inputs, seen)
    if kind == "pendulum":
        return stated(inputs, seen, found, by_pendulum(p, inputs, found))
    threshold, initial = THRESHOLDS[kind]
    gated = p._replace(update=p.update._replace(threshold=threshold))
    speed, held = velocity_update.integrated_speed(gated, inputs, seen, found, initial)
    # at the first contact the person is still setting off, and that speed is held
    known = inputs.stood & (kind != "frozen")
    held = jnp.ones_like(held) if kind == "frozen" else jnp.zeros_like(held)
    start_sd = p.start_speed_sd * jnp.where(known, 0.0, 1.0)
    return stated(inputs, seen, found, velocity_update.by_integration(p, inputs, found, speed, held, start_sd))
