"""Filters against each other and against C: steps a second, gradients, compile time and memory of the 8-state leg EKF.

All candidates run in turn in one process; numbers are medians. Absent libraries are named and left out: `make bench`
installs them. Gradients are by 6 tangents at once ("fast"), one after
another ("fast_forward") and backwards ("fast_reverse", and all others).
"""

import sys
import time
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from experiments.benchmark import day
from experiments.benchmark import inertial as _inertial_problem
from experiments.benchmark.candidates import Candidate, Limit, candidates, filterpy
from experiments.benchmark.leg import LOG_NOISE, recordings
from experiments.benchmark.report import draw, rows_of, tables
from experiments.benchmark.timing import (
    GRADIENTS,
    JOBS,
    Cell,
    Key,
    Program,
    Scope,
    compiled,
    data_of,
    exponent,
    interleaved,
)
from experiments.common.row import Row, show
from jgait import filtering

__all__ = ["draw", "rows"]

OURS = ("core", "fast")
TOLERANCE = {"float64": 1e-5, "float32": 2e-2}
"""Largest difference of means and gradients from the core in float64 that counts as the same filter."""


SIZES = (1, 64, 256, 1024)
FULL = Scope(3000, SIZES, SIZES, (1, 64), 9, tuple(JOBS), ("float32", "float64"), True)
QUICK = Scope(200, (1, 64), (64,), (64,), 5, ("filter", "mse"), ("float32",), False)


# --- measuring ---


def entries(job: str, every: list[Candidate], thorough: bool) -> list[tuple[str, Candidate, str]]:
    """Name, candidate and gradient mode of what a job compares."""
    found = []
    for candidate in every:
        found.append((candidate.name, candidate, "together" if candidate.name == "fast" else "reverse"))
        if thorough and job in GRADIENTS and candidate.name == "fast":
            found += [(f"fast_{mode}", candidate, mode) for mode in ("forward", "reverse")]
    return found


def checked(key: Key, found: Any, every: list[Candidate], reference: Any) -> dict[str, float]:
    """Largest difference from what the core gave in float64.

    Of means [m, rad, rad/s], of a log-likelihood [nat a sample], of a gradient relative to its largest component.
    """
    candidate = next((c for c in every if key.name.startswith(c.name)), None)
    wanted, scale = reference
    return {
        what: float(np.max(np.abs(value - wanted[what]))) / scale[what]
        for what, value in outcome(candidate, key.job, found).items()
    }


def disagreeing(errors: dict[Key, float]) -> list[str]:
    """A line on each candidate that does not compute what the others do; raises where it is jgait."""
    bad = {key: error for key, error in errors.items() if not error <= TOLERANCE[key.dtype]}
    lines = [f"{key.name} computes another {key.job} in {key.dtype}: off by {error:.2g}" for key, error in bad.items()]
    if any(key.name.startswith(OURS) for key in bad):
        raise RuntimeError("; ".join(lines))
    return lines


def outcome(candidate: Candidate | None, job: str, found: Any) -> dict[str, Any]:
    """What a job gave, in NumPy; means (T, B, 8)."""
    if job in GRADIENTS:
        return {f"{job}_gradient": np.asarray(found[1])}
    if job == "smoother":
        return {"smoother": np.asarray(candidate.stacked(found))}
    means = found[0] if candidate is None else candidate.stacked(found[0])
    return {"filter": np.asarray(means), "log_likelihood": np.asarray(found[1])}


def reference_of(core: Candidate, job: str, walks: Any, samples: int) -> tuple[dict[str, Any], dict[str, float]]:
    """What the core gives in float64 for 64 recordings, and what differences from it are divided by."""
    data = data_of(*walks, 64, np.float64, LOG_NOISE)
    wanted = outcome(core, job, compiled(core, job, data, "reverse", False).result())
    scale = {what: float(np.max(np.abs(value))) if job in GRADIENTS else 1.0 for what, value in wanted.items()}
    return wanted, scale | ({"log_likelihood": float(samples)} if job == "filter" else {})


