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
from jgait.filtering.batched_call import evaluated

type Compiler = Callable[[Callable[..., list[jax.Array]], Sequence[jax.ShapeDtypeStruct]], Compiled]
"""Function of arrays, their shapes and types → program."""

INLINED = {"jit": "jaxpr", "pjit": "jaxpr", "closed_call": "call_jaxpr", "custom_jvp_call": "call_jaxpr",
           "custom_vjp_call": "call_jaxpr"}  # fmt: skip
"""Calls of functions, and the parameter that holds the function: its operations become steps of their own."""

FILLING = ("broadcast_in_dim", "iota")
"""Operations on numbers that fill an array: a program that begins with such an array makes it itself."""

FEW = 4
"""Turns of a loop that are steps of their own, if there are loops in it [1]: both sides, or two sensors of each."""

FOLDED = 64
"""Largest number of values that are computed once for all, as constants of a plan: larger ones would fill files."""

BUILT_IN = 1024
"""Largest number of values of a constant that is part of a program: as an argument it takes time at each call."""

REUSED = 31 * 2**20
"""[bytes] Arrays up to this size get memory that the process has already; see `_reuse_memory`."""


@functools.cache
def _reuse_memory() -> None:
    """Let arrays take the memory of freed ones.

    glibc gives freed arrays of more than 128 kB back to the system, which has to clear the pages of the next ones: that
    took longer than many of the steps. Once an array of some size was freed, it keeps up to twice that size (at most
    64 MB) instead. Other C libraries do as before.
    """
    np.empty(REUSED, np.uint8)


def _has_loops(jaxpr: Jaxpr) -> bool:
    """Whether a trace has loops, also in the functions that it calls."""

    def is_loop(equation: JaxprEqn) -> bool:
        name = equation.primitive.name
        inner = equation.params[INLINED[name]].jaxpr if name in INLINED else None
        return name in ("while", "scan", "batched_call") or (inner is not None and _has_loops(inner))

    return any(map(is_loop, jaxpr.eqns))


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
        _reuse_memory()
        self.plan, self.programs = plan, programs
        last = {place: number for number, step in enumerate(plan.steps) for place in (*step.results, *step.arguments)}
        kept = {*plan.results, *plan.constants}
        of_programs = {i for step in plan.steps if isinstance(step.name, int) for i in step.results}
        self._calls = []
        for number, step in enumerate(plan.steps):
            call: Callable[..., PyTree]
            if isinstance(step.name, int):
                call = programs[step.name]
            else:
                call = functools.partial(OPERATIONS[step.name], **step.params) if step.params else OPERATIONS[step.name]
            over = {i for i in (*step.results, *step.arguments) if last[i] == number} - kept
            single = step.results[0] if len(step.results) == 1 and not isinstance(step.name, int) else None
            self._calls.append((
                call, step.arguments, single, step.results, tuple(over), tuple(over & of_programs),
                isinstance(step.name, int),
            ))  # fmt: skip

    def __call__(self, *arrays: PyTree) -> PyTree:
        """The result of the function, in NumPy arrays."""
        values: list[PyTree] = [None] * self.plan.places
        of_programs: dict[int, jax.Array] = {}  # as programs gave them: the next program needs no copy
        for place, value in self.plan.constants.items():
            values[place] = value
        for place, (leaf, dtype) in enumerate(zip(jax.tree.leaves(arrays), self.plan.types, strict=True)):
            values[place] = np.asarray(leaf, dtype)
        value_at = values.__getitem__
        with np.errstate(all="ignore"):
            for call, arguments, single, results, over, gone, compiled in self._calls:
                if single is not None:  # most steps: the loop itself takes a tenth of a short recording's time
                    values[single] = call(*map(value_at, arguments))
                elif compiled:
                    found = call(*[of_programs.get(i, np.asarray(values[i])) for i in arguments])
                    for place, value in zip(results, found, strict=True):
                        of_programs[place] = value
                        values[place] = np.asarray(value)
                else:
                    for place, value in zip(results, call(*map(value_at, arguments)), strict=True):
                        values[place] = value
                for place in over:  # its memory serves the next results
                    values[place] = None
                for place in gone:
                    del of_programs[place]
        return jax.tree.map(lambda i: np.asarray(values[self.plan.results[i]]), self.plan.structure)


