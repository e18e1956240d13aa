"""A filter, or a filter and its smoother, over whole recordings as one function of a batch, with its gradient.

The batch is the last axis, in which a processor's vector units work on several recordings at once: `jax.vmap` makes it
longer. Large batches run in blocks that stay in the processor's cache.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.custom_batching import custom_vmap
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, PyTree

from jgait.filtering.compile import backend
from jgait.filtering.gradient import filter_gradient, smoother_gradient
from jgait.filtering.linear import Linear
from jgait.filtering.methods import EKF, KF, Derivative, Method
from jgait.filtering.model import Shape
from jgait.filtering.scan import After, Belief, Sample, filter_step, nothing_after, smoother_scan
from jgait.filtering.step import real, replaced, widened, widest

FOR_SMOOTHER = ("cov", "M", "J", "G", "z")
FOR_GRADIENT = ("x", "delta", "cov", "G", "z")
BACK = ("move", "smoothed", "lam", "Lam")
"""The outputs of the smoother's scan."""

AXES = {"delta": 1, "move": 1, "lam": 1, "cov": 2, "prior": 2}
"""Number of axes of errors of the outputs."""

SEGMENT = 2**17
"""[samples] Recordings that are longer (22 minutes at 100 Hz) are smoothed in segments of this length: they are
filtered twice, and memory holds the covariances of one segment."""


def linearises_once(method: Method) -> bool:
    """Whether the linearised model depends on the means alone: KF and EKF without iterations."""
    return isinstance(method, KF | EKF) and method.iterations == 1