def group(
    job: str, dtype: str, count: int, walks: Any, scope: Scope, every: list[Candidate], limit: Limit | None
) -> dict[Key, Program]:
    """What is run in turn: all candidates that do a job, for one type and number of recordings."""
    data = data_of(*walks, count, np.dtype(dtype), LOG_NOISE)
    programs = {}
    for name, candidate, mode in entries(job, every, scope.thorough):
        if job == "filter" or count in scope.heavy or (candidate.name == "fast" and count in scope.ours):
            programs[Key(name, job, count, dtype)] = compiled(candidate, job, data, mode, scope.thorough)
    if job == "filter" and limit is not None:
        run, result = limit.prepare(walks[0][:count], dtype)
        run()
        programs[Key("c", job, count, dtype)] = Program(run, result, count * scope.samples)
    return programs


def measured(scope: Scope, every: list[Candidate], limit: Limit | None) -> tuple[dict[Key, Cell], dict[Key, float]]:
    """All timings, and the differences from the core in float64 (there the job is what differs)."""
    walks = recordings(max(scope.sizes), scope.samples)
    cells: dict[Key, Cell] = {}
    errors: dict[Key, float] = {}
    for job in scope.jobs:
        with jax.enable_x64(True):
            reference = reference_of(every[0], job, walks, scope.samples)
        for dtype in scope.dtypes:
            # float32 is measured the way JAX comes: not every library keeps to it where 64 bits are switched on.
            with jax.enable_x64(dtype == "float64"):
                for count in scope.sizes:
                    print(f"{job}, {dtype}, B = {count}", file=sys.stderr)
                    programs = group(job, dtype, count, walks, scope, every, limit)
                    if count == 64:
                        for key, program in programs.items():
                            found = checked(key, program.result(), every, reference)
                            errors |= {key._replace(job=what): error for what, error in found.items()}
                    for key, seconds in interleaved(programs, scope.repeats).items():
                        # Only the numbers are kept: a program holds its arguments.
                        cells[key] = Cell(seconds, programs[key]._replace(run=lambda: None, result=lambda: None))
    return cells, errors


def loop(scope: Scope) -> list[Row]:
    """filterpy's NumPy loop over a single recording, scaled from its first samples."""
    samples, run = filterpy(scope.samples)
    rates = recordings(1, scope.samples)[0][0, :samples].astype(float)
    program = Program(lambda: run(rates), lambda: run(rates), samples)
    (seconds,) = interleaved({"filterpy": program}, scope.repeats).values()
    split = f"one recording of {samples} samples"
    return [Row("filter_msteps_filterpy_b1_float64", samples / seconds / 1e6, "million steps/s", None, 1, split)]


def scaling(fast: Candidate, scope: Scope) -> list[Row]:
    """How the cost of the fast filter grows with the number of recordings and with their length."""
    counts, lengths = [1, 10, 100, 1000, 10_000], [300, 1000, 3000, 10_000, 30_000]
    rows, lines = [], []
    cost = {"recordings": [(count, 300) for count in counts], "samples": [(64, length) for length in lengths]}
    for what, cases in cost.items():
        programs = {}
        for count, samples in cases:
            data = data_of(*recordings(count, samples), count, np.float32, LOG_NOISE)
            programs[count if what == "recordings" else samples] = compiled(fast, "filter", data, try_all=False)
        found = interleaved(programs, scope.repeats)
        slope = exponent(list(found), list(found.values()))
        rows.append(Row(f"cost_exponent_{what}", slope, "", None, len(found), f"{min(found)} to {max(found)} {what}"))
        if what == "recordings":
            wide = {size: seconds for size, seconds in found.items() if size >= 100}
            slope = exponent(list(wide), list(wide.values()))
            rows.append(Row(f"cost_exponent_{what}_from_100", slope, "", None, len(wide), "100 to 10000 recordings"))
        beside = "300 samples" if what == "recordings" else "64 recordings"
        lines += [[f"{what}, {beside}", size, 1e3 * seconds] for size, seconds in found.items()]
    show("Cost of the fast filter, float32", ["over", "number", "ms"], lines)
    return rows