class _Planner:
    """Builds the steps of a plan, and compiles its programs."""

    def __init__(self, compiled: Compiler) -> None:
        self.compiled = compiled
        self.steps: list[PlanStep] = []
        self.constants: dict[int, np.ndarray] = {}
        self.places = 0
        self.programs: list[Compiled] = []
        self._known: dict[tuple[int, tuple[int, ...]], tuple[JaxprEqn, int]] = {}
        self._traces: dict[int, tuple[JaxprEqn, PyTree]] = {}
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
        filled: PyTree = {}  # variable → the operation that makes it of literals alone

        def read(atom: PyTree) -> int:  # a variable or a literal of JAX, which have no types
            like: PyTree = atom.aval
            if isinstance(atom, Literal):
                return self.constant(np.asarray(atom.val, like.dtype))
            if atom not in places:
                places[atom] = self._operation(filled[atom], [read(v) for v in filled[atom].invars])[0]
            return places[atom]

        for equation in jaxpr.eqns:
            name, params = equation.primitive.name, equation.params
            results: Sequence[int]
            if name in FILLING and operation(name, params) and all(isinstance(v, Literal) for v in equation.invars):
                filled[equation.outvars[0]] = equation
                continue
            if name in INLINED:
                inner = params[INLINED[name]]
                results = self.run(inner.jaxpr, inner.consts, [read(v) for v in equation.invars])
            elif name == "batched_call":
                inner = self._opened(equation)
                results = self.run(inner.jaxpr, inner.consts, [read(v) for v in equation.invars])
            elif name == "scan" and params["length"] <= FEW and _has_loops(params["jaxpr"].jaxpr):
                results = self._unrolled(equation, [read(v) for v in equation.invars])
            elif operation(name, params) is not None:
                results = self._operation(equation, [read(v) for v in equation.invars])
            else:
                results = self._program(equation, read, filled)
            places |= dict(zip(equation.outvars, results, strict=True))
        return [read(v) for v in jaxpr.outvars]

    def _operation(self, equation: JaxprEqn, arguments: Sequence[int]) -> tuple[int, ...]:
        name, known = equation.primitive.name, operation(equation.primitive.name, equation.params)
        return self.step(name, arguments, len(equation.outvars), **(known[1] if known is not None else {}))

    def _opened(self, equation: JaxprEqn) -> PyTree:
        """The trace of a batched call, once for all of its uses."""
        if id(equation) not in self._traces:
            inputs: PyTree = equation.invars
            shapes = [jax.ShapeDtypeStruct(v.aval.shape, v.aval.dtype) for v in inputs]
            trace = jax.make_jaxpr(functools.partial(evaluated, **equation.params))(*shapes)
            self._traces[id(equation)] = equation, trace
        return self._traces[id(equation)][1]

    def _unrolled(self, equation: JaxprEqn, arguments: Sequence[int]) -> list[int]:
        """The turns of a short loop one after another, which share the programs of the loops in it."""
        inner, length = equation.params["jaxpr"], equation.params["length"]

        def same(outer: PyTree, own: PyTree) -> int:
            """The number of values that all turns share or hand on: the others have one item for each turn."""
            return sum(o.aval.shape == i.aval.shape for o, i in zip(outer, own, strict=True))

        first = same(equation.invars, inner.jaxpr.invars)
        begin = first - same(equation.outvars, inner.jaxpr.outvars)
        fixed, carry = arguments[:begin], list(arguments[begin:first])
        parts = [self.step("unstack", [place], length, axis=0) for place in arguments[first:]]
        turns: list[Sequence[int]] = [()] * length
        for i in reversed(range(length)) if equation.params["reverse"] else range(length):
            found = self.run(inner.jaxpr, inner.consts, [*fixed, *carry, *(part[i] for part in parts)])
            carry, turns[i] = found[: len(carry)], found[len(carry) :]
        return [*carry, *(self.step("stack", one, axis=0)[0] for one in zip(*turns, strict=True))]

    def _program(self, equation: JaxprEqn, read: Callable[[PyTree], int], filled: PyTree) -> Sequence[int]:
        """A step of an operation that is compiled, with its constants and the arrays of a single number that it begins
        with.
        """
        used: PyTree = list({v: None for v in equation.invars if not isinstance(v, Literal) and v not in filled})
        places = {v: read(v) for v in used}
        known = {v: self.constants[i] for v, i in places.items() if self._built_in(i)}
        inputs = [v for v in used if v not in known]
        key = id(equation), tuple(places[v] for v in known)
        if key not in self._known:

            def alone(*values: jax.Array) -> list[jax.Array]:
                given = dict(zip(inputs, values, strict=True)) | known
                for v in equation.invars:
                    if not isinstance(v, Literal) and v in filled:
                        (given[v],) = _bound(filled[v], filled[v].invars, given)
                return _bound(equation, equation.invars, given)

            shapes = [jax.ShapeDtypeStruct(v.aval.shape, v.aval.dtype) for v in inputs]
            self.programs.append(self.compiled(alone, shapes))
            self._known[key] = equation, len(self.programs) - 1
        return self.step(self._known[key][1], [places[v] for v in inputs], len(equation.outvars))

    def _built_in(self, place: int) -> bool:
        return place in self.constants and self.constants[place].size <= BUILT_IN


def _bound(equation: JaxprEqn, atoms: PyTree, given: PyTree) -> list[jax.Array]:
    """The results of an equation, traced."""
    arguments = [v.val if isinstance(v, Literal) else given[v] for v in atoms]
    results = equation.primitive.bind(*arguments, **equation.primitive.get_bind_params(equation.params))
    return list(results) if equation.primitive.multiple_results else [results]


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
