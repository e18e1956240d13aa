r"""Predict and update over components: what `dense` does, without what structure makes superfluous.

The covariance is updated in the coordinates of the measurement. With z = H x, G = H P⁻, E = H P⁻ Hᵀ, S = E + R,

    cov(z, ·) = R S⁻¹ [G E],      cov(x_j, x_k) = P⁻_jk − (S^-½ G)_jᵀ (S^-½ G)_k     for the x not in z,

so what is measured precisely is never the difference of two large numbers (as in P⁻ − K S Kᵀ), at less than half the
cost of Joseph's form. It needs rows of H that can be solved, one by one, for a component with a constant entry; where
there are none, Joseph's form is used.

Barriers stand where XLA would otherwise repeat work in each of the loops that use it. Whether numbers are sound is
told by a float that is finite if they are: compared where it is used, it costs next to nothing, where stored bools
would break up the vector loops.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from jgait.filtering.component_model import ComponentModel
from jgait.filtering.components import (
    Matrix,
    added,
    congruence,
    dot,
    from_upper,
    identity,
    is_zero,
    known,
    minus,
    plus,
    product,
    symmetric,
    times,
    total,
    transposed,
    upper,
    where,
)
from jgait.filtering.dense import LOG_2PI
from jgait.filtering.linearise import EKF, KF
from jgait.filtering.tracing import Expansion


class Components(NamedTuple):
    """Mean (k scalars), and covariance of the error about it (n × n scalars)."""

    mean: list[Any]
    cov: Matrix


class Sample(NamedTuple):
    """One sample.

    Attributes:
        measured: observation (m scalars).
        control: control tuple, or None.
        dt: interval.
        seen: what of the observation is there (m bools; True where the mask says nothing).
    """

    measured: list[Any]
    control: Any
    dt: Any
    seen: list[Any]


class Noise(NamedTuple):
    """A noise covariance that is the same at every sample; `health` is finite if it is."""

    matrix: Matrix
    health: Any


class Transition(NamedTuple):
    """An affine transition, as `dense.Prediction`; `health` is finite where it was."""

    mean: list[Any]
    matrix: Matrix
    noise: Matrix
    health: Any


class Gains(NamedTuple):
    """The pieces of an update, whitened by the innovation's factor L, S = L Lᵀ; zero where masked or not sound.

    Attributes:
        matrix: H, as if nothing were masked (m × n).
        noise: R.
        cross: H P⁻ (m × n), as if nothing were masked.
        inverse: L⁻¹, lower triangle.
        white_cross: L⁻¹ H P⁻ (m × n).
        white: L⁻¹ (y − ŷ) (m).
        innovation: y − ŷ (m), 0 where masked.
        spread: S (m × m), 1 on the diagonal where masked.
        log_det: of S.
        factor_health: finite where S could be factored; elsewhere nothing is learnt from the sample.
        health: finite where nothing broke down.
    """

    matrix: Matrix
    noise: Matrix
    cross: Matrix
    inverse: Matrix
    white_cross: Matrix
    white: list[Any]
    innovation: list[Any]
    spread: Matrix
    log_det: Any
    factor_health: Any
    health: Any


class Told(NamedTuple):
    """What an update tells beside its result; see `jgait.filtering.Updated`."""

    innovation: list[Any]
    stddev: list[Any]
    log_likelihood: Any
    nis: Any
    count: Any
    health: Any


def barred(*trees: Any) -> Any:
    """The same values behind an `optimization_barrier`; known ones stay known."""
    leaves, structure = jax.tree.flatten(trees)
    places = [i for i, leaf in enumerate(leaves) if not isinstance(leaf, float | bool)]
    if places:
        for i, leaf in zip(places, lax.optimization_barrier(tuple(leaves[i] for i in places)), strict=True):
            leaves[i] = leaf
    return jax.tree.unflatten(structure, leaves)


def sound(health: Any) -> Any:
    """Whether a float is finite; a Python bool where it is known."""
    return True if known(health) else jnp.abs(health) < jnp.inf


def dtype_of(moments: Components) -> Any:
    """The float type of a belief."""
    return jnp.result_type(*(value for value in (*moments.mean, *upper(moments.cov)) if not known(value)))


def affine_transition(cm: ComponentModel, before: Components, sample: Sample, noise: Noise | None) -> Transition:
    """The transition linearised at the mean; where it is not finite, the identity without noise stands in for it."""
    x, size = before.mean, len(before.cov)
    control, dt = sample.control, sample.dt
    trace = Expansion(dtype_of(before))
    if cm.curved:
        mean = trace.call(lambda x: cm.transition(x, control, dt), x)
        matrix = trace.jacobian(
            lambda delta: cm.local(mean, cm.transition(cm.retract(x, delta), control, dt)), [0.0] * size
        )[1]
    else:
        mean, matrix = trace.jacobian(lambda x: cm.transition(x, control, dt), x)
    if noise is None:
        entries = trace.call(lambda x: upper(cm.transition_noise(x, control, dt)), x)
        noise = Noise(from_upper(entries, size), _summary(entries, set()))
    safe = {id(value) for value in (*x, dt)}
    health = plus(_summary((*mean, *(e for row in matrix for e in row)), safe), noise.health)
    health = barred(health)[0]
    good = sound(health)
    matrix = [
        [a if known(a) and a == b else where(good, a, b) for a, b in zip(row, unit, strict=True)]
        for row, unit in zip(matrix, identity(size), strict=True)
    ]
    return Transition(
        [where(good, a, b) for a, b in zip(mean, x, strict=True)],
        barred(matrix)[0],
        symmetric(size, lambda i, j: where(good, noise.matrix[i][j], 0.0)),
        health,
    )


def _summary(values: Sequence[Any], safe: set[int]) -> Any:
    """The sum of what is not known, each once: finite if all are, unless it overflows, which is as bad."""
    unknown = {id(value): value for value in values if not known(value) and id(value) not in safe}
    return total(unknown.values())


def predicted(transition: Transition, cov: Matrix) -> Components:
    """The belief after the interval."""
    return Components(transition.mean, added(congruence(transition.matrix, cov), transition.noise))


def corrected(
    cm: ComponentModel, prior: Components, sample: Sample, method: KF | EKF, noise: Noise | None
) -> tuple[Components, Gains, Told]:
    """The belief after a sample, the last iteration's gains, and what the update tells.

    Each iteration linearises at the result of the one before, but starts again from the same prior.
    """
    size = len(prior.cov)
    at: list[Any] = [0.0] * size
    first = last = gains(cm, prior, sample, at, noise)
    health = first.health
    for _ in range(method.iterations - 1):
        at = _delta(last)
        last = gains(cm, prior, sample, at, noise)
        health = plus(health, last.health)
    delta = _delta(last)
    mean = prior.mean
    if cm.curved or method.iterations > 1:
        trace = Expansion(dtype_of(prior))
        good = sound(health)
        delta = [where(good, d, 0.0) for d in delta]
        mean = trace.call(cm.retract, mean, delta)
        health = plus(health, total(mean))
        good = sound(health)
        cov = _updated_covariance(prior, last, sample.seen)
        if cm.curved:
            state = barred(mean)[0]
            turn = trace.jacobian(lambda d: cm.local(state, cm.retract(prior.mean, d)), delta)[1]
            cov = congruence(turn, cov)
        after = Components(
            [where(good, a, b) for a, b in zip(mean, prior.mean, strict=True)],
            symmetric(size, lambda i, j: where(good, cov[i][j], prior.cov[i][j])),
        )
    else:
        after = Components(
            [plus(a, d) for a, d in zip(mean, delta, strict=True)], _updated_covariance(prior, last, sample.seen)
        )
    return after, last, _told(first, sample.seen, health)


def _delta(g: Gains) -> list[Any]:
    return [dot(column, g.white) for column in zip(*g.white_cross, strict=True)]


def _told(g: Gains, seen: list[Any], health: Any) -> Told:
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


def gains(cm: ComponentModel, prior: Components, sample: Sample, at: list[Any], noise: Noise | None) -> Gains:
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

    def spread_entry(a: int, b: int) -> Any:
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
    cm: ComponentModel, prior: Components, sample: Sample, at: list[Any]
) -> tuple[list[Any], Matrix, list[Any]]:
    """What should be seen at error `at`, its Jacobian, and what was seen beside it."""
    control, x = sample.control, prior.mean
    trace = Expansion(dtype_of(prior))
    point = x if all(map(is_zero, at)) else trace.call(cm.retract, x, at)
    if not cm.curved and not cm.wrapped:
        expected, matrix = trace.jacobian(lambda x: cm.observation(x, control), point)
        return expected, matrix, [minus(y, e) for y, e in zip(sample.measured, expected, strict=True)]
    expected = trace.call(lambda x: cm.observation(x, control), point)
    matrix = trace.jacobian(lambda delta: cm.residual(cm.observation(cm.retract(x, delta), control), expected), at)[1]
    measured = [where(s, y, e) for s, y, e in zip(sample.seen, sample.measured, expected, strict=True)]
    return expected, matrix, trace.call(cm.residual, measured, expected)


def inverse_factor(spread: Matrix, summary: Any) -> tuple[Matrix, Any, Any]:
    """L⁻¹ for spread = L Lᵀ, the logarithm of its determinant, and a float that is finite if all went well.

    Where it did not, L⁻¹ is zero. A pivot that is not positive is replaced before its root is taken, so that
    gradients stay finite.
    """
    health = plus(summary, total(spread[j][j] for j in range(len(spread))))
    pivots: list[Any] = []

    def root(pivot: Any, variance: Any) -> Any:
        del variance
        pivots.append(pivot)
        return lax.rsqrt(jnp.where(pivot > 0.0, pivot, 1.0))

    lower, roots = _factor(spread, root)
    for pivot in pivots:
        health = jnp.where(pivot > 0.0, health, jnp.inf)
    log_det = -2.0 * total(jnp.log(value) for value in roots)
    good = sound(health)
    return _inverted(lower, roots, [where(good, value, 0.0) for value in roots]), log_det, health


def generalised_inverse_factor(cov: Matrix, epsilon: float) -> Matrix:
    """L⁻¹ for cov = L Lᵀ with zero rows for what is known exactly from the components before, up to rounding."""
    floor = 2.0 * len(cov) * epsilon

    def root(pivot: Any, variance: Any) -> Any:
        above = pivot > floor * variance
        return jnp.where(above, lax.rsqrt(jnp.where(above, pivot, 1.0)), 0.0)

    lower, roots = _factor(cov, root)
    return _inverted(lower, roots, roots)


def _factor(spread: Matrix, root: Callable[[Any, Any], Any]) -> tuple[Matrix, list[Any]]:
    """L below its diagonal, and the reciprocals of the diagonal, from `root(pivot, variance)`."""
    size = len(spread)
    lower: Matrix = [[0.0] * size for _ in range(size)]
    roots: list[Any] = []
    for j in range(size):
        pivot = minus(spread[j][j], total(times(lower[j][k], lower[j][k]) for k in range(j)))
        roots.append(root(pivot, spread[j][j]))
        for i in range(j + 1, size):
            below = minus(spread[i][j], total(times(lower[i][k], lower[j][k]) for k in range(j)))
            lower[i][j] = times(below, roots[j])
        if j % 2 == 1 and j + 1 < size:
            lower, roots = barred(lower, roots)
    return lower, roots


def _inverted(lower: Matrix, roots: list[Any], diagonal: list[Any]) -> Matrix:
    size = len(lower)
    inverse: Matrix = [[0.0] * size for _ in range(size)]
    for j in range(size):
        inverse[j][j] = diagonal[j]
        for i in range(j + 1, size):
            inner = total(times(lower[i][k], inverse[k][j]) for k in range(j, i))
            inverse[i][j] = times(-roots[i], inner)
    return inverse


def _updated_covariance(prior: Components, g: Gains, seen: list[Any]) -> Matrix:
    plan = pivots(g.matrix)
    return _joseph(prior.cov, g) if plan is None else _in_measured_coordinates(prior.cov, g, seen, plan)


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
    """For each row a column with a known entry, in an order in which the rows can be solved for them; or None.

    A row is taken when its column shows in no row that is still to be taken; solving goes the other way round. Columns
    that come first in the state are preferred: the motion, not the biases, whose small variances would otherwise come
    out as differences of large ones.
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


