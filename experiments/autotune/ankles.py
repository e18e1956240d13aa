"""Stride lengths of shanks (`walking5m`): the noises of the filter tuned on other people's strides.

Lengths are nearly linear in the logarithms of the noises. So a step of the fit takes lengths and their derivatives at
the present noises, and minimises the loss of lengths that are linear in them: a Gauss–Newton step, of which few are
needed. The lever, a measure of the leg, and biases keep their defaults: learned too, they made strides of other people
worse.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from scipy import optimize

from experiments.autotune.evidence import independent
from experiments.common.recordings import available, names
from experiments.common.row import Row, show
from experiments.common.shanks import legs
from experiments.silva2017 import lever
from experiments.silva2017.groups import keys
from jgait import filtering, params
from jgait.estimators import ankle_stride
from jgait.estimators.ankle_stride import AnkleParams
from jgait.estimators.ankle_stride.prepare import AnkleInputs

SET = "walking5m"
SPLIT = "walking5m, people left out, six folds"
FORWARD = ankle_stride.DEFAULT._replace(method=filtering.EKF(derivative="forward"))
FREE = ("velocity_noise", "rate_noise", "acc_noise", "gyr_noise")
FOLDS, STEPS = 6, 3
WRONG = 0.02
"""[m] Errors much greater than this count in proportion to their size, not to its square."""

SPREAD = 1.0
"""Standard deviation of the logarithm of a noise about its default, before any data."""


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
        """Everything that the fits share."""
        self.found, self.default = found, AnkleParams()
        self.transforms = params.freed(ankle_stride.estimator().transforms, *FREE)
        tree = jax.tree.map(lambda v: jnp.asarray(v, jnp.float32), params.unconstrain(self.default, self.transforms))
        start, self.unflatten = ravel_pytree(tree)
        self.start = np.asarray(start, float)
        self.each = filtering.compiled(lambda free: jax.lax.map(lambda leg: self._linear(free, leg), found.inputs))

    def params(self, free: Any) -> AnkleParams:
        """Parameters in natural units."""
        return params.constrain(self.unflatten(free), self.transforms, self.default)

    def _linear(self, free: Any, leg: AnkleInputs) -> tuple[Any, Any]:
        def lengths(at: Any) -> Any:
            return ankle_stride.run(self.params(at), leg, FORWARD).strides.length

        values, slopes = jax.vmap(lambda direction: jax.jvp(lengths, (free,), (direction,)))(
            jnp.eye(free.size, dtype=free.dtype)
        )
        return values[0], slopes

    def errors(self, free: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(legs, n) [m], and derivatives (legs, n, p); 0 where there is no reference."""
        length, slopes = map(np.asarray, self.each(jnp.asarray(free, jnp.float32)))
        looked = self.found.full
        return np.where(looked, length - self.found.true, 0.0), np.moveaxis(slopes, 1, 2) * looked[..., None]

    def fit(self, first: tuple[np.ndarray, np.ndarray], chosen: np.ndarray, weight: float) -> np.ndarray:
        """Free values for the legs of `chosen` (legs,) bool; `first`: errors and derivatives at the start."""
        free, (error, slopes) = self.start, first
        for step in range(STEPS):
            of = chosen[:, None] & self.found.full
            free = _minimum(error[of], slopes[of], free, self.start, weight)
            if step + 1 < STEPS:
                error, slopes = self.errors(free)
        return free


def _minimum(error: np.ndarray, slopes: np.ndarray, at: np.ndarray, start: np.ndarray, weight: float) -> np.ndarray:
    """The free values of the least loss, errors being linear about `at`; a change by more than 1 is cut."""

    def of(free: np.ndarray) -> tuple[float, np.ndarray]:
        e, away = error + slopes @ (free - at), (free - start) / SPREAD
        root = np.sqrt(1.0 + (e / WRONG) ** 2)
        slope = weight * slopes.T @ (e / root) / WRONG**2 + away / SPREAD
        return float(weight * np.sum(root - 1.0) + 0.5 * away @ away), slope

    found = optimize.minimize(of, at, jac=True, method="BFGS").x
    return at + np.clip(found - at, -1.0, 1.0)


def rows(quick: bool) -> list[Row]:
    """Strides of every person with parameters that the others taught."""
    if not available(SET):
        return []
    every = names(SET)
    found = ready([every[0], every[-1]] if quick else every)
    tuning, people, of = Tuning(found), list(dict.fromkeys(found.people.tolist())), found.full
    first = tuning.errors(tuning.start)
    before = first[0]
    owner = np.repeat(found.people[:, None], of.shape[1], axis=1)[of]
    weight = independent(before[of], owner)
    after, lines = np.zeros_like(before), []
    for fold in range(min(FOLDS, len(people))):
        held = np.isin(found.people, people[fold::FOLDS])
        free = tuning.fit(first, ~held, weight)
        after[held] = tuning.errors(free)[0][held]
        own = tuning.params(free)
        each = [100.0 * np.mean(np.abs(e[held][of[held]])) for e in (before, after)]
        lines.append([", ".join(people[fold::FOLDS]), *each, *(float(getattr(own, name)) for name in FREE)])
        print(lines[-1], flush=True)
    show("walking5m: stride length, error [cm] and what was learned", ["left out", "before", "after", *FREE], lines)
    centred = np.concatenate([before[of][owner == one] - np.median(before[of][owner == one]) for one in people])
    print(f"a stride counts as {weight:.2f} independent ones; less everybody's own median: "
          f"{100.0 * np.mean(np.abs(centred)):.2f} cm")  # fmt: skip
    line = "stride length at the shank, noises tuned on other people, `walking5m`: mean error"
    result = []
    for error, name, part in ((after, "ankle_walking5m_cm", "tuned"), (before, "ankle_walking5m_cm_before", "default")):
        value = 100.0 * float(np.mean(np.abs(error[of])))
        split = SPLIT if part == "tuned" else "walking5m, hand-chosen"
        result.append(Row(name, value, "cm", n=int(of.sum()), split=split).on(line, part, "strides"))
    return result
