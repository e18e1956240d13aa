"""Leave-one-subject-out in one program, against loops over folds."""

import time
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax

from experiments.common.row import Row, show
from experiments.tuning.problems import GYROSCOPES, absolute, walks
from jgait import evaluate, params, tune
from jgait.estimators import leg_ekf
from jgait.tune import Lesson


class Shared(NamedTuple):
    """What the leave-one-subject-out fits share between people."""

    angle_noise: Any
    gyro_noise: Any
    standing_hip: Any
    standing_knee: Any


SHARED = Shared(10.0, 1.0, 0.0, 0.0)
RANGES = Shared(params.positive, params.positive, params.interval(-0.6, 0.6), params.interval(-0.4, 0.8))


def path_loss(p: Shared, lesson: Lesson) -> Any:
    """Squared error of angles and foot path, in degrees and centimetres, the person's lengths known."""
    side = leg_ekf.BySide
    q = leg_ekf.with_body(leg_ekf.LegParams(), lesson.body)._replace(
        angle_noise=p.angle_noise, gyro_noise=p.gyro_noise, standing_hip=side(p.standing_hip, p.standing_hip),
        standing_knee=side(p.standing_knee, p.standing_knee),
    )  # fmt: skip
    return absolute(leg_ekf.run(q, lesson.inputs, GYROSCOPES), lesson)


def rows(quick: bool) -> list[Row]:
    """32 subjects × 4 starts × 300 steps, against loops over folds; float32, compiling counted."""
    people, starts, steps = (6, 2, 20) if quick else (32, 4, 300)
    made = walks(jax.random.key(4), people, np.float32)
    data, names = made.data, made.subjects
    settings: dict[str, Any] = {"steps": steps, "starts": starts, "spread": 0.3, "gradient": "reverse"}
    start = jax.tree.map(np.float32, SHARED)

    begin = time.perf_counter()
    found = tune.cross_validate(
        path_loss, start, RANGES, data, optax.adam(0.03), subjects=names, key=jax.random.key(0), **settings
    )
    seconds = time.perf_counter() - begin

    def one_fold(out: int, **change: Any) -> float:
        others = jax.tree.map(lambda v: np.delete(v, out, axis=0), data)
        t = time.perf_counter()
        tune.fit(path_loss, start, RANGES, others, optax.adam(0.03), key=jax.random.key(0), **(settings | change))
        return time.perf_counter() - t

    folds = [one_fold(k) for k in range(2 if quick else 3)]
    alone = [one_fold(k, starts=1) for k in range(2 if quick else 3)]
    loop, nested = people * float(np.median(folds)), people * starts * float(np.median(alone))
    warm = people * _warm_fold(data, start, starts, steps)
    table = found.table
    gain = evaluate.paired_difference(table["error_before"], table["error_after"], table.index, seed=0)
    show(
        f"leave one out: {people} subjects × {starts} starts × {steps} steps of the leg EKF, 10 s at 100 Hz",
        ["", "seconds", "times ours"],
        [["cross_validate, compiling included", seconds, 1.0],
         ["loop over folds, each a fit of all starts", loop, loop / seconds],
         ["loop over folds and starts, each a fit", nested, nested / seconds],
         ["loop over folds in a step compiled once", warm, warm / seconds]],
    )  # fmt: skip
    show(
        "held-out error of angles and path, in squared degrees and centimetres",
        ["", "before", "after"],
        [["median person", float(table["error_before"].median()), float(table["error_after"].median())],
         ["worst person", float(table["error_before"].max()), float(table["error_after"].max())],
         ["people better", "", f"{gain.better} of {gain.n}"]],
    )  # fmt: skip
    split = "leave one subject out, simulated walks of the leg protocol"
    line = "gyroscopes alone, noise and standing pose tuned on other people: squared error of angles and path"
    return [
        Row("loso_seconds", seconds, "s", n=people, split=f"{starts} starts × {steps} steps, compiling included"),
        Row(
            "loso_speedup_over_loop", loop / seconds, "ratio", n=len(folds), split="over folds, tune.fit of all starts"
        ),
        Row("loso_speedup_over_nested_loop", nested / seconds, "ratio", n=len(alone), split="over folds and starts"),
        Row("loso_speedup_over_compiled_loop", warm / seconds, "ratio", n=1, split="a step compiled once for all"),
        Row("loso_error_before_median", float(table["error_before"].median()), "deg² + cm²", n=people, split=split).on(
            line, "untuned, median", "people", simulated=True
        ),
        Row("loso_error_after_median", float(table["error_after"].median()), "deg² + cm²", n=people, split=split).on(
            line, "median", "people", simulated=True
        ),
        Row("loso_error_before_worst", float(table["error_before"].max()), "deg² + cm²", n=people, split=split).on(
            line, "untuned, worst", "people", simulated=True
        ),
        Row("loso_error_after_worst", float(table["error_after"].max()), "deg² + cm²", n=people, split=split).on(
            line, "worst", "people", simulated=True
        ),
    ]


def _warm_fold(data: Lesson, start: Shared, starts: int, steps: int) -> float:
    """Seconds for one fold of a loop whose step, over one start and all other people, is compiled once before."""
    optimizer = optax.adam(0.03)

    @jax.jit
    def step(free: Shared, state: Any, others: Lesson) -> Any:
        def mean(at: Shared) -> Any:
            natural = params.constrain(at, RANGES, start)
            return jnp.mean(jax.vmap(partial(path_loss, natural))(others))

        loss, slope = jax.value_and_grad(mean)(free)
        updates, state = optimizer.update(slope, state, free)
        return optax.apply_updates(free, updates), state, loss

    others = jax.tree.map(lambda v: np.delete(v, 0, axis=0), data)
    free = jax.tree.map(jnp.asarray, params.unconstrain(start, RANGES))
    state = optimizer.init(free)
    jax.block_until_ready(step(free, state, others))
    few = min(steps, 30)
    t = time.perf_counter()
    for _ in range(few):
        free, state, _ = step(free, state, others)
    jax.block_until_ready(free)
    return (time.perf_counter() - t) * starts * steps / few
