"""A function of arrays as steps on the host: array operations by NumPy, and loops, each a compiled program.

Of a short recording, all that is beside the loops takes NumPy some milliseconds, and a compiler seconds.
"""

import functools
from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import numpy as np
from jax.extend.core import Jaxpr, JaxprEqn, Literal
from jax.interpreters import partial_eval
from jax.stages import Compiled
from jaxtyping import ArrayLike, PyTree

from jgait.estimators.operations import OPERATIONS, operation

type Compiler = Callable[[Callable[..., list[jax.Array]], Sequence[jax.ShapeDtypeStruct]], Compiled]
"""Function of arrays, their shapes and types → program."""

INLINED = {"jit": "jaxpr", "pjit": "jaxpr", "closed_call": "call_jaxpr", "custom_jvp_call": "call_jaxpr",
           "custom_vjp_call": "call_jaxpr"}  # fmt: skip
"""Calls of functions, and the parameter that holds the function: its operations become steps of their own."""


FOLDED = 64
"""Largest number of values that are computed once for all, as constants of a plan: larger ones would fill files."""


class PlanStep(NamedTuple):
    """An operation: its name, or the number of a compiled program; the places of its arguments and results."""

    name: str | int
    arguments: tuple[int, ...]
    results: tuple[int, ...]
    params: dict[str, object]


class StagePlan(NamedTuple):
    """Steps on values with places 0, 1, …: first those of the arguments.

    Attributes:
        types: of the arguments.
        steps: in order.
        constants: values that are known, by place.
        places: number of places.
        results: places of the results.
        structure: of the result, with 0, 1, … as its leaves.
    """

    types: list[np.dtype[np.generic]]
    steps: list[PlanStep]
    constants: dict[int, np.ndarray]
    places: int
    results: list[int]
    structure: PyTree


class Staged:
    """A plan with its programs, as a function of arrays."""

    def __init__(self, plan: StagePlan, programs: Sequence[Compiled]) -> None:
        self.plan, self.programs = plan, programs
        last = {place: number for number, step in enumerate(plan.steps) for place in (*step.results, *step.arguments)}
        kept = {*plan.results, *plan.constants}
        self._calls = []
        for number, step in enumerate(plan.steps):
            call: Callable[..., PyTree]
            if isinstance(step.name, int):
                call, several = programs[step.name], True
            else:
                call, several = functools.partial(OPERATIONS[step.name], **step.params), len(step.results) > 1
            over = tuple({i for i in (*step.results, *step.arguments) if last[i] == number} - kept)
            self._calls.append((call, step.arguments, step.results, several, over))

    def __call__(self, *arrays: PyTree) -> PyTree:
        """The result of the function, in NumPy arrays."""
        values: list[np.ndarray | None] = [None] * self.plan.places
        for place, value in self.plan.constants.items():
            values[place] = value
        for place, (leaf, dtype) in enumerate(zip(jax.tree.leaves(arrays), self.plan.types, strict=True)):
            values[place] = np.asarray(leaf, dtype)
        with np.errstate(all="ignore"):
            for call, arguments, results, several, over in self._calls:
                found = call(*[values[i] for i in arguments])
                for place, value in zip(results, found if several else (found,), strict=True):
                    values[place] = np.asarray(value)
                for place in over:  # its memory serves the next results
                    values[place] = None
        return jax.tree.map(lambda i: values[self.plan.results[i]], self.plan.structure)


