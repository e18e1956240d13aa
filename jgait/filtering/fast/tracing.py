r"""Analysis of functions of scalars: constant derivatives, and the same function in faster primitives.

`Expansion` evaluates the trace of a function equation by equation. Known values (zeros and ones of a derivative's
seed, constants) are folded, so the constant entries of the Jacobian are Python floats among arrays; equal equations
are computed once; sine and cosine become one polynomial pair; and results of expensive primitives pass an
`optimization_barrier`, without which XLA would repeat these primitives in every fused loop that uses the results.
"""

import operator
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.extend.core import Literal
from jax.typing import DTypeLike

from jgait.filtering.fast.components import Matrix, known
from jgait.geometry.trigonometry import sincos

EXPENSIVE = frozenset({
    "acos", "acosh", "asin", "asinh", "atan", "atan2", "atanh", "cbrt", "cosh", "div", "erf", "erf_inv", "exp", "exp2",
    "expm1", "log", "log1p", "logistic", "pow", "rsqrt", "sinh", "sqrt", "tan", "tanh",
})  # fmt: skip
"""Primitives that cost more than a store and a load, so that their results are stored and not computed again."""

_NUMPY: dict[str, Callable[..., Any]] = {
    "add": operator.add, "add_any": operator.add, "sub": operator.sub, "mul": operator.mul, "neg": operator.neg,
    "max": max, "min": min, "abs": abs, "eq": operator.eq, "ne": operator.ne, "lt": operator.lt, "le": operator.le,
    "gt": operator.gt, "ge": operator.ge, "sin": np.sin, "cos": np.cos, "square": lambda a: a * a,
    "stop_gradient": lambda a: a, "copy": lambda a: a,
}  # fmt: skip
INLINED = ("jit", "pjit", "closed_call", "core_call")


