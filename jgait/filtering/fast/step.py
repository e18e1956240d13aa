r"""Predict and update over components, without superfluous operations; the covariance in the measurement's coordinates.

Barriers keep XLA from repeating operations in each loop that uses their results. The field `health` is a float that
is finite if all numbers are finite: a comparison costs almost nothing, while stored bools would split XLA's vector
loops. With z = H x, G = H P⁻, E = H P⁻ Hᵀ, S = E + R, the covariance after an update is

    cov(z, ·) = R S⁻¹ [G E],      cov(x_j, x_k) = P⁻_jk − (S^-½ G)_jᵀ (S^-½ G)_k     for the x_j not in z,

so a small variance of a measured component is not the difference of two large numbers (as in P⁻ − K S Kᵀ), at less
than half the cost of Joseph's form. Each row of H must be solvable for one component with a constant entry; if the
rows are not, Joseph's form is used.
"""

import math
from collections.abc import Sequence, Set
from typing import Any, NamedTuple

import jax.numpy as jnp
from jax import lax

from jgait.filtering.fast.components import (
    Matrix,
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
    times,
    total,
    transposed,
    upper,
    where,
)
from jgait.filtering.fast.tracing import Expansion
from jgait.filtering.model import Shape

LOG_2PI = math.log(2.0 * math.pi)


class ScalarModel(NamedTuple):
    """The functions of a model, with its parameters, on lists of scalars; see `jgait.filtering.Model`."""

    shape: Shape
    params: Any

    def transition(self, x: Sequence[Any], control: Any, dt: Any) -> list[Any]:
        """The state after dt."""
        s = self.shape
        moved = s.model.transition(self.params, s.state.tuple(x), control, dt)
        return s.state.components(moved, s.dtype, "what transition returns")

    def transition_noise(self, x: Sequence[Any], control: Any, dt: Any) -> Matrix:
        """Q."""
        s = self.shape
        noise = s.model.transition_noise(self.params, s.state.tuple(x), control, dt)
        return self.matrix(s.noise(noise, s.error, "what transition_noise returns"), range(s.error.size))

    def observation(self, x: Sequence[Any], control: Any) -> list[Any]:
        """The expected observation."""
        s = self.shape
        shown = s.model.observation(self.params, s.state.tuple(x), control)
        every = s.observed.components(shown, s.dtype, "what observation returns")
        return [every[i] for i in s.measured]

    def observation_noise(self, x: Sequence[Any], control: Any) -> Matrix:
        """R."""
        s = self.shape
        noise = s.model.observation_noise(self.params, s.state.tuple(x), control)
        return self.matrix(s.noise(noise, s.observed, "what observation_noise returns"), s.measured)

    def matrix(self, entries: dict[tuple[int, int], Any], rows: Sequence[int]) -> Matrix:
        """Some rows and columns of a noise matrix; numbers are known."""
        values = {
            place: float(v) if isinstance(v, int | float) else jnp.asarray(v, self.shape.dtype)
            for place, v in entries.items()
        }
        return symmetric(len(rows), lambda i, j: values.get((rows[i], rows[j]), 0.0))


class Components(NamedTuple):
    """Mean (k scalars), and covariance of the error about the mean (n × n scalars)."""

    mean: list[Any]
    cov: Matrix


class Reading(NamedTuple):
    """One sample."""

    measured: list[Any]  #: observation (m scalars).
    control: Any  #: control tuple, or None.
    dt: Any  #: interval [s].
    seen: list[Any]  #: which components are measured (m bools; True without a mask).


class Transition(NamedTuple):
    """A linearised transition."""

    mean: list[Any]  #: the predicted state.
    matrix: Matrix  #: A.
    noise: Matrix  #: Q.
    health: Any  #: finite where the transition was finite.


class Statistics(NamedTuple):
    """Statistics of an update; see `jgait.filtering.Updated`."""

    innovation: list[Any]
    stddev: list[Any]
    log_likelihood: Any
    nis: Any
    count: Any
    health: Any


