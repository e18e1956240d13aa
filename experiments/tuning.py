"""Tuning by gradient: does it find what is there, does it say what is not, and does it hold for other people?"""

import time
from functools import partial
from typing import Any, NamedTuple

import _tuning_problems as problems
import jax
import jax.numpy as jnp
import numpy as np
import optax
from _tuning_killed import killed
from _tuning_problems import FREE, GYROSCOPES, START, TRUE, Drawn, Noise, filtered, nats, walks
from _tuning_real import real
from common import Row, main, show

from jgait import evaluate, params, tune
from jgait.estimators import leg_ekf
from jgait.tune import Fit, Lesson, losses


def cohort_fit(data: Drawn, steps: int) -> Fit[Noise]:
    return tune.fit(nats, START, FREE, data, optax.lbfgs(), steps=steps)


def recovered(quick: bool) -> list[Row]:
    """Noise scales by likelihood on legs drawn from the model; which are determined at all, in words."""
    people = 8 if quick else 32
    learn, other = (problems.drawn(jax.random.key(seed), people) for seed in (1, 2))
    fit = cohort_fit(learn, 15 if quick else 40)
    said = tune.identifiability(nats, fit.params, FREE, learn)
    show(
        f"{people} legs drawn from the model, likelihood",
        ["noise", "true", "start", "found", "standard error, logarithm", "determined"],
        [
            [name, getattr(TRUE, name), getattr(START, name), float(getattr(fit.params, name)), float(error),
             "no" if name in said.undetermined else "yes"]
            for name, error in zip(said.names, said.stderr_free, strict=True)
        ],
    )  # fmt: skip
    print("\n".join(f"  {sentence}" for sentence in said.sentences))
    known = [name for name in Noise._fields if name not in said.undetermined]
    errors = [abs(float(getattr(fit.params, name)) / getattr(TRUE, name) - 1.0) for name in known]
    split = "drawn from the leg model"
    named = float(set(said.undetermined) == {"position_noise", "bias_noise"})
    return [
        Row("recover_noise_rel_error_max", max(errors), "ratio", n=people, split=f"{split}: {', '.join(known)}"),
        Row("recover_noise_unidentifiable_named", named, "bool", n=people, split=f"{split}: σ_xy and σ_β, no others"),
        *consistent(other, START, fit.params, people),
    ]


def consistent(data: Drawn, before: Noise, after: Noise, people: int) -> list[Row]:
    """Innovations of people that the tuning never saw: NIS and whiteness, before and after."""
    rows, lines = [], []
    split = "other legs than those tuned on"

    @jax.jit
    def told(p: Noise) -> Any:
        return jax.vmap(lambda item: filtered(p, item, "nis", "count", "innovation", "innovation_stddev"))(data)

    for name, p in (("before", before), ("after", after)):
        found = told(p)
        nis = evaluate.nis_consistency(np.ravel(found.nis), np.ravel(found.count))
        each = [evaluate.nis_consistency(*both) for both in zip(found.nis, found.count, strict=True)]
        people_inside = float(np.mean([one.consistent for one in each]))
        white = [
            np.stack([np.asarray(v[i]) / np.asarray(s[i]) for v, s in zip(found.innovation, found.innovation_stddev,
                                                                        strict=True)], axis=1)
            for i in range(people)
        ]  # fmt: skip
        tests = [evaluate.whiteness(values) for values in white]
        inside = float(np.mean([one.share_inside for one in tests]))
        passed = float(np.mean([one.consistent for one in tests]))
        lines.append([name, nis.mean, nis.low, nis.high, people_inside, inside, passed])
        rows += [
            Row(f"nis_{name}", nis.mean, "1", n=people, split=split),
            Row(f"nis_inside_{name}", float(nis.consistent), "bool", n=people, split=f"{split}: all as one"),
            Row(f"nis_people_inside_{name}", people_inside, "ratio", n=people, split=f"{split}: 95 % band of each"),
            Row(f"white_lags_inside_{name}", inside, "ratio", n=people, split=split),
            Row(f"white_people_{name}", passed, "ratio", n=people, split=f"{split}: Ljung–Box at 95 %"),
        ]
    show(
        f"innovations of {people} other legs",
        ["", "NIS", "95 % from", "to", "people inside their band", "autocorrelations inside", "people white"],
        lines,
    )
    return rows


def absolute(estimate: Any, lesson: Lesson) -> Any:
    """Squared error of angles [°²] and foot path [cm²], offsets included."""
    return losses.trajectory(estimate, lesson.reference, window=lesson.look)


