"""Functions of a batch with the batch axis last, for single recordings: `jax.vmap` adds axes behind, not in front.

With the batch last, a processor's vector units work on several recordings at once. Large batches run in blocks that
stay in the processor's cache. Reverse mode uses the function's own rule, where it has one.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.custom_batching import custom_vmap
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array

from jgait.filtering.compile import backend
from jgait.filtering.methods import Derivative


class Batched:
    """A function of arrays (..., B), of which some may be (..., 1): the same for the whole batch; hashable."""

    @property
    def block(self) -> int:
        """The number of recordings that a CPU computes at once [1]; more of them leave its cache."""
        raise NotImplementedError

    def value(self, *arguments: Array) -> list[Array]:
        """The outputs, each (..., B)."""
        raise NotImplementedError

    @property
    def whole(self) -> "Batched":
        """The same function with the outputs that `reverse` needs behind its own."""
        return self

    def part(self, outputs: list[Array]) -> list[Array]:
        """The outputs of this function among those of `whole`."""
        return outputs

    def reverse(
        self, moving: tuple[int, ...], arguments: list[Array], outputs: list[Array], cotangents: list[Array | None]
    ) -> list[Array]:
        """Cotangents of the arguments `moving`, from the outputs of `whole` and the cotangents of the function's own.

        The default differentiates `value`.
        """
        lanes = max(v.shape[-1] for v in (*arguments, *outputs))

        def of(*values: Array) -> list[Array]:
            shown = self.value(*replaced(arguments, moving, values))
            return [o for o, c in zip(shown, cotangents, strict=False) if c is not None]

        wide = [jnp.broadcast_to(arguments[i], (*arguments[i].shape[:-1], lanes)) for i in moving]
        shown, pull = jax.vjp(of, *wide)
        given = [c for c in cotangents if c is not None]
        return list(pull([jnp.broadcast_to(c, o.shape) for c, o in zip(given, shown, strict=True)]))


def replaced[T](values: Sequence[T], places: Sequence[int], others: Sequence[T]) -> list[T]:
    """The values, those at some places replaced."""
    every = list(values)
    for i, value in zip(places, others, strict=True):
        every[i] = value
    return every


@dataclass(frozen=True)
class _Reverse(Batched):
    """`reverse` as a function of a batch: (arguments, outputs, cotangents of the outputs `given`)."""

    function: Batched
    moving: tuple[int, ...]
    count: int
    given: tuple[int, ...]
    output_count: int

    @property
    def block(self) -> int:
        return self.function.whole.block

    def value(self, *values: Array) -> list[Array]:
        lanes = max(v.shape[-1] for v in values)
        arguments, rest = list(values[: self.count]), list(values[self.count :])
        outputs, cotangents = rest[: len(rest) - len(self.given)], rest[len(rest) - len(self.given) :]
        every = replaced([None] * self.output_count, self.given, cotangents)
        gradients = self.function.reverse(self.moving, arguments, outputs, every)
        return [jnp.broadcast_to(f, (*f.shape[:-1], lanes)) for f in gradients]


def differentiable(function: Batched, derivative: Derivative) -> Callable[..., list[Array]]:
    """The function of arrays (..., B), for `jax.vmap` and `jax.grad`; in reverse mode by the function's own rule.

    `jax.vmap` makes the batch larger, so that the batch axis stays the last one.
    """
    if derivative == "forward":
        return _mapped(function)
    run = jax.custom_vjp(_mapped(function))

    def ahead(*arguments: Any) -> Any:
        values = [v.value for v in arguments]
        whole = function.whole
        outputs = _mapped(whole)(*values)
        return function.part(outputs), (values, outputs, [() if v.perturbed else None for v in arguments])

    def back(kept: Any, cotangents: Any) -> Any:
        values, outputs, perturbed = kept
        moves = zip(values, perturbed, strict=True)
        moving = tuple(i for i, (v, p) in enumerate(moves) if p is not None and real(v))
        given = tuple(i for i, c in enumerate(cotangents) if not isinstance(c, SymbolicZero))
        if not given or not moving:
            return (None,) * len(values)
        reverse = _Reverse(function, moving, len(values), given, len(cotangents))
        gradients = _mapped(reverse)(*values, *outputs, *(cotangents[i] for i in given))
        # An argument that is the same for the whole batch gets the sum.
        gradients = [_summed(f, values[i].shape) for i, f in zip(moving, gradients, strict=True)]
        return tuple(replaced([None] * len(values), moving, gradients))

    run.defvjp(ahead, back, symbolic_zeros=True)
    return run


def _summed(value: Array, shape: tuple[int, ...]) -> Array:
    return value if value.shape == shape else jnp.sum(value, axis=-1, keepdims=True)


@cache
def _once(function: Batched) -> Callable[..., list[Array]]:
    """`function.value`, traced once for each shape of its arguments."""
    return jax.jit(function.value, inline=True)


def _mapped(function: Batched, lanes: int = 1) -> Callable[..., list[Array]]:
    """The function of `lanes` recordings, computed in blocks on a CPU; `jax.vmap` gives that of more of them.

    Forward mode is a function of a batch too: JAX's own rule for a `custom_vmap` fails where values are batched and
    their tangents are not.
    """
    together = lanes in (1, function.block) or backend() != "cpu"
    run = custom_vmap(_once(function) if together else partial(_in_blocks, function, lanes))

    @run.def_vmap
    def rule(size: int, batched: Sequence[bool], *arguments: Array) -> tuple[list[Array], list[bool]]:
        def behind(value: Array, has_axis: bool) -> Array:
            """The argument with the new axis as part of its last one."""
            if not has_axis and value.shape[-1] == 1:
                return value
            value = jnp.moveaxis(value, 0, -1) if has_axis else value[..., None]
            shape = value.shape[:-2]
            return jnp.broadcast_to(value, (*shape, lanes, size)).reshape(*shape, lanes * size)

        wide = [behind(v, has_axis) for v, has_axis in zip(arguments, batched, strict=True)]
        outputs = [jnp.broadcast_to(o, (*o.shape[:-1], lanes * size)) for o in _mapped(function, lanes * size)(*wide)]
        apart = [jnp.moveaxis(o.reshape(*o.shape[:-1], lanes, size), -1, 0) for o in outputs]
        return apart, [True] * len(apart)

    derived = jax.custom_jvp(run)

    def ahead(
        primals: Sequence[Array], tangents: Sequence[Array | SymbolicZero]
    ) -> tuple[list[Array], list[Array | np.ndarray]]:
        moving = tuple(i for i, t in enumerate(tangents) if not isinstance(t, SymbolicZero))
        outputs, tangent = derived(*primals), _mapped(_Tangent(function, moving, len(primals)), lanes)
        changes = iter(tangent(*primals, *(tangents[i] for i in moving)))
        return outputs, [next(changes) if real(o) else np.zeros(o.shape, jax.dtypes.float0) for o in outputs]

    derived.defjvp(ahead, symbolic_zeros=True)
    return derived


def real(value: Array) -> bool:
    """Whether an array has derivatives."""
    return bool(jnp.issubdtype(value.dtype, jnp.floating))


@dataclass(frozen=True)
class _Tangent(Batched):
    """The tangents of a function's outputs: (arguments, tangents of those `moving`)."""

    function: Batched
    moving: tuple[int, ...]
    count: int

    @property
    def block(self) -> int:
        return self.function.block

    def value(self, *values: Array) -> list[Array]:
        arguments, tangents = list(values[: self.count]), values[self.count :]
        lanes = max(v.shape[-1] for v in values)

        def wide(value: Array) -> Array:
            return jnp.broadcast_to(value, (*value.shape[:-1], lanes))

        def of(*some: Array) -> list[Array]:
            return [wide(o) for o in self.function.value(*replaced(arguments, self.moving, some)) if real(o)]

        at = tuple(wide(arguments[i]) for i in self.moving)
        return list(jax.jvp(of, at, tuple(map(wide, tangents)))[1])