class Expansion:
    """One evaluation of the traces of several functions, which share equal equations.

    Values are Python floats and bools where known, arrays (or tracers) elsewhere.
    """

    def __init__(self, dtype: DTypeLike) -> None:
        """Take the float type of the state."""
        self.dtype = dtype
        self._done: dict[Any, tuple[Any, Any]] = {}

    def call(self, function: Callable[..., Sequence[Any]], *arguments: Sequence[Any]) -> list[Any]:
        """The outputs of a function of lists of scalars."""
        closed = jax.make_jaxpr(function)(*([self._like(value) for value in values] for values in arguments))
        return self._run(closed, [value for values in arguments for value in values])

    def jacobian(self, function: Callable[[list[Any]], Sequence[Any]], at: Sequence[Any]) -> tuple[list[Any], Matrix]:
        """Value (m,) and Jacobian (m, n) of a function of n scalars, from the trace of its derivative."""
        size = len(at)

        def pushforward(point: list[Any], tangent: list[Any]) -> Any:
            return jax.jvp(lambda x: list(function(x)), (point,), (tangent,))

        like = [self._like(value) for value in at]
        closed = jax.make_jaxpr(pushforward)(like, [self._like(0.0)] * size)
        columns = []
        value: list[Any] = []
        for j in range(size):
            results = self._run(closed, [*at, *(1.0 if k == j else 0.0 for k in range(size))])
            value = results[: len(results) // 2]
            columns.append(results[len(results) // 2 :])
        return value, [list(row) for row in zip(*columns, strict=True)]

    def _like(self, value: Any) -> Any:
        return jax.ShapeDtypeStruct((), self.dtype if known(value) else jnp.result_type(value))

    def _run(self, closed: Any, arguments: Sequence[Any]) -> list[Any]:
        jaxpr = closed.jaxpr
        values: dict[Any, Any] = dict(zip(jaxpr.constvars, closed.consts, strict=True))
        values.update(zip(jaxpr.invars, arguments, strict=True))

        def read(variable: Any) -> Any:
            return _constant(variable.val) if isinstance(variable, Literal) else values[variable]

        for equation in jaxpr.eqns:
            outputs = self._equation(equation, [read(variable) for variable in equation.invars])
            values.update(zip(equation.outvars, outputs, strict=True))
        return [read(variable) for variable in jaxpr.outvars]

    def _equation(self, equation: Any, inputs: list[Any]) -> Sequence[Any]:
        name = equation.primitive.name
        if name in INLINED:
            return self._run(equation.params.get("jaxpr", equation.params.get("call_jaxpr")), inputs)
        folded = _folded(name, equation, inputs)
        if folded is not None:
            return [folded]
        key = _key(equation, inputs)
        if key is not None and key in self._done:
            return self._done[key][0]
        outputs = self._bound(name, equation, inputs)
        if key is not None:
            self._done[key] = (outputs, inputs)  # keeps the inputs alive, so that no other object gets their ids
        return outputs

    def _bound(self, name: str, equation: Any, inputs: list[Any]) -> Sequence[Any]:
        arrays = [_array(value, variable.aval) for value, variable in zip(inputs, equation.invars, strict=True)]
        if name in ("sin", "cos") and equation.invars[0].aval.dtype in (jnp.float32, jnp.float64):
            key = ("sincos", id(inputs[0]))
            if key not in self._done:
                self._done[key] = (lax.optimization_barrier(sincos(arrays[0])), inputs)
            return [self._done[key][0][0 if name == "sin" else 1]]
        primitive = equation.primitive
        results = primitive.bind(*arrays, **primitive.get_bind_params(equation.params))
        outputs = list(results) if primitive.multiple_results else [results]
        return list(lax.optimization_barrier(tuple(outputs))) if name in EXPENSIVE else outputs


def _constant(value: Any) -> Any:
    """A literal as a known value: a Python float or bool if it is a scalar."""
    if np.ndim(value) != 0 or isinstance(value, jax.core.Tracer):
        return value
    kind = np.result_type(value).kind
    if kind == "f":
        return float(value)
    return bool(value) if kind == "b" else value


def _array(value: Any, aval: Any) -> Any:
    """A value as an array of the type that a primitive expects."""
    return np.asarray(value, aval.dtype) if isinstance(value, bool | float) else value


def _key(equation: Any, inputs: Sequence[Any]) -> Any:
    """A key that is the same for equal equations; None if equality cannot be determined."""
    if equation.effects:
        return None
    try:
        params = tuple(sorted((name, value) for name, value in equation.params.items()))
        hash(params)
    except TypeError:
        return None
    operands = tuple(value if isinstance(value, bool | float) else id(value) for value in inputs)
    types = tuple(variable.aval.dtype for variable in equation.invars)
    return equation.primitive.name, params, operands, types


def _folded(name: str, equation: Any, inputs: list[Any]) -> Any:
    """The result of an equation on scalars if no operation is needed at run time, else None."""
    aval = equation.outvars[0].aval
    if len(equation.outvars) != 1 or aval.shape != ():
        return None
    if name == "convert_element_type":
        return _converted(equation, inputs[0])
    if name in ("broadcast_in_dim", "reshape", "squeeze"):
        return inputs[0] if equation.invars[0].aval.shape == () else None
    if name == "select_n":
        return _selected(inputs)
    if all(isinstance(value, bool | float) for value in inputs) and name in _NUMPY:
        return _constant(np.asarray(_NUMPY[name](*inputs), aval.dtype))
    if not jnp.issubdtype(aval.dtype, jnp.floating):
        return None
    return _simplified(name, inputs)


def _simplified(name: str, inputs: list[Any]) -> Any:
    zeros = [known(value) and value == 0.0 for value in inputs]
    ones = [known(value) and value == 1.0 for value in inputs]
    if name in ("add", "add_any") and any(zeros):
        return inputs[1] if zeros[0] else inputs[0]
    if name == "sub" and zeros[1]:
        return inputs[0]
    if name in ("mul", "div") and (zeros[0] or (name == "mul" and zeros[1])):
        return 0.0
    if name in ("mul", "div") and ones[1]:
        return inputs[0]
    if name == "mul" and ones[0]:
        return inputs[1]
    return None


def _converted(equation: Any, value: Any) -> Any:
    before, after = equation.invars[0].aval, equation.outvars[0].aval
    if isinstance(value, bool | float):
        return _constant(np.asarray(value, after.dtype)) if after.dtype.kind in "fb" else None
    return value if before.dtype == after.dtype else None


def _selected(inputs: list[Any]) -> Any:
    which, *cases = inputs
    if isinstance(which, bool):
        return cases[int(which)]
    first = cases[0]
    same = all(case is first or (known(case) and known(first) and case == first) for case in cases)
    return first if same else None
