"""Arithmetic on components: scalars that are known while tracing (Python floats), or arrays.

Operations on known components cost no run time: a sum skips zeros, a product with one is the other factor. A matrix
is a list of rows; a symmetric matrix has the same object at (i, j) and (j, i).
"""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool

from jgait.filtering.covariance import Scalar

Matrix = list[list[Scalar]]
Flag = Bool[Array, ""] | bool


def known(value: Any) -> bool:
    """Whether a component is a constant of the trace."""
    return isinstance(value, float)


def is_zero(value: Any) -> bool:
    """Whether a component is known to be zero."""
    return known(value) and value == 0.0


def same(a: Any, b: Any) -> bool:
    """Whether two components are known to be equal."""
    return a is b or (known(a) and known(b) and a == b)


def plus(a: Scalar, b: Scalar) -> Scalar:
    """A + b."""
    if is_zero(a):
        return b
    return a if is_zero(b) else a + b


def minus(a: Scalar, b: Scalar) -> Scalar:
    """A − b."""
    if is_zero(b):
        return a
    return -b if is_zero(a) else a - b


def times(a: Scalar, b: Scalar) -> Scalar:
    """A · b; zero if either factor is a known zero, even if the other is not finite."""
    if is_zero(a) or is_zero(b):
        return 0.0
    if known(a) and a == 1.0:
        return b
    if known(b) and b == 1.0:
        return a
    return a * b


def total(values: Iterable[Scalar]) -> Scalar:
    """The sum of components, from left to right."""
    result: Scalar = 0.0
    for value in values:
        result = plus(result, value)
    return result


def dot(a: Sequence[Scalar], b: Sequence[Scalar]) -> Scalar:
    """Σ a_k b_k."""
    return total(times(x, y) for x, y in zip(a, b, strict=True))


def product(a: Matrix, b: Matrix) -> Matrix:
    """The matrix a b."""
    columns = list(zip(*b, strict=True))
    return [[dot(row, column) for column in columns] for row in a]


def transposed(a: Matrix) -> Matrix:
    """The matrix aᵀ."""
    return [list(column) for column in zip(*a, strict=True)]


def symmetric[T](size: int, entry: Callable[[int, int], T]) -> list[list[T]]:
    """A symmetric matrix from a function of (i, j), called for i ≤ j only."""
    rows: list[list[Any]] = [[None] * size for _ in range(size)]
    for i in range(size):
        for j in range(i, size):
            rows[i][j] = rows[j][i] = entry(i, j)
    return rows


def congruence(a: Matrix, p: Matrix) -> Matrix:
    """The matrix a p aᵀ for symmetric p."""
    left = product(a, p)
    filled = [sum(not is_zero(e) for e in row) for row in a]

    def entry(i: int, j: int) -> Scalar:
        return dot(left[j], a[i]) if filled[i] < filled[j] else dot(left[i], a[j])

    return symmetric(len(a), entry)


def identity(size: int) -> Matrix:
    """The identity matrix."""
    return symmetric(size, lambda i, j: 1.0 if i == j else 0.0)


def upper(p: Matrix) -> list[Scalar]:
    """The upper triangle of a matrix, row by row."""
    return [p[i][j] for i in range(len(p)) for j in range(i, len(p))]


def from_upper[T](entries: Iterable[T], size: int) -> list[list[T]]:
    """The symmetric matrix of an upper triangle."""
    rest = iter(entries)
    return symmetric(size, lambda i, j: next(rest))


def where(condition: Flag, value: Scalar, otherwise: Scalar) -> Scalar:
    """`jnp.where`, skipped if both values are equal; the condition may be a Python bool."""
    if isinstance(condition, bool):
        return value if condition else otherwise
    return value if same(value, otherwise) else jnp.where(condition, value, otherwise)


def parted(tree: Any, moving: Callable[[Any], object]) -> tuple[list[Array], Callable[[Iterable[Array]], Any]]:
    """The leaves that are `moving`, and the function from others in their place to the tree."""
    leaves, structure = jax.tree.flatten(tree)
    moves = [bool(moving(leaf)) for leaf in leaves]
    stay = [None if move else leaf for leaf, move in zip(leaves, moves, strict=True)]

    def whole(values: Iterable[Array]) -> Any:
        rest = iter(values)
        return jax.tree.unflatten(structure, [next(rest) if m else leaf for leaf, m in zip(stay, moves, strict=True)])

    return [leaf for leaf, move in zip(leaves, moves, strict=True) if move], whole


def unknown(value: Any) -> bool:
    """Whether a component, or a bool, is an array."""
    return not isinstance(value, float | bool)


def barred[T](tree: T) -> T:
    """The same values behind an `optimization_barrier`; known values stay Python floats."""
    values, whole = parted(tree, unknown)
    return whole(lax.optimization_barrier(values))


def sound(health: Scalar) -> Flag:
    """Whether a float is finite; a Python bool if the float is known."""
    return True if known(health) else jnp.abs(health) < jnp.inf
