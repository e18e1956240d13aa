"""The scans as one function of a batch of recordings, for `jax.vmap`, with its gradient in closed form.

The batch is the last axis, in which a processor's vector units work on several recordings at once: `jax.vmap` makes it
longer. Large batches run in blocks that stay in the processor's cache.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.custom_batching import custom_vmap
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, PyTree

from jgait.filtering.gradient import filter_gradient, replaced, smoother_gradient
from jgait.filtering.linear import widened, widest
from jgait.filtering.methods import Derivative
from jgait.filtering.scan import AXES, BACK, Recorded
from jgait.geometry.arrays import backend

type Function = Callable[..., list[Array]]
"""Of trees of arrays (..., B), or (..., 1) if one is the same for the whole batch."""


def differentiable(recorded: Recorded, derivative: Derivative) -> Function:
    """The function of arrays, for `jax.vmap` and `jax.grad`; in reverse mode by the rule of `_gradients`.

    `jax.vmap` makes the batch larger, so that the batch axis stays the last one.
    """
    plain = _mapped(_value(recorded), recorded.block)
    if derivative == "forward":
        return plain
    run = jax.custom_vjp(plain)
    whole = replace(recorded, all=True) if recorded.linearises_once else recorded

    def ahead(*arguments: Any) -> Any:
        values = [v.value for v in arguments]
        outputs = _mapped(_value(whole), whole.block)(*values)
        part = [whole.cut(name, value) for name, value in zip(recorded.keep, outputs, strict=False)]
        return part, (values, outputs, [() if v.perturbed else None for v in arguments])

    def back(kept: Any, cotangents: Any) -> Any:
        values, outputs, perturbed = kept
        moving = tuple(i for i, v in enumerate(values) if perturbed[i] is not None and _real(v))
        given = [None if isinstance(c, SymbolicZero) else c for c in cotangents]
        if not moving or all(c is None for c in given):
            return (None,) * len(values)
        gradients = _mapped(_gradients(whole, moving), whole.block)(values, outputs, given)
        # An argument that is the same for the whole batch gets the sum.
        gradients = [
            g if g.shape == values[i].shape else jnp.sum(g, axis=-1, keepdims=True)
            for i, g in zip(moving, gradients, strict=True)
        ]
        return tuple(replaced([None] * len(values), moving, gradients))

    run.defvjp(ahead, back, symbolic_zeros=True)
    return run


@cache  # as `_gradients` and `_tangents`: `_once` traces each function once
def _value(recorded: Recorded) -> Function:
    return recorded.value


@cache
def _gradients(recorded: Recorded, moving: tuple[int, ...]) -> Function:
    """(arguments, outputs, cotangents of `keep`, None for zero) → cotangents of the arguments `moving`.

    Where there is no closed form, that of JAX.
    """

    def by_jax(arguments: list[Array], outputs: list[Array], cotangents: list[Array | None]) -> list[Array]:
        lanes = widest(arguments, outputs)
        used = {k: widened(ct, lanes) for k, ct in enumerate(cotangents) if ct is not None}

        def of(*some: Array) -> list[Array]:
            shown = recorded.value(*replaced(arguments, moving, some))
            return [widened(shown[k], lanes) for k in used]

        pull = jax.vjp(of, *(widened(arguments[i], lanes) for i in moving))[1]
        return list(pull([*used.values()]))

    def closed(arguments: list[Array], outputs: list[Array], cotangents: list[Array | None]) -> list[Array]:
        lanes = widest(arguments, outputs)
        linear, begin, samples = recorded.model(arguments, lanes)
        named = dict(zip(recorded.names, outputs, strict=True))
        more = linear.width - linear.size
        given = {
            name: jnp.pad(ct, [(0, 0), *[(0, more)] * AXES.get(name, 0), *[(0, 0)] * (ct.ndim - 1 - AXES.get(name, 0))])
            for name, ct in zip(recorded.keep, cotangents, strict=True) if ct is not None
        }  # fmt: skip
        if recorded.smooth:
            later = {name: given.pop(name) for name in BACK if name in given}
            for name, ct in smoother_gradient(named, recorded.chosen, later, lanes).items():
                given[name] = given[name] + ct if name in given else ct
        return filter_gradient(linear, begin, samples, named, given, moving)

    return closed if recorded.all else by_jax


@cache
def _tangents(function: Function) -> Function:
    """(arguments, their tangents, None for zero) → tangents of the function's real outputs."""

    def of_tangents(arguments: list[PyTree], tangents: list[PyTree]) -> list[Array]:
        lanes = widest(arguments, tangents)
        values, structure = jax.tree.flatten(arguments, is_leaf=lambda v: v is None)
        changes = jax.tree.leaves(tangents, is_leaf=lambda v: v is None)
        moving = [i for i, change in enumerate(changes) if change is not None]

        def of(*some: Array) -> list[Array]:
            outputs = function(*jax.tree.unflatten(structure, replaced(values, moving, some)))
            return [widened(o, lanes) for o in outputs if _real(o)]

        at, along = ([widened(each[i], lanes) for i in moving] for each in (values, changes))
        return list(jax.jvp(of, at, along)[1])

    return of_tangents


