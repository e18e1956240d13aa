"""Functions of batches with derivative rules of their own, for both modes and any order.

A `Batched` function computes on arrays whose last axis is the batch, the layout in which a processor's vector units
work on several recordings at once. `call` is used on single recordings; `jax.vmap`, also nested, appends axes behind
the arrays instead of in front of them, and large batches run in blocks.

In reverse mode the function's own rule `reverse` is used, where it has one; forward mode and derivatives of higher
order differentiate the computation itself.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir
from jax.interpreters import partial_eval as pe
from jaxtyping import PyTree


class Batched:
    """A function of arrays (..., B), of which some may be (..., 1): the same for the whole batch; hashable."""

    @property
    def block(self) -> int:
        """The number of recordings that a CPU computes at once [1]; more of them leave its cache."""
        raise NotImplementedError

    def value(self, *arguments: Any) -> list[Any]:
        """The outputs, each (..., B)."""
        raise NotImplementedError

    def shapes(self, *arguments: jax.ShapeDtypeStruct) -> list[jax.ShapeDtypeStruct]:
        """The shapes of the outputs without the batch axis, from those of the arguments."""
        raise NotImplementedError

    @property
    def whole(self) -> "Batched":
        """The same function with all outputs that `reverse` needs."""
        return self

    def part(self, outputs: list[Any]) -> list[Any]:
        """The outputs of this function among those of `whole`."""
        return outputs

    def lesser(self, used: Sequence[bool]) -> "tuple[Batched, list[bool]]":
        """The same function without some of its outputs that are not used, and whether it has each of them still."""
        return self, [True] * len(used)

    @property
    def constant(self) -> "Batched":
        """The same function with loops of constant length, which JAX can differentiate in reverse mode."""
        return self

    @property
    def reverse(self) -> "Reverse | None":
        """The function's own rule, or None: derivatives of the computation."""
        return None


Reverse = Callable[[tuple[int, ...], list[Any], list[Any], list[Any | None]], list[Any]]
"""(moving, arguments, outputs of `whole`, their cotangents or None for zero) → cotangents (..., B) of `moving`."""


def call(function: Batched, *arguments: PyTree) -> list[PyTree]:
    """The outputs of a function for arrays without a batch axis; differentiable, and mapped by `jax.vmap`."""
    arrays = [jnp.asarray(value) for value in arguments]
    return _call.bind(*arrays, function=function, ranks=tuple(value.ndim for value in arrays))


_call = Primitive("batched_call")
_call.multiple_results = True


def _sizes(arguments: Sequence[Any], ranks: tuple[int, ...]) -> tuple[int, ...]:
    """The sizes of the batch axes behind the arguments' own axes."""
    tails = [value.shape[rank:] for value, rank in zip(arguments, ranks, strict=True)]
    return tuple(max(sizes) for sizes in zip(*tails, strict=True))


def _own(values: Sequence[Any], ranks: tuple[int, ...]) -> list[jax.ShapeDtypeStruct]:
    return [jax.ShapeDtypeStruct(v.shape[:rank], v.dtype) for v, rank in zip(values, ranks, strict=True)]


def _lanes(value: PyTree, rank: int, sizes: tuple[int, ...]) -> PyTree:
    """An argument with its batch axes as one."""
    own = value.shape[:rank]
    if all(size == 1 for size in value.shape[rank:]):
        return value.reshape(*own, 1)
    return jnp.broadcast_to(value, own + sizes).reshape(*own, math.prod(sizes))


def evaluated(*arguments: PyTree, function: Batched, ranks: tuple[int, ...], blocks: bool = True) -> list[PyTree]:
    """The outputs of a call with its batch axes behind, by operations of JAX; `ranks`: the arguments' own axes."""
    sizes = _sizes(arguments, ranks)
    count = math.prod(sizes)
    lanes = [_lanes(value, rank, sizes) for value, rank in zip(arguments, ranks, strict=True)]
    blocks = blocks and count not in (1, function.block)
    outputs = _in_blocks(function, lanes, count) if blocks else function.value(*lanes)
    return [jnp.broadcast_to(o, (*o.shape[:-1], count)).reshape(o.shape[:-1] + sizes) for o in outputs]