class Gains(NamedTuple):
    """The terms of an update, whitened by the innovation's factor L, S = L Lᵀ; zero where masked or not finite."""

    matrix: Matrix  #: H without the mask (m × n).
    noise: Matrix  #: R (m × m).
    cross: Matrix  #: H P⁻ without the mask (m × n).
    inverse: Matrix  #: L⁻¹, lower triangle.
    white_cross: Matrix  #: L⁻¹ H P⁻ (m × n).
    white: list[Any]  #: L⁻¹ (y − ŷ) (m).
    innovation: list[Any]  #: y − ŷ (m), 0 where masked.
    spread: Matrix  #: S (m × m), 1 on the diagonal where masked.
    log_det: Any  #: logarithm of the determinant of S.
    health: Any  #: finite where all numbers are and S could be factored; elsewhere the belief is left unchanged.


def dtype_of(moments: Components) -> Any:
    """The float type of a belief."""
    return jnp.result_type(*(value for value in (*moments.mean, *upper(moments.cov)) if not known(value)))


def affine_transition(model: ScalarModel, before: Components, sample: Reading) -> Transition:
    """The transition linearised at the mean; where it is not finite, the identity without noise replaces it."""
    x, size = before.mean, len(before.cov)
    control, dt = sample.control, sample.dt
    trace = Expansion(dtype_of(before))
    mean, matrix = trace.jacobian(lambda x: model.transition(x, control, dt), x)
    entries = trace.call(lambda x: upper(model.transition_noise(x, control, dt)), x)
    noise = from_upper(entries, size)
    safe = {id(value) for value in (*x, dt)}
    health = plus(_summary((*mean, *(e for row in matrix for e in row)), safe), _summary(entries))
    health = barred(health)[0]
    good = sound(health)
    matrix = [
        [a if known(a) and a == b else where(good, a, b) for a, b in zip(row, unit, strict=True)]
        for row, unit in zip(matrix, identity(size), strict=True)
    ]
    return Transition(
        [where(good, a, b) for a, b in zip(mean, x, strict=True)],
        barred(matrix)[0],
        symmetric(size, lambda i, j: where(good, noise[i][j], 0.0)),
        health,
    )


def _summary(values: Sequence[Any], safe: Set[int] = frozenset()) -> Any:
    """The sum of all distinct unknown values: finite if all are finite; a sum that overflows counts as a failure."""
    unknown = {id(value): value for value in values if not known(value) and id(value) not in safe}
    return total(unknown.values())


def corrected(model: ScalarModel, prior: Components, sample: Reading) -> tuple[Components, Gains, Statistics]:
    """The belief after a sample, the gains, and the update's statistics."""
    gained = gains(model, prior, sample)
    delta = [dot(column, gained.white) for column in zip(*gained.white_cross, strict=True)]
    after = Components(
        [plus(a, d) for a, d in zip(prior.mean, delta, strict=True)], updated_covariance(prior.cov, gained, sample.seen)
    )
    return after, gained, _statistics(gained, sample.seen)


def _statistics(g: Gains, observed: list[Any]) -> Statistics:
    good = sound(g.health)
    count = total(where(s, 1.0, 0.0) for s in observed)
    nis = dot(g.white, g.white)
    return Statistics(
        [where(good, e, 0.0) for e in g.innovation],
        [where(good, lax.sqrt(g.spread[a][a]), 0.0) for a in range(len(observed))],
        where(good, -0.5 * (nis + g.log_det + count * LOG_2PI), 0.0),
        where(good, nis, 0.0),
        where(good, count, 0.0),
        g.health,
    )


