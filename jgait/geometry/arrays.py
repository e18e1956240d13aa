"""Functions of arrays by the library that the arrays come from.

`xp.sqrt(x)` is NumPy's for NumPy's arrays and for numbers, and JAX's if any argument is JAX's. What is beside the
filters is written so: for one recording it runs on the host, where nothing is compiled, and inside `jax.jit`,
`jax.vmap` and `jax.grad` it is JAX.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import PyTree


def of_jax(*values: PyTree) -> bool:
    """Whether a value, or a part of a list or tuple, is an array of JAX."""
    return any(isinstance(value, jax.Array) or (isinstance(value, list | tuple) and of_jax(*value)) for value in values)


class _Namespace:
    """Names of NumPy, each function by its arguments; `xp.pi`, `xp.int32` are NumPy's own."""

    def __getattr__(self, name: str) -> Any:
        host = getattr(np, name)
        if isinstance(host, type) or not callable(host):
            return host
        traced = getattr(jnp, name)

        def either(*args: Any, **named: Any) -> Any:
            if of_jax(*args, *named.values()):
                return traced(*args, **named)
            value = host(*args, **named)
            # of numbers a number, which takes the type of the arrays that it meets
            plain = isinstance(value, np.generic) and all(isinstance(a, float | int) for a in args)
            return value.item() if plain else value

        setattr(self, name, either)
        return either


xp: Any = _Namespace()


def on_host(tree: PyTree) -> PyTree:
    """A tree whose arrays of JAX are NumPy's."""
    return jax.tree.map(lambda leaf: np.asarray(leaf) if isinstance(leaf, jax.Array) else leaf, tree)


def for_each(function: Callable[..., PyTree], *records: PyTree) -> PyTree:
    """The results of a function for each of some records, stacked; each record is a row of all arguments' arrays."""
    if all(of_jax(*jax.tree.leaves(record)) for record in records):
        return jax.vmap(function)(*records)
    rows = len(jax.tree.leaves(records)[0])
    each = [function(*jax.tree.map(lambda leaf, k=k: leaf[k], records)) for k in range(rows)]
    return jax.tree.map(lambda *parts: xp.stack(parts), *each)


def interpolated(at: PyTree, knots: PyTree, values: PyTree) -> PyTree:
    """Values (n, m) at increasing knots (n,), interpolated linearly at other places (T,): (T, m), of their type."""
    if of_jax(at, knots, values):
        return jax.vmap(lambda column: jnp.interp(at, knots, column), 1, 1)(values)
    columns = [np.interp(at, knots, column) for column in np.asarray(values).T]
    return np.stack(columns, axis=1).astype(values.dtype)


def largest_so_far(values: PyTree) -> PyTree:
    """The largest of the values (n, …) up to each one."""
    return lax.cummax(values) if of_jax(values) else np.maximum.accumulate(values)


def put(values: PyTree, at: PyTree, new: PyTree, how: str = "set") -> PyTree:
    """A copy of the values in which rows `at` are set to `new`, or, as `how` says, their sum with it ("add") or the
    larger of both ("max"). Rows behind the last are left out.
    """
    if of_jax(values, at, new):
        return getattr(jnp.asarray(values).at[at], how)(new, mode="drop")
    inside = np.asarray(at) < len(values)
    result, rows = np.array(values), np.asarray(at)[inside]
    new = np.broadcast_to(new, (len(inside), *result.shape[1:]))[inside]
    if how == "set":
        result[rows] = new
    else:
        {"add": np.add, "max": np.maximum}[how].at(result, rows, new)
    return result


def places(flags: PyTree, size: int) -> PyTree:
    """(size,) the places of the first flags (T,) that are True, in order; −1 behind the last."""
    if of_jax(flags):
        return jnp.nonzero(flags, size=size, fill_value=-1)[0]
    there = np.flatnonzero(flags)[:size]
    return np.pad(there, (0, size - there.size), constant_values=-1)


def as_given(result: PyTree, *given: PyTree) -> PyTree:
    """The result of a function of JAX, as NumPy's arrays if it was given no array of JAX."""
    return result if of_jax(*given) else on_host(result)