@dataclass(frozen=True)
class Recorded:
    """Parameters, start, recording → the outputs `keep` of `filter_step` and of `smoother_scan`, over samples.

    Arguments, each (..., B), or (..., 1) if it is the same for the whole batch: leaves of the parameters, mean (k,),
    covariance (n, n), then a `Sample` with the time axis in front, its control as separate components.

    Attributes:
        shape: the model.
        method: how to linearise.
        keep: names of outputs.
        chosen: components whose smoothed covariances are computed.
        all: whether everything is computed that the gradient needs, behind `keep`.
        segment: see `SEGMENT`.
    """

    shape: Shape
    method: Method
    keep: tuple[str, ...]
    chosen: tuple[int, ...] = ()
    all: bool = False
    segment: int = SEGMENT

    @property
    def block(self) -> int:
        """The number of recordings that a CPU computes at once [1]; more of them leave its cache.

        Of large models 32, which fill vector units; of small ones 16, whose matrices stay in the processor's first
        cache; in a smoother's gradient one, for its program is then half as long.
        """
        if self.all and self.smooth:
            return 1
        return 16 if self.shape.error.size**2 * jnp.dtype(self.shape.dtype).itemsize <= 512 else 32

    @property
    def smooth(self) -> bool:
        """Whether the smoother's scan is needed."""
        return any(name in BACK for name in self.keep)

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the outputs: `keep`, then what the gradient needs."""
        more = (*FOR_GRADIENT, *((*FOR_SMOOTHER, "lam", *(("Lam",) if self.chosen else ())) if self.smooth else ()))
        return tuple(dict.fromkeys((*self.keep, *more))) if self.all else self.keep

    @property
    def whole(self) -> "Recorded":
        """The same with the outputs that the gradient needs."""
        return replace(self, all=True) if linearises_once(self.method) else self

    def part(self, outputs: list[Array]) -> list[Array]:
        """The outputs without those that the gradient needs."""
        return [self.cut(name, value) for name, value in zip(self.keep, outputs, strict=False)]

    def model(self, arguments: Sequence[Array], lanes: int) -> tuple[Linear, Belief, Sample]:
        """The model, (x, δ, P) before the first sample, and the samples.

        A single recording has matrices whose rows fill vector units, if that adds few: with 15 errors it takes half of
        the time with 16 rows. In a gradient all recordings have matrices of the same size.
        """
        count, controls, size = self.shape.params.num_leaves, self.shape.control.size, self.shape.error.size
        mean, cov, measured, *rest = arguments[count:]
        samples = Sample(measured, tuple(rest[:controls]), *rest[controls:])
        alone = (lanes == 1 and not self.all) or (self.all and self.block == 1)
        width = -(-size // 8) * 8
        width = width if alone and linearises_once(self.method) and 10 * width <= 11 * size else size
        cov = jnp.pad(widened(cov, lanes), ((0, width - size), (0, width - size), (0, 0)))
        linear = Linear(self.shape, arguments[:count], lanes, self.method, width)
        return linear, (widened(mean, lanes), jnp.zeros_like(cov[0]), cov), samples

    def cut(self, name: str, value: Array) -> Array:
        """An output without the rows and columns beyond the model's errors."""
        size = self.shape.error.size
        return value[:, *[slice(size)] * AXES.get(name, 0)]

    def value(self, *arguments: Array) -> list[Array]:
        """The outputs, time axis in front and batch behind."""
        lanes = widest(arguments)
        linear, begin, samples = self.model(arguments, lanes)
        ahead, behind = ([name for name in self.names if (name in BACK) == back] for back in (False, True))
        if self.smooth:
            ahead = list(dict.fromkeys((*ahead, *FOR_SMOOTHER)))
        after = nothing_after(linear.width, lanes, self.shape.dtype, bool(self.chosen))

        def outputs_of(named: dict[str, Array], later: After) -> tuple[After, list[Array]]:
            if self.smooth:
                later, back = smoother_scan(named, self.chosen, later, behind)
                named |= back
            return later, [named[name] if self.all else self.cut(name, named[name]) for name in self.names]

        length, step = len(samples.dt), filter_step(linear, ahead)
        if self.all or not self.smooth or length <= self.segment:
            return outputs_of(lax.scan(step, begin, samples)[1], after)[1]
        # From the last segment to the first, each filtered again from the belief before it.
        count = -(-length // self.segment)
        missing = count * self.segment - length  # filled up with padding: no interval, nothing measured
        longer = jax.tree.map(lambda v: jnp.pad(v, [(0, missing), *[(0, 0)] * (v.ndim - 1)]), samples)
        parts = jax.tree.map(lambda v: v.reshape(count, self.segment, *v.shape[1:]), longer)
        only = filter_step(linear, ())
        begins = lax.scan(lambda begin, part: (lax.scan(only, begin, part)[0], begin), begin, parts)[1]
        outputs = lax.scan(
            lambda later, part: outputs_of(lax.scan(step, *part)[1], later), after, (begins, parts), reverse=True
        )[1]
        return [v.reshape(-1, *v.shape[2:])[:length] for v in outputs]

    def reverse(
        self, moving: tuple[int, ...], arguments: list[Array], outputs: list[Array], cotangents: list[Array | None]
    ) -> list[Array]:
        """The closed form where there is one: back through the smoother's scan, then through the filter's."""
        lanes = widest(arguments, outputs)
        if not linearises_once(self.method):
            used = {k: widened(ct, lanes) for k, ct in enumerate(cotangents) if ct is not None}

            def of(*some: Array) -> list[Array]:
                shown = self.value(*replaced(arguments, moving, some))
                return [widened(shown[k], lanes) for k in used]

            pull = jax.vjp(of, *(widened(arguments[i], lanes) for i in moving))[1]
            return list(pull([*used.values()]))
        linear, begin, samples = self.whole.model(arguments, lanes)
        named = dict(zip(self.whole.names, outputs, strict=True))
        more = linear.width - linear.size
        given = {
            name: jnp.pad(ct, [(0, 0), *[(0, more)] * AXES.get(name, 0), *[(0, 0)] * (ct.ndim - 1 - AXES.get(name, 0))])
            for name, ct in zip(self.keep, cotangents, strict=True) if ct is not None
        }  # fmt: skip
        if self.smooth:
            later = {name: given.pop(name) for name in BACK if name in given}
            for name, ct in smoother_gradient(named, self.chosen, later, lanes).items():
                given[name] = given[name] + ct if name in given else ct
        return filter_gradient(linear, begin, samples, named, given, moving)


type _Function = Recorded | _Reverse | _Tangent
"""Hashable functions `value` of arrays, on a CPU of `block` recordings at once."""


def differentiable(function: Recorded, derivative: Derivative) -> Callable[..., list[Array]]:
    """The function of arrays (..., B), for `jax.vmap` and `jax.grad`; in reverse mode by the function's own rule.

    `jax.vmap` makes the batch larger, so that the batch axis stays the last one.
    """
    if derivative == "forward":
        return _mapped(function)
    run = jax.custom_vjp(_mapped(function))

    def ahead(*arguments: Any) -> Any:
        values = [v.value for v in arguments]
        outputs = _mapped(function.whole)(*values)
        return function.part(outputs), (values, outputs, [() if v.perturbed else None for v in arguments])

    def back(kept: Any, cotangents: Any) -> Any:
        values, outputs, perturbed = kept
        moving = tuple(i for i, v in enumerate(values) if perturbed[i] is not None and real(v))
        given = [None if isinstance(c, SymbolicZero) else c for c in cotangents]
        if not moving or all(c is None for c in given):
            return (None,) * len(values)
        gradients = _mapped(_Reverse(function, moving))(values, outputs, given)
        # An argument that is the same for the whole batch gets the sum.
        gradients = [
            g if g.shape == values[i].shape else jnp.sum(g, axis=-1, keepdims=True)
            for i, g in zip(moving, gradients, strict=True)
        ]
        return tuple(replaced([None] * len(values), moving, gradients))

    run.defvjp(ahead, back, symbolic_zeros=True)
    return run


def _mapped(function: _Function, lanes: int = 1) -> Callable[..., list[Array]]:
    """The function of `lanes` recordings, computed in blocks on a CPU; `jax.vmap` gives that of more of them.

    Forward mode is a function of a batch too: JAX's own rule for a `custom_vmap` fails where values are batched and
    their tangents are not.
    """
    together = lanes in (1, function.block) or backend() != "cpu"
    run = custom_vmap(_once(function) if together else partial(_in_blocks, function, lanes))

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
        outputs = [widened(o, lanes * size) for o in _mapped(function, lanes * size)(*wide)]
        apart = [jnp.moveaxis(o.reshape(*o.shape[:-1], lanes, size), -1, 0) for o in outputs]
        return apart, [True] * len(apart)

    derived = jax.custom_jvp(run)

    def ahead(primals: Sequence[PyTree], tangents: Sequence[PyTree]) -> tuple[list[Array], list[Array | np.ndarray]]:
        changes = jax.tree.map(
            lambda t: None if isinstance(t, SymbolicZero) else t, list(tangents),
            is_leaf=lambda t: isinstance(t, SymbolicZero),
        )  # fmt: skip
        outputs, changed = derived(*primals), iter(_mapped(_Tangent(function), lanes)(list(primals), changes))
        return outputs, [next(changed) if real(o) else np.zeros(o.shape, jax.dtypes.float0) for o in outputs]

    derived.defjvp(ahead, symbolic_zeros=True)
    return derived


@cache
def _once(function: _Function) -> Callable[..., list[Array]]:
    """`function.value`, traced once for each shape of its arguments."""
    return jax.jit(function.value, inline=True)


@dataclass(frozen=True)
class _Reverse:
    """`reverse` as a function of a batch: (arguments, outputs, their cotangents)."""

    function: Recorded
    moving: tuple[int, ...]

    @property
    def block(self) -> int:
        return self.function.whole.block

    def value(self, arguments: list[Array], outputs: list[Array], cotangents: list[Array | None]) -> list[Array]:
        gradients = self.function.reverse(self.moving, arguments, outputs, cotangents)
        lanes = widest(arguments, outputs, cotangents)
        return [widened(g, lanes) for g in gradients]


@dataclass(frozen=True)
class _Tangent:
    """The tangents of a function's real outputs: (arguments, their tangents), None for zero."""

    function: _Function

    @property
    def block(self) -> int:
        return self.function.block

    def value(self, arguments: list[PyTree], tangents: list[PyTree]) -> list[Array]:
        lanes = widest(arguments, tangents)
        values, structure = jax.tree.flatten(arguments, is_leaf=lambda v: v is None)
        changes = jax.tree.leaves(tangents, is_leaf=lambda v: v is None)
        moving = [i for i, change in enumerate(changes) if change is not None]

        def of(*some: Array) -> list[Array]:
            outputs = self.function.value(*jax.tree.unflatten(structure, replaced(values, moving, some)))
            return [widened(o, lanes) for o in outputs if real(o)]

        at, along = ([widened(each[i], lanes) for i in moving] for each in (values, changes))
        return list(jax.jvp(of, at, along)[1])


def _in_blocks(function: _Function, count: int, *arguments: PyTree) -> list[Array]:
    """The function of blocks of recordings, one after another; the last is filled up with copies.

    Fewer recordings than a block are computed one by one: a single recording fills the vector units by its matrices.
    """
    size = function.block if count >= function.block else 1
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
        return [widened(o, size) for o in run(*jax.tree.unflatten(structure, replaced(values, apart, some)))]

    joined = [jnp.moveaxis(o, 0, -2) for o in lax.map(of, [folded(values[i]) for i in apart])]
    return [o.reshape(*o.shape[:-2], count + missing)[..., :count] for o in joined]