def _mapped(function: Function, block: int, lanes: int = 1) -> Function:
    """The function of `lanes` recordings, on a CPU in blocks; `jax.vmap` gives that of more of them.

    Forward mode is a function of a batch too: JAX's own rule for a `custom_vmap` fails where values are batched and
    their tangents are not.
    """
    together = lanes in (1, block) or backend() != "cpu"
    run = custom_vmap(_once(function) if together else partial(_in_blocks, function, block, lanes))

    @run.def_vmap
    def rule(size: int, batched: Sequence[PyTree], *arguments: PyTree) -> tuple[list[Array], list[bool]]:
        def behind(value: Array, has_axis: bool) -> Array:
            """The argument with the new axis as part of its last one."""
            if not has_axis and value.shape[-1] == 1:
                return value
            value = jnp.moveaxis(value, 0, -1) if has_axis else value[..., None]
            shape = value.shape[:-2]
            return jnp.broadcast_to(value, (*shape, lanes, size)).reshape(*shape, lanes * size)

        wide = jax.tree.map(behind, list(arguments), list(batched))
        outputs = widened(_mapped(function, block, lanes * size)(*wide), lanes * size)
        apart = [jnp.moveaxis(o.reshape(*o.shape[:-1], lanes, size), -1, 0) for o in outputs]
        return apart, [True] * len(apart)

    derived = jax.custom_jvp(run)

    def ahead(primals: Sequence[PyTree], tangents: Sequence[PyTree]) -> tuple[list[Array], list[Array | np.ndarray]]:
        changes = jax.tree.map(
            lambda t: None if isinstance(t, SymbolicZero) else t, list(tangents),
            is_leaf=lambda t: isinstance(t, SymbolicZero),
        )  # fmt: skip
        outputs, changed = derived(*primals), iter(_mapped(_tangents(function), block, lanes)(list(primals), changes))
        return outputs, [next(changed) if _real(o) else np.zeros(o.shape, jax.dtypes.float0) for o in outputs]

    derived.defjvp(ahead, symbolic_zeros=True)
    return derived


@cache
def _once(function: Function) -> Function:
    """The function, traced once for each shape of its arguments."""
    return jax.jit(function, inline=True)


def _in_blocks(function: Function, block: int, count: int, *arguments: PyTree) -> list[Array]:
    """The function of blocks of recordings, one after another; the last is filled up with copies.

    Fewer recordings than a block are computed one by one: a single recording fills the vector units by its matrices.
    """
    size = block if count >= block else 1
    missing, run = -count % size, _once(function)
    values, structure = jax.tree.flatten(arguments)
    apart = [i for i, value in enumerate(values) if value.shape[-1] > 1]

    def folded(value: Array) -> Array:
        if missing:
            value = jnp.concatenate([value, jnp.repeat(value[..., -1:], missing, axis=-1)], axis=-1)
        if size == 1:  # a transpose that XLA joins with the one before it
            return jnp.moveaxis(value, -1, 0)[..., None]
        return jnp.moveaxis(value.reshape(*value.shape[:-1], -1, size), -2, 0)

    def of(some: list[Array]) -> list[Array]:
        return widened(run(*jax.tree.unflatten(structure, replaced(values, apart, some))), size)

    joined = [jnp.moveaxis(o, 0, -2) for o in lax.map(of, [folded(values[i]) for i in apart])]
    return [o.reshape(*o.shape[:-2], count + missing)[..., :count] for o in joined]


def _real(value: Array) -> bool:
    """Whether an array has derivatives."""
    return bool(jnp.issubdtype(value.dtype, jnp.floating))
