"""Wavelets beside those of pywavelets; value, error and time of OFDRI's gradient."""

import time
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pywt

from experiments.common.row import Row
from jgait.estimators.waist import ofdri as direct_reverse
from jgait.estimators.waist.ofdri import Cycles
from jgait.estimators.waist.optimum import optimum_cutoffs
from jgait.signal import wavelet

WAVELETS = ("db1", "db2", "db5", "db10", "sym4", "coif2", "bior2.4", "rbio3.1")
LEVELS = (1, 2, 3, 5, 10)
SAMPLES = 1024
CYCLES, RATE_HZ = 1000, 100.0


def rows(quick: bool) -> list[Row]:
    """Wavelets, then the gradient."""
    return wavelets(quick) + gradient(quick)


def wavelets(quick: bool) -> list[Row]:
    """Greatest difference from pywavelets, there and back; and three levels beside ten."""
    rng = np.random.default_rng(0)
    x, worst, count = rng.normal(size=SAMPLES), 0.0, 0
    for name in WAVELETS[2:4] if quick else WAVELETS:
        for levels in LEVELS[2:4] if quick else LEVELS:
            theirs = pywt.swt(x, name, level=levels)
            ours = wavelet.transform(x, name, levels)
            apart = [np.abs(ours.approximation - theirs[0][0]).max()]
            apart += [np.abs(a - b).max() for a, (_, b) in zip(ours.details, reversed(theirs), strict=True)]
            # changed coefficients are no transform of any signal, and the ways back differ
            changed = [(rng.normal(size=SAMPLES), rng.normal(size=SAMPLES)) for _ in range(levels)]
            made = wavelet.Decomposition(
                jnp.asarray(changed[0][0]), tuple(jnp.asarray(d) for _, d in reversed(changed))
            )
            apart.append(np.abs(wavelet.inverse(made, name) - pywt.iswt(changed, name)).max())
            worst, count = max(worst, float(max(apart))), count + 1
    three, ten = wavelet.transform(x, "db5", 3), wavelet.transform(x, "db5", 10)
    none = jnp.zeros_like(ten.approximation)
    few = wavelet.inverse(wavelet.Decomposition(none, three.details), "db5")
    many = wavelet.inverse(wavelet.Decomposition(none, (*ten.details[:3], *(none,) * 7)), "db5")
    print(f"wavelets: at most {worst:.1e} from pywavelets over {count} wavelets and levels")
    split = "there and back, signals and coefficients of standard deviation 1"
    return [
        Row("swt_parity", worst, "1", n=count, split=split),
        Row("swt_three_levels_against_ten", float(jnp.abs(few - many).max()), "1", split="details 1 to 3 of db5"),
    ]


def walk(cycles: int) -> tuple[Any, Cycles]:
    """A forward acceleration with a bias that wanders, and its cycles; about a second each."""
    rng = np.random.default_rng(1)
    ends = np.concatenate([[0], np.cumsum(rng.integers(95, 116, cycles))])
    t = np.arange(ends[-1] + 1) / RATE_HZ
    acc = 1.5 * np.sin(4.0 * np.pi * t) + 0.5 * np.sin(2.0 * np.pi * t) + 0.1 * np.sin(0.02 * t)
    acc += 0.05 + 0.1 * rng.normal(size=t.size)
    return jnp.asarray(acc), Cycles(jnp.asarray(ends[:-1]), jnp.asarray(ends[1:]), cycles)


def gradient(quick: bool) -> list[Row]:
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
