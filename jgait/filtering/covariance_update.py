r"""Innovations factored, and the covariance after an update, over components.

The covariance is computed in the coordinates of the measurement. With z = H x, G = H P⁻, E = H P⁻ Hᵀ, S = E + R,

    cov(z, ·) = R S⁻¹ [G E],      cov(x_j, x_k) = P⁻_jk − (S^-½ G)_jᵀ (S^-½ G)_k     for the x_j not in z,

so a small variance of a measured component is not the difference of two large numbers (as in P⁻ − K S Kᵀ), at less
than half the cost of Joseph's form. Each row of H must be solvable for one component with a constant entry; if the
rows are not, Joseph's form is used.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax import lax
from jaxtyping import PyTree

from jgait.filtering.components import (
    Matrix,
    barred,
    congruence,
    dot,
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
    where,
)
from jgait.types import Values


def inverse_factor(spread: Matrix, summary: Values) -> tuple[Matrix, Values, Values]:
    """L⁻¹ for spread = L Lᵀ, the logarithm of its determinant, and a float that is finite if the factor exists.

    If the factor does not exist, L⁻¹ is zero. A pivot that is not positive is replaced before its square root is
    computed, so that gradients stay finite.
    """
    size = len(spread)
    health = plus(summary, total(spread[j][j] for j in range(size)))
    lower: Matrix = [[0.0] * size for _ in range(size)]  # L below its diagonal
    roots: list[Values] = []  # reciprocals of the diagonal
    pivots: list[Values] = []
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


class Gains(NamedTuple):
    """The terms of an update, whitened by the innovation's factor L, S = L Lᵀ; zero where masked or not finite."""

    matrix: Matrix  #: H without the mask (m × n).
    noise: Matrix  #: R (m × m).
    cross: Matrix  #: H P⁻ without the mask (m × n).
    inverse: Matrix  #: L⁻¹, lower triangle.
    white_cross: Matrix  #: L⁻¹ H P⁻ (m × n).
    white: list[PyTree]  #: L⁻¹ (y − ŷ) (m).
    innovation: list[PyTree]  #: y − ŷ (m), 0 where masked.
    spread: Matrix  #: S (m × m), 1 on the diagonal where masked.
    log_det: PyTree  #: logarithm of the determinant of S.
    health: PyTree  #: finite where all numbers are and S could be factored; elsewhere the belief is left unchanged.


def updated_covariance(cov: Matrix, g: Gains, observed: list[PyTree]) -> Matrix:
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


def _in_measured_coordinates(cov: Matrix, g: Gains, observed: list[PyTree], plan: list[tuple[int, int]]) -> Matrix:
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

    def of_z(a: int, c: int) -> PyTree:
        unseen = before[a][c]
        if not isinstance(observed[a], bool):
            unseen = minus(unseen, dot(columns[len(free) + a], columns[c]))
            return where(observed[a] & good, measured[a][c], unseen)
        return where(good, measured[a][c], unseen)

    def entry(i: int, j: int) -> PyTree:
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