def _in_blocks(function: Batched, lanes: list[PyTree], count: int) -> list[PyTree]:
    """The function of blocks of recordings, one after another; the last is filled up with copies.

    Fewer recordings than a block are computed one by one: a single recording fills the vector units by its matrices.
    """
    size = function.block if count > function.block else 1
    missing = -count % size

    def folded(value: PyTree) -> PyTree:
        if missing:
            value = jnp.concatenate([value, jnp.repeat(value[..., -1:], missing, axis=-1)], axis=-1)
        if size == 1:  # a transpose that XLA joins with the one before it
            return jnp.moveaxis(value, -1, 0)[..., None]
        return jnp.moveaxis(value.reshape(*value.shape[:-1], -1, size), -2, 0)

    own = [value.shape[-1] > 1 for value in lanes]

    def of(block: list[PyTree]) -> list[PyTree]:
        parts = iter(block)
        outputs = function.value(*(next(parts) if part else value for value, part in zip(lanes, own, strict=True)))
        return [jnp.broadcast_to(o, (*o.shape[:-1], size)) for o in outputs]

    outputs = lax.map(of, [folded(value) for value, part in zip(lanes, own, strict=True) if part])
    joined = [jnp.moveaxis(o, 0, -2) for o in outputs]
    return [o.reshape(*o.shape[:-2], count + missing)[..., :count] for o in joined]


def _abstract(*arguments: PyTree, function: Batched, ranks: tuple[int, ...]) -> list[PyTree]:
    sizes = _sizes(arguments, ranks)
    outputs = function.shapes(*_own(arguments, ranks))
    return [jax.core.ShapedArray(o.shape + sizes, o.dtype) for o in outputs]


def _mapped(
    arguments: Sequence[PyTree], axes: Sequence[int | None], *, function: Batched, ranks: tuple[int, ...]
) -> tuple[list[PyTree], list[int]]:
    moved = [
        value[..., None] if axis is None else jnp.moveaxis(value, axis, -1)
        for value, axis in zip(arguments, axes, strict=True)
    ]
    outputs = _call.bind(*moved, function=function, ranks=ranks)
    return outputs, [o.ndim - 1 for o in outputs]


@dataclass(frozen=True)
class _Derived(Batched):
    """A function that computes with another one, of `count` arguments of which those in `moving` vary."""

    function: Any
    moving: tuple[int, ...]
    count: int

    @property
    def constant(self) -> Any:
        return replace(self, function=self.function.constant)

    @property
    def block(self) -> int:
        return int(self.function.block)


class _Tangent(_Derived):
    """The derivative of a function: (arguments, outputs of `whole`, tangents of `moving`) → tangents of the outputs."""

    def value(self, *arguments: PyTree) -> list[PyTree]:
        primals, tangents = arguments[: self.count], arguments[len(arguments) - len(self.moving) :]
        lanes = max(v.shape[-1] for v in arguments)
        pairs = [
            [jnp.broadcast_to(v, (*v.shape[:-1], lanes)) for v in (primals[i], t)]
            for i, t in zip(self.moving, tangents, strict=True)
        ]

        def of(*values: PyTree) -> list[PyTree]:
            outputs = self.function.value(*replaced(primals, self.moving, values))
            return [jnp.broadcast_to(o, (*o.shape[:-1], lanes)) for o in outputs if _real(o)]

        moved = jax.jvp(of, tuple(p for p, _ in pairs), tuple(t for _, t in pairs))[1]
        return list(moved)

    def shapes(self, *arguments: jax.ShapeDtypeStruct) -> list[jax.ShapeDtypeStruct]:
        return [o for o in self.function.shapes(*arguments[: self.count]) if _real(o)]


@dataclass(frozen=True)
class _Reverse(_Derived):
    """The transpose of a derivative: (arguments, outputs, cotangents of the outputs `given`) → cotangents."""

    given: tuple[int, ...]

    def value(self, *arguments: PyTree) -> list[PyTree]:
        primals = list(arguments[: self.count])
        after = len(arguments) - len(self.given)
        outputs = list(arguments[self.count : after])
        cotangents = replaced([None] * len(outputs), self.given, arguments[after:])
        lanes = max(v.shape[-1] for v in arguments)
        own = self.function.reverse or _plain(self.function)
        found = own(self.moving, primals, outputs, cotangents)
        return [jnp.broadcast_to(f, (*f.shape[:-1], lanes)) for f in found]

    def shapes(self, *arguments: jax.ShapeDtypeStruct) -> list[jax.ShapeDtypeStruct]:
        return [arguments[i] for i in self.moving]


def _plain(function: Batched) -> Reverse:
    """The rule `reverse` by differentiation of the computation."""

    def reverse(
        moving: tuple[int, ...], arguments: list[PyTree], outputs: list[PyTree], cotangents: list[PyTree]
    ) -> list[PyTree]:
        lanes = max(v.shape[-1] for v in (*arguments, *outputs))

        def of(*values: PyTree) -> list[PyTree]:
            shown = function.constant.value(*replaced(arguments, moving, values))
            return [o for o, c in zip(shown, cotangents, strict=True) if c is not None]

        wide = [jnp.broadcast_to(arguments[i], (*arguments[i].shape[:-1], lanes)) for i in moving]
        shown, pull = jax.vjp(of, *wide)
        given = [c for c in cotangents if c is not None]
        return list(pull([jnp.broadcast_to(c, o.shape) for c, o in zip(given, shown, strict=True)]))

    return reverse