def gains(model: ScalarModel, prior: Components, sample: Reading) -> Gains:
    """Linearise the observation at the prediction, and factor the innovation's covariance."""
    x, cov = prior
    observed, count = sample.seen, len(sample.measured)
    expected, matrix, innovation = _linearised(model, prior, sample)
    entries = Expansion(dtype_of(prior)).call(lambda x: upper(model.observation_noise(x, sample.control)), x)
    noise = from_upper(entries, count)
    linear = [all(known(e) for e in row) for row in matrix]
    # What is not seen tells nothing, even where it is not finite.
    matrix = [[e if known(e) else where(s, e, 0.0) for e in row] for s, row in zip(observed, matrix, strict=True)]
    doubtful = [where(s, e, 0.0) for s, e, straight in zip(observed, expected, linear, strict=True) if not straight]
    variance = symmetric(count, lambda a, b: where(observed[a] & observed[b], noise[a][b], 1.0 if a == b else 0.0))
    noise = variance
    summary = _summary((*doubtful, *(e for row in matrix for e in row), *upper(variance)))
    if not known(summary):
        summary = barred(summary)[0]
        usable = sound(summary)
        matrix = [[e if known(e) else where(usable, e, 0.0) for e in row] for row in matrix]
        variance = symmetric(count, lambda a, b: where(usable, noise[a][b], 1.0 if a == b else 0.0))
    innovation = [where(s, e, 0.0) for s, e in zip(observed, innovation, strict=True)]
    cross = barred(product(matrix, cov))[0]

    def spread_entry(a: int, b: int) -> Any:
        entry = plus(dot(cross[a], matrix[b]), variance[a][b])
        if a == b:
            return where(observed[a], entry, 1.0)
        return where(observed[a], where(observed[b], entry, 0.0), 0.0)

    innovation, spread = barred(innovation, symmetric(count, spread_entry))
    inverse, log_det, health = inverse_factor(spread, plus(summary, total(innovation)))
    error = [where(sound(e), e, 0.0) for e in innovation]
    inverse, error = barred(inverse, error)
    masked = [[where(s, e, 0.0) for e in row] for s, row in zip(observed, cross, strict=True)]
    white_cross, white = barred(product(inverse, masked), [dot(row, error) for row in inverse])
    return Gains(matrix, variance, cross, inverse, white_cross, white, innovation, spread, log_det, health)


def _linearised(model: ScalarModel, prior: Components, sample: Reading) -> tuple[list[Any], Matrix, list[Any]]:
    """The expected observation at the prediction, its Jacobian, and the innovation."""
    control, x = sample.control, prior.mean
    trace = Expansion(dtype_of(prior))
    if model.shape.model.residual is None:
        expected, matrix = trace.jacobian(lambda x: model.observation(x, control), x)
        return expected, matrix, [minus(y, e) for y, e in zip(sample.measured, expected, strict=True)]
    expected = trace.call(lambda x: model.observation(x, control), x)
    matrix = trace.jacobian(lambda x: model.shape.residual(model.observation(x, control), expected), x)[1]
    measured = [where(s, y, e) for s, y, e in zip(sample.seen, sample.measured, expected, strict=True)]
    return expected, matrix, trace.call(model.shape.residual, measured, expected)


def inverse_factor(spread: Matrix, summary: Any) -> tuple[Matrix, Any, Any]:
    """L⁻¹ for spread = L Lᵀ, the logarithm of its determinant, and a float that is finite if the factor exists.

    If the factor does not exist, L⁻¹ is zero. A pivot that is not positive is replaced before its square root is
    computed, so that gradients stay finite.
    """
    size = len(spread)
    health = plus(summary, total(spread[j][j] for j in range(size)))
    lower: Matrix = [[0.0] * size for _ in range(size)]  # L below its diagonal
    roots: list[Any] = []  # reciprocals of the diagonal
    pivots: list[Any] = []
    for j in range(size):
        pivots.append(minus(spread[j][j], total(times(lower[j][k], lower[j][k]) for k in range(j))))
        roots.append(lax.rsqrt(jnp.where(pivots[j] > 0.0, pivots[j], 1.0)))
        for i in range(j + 1, size):
            below = minus(spread[i][j], total(times(lower[i][k], lower[j][k]) for k in range(j)))
            lower[i][j] = times(below, roots[j])
        if j % 2 == 1 and j + 1 < size:
            lower, roots = barred(lower, roots)
    for pivot in pivots:
        health = jnp.where(pivot > 0.0, health, jnp.inf)
    log_det = -2.0 * total(jnp.log(value) for value in roots)
    good = sound(health)
    inverse: Matrix = [[0.0] * size for _ in range(size)]
    for j in range(size):
        inverse[j][j] = where(good, roots[j], 0.0)
        for i in range(j + 1, size):
            inner = total(times(lower[i][k], inverse[k][j]) for k in range(j, i))
            inverse[i][j] = times(-roots[i], inner)
    return inverse, log_det, health


