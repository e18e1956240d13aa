r"""Predict and update over components: the computation of `dense` without superfluous operations.

Barriers keep XLA from repeating operations in each loop that uses their results. The field `health` is a float that
is finite if all numbers are finite: a comparison costs almost nothing, while stored bools would split XLA's vector
loops.
"""

import math
from collections.abc import Callable, Sequence
from functools import partial, reduce
from typing import NamedTuple

import jax.numpy as jnp
from jax import lax
from jaxtyping import PyTree

from jgait.filtering.component_model import ComponentModel
from jgait.filtering.components import (
    Matrix,
    added,
    barred,
    congruence,
    dot,
    from_upper,
    identity,
    is_zero,
    known,
    minus,
    plus,
    product,
    sound,
    symmetric,
    total,
    upper,
    where,
)
from jgait.filtering.covariance_update import Gains, updated_covariance
from jgait.filtering.inverse_factor import inverse_factor
from jgait.filtering.methods import EKF, KF
from jgait.filtering.tracing import Expansion
from jgait.types import Values

LOG_2PI = math.log(2.0 * math.pi)


class Components(NamedTuple):
    """Mean (k scalars), and covariance of the error about the mean (n × n scalars)."""

    mean: list[PyTree]
    cov: Matrix


class Sample(NamedTuple):
    """One sample.

    Attributes:
        measured: observation (m scalars).
        control: control tuple, or None.
        dt: interval [s].
        seen: which components are measured (m bools; True without a mask).
    """

    measured: list[PyTree]
    control: PyTree
    dt: Values
    seen: list[PyTree]


class Noise(NamedTuple):
    """A noise covariance that is the same at every sample; `health` is finite if the matrix is finite."""

    matrix: Matrix
    health: PyTree


class Transition(NamedTuple):
    """An affine transition, as `dense.Prediction`.

    Attributes:
        mean: the predicted state.
        steps: matrices that propagate the error, in the order of application.
        noise: Q.
        health: finite where the transition was finite.
    """

    mean: list[PyTree]
    steps: list[Matrix]
    noise: Matrix
    health: PyTree

    @property
    def matrix(self) -> Matrix:
        """The product of the steps."""
        return reduce(lambda before, step: product(step, before), self.steps)


class Told(NamedTuple):
    """Statistics of an update; see `jgait.filtering.Updated`."""

    innovation: list[PyTree]
    stddev: list[PyTree]
    log_likelihood: PyTree
    nis: PyTree
    count: PyTree
    health: PyTree


def dtype_of(moments: Components) -> PyTree:
    """The float type of a belief."""
    return jnp.result_type(*(value for value in (*moments.mean, *upper(moments.cov)) if not known(value)))


def affine_transition(cm: ComponentModel, before: Components, sample: Sample, noise: Noise | None) -> Transition:
    """The transition linearised at the mean; where it is not finite, the identity without noise replaces it."""
    x, size = before.mean, len(before.cov)
    control, dt = sample.control, sample.dt
    trace = Expansion(dtype_of(before))
    if cm.curved:
        mean = trace.call(lambda x: cm.transition(x, control, dt), x)
        steps = _moving_steps(cm, trace, x, mean, control, dt)
    else:
        mean, matrix = trace.jacobian(lambda x: cm.transition(x, control, dt), x)
        steps = [matrix]
    if noise is None:
        entries = trace.call(lambda x: upper(cm.transition_noise(x, control, dt)), x)
        noise = Noise(from_upper(entries, size), _summary(entries, set()))
    safe = {id(value) for value in (*x, dt)}
    health = plus(_summary((*mean, *(e for step in steps for row in step for e in row)), safe), noise.health)
    health = barred(health)[0]
    good = sound(health)
    steps = [
        [
            [a if known(a) and a == b else where(good, a, b) for a, b in zip(row, unit, strict=True)]
            for row, unit in zip(step, identity(size), strict=True)
        ]
        for step in steps
    ]
    return Transition(
        [where(good, a, b) for a, b in zip(mean, x, strict=True)],
        barred(steps)[0],
        symmetric(size, lambda i, j: where(good, noise.matrix[i][j], 0.0)),
        health,
    )


