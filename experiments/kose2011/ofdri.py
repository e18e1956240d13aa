"""Value, error and time of OFDRI's gradient."""

import time
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from experiments.common.row import Row
from jgait.estimators.waist import velocity_update as direct_reverse
from jgait.estimators.waist.velocity_update import Cycles, optimum_cutoffs

CYCLES, RATE_HZ = 1000, 100.0


def walk(cycles: int) -> tuple[Any, Cycles]:
    """A forward acceleration with a bias that wanders, and its cycles; about a second each."""
    rng = np.random.default_rng(1)
    ends = np.concatenate([[0], np.cumsum(rng.integers(95, 116, cycles))])
    t = np.arange(ends[-1] + 1) / RATE_HZ
    acc = 1.5 * np.sin(4.0 * np.pi * t) + 0.5 * np.sin(2.0 * np.pi * t) + 0.1 * np.sin(0.02 * t)
    acc += 0.05 + 0.1 * rng.normal(size=t.size)
    return jnp.asarray(acc), Cycles(jnp.asarray(ends[:-1]), jnp.asarray(ends[1:]), cycles)


def rows(quick: bool) -> list[Row]:
    """OFDRI of a thousand cycles: gradient of the way in the cut-off beside finite differences, and how long it takes.

    The cut-off is given, one for all cycles; then that of each cycle by the optimum rule, its implicit gradient too.
    """
    number = 50 if quick else CYCLES
    acc, cycles = walk(number)
    dt = 1.0 / RATE_HZ

    def way(cutoff_hz: Any, scale: Any) -> Any:
        velocity = direct_reverse.direct_reverse_cycles(scale * acc, cycles, 1.2, 1.2, dt, cutoff_hz)
        return dt * jnp.sum(velocity)

    def optimum(scale: Any) -> Any:
        return way(optimum_cutoffs(scale * acc, cycles, 0.0, dt), scale)

    plain, ruled = jax.jit(jax.value_and_grad(way)), jax.jit(jax.value_and_grad(optimum))
    at, step = jnp.asarray(0.05), 1e-5
    told = float(plain(at, 1.0)[1])
    measured = float((plain(at + step, 1.0)[0] - plain(at - step, 1.0)[0]) / (2.0 * step))
    wrong = abs(told - measured) / abs(measured)
    milliseconds = [milliseconds_of(lambda: plain(at, 1.0)), milliseconds_of(lambda: ruled(1.0))]
    print(f"OFDRI: gradient in the cut-off {told:.6g} m/Hz, by differences {measured:.6g}; {number} cycles take "
          f"{milliseconds[0]:.1f} ms with the gradient, {milliseconds[1]:.0f} ms with the optimum rule")  # fmt: skip
    split = f"{acc.size} samples at {RATE_HZ:g} Hz"
    return [
        Row("ofdri_gradient_error", wrong, "1", n=number, split=f"relative, against differences of {step:g} Hz"),
        Row("ofdri_value_and_gradient_ms", milliseconds[0], "ms", n=number, split=split),
        Row("ofdri_optimum_value_and_gradient_ms", milliseconds[1], "ms", n=number, split=split),
    ]


def milliseconds_of(call: Any, repeats: int = 11) -> float:
    """Median time of a call that was made before [ms]."""
    jax.block_until_ready(call())
    taken = []
    for _ in range(repeats):
        start = time.perf_counter()
        jax.block_until_ready(call())
        taken.append(time.perf_counter() - start)
    return 1000.0 * float(np.median(taken))
