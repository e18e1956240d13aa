"""Barriers that make XLA compute a value once that is used several times.

XLA's fusion for CPUs writes one loop for each stored result and repeats shared operations in each loop: for a step
of a filter with 15 states, ten times the operations of the source were compiled and computed. `shared` traces a
function of scalars and puts an `optimization_barrier` behind each value that several others use and that costs more
than a store and a load.
"""

from collections import Counter
from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
from jax import lax
from jax.extend.core import Literal
from jaxtyping import PyTree

from jgait.filtering.tracing import EXPENSIVE, INLINED

WORTH = 3
"""Least number of operations at which a value that is used again is stored [1]."""

OFTEN = 3
"""Number of uses from which a value of a derivative is stored: its arrays of columns take longer to load."""

_FREE = frozenset({"convert_element_type", "broadcast_in_dim", "reshape", "squeeze", "copy", "stop_gradient"})


def shared(function: Callable[..., PyTree], uses: int = 2) -> Callable[..., PyTree]:
    """The same function of pytrees: equal operations once, and barriers behind values that are used again.

    Args:
        function: function of arrays, typically the body of a scan; loops and branches in it do not change.
        uses: number of uses from which a value is stored.
    """

    def run(*arguments: PyTree) -> PyTree:
        closed, shapes = jax.make_jaxpr(function, return_shape=True)(*arguments)
        leaves = jax.tree.leaves(arguments)
        flat, counts = _flattened(closed)
        return jax.tree.unflatten(jax.tree.structure(shapes), _evaluated(flat, counts, leaves, uses))

    return run


def stored_for(lanes: int) -> Callable[[Callable[..., PyTree]], Callable[..., PyTree]]:
    """`shared` for the model of one recording, whose program it makes shorter; that of several would take longer."""
    return partial(shared, uses=OFTEN) if lanes == 1 else lambda function: function


class _Flat:
    """The equations of a program without calls, on numbered values."""

    def __init__(self) -> None:
        self.equations: list[tuple[PyTree, list[PyTree], list[int]]] = []
        self.values: dict[int, PyTree] = {}
        self.size = 0
        self.inputs: list[int] = []
        self.outputs: list[PyTree] = []

    def new(self) -> int:
        self.size += 1
        return self.size - 1


def _flattened(closed: PyTree) -> tuple[_Flat, Counter[int]]:
    """A jaxpr with its calls inlined, and the number of uses of each value."""
    flat = _Flat()
    done: dict[PyTree, list[int]] = {}

    def constant(value: PyTree) -> int:
        place = flat.new()
        flat.values[place] = value
        return place

    def inline(jaxpr: PyTree, consts: PyTree, arguments: list[PyTree]) -> list[PyTree]:
        names: dict[PyTree, PyTree] = dict(zip(jaxpr.constvars, map(constant, consts), strict=True))
        names.update(zip(jaxpr.invars, arguments, strict=True))

        def read(variable: PyTree) -> PyTree:
            return variable if isinstance(variable, Literal) else names[variable]

        for equation in jaxpr.eqns:
            inputs = [read(variable) for variable in equation.invars]
            if equation.primitive.name in INLINED:
                body = equation.params.get("jaxpr", equation.params.get("call_jaxpr"))
                names.update(zip(equation.outvars, inline(body.jaxpr, body.consts, inputs), strict=True))
                continue
            key = _key(equation, inputs)
            if key is not None and key in done:
                names.update(zip(equation.outvars, done[key], strict=True))
                continue
            places = [flat.new() for _ in equation.outvars]
            done[key] = places
            flat.equations.append((equation, inputs, places))
            names.update(zip(equation.outvars, places, strict=True))
        return [read(variable) for variable in jaxpr.outvars]

    flat.inputs = [flat.new() for _ in closed.jaxpr.invars]
    flat.outputs = inline(closed.jaxpr, closed.consts, list(flat.inputs))
    counts: Counter[int] = Counter()
    for _, inputs, _ in flat.equations:
        counts.update({place for place in inputs if isinstance(place, int)})
    counts.update({place for place in flat.outputs if isinstance(place, int)})
    return flat, counts


def _evaluated(flat: _Flat, counts: Counter[int], arguments: list[PyTree], uses: int) -> list[PyTree]:
    values = dict(flat.values)
    costs: dict[int, int] = dict.fromkeys(values, 0)
    for place, argument in zip(flat.inputs, arguments, strict=True):
        # XLA repeats the slicing of a scan's inputs, too.
        values[place] = lax.optimization_barrier(argument) if counts[place] >= uses else argument
        costs[place] = 0

    def read(place: PyTree) -> PyTree:
        return values[place] if isinstance(place, int) else place.val

    for equation, inputs, places in flat.equations:
        primitive = equation.primitive
        results = primitive.bind(*map(read, inputs), **primitive.get_bind_params(equation.params))
        outputs = list(results) if primitive.multiple_results else [results]
        below = sum(costs[place] for place in {place for place in inputs if isinstance(place, int)})
        cost = 0 if primitive.name == "optimization_barrier" else below + _cost(primitive.name)
        for place, output in zip(places, outputs, strict=True):
            stored = counts[place] >= uses and cost >= WORTH
            values[place] = lax.optimization_barrier(output) if stored else output
            costs[place] = 0 if stored else cost
    return [read(place) for place in flat.outputs]


def _key(equation: PyTree, inputs: list[PyTree]) -> PyTree:
    """The same for equal equations; None if equality cannot be determined."""
    if equation.effects:
        return None
    operands = [(float(v.val), v.aval) if isinstance(v, Literal) and jnp.ndim(v.val) == 0 else v for v in inputs]
    key = (equation.primitive.name, tuple(sorted(equation.params.items())), *operands)
    try:
        hash(key)
    except TypeError:
        return None
    return key


def _cost(name: str) -> int:
    if name in _FREE:
        return 0
    return 8 if name in EXPENSIVE else 1
