"""The filter core on the estimators' own models: compile time, rate and gradients for a foot and a leg.

The foot has 15 error states and three velocities in stance, the leg 8 states and six observations with masks. Signals
are simulated by formulas: only their sizes matter for time. Seconds are of processor time where a program is
compiled, and of the clock where it runs; `b64` splits the batch between two threads, one for each core. Rows named
`*_over_today` are ratios of medians over an earlier build, see `today`, which runs in turn with the present one.
"""

import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from experiments.benchmark import today
from experiments.benchmark.candidates import candidates
from experiments.benchmark.leg import LOG_NOISE, recordings
from experiments.benchmark.timing import Program, compiled, data_of, interleaved
from experiments.common.process import ROOT
from experiments.common.row import Row, show
from jgait import filtering
from jgait.estimators.foot_ins import model as foot_model
from jgait.estimators.leg_ekf import model as leg_model

SAMPLES = 1024
CORES = min(2, os.cpu_count() or 1)
FILTERING = Path(filtering.__file__).parent


class Problem(NamedTuple):
    """A model, the logarithms of its parameters, and a batch: observations, controls, masks, the intervals [s].

    `params` is the type of the model's parameters.
    """

    model: Any
    logs: Any
    batch: Any
    dt: float
    chosen: tuple[str, ...]
    params: Any


def foot(count: int, samples: int, dtype: Any) -> Problem:
    """Steps of one foot: swing for half of the time, at rest for the other."""
    rng, dt = np.random.default_rng(0), 0.005
    phase = 2 * np.pi * np.arange(samples) * dt * (0.9 + 0.02 * rng.standard_normal((count, 1)))
    swing = np.sin(phase) > 0.2
    gyr = [swing * wave for wave in (0.3 * np.sin(2 * phase), 4.0 * np.sin(phase), 0.2 * np.cos(phase))]
    acc = [swing * wave for wave in (3.0 * np.cos(2 * phase), 0.5 * np.sin(phase), 2.0 * np.sin(2 * phase))]
    acc[2] = acc[2] + 9.81

    def noisy(waves: list[Any], noise: float) -> Any:
        return jnp.stack([jnp.asarray(w + noise * rng.standard_normal(w.shape), dtype) for w in waves], axis=-1)

    restart = np.diff(swing.astype(float), axis=1, prepend=0.0) > 0.0
    every = [jnp.full((count, samples), value, dtype) for value in (1e-6, 1e-4, 1e-4)]
    controls = foot_model.FootControl(noisy(gyr, 0.01), noisy(acc, 0.02), *every, jnp.asarray(restart, dtype))
    rest = jnp.asarray(~swing)
    observed = foot_model.FootObservation(jnp.zeros((count, samples, 3), dtype), None)
    batch = observed, controls, foot_model.FootObservation(rest, None)
    logs = jnp.log(jnp.asarray([0.05, 1e-9, 1e-8, 1e-4], dtype))
    model = foot_model.MODEL._replace(observation=_velocity, observation_noise=_velocity_noise)
    return Problem(model, logs, batch, dt, ("position", "velocity", "attitude"), foot_model.FootModelParams)


def _velocity(*arguments: Any) -> Any:
    return foot_model.observation(*arguments)._replace(height=None)


def _velocity_noise(*arguments: Any) -> Any:
    return foot_model.observation_noise(*arguments)._replace(height=None)


def leg(count: int, samples: int, dtype: Any) -> Problem:
    """A leg with gyroscopes at every sample and inclinations at some."""
    rng, dt = np.random.default_rng(1), 0.01
    phase = 2 * np.pi * np.arange(samples) * dt * (0.9 + 0.02 * rng.standard_normal((count, 1)))
    waves = [2.0 * np.cos(phase), 3.0 * np.sin(phase), 0 * phase, 0 * phase, 0.3 * np.sin(phase) - 1.5,
             0.2 * np.cos(phase) - 1.6]  # fmt: skip
    noise = (0.02, 0.02, 0.0, 0.0, 0.05, 0.05)
    observed = [jnp.asarray(w + s * rng.standard_normal(w.shape), dtype) for w, s in zip(waves, noise, strict=True)]
    masks = [jnp.asarray(rng.random(phase.shape) < share) for share in (1.0, 1.0, 1.0, 1.0, 0.3, 0.3)]
    controls = leg_model.LegControl(*(jnp.full(phase.shape, 0.01, dtype) for _ in range(2)))
    batch = leg_model.LegObservation(*observed), controls, leg_model.LegObservation(*masks)
    logs = jnp.log(jnp.asarray([0.42, 0.43, 1e-6, 5.0, 1e-9, 4e-4, 4e-4, 1e-5], dtype))
    return Problem(leg_model.MODEL, logs, batch, dt, ("thigh_angle", "knee_angle"), leg_model.LegModelParams)