class Leg(NamedTuple):
    """What is each person's own: lengths [m], and the pose in which they stand [rad]."""

    thigh_length: Any
    shank_length: Any
    standing_hip: Any
    standing_knee: Any


def lengths(quick: bool) -> list[Row]:
    """Everybody's own leg lengths from the path of their feet, all people in one fit."""
    people = 4 if quick else 32
    data = walks(jax.random.key(3), people, np.float64).data
    length, angle = (params.per_subject(params.interval(*ends)) for ends in ((0.2, 0.7), (-0.6, 0.6)))

    def loss(p: Leg, lesson: Lesson) -> Any:
        side = leg_ekf.BySide
        q = leg_ekf.with_body(leg_ekf.LegParams(), {"thigh_length": p.thigh_length, "shank_length": p.shank_length})
        q = q._replace(
            standing_hip=side(p.standing_hip, p.standing_hip), standing_knee=side(p.standing_knee, p.standing_knee)
        )
        return absolute(leg_ekf.run(q, lesson.inputs, GYROSCOPES), lesson)

    fit = tune.fit(
        loss, Leg(0.43, 0.43, 0.0, 0.0), Leg(length, length, angle, angle), data, optax.lbfgs(),
        steps=10 if quick else 30, subjects=range(people), gradient="forward",
    )  # fmt: skip
    true = [data.own[name][:, 0] for name in ("thigh_length", "shank_length")]
    errors = 100.0 * np.abs(np.stack([np.asarray(fit.params[k]) - true[k] for k in range(2)]))
    total = 100.0 * np.abs(sum(np.asarray(fit.params[k]) - true[k] for k in range(2)))
    show(
        f"leg lengths of {people} people from the path of the foot, {fit.losses[0]:.1f} → {fit.best_loss:.1f} cm²",
        ["", "median error [cm]", "worst [cm]"],
        [["thigh", float(np.median(errors[0])), float(errors[0].max())],
         ["shank", float(np.median(errors[1])), float(errors[1].max())],
         ["both together", float(np.median(total)), float(total.max())]],
    )  # fmt: skip
    split = "walks of the leg protocol, own lengths of each person in one fit"
    return [
        Row("recover_leg_length_cm_median", float(np.median(errors)), "cm", n=2 * people, split=split),
        Row("recover_leg_length_cm_worst", float(errors.max()), "cm", n=2 * people, split=split),
        Row("recover_leg_length_whole_cm_median", float(np.median(total)), "cm", n=people, split=split),
    ]


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
    q = leg_ekf.with_body(leg_ekf.LegParams(), lesson.own)._replace(
        angle_noise=p.angle_noise, gyro_noise=p.gyro_noise, standing_hip=side(p.standing_hip, p.standing_hip),
        standing_knee=side(p.standing_knee, p.standing_knee),
    )  # fmt: skip
    return absolute(leg_ekf.run(q, lesson.inputs, GYROSCOPES), lesson)


def leave_one_out(quick: bool) -> list[Row]:
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
    return [
        Row("loso_seconds", seconds, "s", n=people, split=f"{starts} starts × {steps} steps, compiling included"),
        Row(
            "loso_speedup_over_loop", loop / seconds, "ratio", n=len(folds), split="over folds, tune.fit of all starts"
        ),
        Row("loso_speedup_over_nested_loop", nested / seconds, "ratio", n=len(alone), split="over folds and starts"),
        Row("loso_speedup_over_compiled_loop", warm / seconds, "ratio", n=1, split="a step compiled once for all"),
        Row("loso_error_before_median", float(table["error_before"].median()), "deg² + cm²", n=people, split=split),
        Row("loso_error_after_median", float(table["error_after"].median()), "deg² + cm²", n=people, split=split),
        Row("loso_error_before_worst", float(table["error_before"].max()), "deg² + cm²", n=people, split=split),
        Row("loso_error_after_worst", float(table["error_after"].max()), "deg² + cm²", n=people, split=split),
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


PARTS = {"recovered": recovered, "lengths": lengths, "leave_one_out": leave_one_out, "real": real, "killed": killed}


def experiment(quick: bool) -> list[Row]:
    """All parts; what needs recordings that are not here says so and is left out."""
    return [row for part in PARTS.values() for row in part(quick)]


if __name__ == "__main__":
    main("tuning", __doc__.splitlines()[0], experiment)
