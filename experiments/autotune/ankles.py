"""Stride lengths of shanks (`walking5m`): lever and noise of the filter tuned on other people's strides."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax

from experiments.common.recordings import available, names
from experiments.common.row import Row, show
from experiments.common.shanks import legs
from experiments.silva2017 import lever
from experiments.silva2017.groups import keys
from jgait import filtering, params
from jgait.estimators import ankle_stride
from jgait.estimators.ankle_stride import AnkleParams
from jgait.estimators.ankle_stride.inputs import AnkleInputs

SET = "walking5m"
SPLIT = "walking5m, people left out, six folds"
FREE = (
    "lever_shank", "lever_forward", "lever_along_sd", "lever_across_sd", "velocity_noise", "rate_noise", "acc_noise",
    "gyr_noise", "acc_jump_noise", "gyr_jump_noise", "acc_bias", "tilt",
)  # fmt: skip
FOLDS, STEPS, RATE = 6, 25, 0.2
WRONG = 0.02
"""[m] Errors much greater than this count in proportion to their size, not to its square."""


class Legs(NamedTuple):
    """The legs of a set: inputs, true lengths (legs, n) [m], which of them are whole strides, and the people."""

    inputs: AnkleInputs
    true: np.ndarray
    full: np.ndarray
    people: np.ndarray


def ready(some: list[str]) -> Legs:
    """The legs of some recordings, in single precision."""
    of = list(legs(SET, some))
    inputs = lever.together([lever.prepared(leg, np.zeros(3), np.eye(3)) for leg in of])
    true, full = lever.references(of, inputs)
    single = jax.tree.map(lambda v: v.astype(np.float32) if v.dtype == np.float64 else v, inputs)
    return Legs(single, true.astype(np.float32), full, keys(SET, of))


class Tuning:
    """Fits to some of the legs; one compiled program for all of them."""

    def __init__(self, found: Legs) -> None:
        self.found, self.start = found, AnkleParams()
        self.transforms = params.freed(ankle_stride.estimator().transforms, *FREE)
        self.free = jax.tree.map(lambda v: jnp.asarray(v, jnp.float32), params.unconstrain(self.start, self.transforms))
        data = (found.inputs, found.true, found.full)
        one = jax.value_and_grad(self._loss, has_aux=True)
        self.each = filtering.compiled(lambda free: jax.lax.map(lambda leg: one(free, leg), data, batch_size=4))

    def params(self, free: Any) -> AnkleParams:
        """Parameters in natural units."""
        return params.constrain(free, self.transforms, self.start)

    def _loss(self, free: Any, leg: Any) -> tuple[Any, Any]:
        inputs, true, full = leg
        error = jnp.where(full, ankle_stride.run(self.params(free), inputs).strides.length - true, 0.0)
        return jnp.sum(jnp.sqrt(1.0 + (error / WRONG) ** 2) - 1.0), error

    def errors(self, free: Any) -> np.ndarray:
        """(legs, n) [m], 0 where there is no reference."""
        return np.asarray(self.each(free)[0][1])

    def fit(self, chosen: np.ndarray, steps: int) -> Any:
        """Free values for the legs of `chosen` (legs,) bool; a factor of e of a parameter costs half a stride's nat."""
        count = float(self.found.full[chosen].sum())
        optimizer = optax.adam(optax.cosine_decay_schedule(RATE, steps), b1=0.8, b2=0.95)
        free, state = self.free, optimizer.init(self.free)

        def mean(slope: Any, now: Any, start: Any) -> Any:
            return (jnp.tensordot(jnp.asarray(chosen, slope.dtype), slope, 1) + now - start) / count

        for _ in range(steps):
            _, slopes = self.each(free)
            step, state = optimizer.update(jax.tree.map(mean, slopes, free, self.free), state)
            free = optax.apply_updates(free, step)
        return free


def rows(quick: bool) -> list[Row]:
    """Strides of every person with parameters that the others taught."""
    if not available(SET):
        return []
    every = names(SET)
    found = ready([every[0], every[-1]] if quick else every)
    tuning, people = Tuning(found), list(dict.fromkeys(found.people.tolist()))
    before = tuning.errors(tuning.free)
    after, lines = np.zeros_like(before), []
    for fold in range(min(FOLDS, len(people))):
        held = np.isin(found.people, people[fold::FOLDS])
        free = tuning.fit(~held, 2 if quick else STEPS)
        after[held] = tuning.errors(free)[held]
        own = tuning.params(free)
        each = [100.0 * np.mean(np.abs(e[held][found.full[held]])) for e in (before, after)]
        lines.append([", ".join(people[fold::FOLDS]), *each, *(float(getattr(own, name)) for name in FREE[:5])])
    show("walking5m: stride length, error [cm] and what was learned", ["left out", "before", "after", *FREE[:5]], lines)
    line = "stride length at the shank, lever and noise tuned on other people, `walking5m`: mean error"
    of, result = found.full, []
    for error, name, part in ((after, "ankle_walking5m_cm", "tuned"), (before, "ankle_walking5m_cm_before", "default")):
        value = 100.0 * float(np.mean(np.abs(error[of])))
        split = SPLIT if part == "tuned" else "walking5m, hand-chosen"
        result.append(Row(name, value, "cm", n=int(of.sum()), split=split).on(line, part, "strides"))
    return result