def params_of(problem: Problem, logs: Any) -> Any:
    """The model's parameters from their logarithms."""
    return problem.params(*(jnp.exp(logs[i]) for i in range(len(problem.params._fields))))


def smoother(problem: Problem, batch: Any, logs: Any, variances: bool = True) -> Any:
    """Smoothed means of a batch, and variances."""

    def one(observed: Any, controls: Any, mask: Any) -> Any:
        found = filtering.kalman_smoother(
            problem.model, params_of(problem, logs), observed, controls=controls, dt=problem.dt, mask=mask,
            keep=("log_likelihood",), covariance=problem.chosen if variances else False, execution="core",
        )  # fmt: skip
        return found.mean, found.cov.variances() if variances else None

    return jax.vmap(one)(*batch)


def likelihood(problem: Problem, batch: Any, logs: Any) -> Any:
    """The sum of the log-likelihoods of a batch."""

    def one(observed: Any, controls: Any, mask: Any) -> Any:
        found = filtering.kalman_filter(
            problem.model, params_of(problem, logs), observed, controls=controls, dt=problem.dt, mask=mask,
            keep=("log_likelihood",), execution="core",
        )  # fmt: skip
        return jnp.sum(found.log_likelihood)

    return jnp.sum(jax.vmap(one)(*batch))


def loss(problem: Problem, batch: Any, weights: Any) -> Any:
    """A loss on smoothed means, of parameters, a scale of each control, and a shift of each observation."""
    logs, scales, shifts = weights
    observed, controls, mask = batch
    leaves, structure = jax.tree.flatten(controls)
    controls = structure.unflatten([leaf * jnp.exp(scale) for leaf, scale in zip(leaves, scales, strict=True)])
    leaves, structure = jax.tree.flatten(observed)
    observed = structure.unflatten([leaf + shift for leaf, shift in zip(leaves, shifts, strict=True)])
    mean, _ = smoother(problem, (observed, controls, mask), logs, variances=False)
    wave = jnp.cos(jnp.arange(jax.tree.leaves(mean)[0].shape[1], dtype=logs.dtype))
    return sum(jnp.mean(wave * jnp.moveaxis(leaf + leaf**2, 1, -1)) for leaf in jax.tree.leaves(mean))


def weights_of(problem: Problem) -> Any:
    observed, controls, _ = problem.batch
    return (
        problem.logs,
        jnp.zeros(len(jax.tree.leaves(controls)), problem.logs.dtype),
        jnp.zeros(len(jax.tree.leaves(observed)), problem.logs.dtype),
    )


def program(function: Callable[..., Any], *arguments: Any, steps: int) -> tuple[Program, float]:
    """A compiled program, whose `compile_seconds` are of processor time without tracing, and the seconds of tracing."""
    jax.clear_caches()
    start = time.process_time()
    lowered = filtering.compiled(function).lower(*arguments)
    traced = time.process_time() - start
    executable = lowered.compile()
    took = time.process_time() - start - traced

    def run() -> Any:
        return jax.block_until_ready(executable(*arguments))

    memory = executable.memory_analysis()
    return Program(run, run, steps, took, memory.temp_size_in_bytes if memory else 0, np.nan, np.nan, "w"), traced


def on_all_cores(function: Callable[..., Any], batch: Any, logs: Any, steps: int) -> Program:
    """The batch split between threads, one for each core."""
    count = len(jax.tree.leaves(batch)[0]) // CORES
    parts = [jax.tree.map(lambda leaf, i=i: leaf[i * count : (i + 1) * count], batch) for i in range(CORES)]
    one = filtering.compiled(function).lower(parts[0], logs).compile()
    pool = ThreadPoolExecutor(CORES)

    def run() -> Any:
        return list(pool.map(lambda part: jax.block_until_ready(one(part, logs)), parts))

    return Program(run, run, steps, 0.0, 0, np.nan, np.nan, "w")


