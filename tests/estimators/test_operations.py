"""Operations of JAX in NumPy: as JAX computes them."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

from jgait.estimators.operations import OPERATIONS, operation

X = np.array([[-1.75, 0.0, 0.5, 2.5], [np.inf, np.nan, -np.inf, 1e12], [-0.0, 3.0, -2.5, 0.25]])
N = np.array([[-7, 0, 3, 5], [2, -3, 9, -1], [4, 4, -5, 1]], np.int32)
Y = np.array([[0.5, -2.0, 3.0, 2.0], [1.0, 2.0, 0.0, -0.5], [4.0, 1.5, -1.0, 0.125]])
Z = np.arange(60.0).reshape(3, 4, 5)
FLAGS = X > 0.0
ONE = (
    "abs", "sign", "floor", "ceil", "exp", "log", "log1p", "expm1", "sin", "cos", "tan", "arcsin", "arccos", "arctan",
    "tanh", "sqrt", "square", "isfinite", "negative",
)  # fmt: skip
TWO = (
    "add", "subtract", "multiply", "divide", "maximum", "minimum", "arctan2", "equal", "not_equal", "less",
    "less_equal", "greater", "greater_equal",
)  # fmt: skip


def primitives() -> dict[str, Any]:
    """Functions whose traces have the primitives, and arguments."""
    one = {name: (getattr(jnp, name), (X,)) for name in ONE}
    two = {name: (getattr(jnp, name), (X, Y)) for name in TWO}
    more = {
        "power": (lax.pow, (np.abs(X), Y)),
        "rsqrt": (lax.rsqrt, (np.abs(Y),)),
        "remainder": (lax.rem, (X, Y)),
        "remainder of integers": (lax.rem, (N, N.T.reshape(N.shape) + 13)),
        "quotient": (lax.div, (N, np.abs(N[::-1]) + 1)),
        "and": (lambda a, b: a & b, (FLAGS, Y > 0)),
        "or": (lambda a, b: a | b, (N, N[::-1])),
        "xor": (lambda a, b: a ^ b, (N, N[::-1])),
        "not": (lambda a: ~a, (FLAGS,)),
        "cube": (lambda a: a**3, (Y,)),
        "inverse cube": (lambda a: a**-3, (Y,)),
        "round": (jnp.round, (X,)),
        "sinc": (jnp.sinc, (X,)),
        "round away": (lambda a: lax.round(a, lax.RoundingMethod.AWAY_FROM_ZERO), (X,)),
        "clamp": (lambda a: lax.clamp(-1.0, a, 2.0), (X,)),
        "choice": (jnp.where, (FLAGS, X, Y)),
        "choice of three": (lambda n, a: lax.select_n(n, a, a + 1.0, a + 2.0), (np.abs(N) % 3, Y)),
        "conversion": (lambda a: a.astype(jnp.int32), (X,)),
        "conversion to long": (lambda a: a.astype(jnp.int64), (X * 1e9,)),
        "conversion of flags": (lambda a: a.astype(jnp.float32), (FLAGS,)),
        "conversion to flags": (lambda a: a.astype(bool), (Y,)),
        "broadcast": (lambda a: jnp.broadcast_to(a[:, None], (3, 2, 4)), (X,)),
        "slice": (lambda a: a[1:, ::2], (X,)),
        "backward": (lambda a: a[::-1], (X,)),
        "dynamic slice": (lambda a, i: lax.dynamic_slice(a, (i, i), (2, 2)), (X, np.int32(5))),
        "shape": (lambda a: a.reshape(2, 6).T.squeeze(), (X,)),
        "axes": (lambda a: jnp.expand_dims(a, (0, 2)), (X,)),
        "together": (lambda a, b: jnp.concatenate([a, b], 1), (X, Y)),
        "stack": (lambda a, b: jnp.stack([a, b], 1), (X, Y)),
        "unstack": (lambda a: list(a), (X,)),
        "count": (lambda a: a + jnp.arange(4.0)[None], (Y,)),
        "sums": (lambda a: a.sum(axis=1), (Y,)),
        "sum of single": (lambda a: a.sum(), (Y.astype(np.float32),)),
        "most": (lambda a: a.max(axis=0), (X,)),
        "least": (lambda a: a.min(), (Y,)),
        "all": (lambda a: a.all(axis=1), (FLAGS,)),
        "any": (lambda a: a.any(axis=0), (FLAGS,)),
        "first most": (lambda a: a.argmax(axis=1), (X,)),
        "first least": (lambda a: a.argmin(axis=0), (Y,)),
        "running sum": (lambda a: jnp.cumsum(a, axis=1), (Y,)),
        "running most": (lambda a: lax.cummax(a, axis=0, reverse=True), (Y,)),
        "running least": (lambda a: lax.cummin(a, axis=1), (Y,)),
        "samples": (lambda a, n: a[n], (Y, N)),
        "samples of rows": (lambda a, n: a[:, n], (Y, N[0])),
        "samples beyond": (lambda a, n: a.at[n].get(mode="fill", fill_value=7.0), (Y, N)),
        "samples beyond, no value": (lambda a, n: a.at[n].get(mode="fill"), (Y, N)),
        "counts beyond": (lambda a, n: a.at[n].get(mode="fill"), (N, N)),
        "flags beyond": (lambda a, n: a.at[n].get(mode="fill"), (FLAGS, N)),
        "nearest samples": (lambda a, n: a.at[n].get(mode="clip"), (Y, N)),
        "samples of each": (jax.vmap(lambda a, n: a[n]), (Y, N % 4)),
        "pieces of each": (jax.vmap(lambda a, i: lax.dynamic_slice(a, (i,), (2,))), (Y, N[:, 1])),
        "entries": (lambda a, n: a[n, n + 1], (Y, N[0] % 3)),
        "entries of matrices": (lambda a, n: a[:, n, n[::-1]], (Z, N[0] % 4)),
        "columns of matrices": (lambda a, n: a[:, :, n], (Z, N % 4)),
        "whole beside pieces": (jax.vmap(lambda a, i: lax.dynamic_slice(a, (i, 0 * i), (2, 5))), (Z, N[:, 1] % 3)),
        "taken along": (lambda a, n: jnp.take_along_axis(a, n, axis=1), (Y, N % 4)),
    }
    return one | two | more


@pytest.mark.parametrize("name", primitives())
def test_an_operation_equals_that_of_jax(name):
    function, arguments = primitives()[name]
    trace = jax.make_jaxpr(function)(*arguments)
    want = jax.tree.leaves(jax.jit(function)(*arguments))
    with np.errstate(all="ignore"):
        found = evaluated(trace.jaxpr, trace.consts, arguments)
    for own, other in zip(found, want, strict=True):
        assert own.dtype == other.dtype
        np.testing.assert_allclose(own, other, rtol=1e-6 if other.dtype == np.float32 else 1e-13, atol=1e-15)


def evaluated(jaxpr: Any, consts: Any, arguments: Any) -> list[Any]:
    """The results of a trace, operation by operation."""
    values = dict(zip((*jaxpr.constvars, *jaxpr.invars), (*consts, *arguments), strict=True))

    def read(atom: Any) -> Any:
        return np.asarray(atom.val, atom.aval.dtype) if hasattr(atom, "val") else values[atom]

    for equation in jaxpr.eqns:
        inputs = [read(v) for v in equation.invars]
        inner = equation.params.get("jaxpr")
        if inner is not None:
            found = evaluated(inner.jaxpr, inner.consts, inputs)
        else:
            known = operation(equation.primitive.name, equation.params)
            assert known is not None, equation.primitive.name
            own = known[0](*inputs, **known[1])
            found = own if len(equation.outvars) > 1 else [own]
        values |= dict(zip(equation.outvars, map(np.asarray, found), strict=True))
    return [read(v) for v in jaxpr.outvars]


def test_a_running_sum_of_single_numbers_does_not_lose_digits():
    found = OPERATIONS["cumsum"](np.full(2**20, 0.1, np.float32), axis=0, reverse=False)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found[-1], 2**20 * float(np.float32(0.1)), rtol=1e-6)


def test_what_is_not_known_has_no_function():
    assert operation("scan", {}) is None


def test_a_primitive_with_other_parameters_is_left_to_the_compiler():
    assert operation("slice", {"start_indices": (0,), "limit_indices": (1,)}) is None
    assert operation("a primitive of another version", {}) is None
    assert operation("add", {}) == (np.add, {})