def _in_blocks(function: Batched, count: int, *lanes: Array) -> list[Array]:
    """The function of blocks of recordings, one after another; the last is filled up with copies.

    Fewer recordings than a block are computed one by one: a single recording fills the vector units by its matrices.
    """
    size = function.block if count >= function.block else 1
    missing, run = -count % size, _once(function)

    def folded(value: Array) -> Array:
        if missing:
            value = jnp.concatenate([value, jnp.repeat(value[..., -1:], missing, axis=-1)], axis=-1)
        if size == 1:  # a transpose that XLA joins with the one before it
            return jnp.moveaxis(value, -1, 0)[..., None]
        return jnp.moveaxis(value.reshape(*value.shape[:-1], -1, size), -2, 0)

    per_lane = [value.shape[-1] > 1 for value in lanes]

    def of(some: list[Array]) -> list[Array]:
        parts = iter(some)
        outputs = run(*(next(parts) if part else value for value, part in zip(lanes, per_lane, strict=True)))
        return [jnp.broadcast_to(o, (*o.shape[:-1], size)) for o in outputs]

    outputs = lax.map(of, [folded(value) for value, part in zip(lanes, per_lane, strict=True) if part])
    joined = [jnp.moveaxis(o, 0, -2) for o in outputs]
    return [o.reshape(*o.shape[:-2], count + missing)[..., :count] for o in joined]