def replaced(values: Sequence[PyTree], places: Sequence[int], others: Sequence[PyTree]) -> list[PyTree]:
    """The values, those at some places replaced."""
    every = list(values)
    for i, value in zip(places, others, strict=True):
        every[i] = value
    return every


def _real(value: PyTree) -> bool:
    return bool(jnp.issubdtype(value.dtype, jnp.floating))


def _jvp(
    primals: Sequence[PyTree], tangents: Sequence[PyTree], *, function: Batched, ranks: tuple[int, ...]
) -> tuple[list[PyTree], list[PyTree]]:
    moving = tuple(i for i, (p, t) in enumerate(zip(primals, tangents, strict=True))
                   if _real(p) and not isinstance(t, ad.Zero))  # fmt: skip
    whole = function.whole
    outputs = _call.bind(*primals, function=whole, ranks=ranks)
    depth = primals[0].ndim - ranks[0]
    tangent = _Tangent(whole, moving, len(primals))
    every = (*ranks, *(o.ndim - depth for o in outputs), *(ranks[i] for i in moving))
    moved = iter(_call.bind(*primals, *outputs, *(tangents[i] for i in moving), function=tangent, ranks=every))
    changes = [next(moved) if _real(o) else ad.Zero(jax.typeof(o).to_tangent_aval()) for o in outputs]
    return function.part(outputs), function.part(changes)


def _transposed(
    cotangents: Sequence[PyTree], *arguments: PyTree, function: PyTree, ranks: tuple[int, ...]
) -> list[PyTree]:
    if not isinstance(function, _Tangent) or any(ad.is_undefined_primal(v) for v in arguments[: -len(function.moving)]):
        raise NotImplementedError("the transpose of a function that is not linear")
    first = len(arguments) - len(function.moving)
    known, linear = arguments[:first], arguments[first:]
    outputs = known[function.count :]
    real = [i for i, o in enumerate(outputs) if _real(o)]
    given = [(i, c) for i, c in zip(real, cotangents, strict=True) if not isinstance(c, ad.Zero)]
    if not given:
        return [None] * first + [ad.Zero(v.aval) if ad.is_undefined_primal(v) else None for v in linear]
    depth = known[0].ndim - ranks[0]
    reverse = _Reverse(function.function, function.moving, function.count, tuple(i for i, _ in given))
    every = (*ranks[:first], *(c.ndim - depth for _, c in given))
    found = _call.bind(*known, *(c for _, c in given), function=reverse, ranks=every)
    return [None] * first + [
        _summed(f, v.aval.shape) if ad.is_undefined_primal(v) else None for f, v in zip(found, linear, strict=True)
    ]


def _pruned(used: Sequence[bool], *rest: Any) -> tuple[list[bool], Any]:
    """The call without the outputs that are not used, and which of its arguments that needs."""
    equation = rest[-1]  # some versions of JAX pass another argument before it
    inputs, params = equation.invars, equation.params
    if not any(used):
        return [False] * len(inputs), None
    function, ranks = params["function"], params["ranks"]
    needed, outputs = [True] * len(inputs), [True] * len(equation.outvars)
    if isinstance(function, _Reverse):
        given = [i in function.given for i in range(len(inputs) - function.count - len(function.given))]
        lesser, kept = function.function.lesser(given)
        needed[function.count : function.count + len(kept)] = kept
        place = [sum(kept[:i]) for i in function.given]
        function = replace(function, function=lesser, given=tuple(place))
    else:
        function, outputs = function.lesser(used)
    ranks = tuple(r for r, needs in zip(ranks, needed, strict=True) if needs)
    new = equation.replace(
        invars=[v for v, needs in zip(inputs, needed, strict=True) if needs],
        outvars=[v for v, has in zip(equation.outvars, outputs, strict=True) if has],
        params={**params, "function": function, "ranks": ranks},
    )
    return needed, new


def _summed(value: PyTree, shape: tuple[int, ...]) -> PyTree:
    """The sum over batch axes in which the argument was the same for all."""
    axes = tuple(i for i, (a, b) in enumerate(zip(value.shape, shape, strict=True)) if a != b)
    return jnp.sum(value, axis=axes, keepdims=True) if axes else value


_call.def_impl(evaluated)
_call.def_abstract_eval(_abstract)
mlir.register_lowering(_call, mlir.lower_fun(partial(evaluated, blocks=False), multiple_results=True))
mlir.register_lowering(_call, mlir.lower_fun(evaluated, multiple_results=True), platform="cpu")
batching.primitive_batchers[_call] = _mapped
ad.primitive_jvps[_call] = _jvp
ad.primitive_transposes[_call] = _transposed
pe.dce_rules[_call] = _pruned