def measured(name: str, make: Callable[..., Problem], quick: bool) -> list[Row]:
    """Rows of one model."""
    counts = (1, 64) if quick else (1, 16, 64, 256)
    split = f"{SAMPLES} samples, float32"
    programs: dict[Any, Program] = {}
    traced: list[float] = []
    for count in counts:
        problem = make(count, SAMPLES, jnp.float32)
        steps = count * SAMPLES

        def run(batch: Any, logs: Any, problem: Problem = problem) -> Any:
            return smoother(problem, batch, logs)

        if count >= 64:
            programs["smoother", count] = on_all_cores(run, problem.batch, problem.logs, steps)
        else:
            programs["smoother", count], seconds = program(run, problem.batch, problem.logs, steps=steps)
            traced.append(seconds)
    problem = make(16, SAMPLES, jnp.float32)
    steps, weights = 16 * SAMPLES, weights_of(problem)

    def value(batch: Any, weights: Any) -> Any:
        return loss(problem, batch, weights)

    def logs_value(batch: Any, logs: Any) -> Any:
        return likelihood(problem, batch, logs)

    def smoothed(batch: Any, logs: Any) -> Any:
        return smoother(problem, batch, logs)

    programs["smoother", 16], _ = program(smoothed, problem.batch, problem.logs, steps=steps)
    programs["gradient", 16], _ = program(jax.value_and_grad(value, argnums=1), problem.batch, weights, steps=steps)
    programs["filter", 16], _ = program(logs_value, problem.batch, problem.logs, steps=steps)
    programs["likelihood", 16], _ = program(
        jax.value_and_grad(logs_value, argnums=1), problem.batch, problem.logs, steps=steps
    )
    seconds = interleaved(programs, 3 if quick else 9)
    first = programs["smoother", 1].compile_seconds
    gradient = programs["gradient", 16]
    rows = [Row(f"{name}_compile_s", first, "s", None, 1, split)]
    rows.append(Row(f"{name}_trace_s", traced[0], "s", None, 1, split))
    for count in counts:
        rate = programs["smoother", count].steps / seconds["smoother", count] / 1e6
        rows.append(Row(f"{name}_msteps_b{count}", rate, "1e6/s", None, count, split))
    free = sum(leaf.size for leaf in jax.tree.leaves(weights))
    ratios = {
        f"{name}_gradient_over_smoother": seconds["gradient", 16] / seconds["smoother", 16],
        f"{name}_likelihood_gradient_over_filter": seconds["likelihood", 16] / seconds["filter", 16],
    }
    rows.append(Row(f"{name}_gradient_compile_s", gradient.compile_seconds, "s", None, free, f"{free} parameters"))
    rows.append(Row(f"{name}_gradient_memory_mb", gradient.temporary / 1e6, "MB", None, 16, "16 recordings"))
    if not quick:
        many = make(28, 6000, jnp.float32)
        large, _ = program(jax.value_and_grad(value, argnums=1), many.batch, weights, steps=1)
        rows.append(Row(f"{name}_gradient_memory_28_walks_mb", large.temporary / 1e6, "MB", None, 28, "30 s at 200 Hz"))
    rows += [Row(metric, ratio, "ratio", None, 16, "16 recordings") for metric, ratio in ratios.items()]
    return rows


def accelerator(name: str, make: Callable[..., Problem]) -> list[Row]:
    """Rates of smoother and gradient on what else than a CPU there is, and their largest difference from the CPU's."""
    rows, device, processor = [], jax.devices()[0], jax.devices("cpu")[0]
    split = f"{device.device_kind}, {SAMPLES} samples, float32"
    for count in (64, 1024, 8192):
        problem = make(count, SAMPLES, jnp.float32)
        jobs: dict[str, tuple[Callable[..., Any], Any]] = {
            "smoother": (lambda batch, logs, p=problem: smoother(p, batch, logs), problem.logs),
            "gradient": (
                jax.value_and_grad(lambda batch, weights, p=problem: loss(p, batch, weights), argnums=1),
                weights_of(problem),
            ),
        }
        for job, (function, free) in jobs.items():
            here = jax.device_put((problem.batch, free), device)
            fast, _ = program(function, *here, steps=count * SAMPLES)
            seconds = interleaved({job: fast}, 3)[job]
            rows.append(
                Row(f"{name}_gpu_{job}_msteps_b{count}", fast.steps / seconds / 1e6, "1e6/s", None, count, split)
            )
            if count == 64:
                there = jax.device_put((problem.batch, free), processor)
                slow, _ = program(function, *there, steps=count * SAMPLES)
                pairs = zip(jax.tree.leaves(fast.run()), jax.tree.leaves(slow.run()), strict=True)
                apart = max(float(np.max(abs(np.asarray(a) - b)) / max(np.max(abs(b)), 1e-9))
                            for a, b in ((a, np.asarray(b)) for a, b in pairs))  # fmt: skip
                rows.append(Row(f"{name}_gpu_{job}_difference", apart, "1", None, count, "over the largest value"))
    return rows