def inertial_rows() -> list[Row]:
    """How long a filter of 15 error states takes to trace and compile for 64 recordings, by either way."""
    observed, controls, mask = _inertial_problem.recordings(64, 200)
    noise = jnp.asarray(_inertial_problem.PARAMS, jnp.float32)
    rows = []
    for execution in OURS:

        def one(y: Any, u: Any, m: Any, execution: Any = execution) -> Any:
            return filtering.kalman_filter(
                _inertial_problem.MODEL, noise, y, controls=u, dt=0.01, mask=m, keep=("mean", "log_likelihood"),
                execution=execution,
            )  # fmt: skip

        start = time.perf_counter()
        filtering.compiled(jax.vmap(one)).lower(observed, controls, mask).compile()
        name = "compile_seconds_inertial" + ("" if execution == "fast" else f"_{execution}")
        rows.append(Row(name, time.perf_counter() - start, "s", split="15 error states, zero velocity, float32"))
    return rows


def accelerator(every: list[Candidate], scope: Scope) -> list[Row]:
    """jgait and dynamax on what else than a CPU there is.

    Operations and bytes are the compiler's count for a single sample, for it counts the body of a loop once.
    """
    rows, lines = [], []
    samples, modes = 300, {"fast": "forward", "dynamax": "reverse"}
    for count in (64, 1024, 10_000, 100_000):
        data = data_of(*recordings(count, samples), count, np.float32, LOG_NOISE)
        first = data._replace(rates=data.rates[:1], path=data.path[:1])
        chosen = {(job, c.name): (c, job, modes[c.name]) for job in ("filter", "mse") for c in every if c.name in modes}
        programs = {key: compiled(c, job, data, mode, False) for key, (c, job, mode) in chosen.items()}
        once = {key: compiled(c, job, first, mode, False) for key, (c, job, mode) in chosen.items()}
        for key, seconds in interleaved(programs, scope.repeats).items():
            rate = programs[key].steps / seconds
            each = [1e-9 * rate * amount / count for amount in (once[key].operations, once[key].traffic)]
            lines.append([*key, count, rate / 1e6, *each])
            metric = f"{jax.default_backend()}_{key[0]}_msteps_{key[1]}_b{count}_float32"
            rows.append(Row(metric, rate / 1e6, "million steps/s", None, scope.repeats, f"{samples} samples"))
    columns = ["job", "candidate", "recordings", "million steps/s", "GFLOP/s", "GB/s"]
    show(f"{jax.devices()[0].device_kind}: float32, {samples} samples", columns, lines)
    return rows


# --- running ---


def rows(quick: bool) -> list[Row]:
    """All of it; `quick` shows that it runs, and leaves out what takes long."""
    scope = QUICK if quick else FULL
    # A compilation is measured, not looked up.
    jax.config.update("jax_enable_compilation_cache", False)
    every, absent = candidates()
    try:
        limit = Limit()
    except RuntimeError as error:
        limit = None
        absent.append(str(error))
    with jax.default_device(jax.devices("cpu")[0]):
        cells, errors = measured(scope, every, limit)
        tables(cells, errors, scope)
        rows = rows_of(cells, errors, scope)
        try:
            rows += loop(scope)
        except ImportError as error:
            absent.append(f"filterpy is absent: {error}")
        if not quick:
            with jax.enable_x64(False):
                rows += scaling(next(c for c in every if c.name == "fast"), scope)
                rows += inertial_rows()
            rows += day.rows()
    if jax.default_backend() != "cpu":
        with jax.enable_x64(False):
            rows += accelerator(every, scope)
    for line in absent + disagreeing(errors):
        print(line)
    return rows
