"""Measurements of the filter benchmark: programs are compiled afresh and run in turn; their time and memory."""

import math
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from experiments.benchmark.candidates import Candidate
from jgait import filtering

JOBS = {
    "filter": "filtered means and log-likelihood",
    "smoother": "smoothed means",
    "mse": "value and gradient of the trajectory's mean squared error",
    "nll": "value and gradient of the negative log-likelihood",
}
"""What is timed; the gradients are with respect to 6 noise parameters."""

GRADIENTS = ("mse", "nll")


class Program(NamedTuple):
    """Something to time.

    Attributes:
        run: does the work and waits for it.
        result: of the last thing it did (or does, where it is not kept).
        steps: filter steps in one run.
        compile_seconds: tracing and compiling, with no cache.
        temporary: bytes beside arguments and results.
        operations: floating point operations of a run, by the compiler's count.
        traffic: bytes read and written in a run, by the compiler's count.
        options: "w" compiled for wide vectors, "d" with XLA's defaults.
    """

    run: Callable[[], Any]
    result: Callable[[], Any]
    steps: int
    compile_seconds: float = 0.0
    temporary: int = 0
    operations: float = math.nan
    traffic: float = math.nan
    options: str = ""


class Data(NamedTuple):
    """Recordings of one type: log noise (6,), rates and path (T, B, 2) or, of a single one, (T, 2)."""

    theta: Any
    rates: Any
    path: Any


def data_of(rates: Any, path: Any, count: int, dtype: Any, theta: Any) -> Data:
    """The first `count` of recordings (B, T, 2), time in front; a single one has no axis for recordings."""

    def front(array: Any) -> Any:
        return jnp.asarray(array[0] if count == 1 else array[:count].swapaxes(0, 1), dtype)

    return Data(jnp.asarray(theta, dtype), front(rates), front(path))


class Scope(NamedTuple):
    """How much is measured.

    Attributes:
        samples: T.
        sizes: numbers of recordings that are filtered.
        ours: that the fast filter smooths and differentiates.
        heavy: the same for all others, which take seconds and gigabytes beyond.
        repeats: runs that a median is of.
        jobs: of `JOBS`.
        dtypes: names of types.
        thorough: compile with and without wide vectors and keep the faster; differentiate in every way.
    """

    samples: int
    sizes: tuple[int, ...]
    ours: tuple[int, ...]
    heavy: tuple[int, ...]
    repeats: int
    jobs: tuple[str, ...]
    dtypes: tuple[str, ...]
    thorough: bool


class Key(NamedTuple):
    name: str
    job: str
    count: int
    dtype: str


class Cell(NamedTuple):
    """One measurement: median seconds, and what was measured."""

    seconds: float
    program: Program

    @property
    def rate(self) -> float:
        """Million steps a second."""
        return self.program.steps / self.seconds / 1e6


# --- what is compiled ---


def mapped(one: Callable[[Any], Any], arranged: Any, batched: bool, out_axes: Any) -> Any:
    """Over recordings, which lie behind the time in arguments and results, so that no candidate has to transpose."""
    return jax.vmap(one, in_axes=1, out_axes=out_axes)(arranged) if batched else one(arranged)


def objective(candidate: Candidate, job: str, batched: bool) -> Callable[..., Any]:
    """The loss as a function of the log noise."""

    def loss(theta: Any, arranged: Any, path: Any) -> Any:
        means, log_likelihood = mapped(lambda r: candidate.filtered(theta, r), arranged, batched, (1, 0))
        if job == "nll":
            return -jnp.mean(log_likelihood)
        x, y = candidate.path(means)
        return jnp.mean((x - path[..., 0]) ** 2 + (y - path[..., 1]) ** 2)

    return loss


def function_of(candidate: Candidate, job: str, batched: bool, gradient: str = "reverse") -> Callable[..., Any]:
    """A job as a function of log noise, rates in the candidate's form, and path."""
    if job == "filter":
        return lambda theta, r, path: mapped(lambda one: candidate.filtered(theta, one), r, batched, (1, 0))
    if job == "smoother":
        return lambda theta, r, path: mapped(lambda one: candidate.smoothed(theta, one), r, batched, 1)
    loss = objective(candidate, job, batched)
    return jax.value_and_grad(loss) if gradient == "reverse" else along_tangents(loss, together=gradient == "together")


def along_tangents(loss: Callable[..., Any], *, together: bool) -> Callable[..., Any]:
    """Value and gradient by the first argument (n,) in forward mode, one tangent after another or all `together`."""

    def both(free: Any, *rest: Any) -> tuple[Any, Any]:
        def along(direction: Any) -> tuple[Any, Any]:
            return jax.jvp(lambda v: loss(v, *rest), (free,), (direction,))

        directions = jnp.eye(free.size, dtype=free.dtype)
        value, slopes = jax.vmap(along)(directions) if together else lax.map(along, directions)
        return value[0], slopes

    return both


def compiled(candidate: Candidate, job: str, data: Data, gradient: str = "reverse", try_all: bool = True) -> Program:
    """A job, compiled with XLA's defaults and for the widest vectors of the CPU, whichever runs faster."""
    batched = data.rates.ndim == 3
    function = function_of(candidate, job, batched, gradient)
    arguments = (data.theta, candidate.arranged(data.rates), data.path)
    makers = {"w": filtering.compiled, "d": jax.jit}
    best, fastest = None, math.inf
    for label in ("w", "d") if try_all else ("w",):
        jax.clear_caches()
        start = time.perf_counter()
        executable = makers[label](function).lower(*arguments).compile()
        took = time.perf_counter() - start

        def run(executable: Any = executable) -> Any:
            return jax.block_until_ready(executable(*arguments))

        run()
        seconds = min(timed(run) for _ in range(3 if try_all else 1))
        if seconds < fastest:
            cost = executable.cost_analysis() or {}
            memory = executable.memory_analysis()
            best, fastest = (run, took, memory.temp_size_in_bytes if memory else 0, cost, label), seconds
    run, took, temporary, cost, label = best
    count, samples = (data.rates.shape[1], data.rates.shape[0]) if batched else (1, data.rates.shape[0])
    return Program(
        run, run, count * samples, took, temporary, cost.get("flops", math.nan), cost.get("bytes accessed", math.nan),
        label,
    )  # fmt: skip


# --- clocks ---


def timed(run: Callable[[], Any]) -> float:
    """Seconds of one run."""
    start = time.perf_counter()
    run()
    return time.perf_counter() - start


def interleaved(programs: dict[Any, Program], repeats: int) -> dict[Any, float]:
    """Median seconds of each program; every repeat comes to each of them in turn, so that all see the same machine.

    What takes less than 20 ms is run once untimed, to have the caches back, and then as often as fills them.
    """
    times = {}
    for name, program in programs.items():
        program.run()
        times[name] = max(1, min(50, int(0.02 / timed(program.run))))
    took: dict[Any, list[float]] = {name: [] for name in programs}
    for _ in range(repeats):
        for name, program in programs.items():
            if times[name] > 1:
                program.run()
            start = time.perf_counter()
            for _ in range(times[name]):
                program.run()
            took[name].append((time.perf_counter() - start) / times[name])
    return {name: float(np.median(seconds)) for name, seconds in took.items()}


def exponent(sizes: list[int], seconds: list[float]) -> float:
    """Slope of the logarithms: 1 is a cost in proportion."""
    return float(np.polyfit(np.log(sizes), np.log(seconds), 1)[0])