def _moving_steps(
    cm: ComponentModel, trace: Expansion, x: list[PyTree], mean: list[PyTree], control: PyTree, dt: Values
) -> list[Matrix]:
    """The matrices that propagate an error, from the model's `error_transition` or through `retract` and `local`."""

    def found(delta: Sequence[PyTree]) -> list[PyTree]:
        return cm.local(mean, cm.transition(cm.retract(x, delta), control, dt))

    def stated(step: PyTree, delta: Sequence[PyTree]) -> list[PyTree]:
        return list(step(x, delta, control, dt))

    steps = [partial(stated, step) for step in cm.error_transition]
    functions: list[Callable[..., list[PyTree]]] = [*steps] if steps else [found]
    zero = [0.0] * cm.error.num_leaves
    return [trace.jacobian(function, zero)[1] for function in functions]


def _summary(values: Sequence[PyTree], safe: set[int]) -> PyTree:
    """The sum of all distinct unknown values: finite if all are finite; a sum that overflows counts as a failure."""
    unknown = {id(value): value for value in values if not known(value) and id(value) not in safe}
    return total(unknown.values())


def predicted(transition: Transition, cov: Matrix) -> Components:
    """The belief after the interval."""
    for step in transition.steps[:-1]:
        cov = barred(congruence(step, cov))[0]
    return Components(transition.mean, added(congruence(transition.steps[-1], cov), transition.noise))


def corrected(
    cm: ComponentModel, prior: Components, sample: Sample, method: KF | EKF, noise: Noise | None
) -> tuple[Components, Gains, Told, Matrix | None]:
    """The belief after a sample, the last iteration's gains, the update's statistics, and on a manifold its `turn`.

    Each iteration linearises at the result of the previous iteration, but updates the same prior.
    """
    size = len(prior.cov)
    at: list[PyTree] = [0.0] * size
    first = last = gains(cm, prior, sample, at, noise)
    health = first.health
    for _ in range(method.iterations - 1):
        at = _delta(last)
        last = gains(cm, prior, sample, at, noise)
        health = plus(health, last.health)
    delta = _delta(last)
    mean = prior.mean
    turned = None
    if cm.curved or method.iterations > 1:
        trace = Expansion(dtype_of(prior))
        good = sound(health)
        delta = [where(good, d, 0.0) for d in delta]
        mean = trace.call(cm.retract, mean, delta)
        health = plus(health, total(mean))
        good = sound(health)
        cov = updated_covariance(prior.cov, last, sample.seen)
        if cm.curved:
            turned = turn(cm, trace, prior.mean, delta, mean)
            cov = congruence(turned, cov)
        after = Components(
            [where(good, a, b) for a, b in zip(mean, prior.mean, strict=True)],
            symmetric(size, lambda i, j: where(good, cov[i][j], prior.cov[i][j])),
        )
        last = last._replace(
            inverse=[[where(good, e, 0.0) for e in row] for row in last.inverse],
            white_cross=[[where(good, e, 0.0) for e in row] for row in last.white_cross],
            white=[where(good, e, 0.0) for e in last.white],
        )
    else:
        after = Components(
            [plus(a, d) for a, d in zip(mean, delta, strict=True)], updated_covariance(prior.cov, last, sample.seen)
        )
    return after, last, _told(first, sample.seen, health), turned


def turn(
    cm: ComponentModel, trace: Expansion, reference: list[PyTree], delta: list[PyTree], state: list[PyTree]
) -> Matrix:
    """∂/∂δ of ((reference ⊕ δ) ⊖ state) at `delta`, where the state is reference ⊕ delta."""
    if cm.error_shift is not None:
        shift = cm.error_shift
        return barred(trace.jacobian(lambda e: shift(reference, delta, e), [0.0] * len(delta))[1])[0]
    state = barred(state)[0]
    return trace.jacobian(lambda d: cm.local(state, cm.retract(reference, d)), delta)[1]


def _delta(g: Gains) -> list[PyTree]:
    return [dot(column, g.white) for column in zip(*g.white_cross, strict=True)]