def gradient_error(make: Callable[..., Problem]) -> float:
    """The largest relative difference of the gradient from central differences, over all free numbers, in float64."""
    with jax.enable_x64(True):
        problem = make(1, 200, jnp.float64)
        value = jax.jit(lambda weights: loss(problem, problem.batch, weights))
        weights = weights_of(problem)
        flat, structure = jax.tree.flatten(jax.jit(jax.grad(value))(weights))
        found = np.concatenate(flat)
        start = np.concatenate(jax.tree.leaves(weights))
        ends = np.cumsum([leaf.size for leaf in flat])[:-1]

        def at(vector: Any) -> float:
            return float(value(structure.unflatten([jnp.asarray(part) for part in np.split(vector, ends)])))

        slopes = []
        for i in range(start.size):
            step = 1e-3 * np.eye(start.size)[i]
            once, twice = at(start + step) - at(start - step), at(start + 2 * step) - at(start - 2 * step)
            slopes.append((8.0 * once - twice) / 12e-3)
    largest = max(abs(found))
    return float(max(abs(found - slopes) / np.maximum(abs(found), 1e-4 * largest)))


def over_dynamax(quick: bool) -> list[Row]:
    """How much faster than dynamax the components of the 8-state leg are; no row where dynamax is absent."""
    every, absent = candidates()
    named = {candidate.name: candidate for candidate in every}
    if "dynamax" not in named:
        print("; ".join(absent))
        return []
    samples = 200 if quick else 3000
    data = data_of(*recordings(64, samples), 64, np.dtype(np.float32), LOG_NOISE)
    programs = {name: compiled(named[name], "filter", data, "reverse", False) for name in ("fast", "dynamax")}
    seconds = interleaved(programs, 3 if quick else 9)
    ratio = seconds["dynamax"] / seconds["fast"]
    return [Row("fast_over_dynamax_b64", ratio, "ratio", None, 64, f"8 states, {samples} samples, float32")]


def over_today(quick: bool) -> list[Row]:
    """Rates of the smoother, and seconds of compiling and tracing it, over those of the earlier build, in turn."""
    rounds, again = (3, 1) if quick else (9, 3)
    models, counts = ("foot", "leg"), (1, 64)
    with today.earlier() as tree:
        if tree is None:
            return []
        with today.Build(tree) as before, today.Build(ROOT) as now:
            builds = (before, now)
            made = {model: [[build.compiled(model, 1) for build in builds] for _ in range(again)] for model in models}
            for model in models:
                for build in builds:
                    build.compiled(model, 64)
            jobs = [(model, count) for model in models for count in counts]
            took = [{job: [build.seconds(*job) for build in builds] for job in jobs} for _ in range(rounds)]
    split = f"medians of {rounds} rounds in turn, {SAMPLES} samples, float32"
    found = []
    for model, count in jobs:
        old, new = (median(one[model, count][k] for one in took) for k in (0, 1))
        found.append(Row(f"{model}_b{count}_over_today", old / new, "ratio", None, count, split))
    for part in ("compile", "trace"):
        seconds = [[median(one[k][part] for one in made[model]) for k in (0, 1)] for model in models]
        worst = max(new / old for old, new in seconds)
        found.append(Row(f"{part}_over_today", worst, "ratio", None, again, "processor seconds, worst of foot and leg"))
    return found


def rows(quick: bool) -> list[Row]:
    """All of it; `quick` takes fewer sizes and repeats."""
    jax.config.update("jax_enable_compilation_cache", False)
    jax.config.update("jax_cpu_enable_async_dispatch", False)  # else two threads compute one after the other
    with jax.default_device(jax.devices("cpu")[0]), jax.enable_x64(False):
        found = [*measured("foot", foot, quick), *measured("leg", leg, quick)]
        found += over_dynamax(quick)
    if jax.default_backend() != "cpu":
        with jax.enable_x64(False):
            found += [*accelerator("foot", foot), *accelerator("leg", leg)]
    found += over_today(quick)
    error = max(gradient_error(foot), gradient_error(leg))
    found.append(Row("gradient_relative_error", error, "1", None, None, "against central differences, float64"))
    ratio = max(row.value for row in found if row.metric.endswith("likelihood_gradient_over_filter"))
    found.append(Row("likelihood_gradient_over_filter", ratio, "ratio", None, 16, "the larger of foot and leg"))
    lines = sum(len(path.read_text(encoding="utf-8").splitlines()) for path in FILTERING.glob("*.py"))
    found.append(Row("filtering_lines", lines, "lines", None, None, "jgait/filtering"))
    show("The filter core", ["", "", ""], [[row.metric, row.value, row.unit] for row in found])
    return found