class _Planner:
    """Builds the steps of a plan, and compiles its programs."""

    def __init__(self, compiled: Compiler) -> None:
        self.compiled = compiled
        self.steps: list[PlanStep] = []
        self.constants: dict[int, np.ndarray] = {}
        self.places = 0
        self.programs: list[Compiled] = []
        self._known: dict[int, tuple[JaxprEqn, int]] = {}
        self._made: dict[tuple[str | int, tuple[int, ...], str], tuple[int, ...]] = {}

    def place(self) -> int:
        self.places += 1
        return self.places - 1

    def constant(self, value: ArrayLike) -> int:
        array = np.asarray(value)
        key = "", (), f"{array.dtype} {array.shape} {array.tobytes()!r}"
        if key not in self._made:
            self._made[key] = (self.place(),)
            self.constants[self._made[key][0]] = array
        return self._made[key][0]

    def step(self, name: str | int, arguments: Sequence[int], count: int = 1, **params: object) -> tuple[int, ...]:
        key = name, tuple(arguments), repr(params)
        if key not in self._made:
            results = tuple(self.place() for _ in range(count))
            self._made[key] = self._known_now(PlanStep(name, tuple(arguments), results, params))
        return self._made[key]

    def _known_now(self, step: PlanStep) -> tuple[int, ...]:
        """Add a step; if its arguments are constants and its results small, these are computed now."""
        if isinstance(step.name, str) and all(i in self.constants for i in step.arguments):
            with np.errstate(all="ignore"):
                found = OPERATIONS[step.name](*[self.constants[i] for i in step.arguments], **step.params)
            values = [np.asarray(v) for v in (found if len(step.results) > 1 else [found])]
            if sum(v.size for v in values) <= FOLDED:
                self.constants |= dict(zip(step.results, values, strict=True))
                return step.results
        self.steps.append(step)
        return step.results

    def run(self, jaxpr: Jaxpr, consts: Sequence[ArrayLike], arguments: Sequence[int]) -> list[int]:
        """Add the steps of a trace; the places of its results."""
        places = dict(zip(jaxpr.constvars, map(self.constant, consts), strict=True))
        places |= dict(zip(jaxpr.invars, arguments, strict=True))

        def read(atom: PyTree) -> int:  # a variable or a literal of JAX, which have no types
            literal = isinstance(atom, Literal)
            return self.constant(np.asarray(atom.val, atom.aval.dtype)) if literal else places[atom]

        for equation in jaxpr.eqns:
            name, params = equation.primitive.name, equation.params
            results: Sequence[int]
            if name in INLINED:
                inner = params[INLINED[name]]
                results = self.run(inner.jaxpr, inner.consts, [read(v) for v in equation.invars])
            elif (known := operation(name, params)) is not None:
                results = self.step(name, [read(v) for v in equation.invars], len(equation.outvars), **known[1])
            else:
                results = self._program(equation, read)
            places |= dict(zip(equation.outvars, results, strict=True))
        return [read(v) for v in jaxpr.outvars]

    def _program(self, equation: JaxprEqn, read: Callable[[PyTree], int]) -> Sequence[int]:
        inputs: PyTree = list({v: None for v in equation.invars if not isinstance(v, Literal)})
        if id(equation) not in self._known:

            def alone(*values: jax.Array) -> list[jax.Array]:
                given = dict(zip(inputs, values, strict=True))
                arguments = [v.val if isinstance(v, Literal) else given[v] for v in equation.invars]
                results = equation.primitive.bind(*arguments, **equation.primitive.get_bind_params(equation.params))
                return results if equation.primitive.multiple_results else [results]

            shapes = [jax.ShapeDtypeStruct(v.aval.shape, v.aval.dtype) for v in inputs]
            self.programs.append(self.compiled(alone, shapes))
            self._known[id(equation)] = equation, len(self.programs) - 1
        return self.step(self._known[id(equation)][1], [read(v) for v in inputs], len(equation.outvars))


def staged(function: Callable[..., PyTree], arrays: PyTree, compiled: Compiler) -> Staged:
    """The function for arguments of these shapes and types as steps.

    Args:
        function: of arrays, traced by JAX.
        arrays: its arguments.
        compiled: (function of arrays → list, their shapes and types) → program.
    """
    trace, shape = jax.make_jaxpr(function, return_shape=True)(*arrays)
    leaves, structure = jax.tree.flatten(shape)
    jaxpr = partial_eval.dce_jaxpr(trace.jaxpr, [True] * len(leaves), instantiate=True)[0]
    planner = _Planner(compiled)
    inputs: PyTree = jaxpr.invars
    arguments = [planner.place() for _ in inputs]
    results = planner.run(jaxpr, trace.consts, arguments)
    types = [np.dtype(v.aval.dtype) for v in inputs]
    tree = jax.tree.unflatten(structure, range(len(leaves)))
    plan = StagePlan(types, planner.steps, planner.constants, planner.places, results, tree)
    return Staged(plan, planner.programs)