def _in_measured_coordinates(cov: Matrix, g: Gains, seen: list[Any], plan: list[tuple[int, int]]) -> Matrix:
    """The covariance after the update, through that of the unmeasured components and z = H x."""
    size, count = len(cov), len(seen)
    solved = {column for _, column in plan}
    free = [j for j in range(size) if j not in solved]
    before = [[row[j] for j in free] + [dot(row, h) for h in g.matrix] for row in g.cross]  # [G E]
    masked = [[where(s, e, 0.0) for e in row] for s, row in zip(seen, before, strict=True)]
    white = [
        [g.white_cross[a][j] for j in free] + row[len(free) :]
        for a, row in enumerate(product(g.inverse, masked))
    ]  # fmt: skip
    measured = product(g.noise, product(transposed(g.inverse), white))
    good = sound(g.factor_health)
    columns = transposed(white)

    def of_z(a: int, c: int) -> Any:
        unseen = before[a][c]
        if not isinstance(seen[a], bool):
            unseen = minus(unseen, dot(columns[len(free) + a], columns[c]))
            return where(seen[a] & good, measured[a][c], unseen)
        return where(good, measured[a][c], unseen)

    def entry(i: int, j: int) -> Any:
        if j >= len(free):
            return of_z(j - len(free), i)
        return minus(cov[free[i]][free[j]], dot(columns[i], columns[j]))

    return congruence(_solution(g.matrix, free, plan), symmetric(len(free) + count, entry))


def _solution(matrix: Matrix, free: list[int], plan: list[tuple[int, int]]) -> Matrix:
    """X = T (x_free, z): z = H x solved row by row for the pivots."""
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
