"""Integration of the waist's speed begins anew with every bout."""

import jax
import jax.numpy as jnp
import numpy as np
from made.trunk import cut, walk

from jgait.estimators import waist
from jgait.estimators.axes import pad
from jgait.estimators.waist import WaistParams
from jgait.estimators.waist import motion as waist_motion
from jgait.estimators.waist import readout as waist_distance
from jgait.estimators.waist import steps as waist_steps
from jgait.estimators.waist.inputs import PER_NODE

SAMPLES = 1024  # of everything that the compiled programs see


def doubled(inputs, seen):
    """One recording behind itself: its samples, nodes and cycles."""
    samples, nodes, cycles = (int(n) for n in (inputs.valid.sum(), inputs.count, inputs.cycles))

    def twice(values, count, size, shift=0):
        values = np.concatenate([values[:count], values[:count] + shift if shift else values[:count]])
        return np.pad(values, [(0, size - len(values))] + [(0, 0)] * (values.ndim - 1))

    moved = dict.fromkeys(("at", "cycle_begin", "cycle_end"), samples)
    per_node = {
        name: twice(
            getattr(inputs, name), cycles if name.startswith("cycle") else nodes, len(inputs.at), moved.get(name, 0)
        )
        for name in PER_NODE
    }
    per_sample = {name: twice(getattr(inputs, name), samples, SAMPLES) for name in ("valid", "dt", "measured", "still")}
    both = inputs._replace(**per_node, **per_sample, count=np.int32(2 * nodes), cycles=np.int32(2 * cycles))
    last = np.int32(2 * samples - 1)
    return both._replace(last=last), jax.tree.map(lambda v: twice(np.asarray(v), samples, SAMPLES), seen)


def test_integration_begins_anew_with_every_bout():
    one = pad(waist.prepared(cut(walk(steps=6, quiet=5.5).recording, 2.5)).inputs, SAMPLES)
    p = WaistParams()
    seen = jax.jit(waist_motion.motion_and_likelihood)(p, one)[0]

    @jax.jit
    def told(inputs, seen):
        found = waist_steps.intervals(p, inputs, seen)
        speed, held = waist_distance.integrated_speed(p, inputs, seen, found)
        start_sd = p.start_speed_sd * jnp.where(inputs.stood, 0.0, 1.0)
        return waist_distance.by_integration(p, inputs, found, speed, held, start_sd)

    first, both = told(one, seen), told(*doubled(one, seen))
    nodes = int(one.count)
    assert first.distance[-1] > 0.5 and not first.unsure[:nodes].any()
    for name in ("step", "stride", "stride_sd"):
        values = getattr(both, name)[2:nodes], getattr(both, name)[nodes + 2 : 2 * nodes]
        np.testing.assert_allclose(values[0], getattr(first, name)[2:nodes], atol=1e-9)
        np.testing.assert_allclose(values[1], values[0], atol=1e-9)
    for name in ("distance", "distance_sd"):
        np.testing.assert_allclose(getattr(both, name)[2 * nodes - 1], 2.0 * getattr(first, name)[nodes - 1], atol=1e-9)
