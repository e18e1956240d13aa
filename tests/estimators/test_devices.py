"""Single recordings are computed on the CPU, also where JAX would take another device by itself."""

from made.process import ran

SCRIPT = """
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

gpu, cpu = jax.devices()  # the first stands for a GPU, which this process says it has
jax.default_backend = lambda: "cuda"
jax.local_devices = lambda backend=None: [cpu]

from jgait.estimators import programs
from jgait.estimators.online.device import Device, Runner
from jgait.geometry.arrays import compiled, host

programs.on_host = lambda tree: tree  # NumPy's arrays do not say where they were computed

class Outputs(NamedTuple):
    dt: Any

def begin(constants, first, options):
    return constants

def advance(constants, state, samples, count, options):
    return state, Outputs(samples.dt)

x = np.arange(3.0)
program = programs.compiled(jnp.sin, quick=True)
on = [program(v).device for v in (x, jnp.asarray(x), jax.device_put(x, gpu), jax.device_put(x, cpu))]
on += [program.function(x).device, compiled(jnp.sin)(x).device]
with jax.default_device(gpu):
    on += [program(x).device]
runner = Runner(Device("feet", ("foot_right",), jnp.ones(2), begin, advance, None, (0,)))
runner.push(np.ones((2, 9)))
on += [runner._parts[0].device]
print(*("cpu" if device == cpu else "gpu" for device in on))

def absent(backend=None):
    raise RuntimeError("no such platform")

jax.local_devices = absent
print(host(), program(x).device == gpu)
"""


def test_one_recording_is_computed_on_the_cpu_and_a_batch_where_jax_computes():
    said = ran(SCRIPT, devices=2).split()
    assert said == ["cpu"] * 4 + ["gpu"] * 3 + ["cpu", "None", "True"]
