r"""Components, which are scalars known while tracing (Python floats) or arrays: arithmetic, and functions traced.

Operations on known components cost no run time: a sum skips zeros, a product with one is the other factor. A matrix
is a list of rows; a symmetric matrix has the same object at (i, j) and (j, i).

`Expansion` evaluates the trace of a function equation by equation. Known values (zeros and ones of a derivative's
seed, constants) are folded, so the constant entries of the Jacobian are Python floats among arrays; equal equations
are computed once; and results of expensive primitives pass an `optimization_barrier`, without which XLA would repeat
these primitives in every fused loop that uses the results.
"""

import operator
from collections.abc import Callable, Hashable, Iterable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.extend.core import JaxprEqn, Literal, Var
from jax.typing import ArrayLike, DTypeLike
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


# --- functions, traced ---

EXPENSIVE = frozenset({
    "acos", "acosh", "asin", "asinh", "atan", "atan2", "atanh", "cbrt", "cos", "cosh", "div", "erf", "erf_inv", "exp",
    "exp2", "expm1", "log", "log1p", "logistic", "pow", "rsqrt", "sin", "sinh", "sqrt", "tan", "tanh",
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
        self._done: dict[Hashable, tuple[Sequence[Array], list[ArrayLike]]] = {}

    def call(self, function: Callable[..., Sequence[Scalar]], *arguments: Sequence[Scalar]) -> list[Scalar]:
        """The outputs of a function of lists of scalars."""
        closed = jax.make_jaxpr(function)(*([self._like(value) for value in values] for values in arguments))
        return self._run(closed, [value for values in arguments for value in values])

    def jacobian(
        self, function: Callable[[list[Scalar]], Sequence[Scalar]], at: Sequence[Scalar]
    ) -> tuple[list[Scalar], Matrix]:
        """Value (m,) and Jacobian (m, n) of a function of n scalars, from the trace of its derivative."""

        def pushforward(point: list[Scalar], tangent: list[Scalar]) -> Any:
            return jax.jvp(lambda x: list(function(x)), (point,), (tangent,))

        closed = jax.make_jaxpr(pushforward)([self._like(value) for value in at], [self._like(0.0)] * len(at))
        results = [self._run(closed, [*at, *seed]) for seed in identity(len(at))]
        size = len(results[0]) // 2
        return results[-1][:size], transposed([result[size:] for result in results])

    def _like(self, value: Scalar) -> jax.ShapeDtypeStruct:
        return jax.ShapeDtypeStruct((), self.dtype if known(value) else jnp.result_type(value))

    def _run(self, closed: Any, arguments: Sequence[ArrayLike]) -> list[Any]:
        jaxpr = closed.jaxpr
        constants = map(_constant, closed.consts)
        values = dict(zip([*jaxpr.constvars, *jaxpr.invars], [*constants, *arguments], strict=True))

        def read(variable: Var | Literal) -> ArrayLike:
            return _constant(variable.val) if isinstance(variable, Literal) else values[variable]

        for equation in jaxpr.eqns:
            outputs = self._equation(equation, [read(variable) for variable in equation.invars])
            values.update(zip(equation.outvars, outputs, strict=True))
        return [read(variable) for variable in jaxpr.outvars]

    def _equation(self, equation: JaxprEqn, inputs: list[ArrayLike]) -> Sequence[ArrayLike]:
        if equation.primitive.name in INLINED:
            params = equation.params
            return self._run(params["jaxpr" if "jaxpr" in params else "call_jaxpr"], inputs)
        folded = _folded(equation, inputs)
        if folded is not None:
            return [folded]
        return self._once(_key(equation, inputs), inputs, lambda: self._bound(equation, inputs))

    def _once(self, key: Hashable, inputs: list[ArrayLike], compute: Callable[[], Sequence[Array]]) -> Sequence[Array]:
        """What was computed for the key; inputs are kept alive, so that no other object gets their ids."""
        if key not in self._done:
            self._done[key] = (compute(), inputs)
        return self._done[key][0]

    def _bound(self, equation: JaxprEqn, inputs: list[ArrayLike]) -> Sequence[Array]:
        primitive, variables = equation.primitive, equation.invars
        arrays = [
            value if unknown(value) else np.asarray(value, _type(variable).dtype)
            for value, variable in zip(inputs, variables, strict=True)
        ]
        results = primitive.bind(*arrays, **primitive.get_bind_params(equation.params))
        outputs = list(results) if primitive.multiple_results else [results]
        return lax.optimization_barrier(outputs) if primitive.name in EXPENSIVE else outputs


def _type(variable: Var | Literal) -> Any:
    """Shape and dtype of an operand or a result."""
    return variable.aval


def _constant(value: Any) -> ArrayLike:
    """A literal as a known value: a Python float or bool if it is a scalar."""
    if np.ndim(value) != 0 or isinstance(value, jax.core.Tracer):
        return value
    kind = np.result_type(value).kind
    if kind == "f":
        return float(value)
    return bool(value) if kind == "b" else value


def _key(equation: JaxprEqn, inputs: Sequence[ArrayLike]) -> Hashable:
    """A key that is the same for equal equations, and for no other if equality cannot be determined."""
    operands = tuple(id(value) if unknown(value) else value for value in inputs)
    types = tuple(_type(variable).dtype for variable in equation.invars)
    key = equation.primitive.name, tuple(sorted(equation.params.items())), operands, types
    try:
        hash(key)
    except TypeError:
        return object()
    return object() if equation.effects else key


def _folded(equation: JaxprEqn, inputs: list[ArrayLike]) -> ArrayLike | None:
    """The result of an equation on scalars if no operation is needed at run time, else None."""
    name, aval = equation.primitive.name, _type(equation.outvars[0])
    if len(equation.outvars) != 1 or aval.shape != ():
        return None
    if name == "convert_element_type" and unknown(inputs[0]):
        return inputs[0] if _type(equation.invars[0]).dtype == aval.dtype else None
    if name == "convert_element_type":
        return _constant(np.asarray(inputs[0], aval.dtype)) if aval.dtype.kind in "fb" else None
    if name in ("broadcast_in_dim", "reshape", "squeeze"):
        return inputs[0] if _type(equation.invars[0]).shape == () else None
    if name == "select_n" and isinstance(inputs[0], bool):
        return inputs[1:][inputs[0]]
    if name == "select_n":
        return inputs[1] if all(same(case, inputs[1]) for case in inputs[2:]) else None
    if name in _NUMPY and not any(map(unknown, inputs)):
        return _constant(np.asarray(_NUMPY[name](*inputs), aval.dtype))
    return _simplified(name, inputs) if jnp.issubdtype(aval.dtype, jnp.floating) else None


def _simplified(name: str, inputs: list[ArrayLike]) -> ArrayLike | None:
    zeros = list(map(is_zero, inputs))
    ones = [same(value, 1.0) for value in inputs]
    if name in ("add", "add_any") and any(zeros):
        return inputs[1] if zeros[0] else inputs[0]
    if name == "sub" and zeros[1]:
        return inputs[0]
    if name in ("mul", "div") and (zeros[0] or (name == "mul" and zeros[1])):
        return 0.0
    if name in ("mul", "div") and ones[1]:
        return inputs[0]
    return inputs[1] if name == "mul" and ones[0] else None
