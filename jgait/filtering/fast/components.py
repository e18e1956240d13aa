"""Arithmetic on components: scalars that are known while tracing (Python floats), or arrays.

Operations on known components cost no run time: a sum skips zeros, a product with one is the other factor. A matrix
is a list of rows; a symmetric matrix has the same object at (i, j) and (j, i).
"""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from jgait.filtering.batch import replaced

Matrix = list[list[Any]]


def known(value: Any) -> bool:
    """Whether a component is a constant of the trace."""
    return isinstance(value, float)


def is_zero(value: Any) -> bool:
    """Whether a component is known to be zero."""
    return isinstance(value, float) and value == 0.0


def plus(a: Any, b: Any) -> Any:
    """A + b."""
    if is_zero(a):
        return b
    return a if is_zero(b) else a + b


def minus(a: Any, b: Any) -> Any:
    """A − b."""
    if is_zero(b):
        return a
    return -b if is_zero(a) else a - b


def times(a: Any, b: Any) -> Any:
    """A · b; zero if either factor is a known zero, even if the other is not finite."""
    if is_zero(a) or is_zero(b):
        return 0.0
    if known(a) and a == 1.0:
        return b
    if known(b) and b == 1.0:
        return a
    return a * b


def total(values: Iterable[Any]) -> Any:
    """The sum of components, from left to right."""
    result: Any = 0.0
    for value in values:
        result = plus(result, value)
    return result


def dot(a: Sequence[Any], b: Sequence[Any]) -> Any:
    """Σ a_k b_k."""
    return total(times(x, y) for x, y in zip(a, b, strict=True))


def product(a: Matrix, b: Matrix) -> Matrix:
    """The matrix a b."""
    columns = list(zip(*b, strict=True))
    return [[dot(row, column) for column in columns] for row in a]


def transposed(a: Matrix) -> Matrix:
    """The matrix aᵀ."""
    return [list(column) for column in zip(*a, strict=True)]


def symmetric(size: int, entry: Callable[[int, int], Any]) -> Matrix:
    """A symmetric matrix from a function of (i, j), called for i ≤ j only."""
    rows: Matrix = [[0.0] * size for _ in range(size)]
    for i in range(size):
        for j in range(i, size):
            rows[i][j] = rows[j][i] = entry(i, j)
    return rows


def congruence(a: Matrix, p: Matrix) -> Matrix:
    """The matrix a p aᵀ for symmetric p."""
    left = product(a, p)
    filled = [sum(not is_zero(e) for e in row) for row in a]

    def entry(i: int, j: int) -> Any:
        return dot(left[j], a[i]) if filled[i] < filled[j] else dot(left[i], a[j])

    return symmetric(len(a), entry)


def added(p: Matrix, q: Matrix) -> Matrix:
    """The sum of two symmetric matrices."""
    return symmetric(len(p), lambda i, j: plus(p[i][j], q[i][j]))


def identity(size: int) -> Matrix:
    """The identity matrix."""
    return symmetric(size, lambda i, j: 1.0 if i == j else 0.0)


def upper(p: Matrix) -> list[Any]:
    """The upper triangle of a matrix, row by row."""
    return [p[i][j] for i in range(len(p)) for j in range(i, len(p))]


def from_upper(entries: Sequence[Any], size: int) -> Matrix:
    """The symmetric matrix of an upper triangle."""
    rest = iter(entries)
    return symmetric(size, lambda i, j: next(rest))


def where(condition: Any, value: Any, otherwise: Any) -> Any:
    """`jnp.where`, skipped if both values are equal; the condition may be a Python bool."""
    if isinstance(condition, bool):
        return value if condition else otherwise
    if value is otherwise or (known(value) and known(otherwise) and value == otherwise):
        return value
    return jnp.where(condition, value, otherwise)


def barred(*trees: Any) -> Any:
    """The same values behind an `optimization_barrier`; known values stay Python floats."""
    leaves, structure = jax.tree.flatten(trees)
    places = [i for i, leaf in enumerate(leaves) if not isinstance(leaf, float | bool)]
    behind = lax.optimization_barrier(tuple(leaves[i] for i in places)) if places else ()
    return jax.tree.unflatten(structure, replaced(leaves, places, behind))


def sound(health: Any) -> Any:
    """Whether a float is finite; a Python bool if the float is known."""
    return True if known(health) else jnp.abs(health) < jnp.inf