def updated_covariance(cov: Matrix, g: Gains, observed: list[Any]) -> Matrix:
    """The covariance after the update, of errors about the predicted state; `observed`: m bools."""
    plan = pivots(g.matrix)
    return _joseph(cov, g) if plan is None else _in_measured_coordinates(cov, g, observed, plan)


def _joseph(cov: Matrix, g: Gains) -> Matrix:
    """(I − K H) P (I − K H)ᵀ + K R Kᵀ."""
    size = len(cov)
    gain = barred(product(transposed(g.white_cross), g.inverse))[0]
    left = [
        [minus(1.0 if i == j else 0.0, e) for j, e in enumerate(row)] for i, row in enumerate(product(gain, g.matrix))
    ]
    left = barred(left)[0]
    half = barred(product(left, cov))[0]
    noisy = product(gain, g.noise)
    return symmetric(size, lambda i, j: plus(dot(half[i], left[j]), dot(noisy[i], gain[j])))


def pivots(matrix: Matrix) -> list[tuple[int, int]] | None:
    """(row, column) of a known entry for each row, in the order in which the rows are solved for the columns; or None.

    A row is selected when its column is zero in all rows not yet selected; the result has the reverse order. The
    first columns of the state are preferred: the motion, not the biases, whose small variances would otherwise be
    differences of large numbers.
    """
    rest = set(range(len(matrix)))
    taken: list[tuple[int, int]] = []
    while rest:
        choices = []
        for row in sorted(rest):
            columns = [j for j, entry in enumerate(matrix[row]) if known(entry) and entry != 0.0]
            for rank, j in enumerate(columns):
                if all(is_zero(matrix[other][j]) for other in rest - {row}):
                    choices.append((rank, -len(columns), row, j))
        if not choices:
            return None
        _, _, row, j = min(choices)
        taken.append((row, j))
        rest.discard(row)
    return taken[::-1]


def _in_measured_coordinates(cov: Matrix, g: Gains, observed: list[Any], plan: list[tuple[int, int]]) -> Matrix:
    """The covariance after the update, from the covariance of the unmeasured components and z = H x."""
    size, count = len(cov), len(observed)
    solved = {column for _, column in plan}
    free = [j for j in range(size) if j not in solved]
    before = [[row[j] for j in free] + [dot(row, h) for h in g.matrix] for row in g.cross]  # [G E]
    masked = [[where(s, e, 0.0) for e in row] for s, row in zip(observed, before, strict=True)]
    white = [
        [g.white_cross[a][j] for j in free] + row[len(free) :]
        for a, row in enumerate(product(g.inverse, masked))
    ]  # fmt: skip
    measured = product(g.noise, product(transposed(g.inverse), white))
    good = sound(g.health)
    columns = transposed(white)

    def of_z(a: int, c: int) -> Any:
        unseen = before[a][c]
        if not isinstance(observed[a], bool):
            unseen = minus(unseen, dot(columns[len(free) + a], columns[c]))
            return where(observed[a] & good, measured[a][c], unseen)
        return where(good, measured[a][c], unseen)

    def entry(i: int, j: int) -> Any:
        if j >= len(free):
            return of_z(j - len(free), i)
        return minus(cov[free[i]][free[j]], dot(columns[i], columns[j]))

    return congruence(_solution(g.matrix, free, plan), symmetric(len(free) + count, entry))


def _solution(matrix: Matrix, free: list[int], plan: list[tuple[int, int]]) -> Matrix:
    """The matrix T of x = T (x_free, z): z = H x solved row by row for the pivots."""
    size, width = len(matrix[0]), len(free) + len(matrix)
    rows: Matrix = [[0.0] * width for _ in range(size)]
    for place, j in enumerate(free):
        rows[j][place] = 1.0
    for a, column in plan:
        row = [1.0 if k == len(free) + a else 0.0 for k in range(width)]
        for k, entry in enumerate(matrix[a]):
            if k != column and not is_zero(entry):
                row = [minus(r, times(entry, t)) for r, t in zip(row, rows[k], strict=True)]
        rows[column] = [times(1.0 / matrix[a][column], r) for r in row]
    return rows