def _told(g: Gains, seen: list[PyTree], health: PyTree) -> Told:
    good = sound(health)
    count = total(where(s, 1.0, 0.0) for s in seen)
    nis = dot(g.white, g.white)
    return Told(
        [where(good, e, 0.0) for e in g.innovation],
        [where(good, lax.sqrt(g.spread[a][a]), 0.0) for a in range(len(seen))],
        where(good, -0.5 * (nis + g.log_det + count * LOG_2PI), 0.0),
        where(good, nis, 0.0),
        where(good, count, 0.0),
        health,
    )


def gains(cm: ComponentModel, prior: Components, sample: Sample, at: list[PyTree], noise: Noise | None) -> Gains:
    """Linearise the observation at error `at` (n), and factor the innovation's covariance."""
    x, cov = prior
    seen, count = sample.seen, len(sample.measured)
    expected, matrix, innovation = _linearised(cm, prior, sample, at)
    if noise is None:
        trace = Expansion(dtype_of(prior))
        entries = trace.call(lambda x: upper(cm.observation_noise(x, sample.control)), x)
        noise = Noise(from_upper(entries, count), _summary(entries, set()))
    linear = [all(known(e) for e in row) for row in matrix]
    doubtful = [e for e, straight in zip(expected, linear, strict=True) if not straight]
    summary = plus(_summary((*doubtful, *(e for row in matrix for e in row)), set()), noise.health)
    variance = noise.matrix
    if not known(summary):
        summary = barred(summary)[0]
        usable = sound(summary)
        matrix = [[e if known(e) else where(usable, e, 0.0) for e in row] for row in matrix]
        variance = symmetric(count, lambda a, b: where(usable, noise.matrix[a][b], 1.0 if a == b else 0.0))
    innovation = [where(s, e, 0.0) for s, e in zip(seen, innovation, strict=True)]
    cross = barred(product(matrix, cov))[0]

    def spread_entry(a: int, b: int) -> PyTree:
        entry = plus(dot(cross[a], matrix[b]), variance[a][b])
        if a == b:
            return where(seen[a], entry, 1.0)
        return where(seen[a], where(seen[b], entry, 0.0), 0.0)

    innovation, spread = barred(innovation, symmetric(count, spread_entry))
    inverse, log_det, factor_health = inverse_factor(spread, summary)
    error = [where(sound(e), e, 0.0) for e in innovation]
    if not all(map(is_zero, at)):
        back = [where(s, dot(row, at), 0.0) for s, row in zip(seen, matrix, strict=True)]
        error = [plus(e, b) for e, b in zip(error, back, strict=True)]
    inverse, error = barred(inverse, error)
    masked = [[where(s, e, 0.0) for e in row] for s, row in zip(seen, cross, strict=True)]
    white_cross, white = barred(product(inverse, masked), [dot(row, error) for row in inverse])
    health = plus(factor_health, total(innovation))
    return Gains(
        matrix, variance, cross, inverse, white_cross, white, innovation, spread, log_det, factor_health, health
    )  # fmt: skip


def _linearised(
    cm: ComponentModel, prior: Components, sample: Sample, at: list[PyTree]
) -> tuple[list[PyTree], Matrix, list[PyTree]]:
    """The expected observation at error `at`, its Jacobian, and the measured observation."""
    control, x = sample.control, prior.mean
    trace = Expansion(dtype_of(prior))
    point = x if all(map(is_zero, at)) else trace.call(cm.retract, x, at)
    if not cm.curved and not cm.wrapped:
        expected, matrix = trace.jacobian(lambda x: cm.observation(x, control), point)
        return expected, matrix, [minus(y, e) for y, e in zip(sample.measured, expected, strict=True)]
    expected = trace.call(lambda x: cm.observation(x, control), point)
    if cm.error_observation is not None and point is x:
        shown = cm.error_observation
        matrix = trace.jacobian(lambda delta: shown(x, delta, control), at)[1]
    else:
        matrix = trace.jacobian(lambda delta: cm.residual(cm.observation(cm.retract(x, delta), control), expected), at)[
            1
        ]
    measured = [where(s, y, e) for s, y, e in zip(sample.seen, sample.measured, expected, strict=True)]
    return expected, matrix, trace.call(cm.residual, measured, expected)
