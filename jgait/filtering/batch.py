r"""The scans as one function of a batch of recordings, for `jax.vmap`, with its gradient in closed form.

The batch is the last axis, in which a processor's vector units work on several recordings at once: `jax.vmap` makes it
longer. Large batches run in blocks that stay in the processor's cache.

The gradient is a scan back over the samples, and one of the smoother forward. With a bar for cotangents, K = P⁻ Hᵀ G,
z = G e, u = Kᵀ δ̄, and P̄ that of the covariance after the update,

    ē = u,   S̄ = Kᵀ P̄ K − sym(u zᵀ),   C̄ = z δ̄ᵀ − 2 Kᵀ P̄ + S̄ H  (of C = H P⁻),   H̄ = (C̄ + S̄ H) P⁻,
    P̄⁻ = P̄ + sym(Hᵀ C̄),   Ā = 2 P̄⁻ A P,   Q̄ = P̄⁻,   and P̄ of the sample before: Aᵀ P̄⁻ A,

and further terms where the outputs of the sample have cotangents of their own. The model's functions are
differentiated by `jax.vjp` of their linearisation.

Source: C. Parellier, A. Barrau, S. Bonnabel, "Speeding-up backpropagation of gradients through the Kalman filter via
closed-form expressions", IEEE TAC 68(12), 2023 (arXiv 2303.16846), for the form of the backward scan.
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
from jaxtyping import Array, Bool, PyTree

from jgait.filtering.linear import Linear, Matrices, widened, widest
from jgait.filtering.methods import Derivative
from jgait.filtering.scan import AXES, BACK, FOR_SMOOTHER, After, Belief, Recorded, Sample, taken
from jgait.filtering.step import (
    applied,
    diagonal_matrix,
    held,
    lifted,
    outer,
    predict,
    product,
    product_transposed,
    symmetrised,
    transposed,
    where,
)
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


# --- the gradient in closed form ---

type Named = dict[str, Array]
"""Outputs of a scan, or their cotangents, by name."""

type Scanned = tuple[list[Array], Sample, Named, Named]
"""x, δ and P before a sample, the sample, known outputs, cotangents."""

type Later = tuple[tuple[Array, ...], Named, Named]
"""Outputs of the filter, λ and Λ after a sample, cotangents."""


def filter_gradient(
    linear: Linear, start: Belief, samples: Sample, known: Named, ct: Named, moving: Sequence[int]
) -> list[Array]:
    """Cotangents of the arguments of `Recorded` with the numbers `moving`.

    `start` is (x, δ, P) before the first sample; `known` are the outputs x, delta, cov, G and z of the filter's scan,
    `ct` cotangents of its outputs.
    """
    count = len(linear.wide)
    constants, series = [i for i in moving if i < count], [i for i in moving if i > count + 1]
    places = [*constants, *(i - 2 for i in series)]  # without mean and covariance at the start
    before = [jnp.concatenate([a[None], known[n][:-1]]) for a, n in zip(start, ("x", "delta", "cov"), strict=True)]

    def body(carry: tuple[Belief, list[Array]], item: Scanned) -> tuple[tuple[Belief, list[Array]], list[Array]]:
        back, total = carry
        back, places_ct = _adjoint(linear, places, item, back)
        return (back, [a + b for a, b in zip(total, places_ct, strict=False)]), places_ct[len(constants) :]

    zero = jax.tree.map(jnp.zeros_like, start)
    none = [jnp.zeros((*linear.wide[i].shape[:-1], linear.lanes), linear.wide[i].dtype) for i in constants]
    items: Scanned = before, samples, {name: known[name] for name in ("G", "z")}, ct
    (first, sums), series_ct = lax.scan(body, (zero, none), items, reverse=True)
    gradients = dict(zip([*constants, *series], [*sums, *series_ct], strict=True))
    gradients |= {count: first[0], count + 1: first[2][: linear.size, : linear.size]}
    return [gradients[i] for i in moving]


def _adjoint(linear: Linear, places: list[int], item: Scanned, back: Belief) -> tuple[Belief, list[Array]]:
    """Cotangents of (x, δ, P) before a sample, and of the `places` among parameters, observation, control and dt."""
    (before, delta, P), sample, known, ct = item
    every, count = [*linear.wide, sample.measured, *sample.control, sample.dt], len(linear.wide)
    moving = [jnp.broadcast_to(every[i], (*every[i].shape[:-1], linear.lanes)) for i in places]

    def at(moving: list[Array]) -> tuple[Linear, list[Array]]:
        """The model and the sample."""
        values = replaced(every, places, moving)
        return Linear(linear.shape, values[:count], linear.lanes, linear.method, linear.width), values[count:]

    def transition(before: list[Array], delta: list[Array], moving: list[Array]) -> tuple[Array, Array, Array]:
        model, (_, *control, dt) = at(moving)
        return model.transition(before, delta, P, control, dt)

    def observation(x: Array, moving: list[Array]) -> tuple[Array, Array, Array]:
        model, (measured, *control, _) = at(moving)
        return model.observation(list(x), control, list(measured), list(sample.visible))

    # Two parts, so that an observation that is not finite does not spoil the derivatives of its prediction.
    (A, Q, x), pull = jax.vjp(transition, list(before), list(delta), moving)
    (H, _, _), pull_seen = jax.vjp(observation, x, moving)
    A, Q, x, H = held(A, Q, x, H)
    prior, finite = predict(P, A, Q, x)
    G, z = known["G"], known["z"]
    valid = held(finite & (G[0, 0] > 0.0))
    H = where(valid, H, 0.0)
    K = held(product(transposed(product(H, prior)), G))
    x_ct, delta_ct, P_ct = back
    x_ct, delta_ct = x_ct + ct.get("x", 0.0), delta_ct + ct.get("delta", 0.0)
    P_ct = symmetrised(P_ct + ct["cov"]) if "cov" in ct else P_ct
    A_ct, H_ct, e_ct, S_ct, prior_ct = _updated(ct, H, prior, G, z, K, A, delta_ct, P_ct, valid)
    half = product(prior_ct, A)
    A_ct = product(2.0 * half, P, A_ct)
    on_x, seen_ct = pull_seen(held(*(where(valid, v, 0.0) for v in (H_ct, S_ct, e_ct))))
    # A component that is not seen tells nothing, even where its derivative is not finite.
    whole = jnp.all(sample.visible, axis=0)
    on_x, seen_ct = jax.tree.map(lambda v: where(whole, v, jnp.where(jnp.isfinite(v), v, 0.0)), (on_x, seen_ct))
    x_back, delta_back, moved_ct = pull(held(A_ct, prior_ct, x_ct + where(valid, on_x, 0.0)))
    state = jnp.stack(x_back), jnp.stack(delta_back), product(transposed(A), half, hold=False)
    # What was not finite did not change the belief, and says nothing of the parameters.
    x_ct, delta_ct, P_ct = (where(finite, f, p) for f, p in zip(state, (x_ct, delta_ct, P_ct), strict=True))
    places_ct = jax.tree.map(lambda m, s: where(finite, m, 0.0) + where(valid, s, 0.0), moved_ct, seen_ct)
    return (x_ct, delta_ct, P_ct), places_ct


def _updated(
    ct: Named, H: Array, prior: Array, G: Array, z: Array, K: Array, A: Array, delta_ct: Array, P_ct: Array,
    valid: Bool[Array, "B"],
) -> tuple[Matrices | None, Array, Array, Array, Array]:  # fmt: skip
    """Cotangents of A by the output M (None without it), of H, e, S and P⁻."""
    e_ct = applied(transposed(K), delta_ct)
    spread = product(transposed(K), P_ct)
    C_ct, from_gain = outer(z, delta_ct) - 2.0 * spread, spread
    A_ct: Matrices | None = None
    H_ct: Matrices | None = None
    if "M" in ct or "J" in ct:  # J = H A, M = A − K J
        J = product(H, A)
        M_ct, J_ct = ct.get("M", jnp.zeros_like(P_ct)), ct.get("J", jnp.zeros_like(H))
        whitened = -product_transposed(G, product_transposed(M_ct, J))
        C_ct, from_gain = C_ct + whitened, spread - whitened
        J_ct = J_ct - product(transposed(K), M_ct)
        H_ct = product_transposed(J_ct, A)
        A_ct = product(transposed(H), J_ct, M_ct)
    along = e_ct
    if "z" in ct:
        pulled = applied(G, ct["z"])
        e_ct, along = e_ct + pulled, along + pulled
    if "nis" in ct:
        pulled = lifted(ct["nis"], z) * z
        e_ct, along = e_ct + 2.0 * pulled, along + pulled
    if "innovation" in ct:
        e_ct = e_ct + ct["innovation"]
    S_ct = symmetrised(product(from_gain, K, -outer(along, z)))
    if "G" in ct:
        S_ct = S_ct - product(product(G, symmetrised(ct["G"])), G)
    if "log_det" in ct:
        S_ct = S_ct + lifted(ct["log_det"], G) * G
    if "variance" in ct:
        S_ct = S_ct + diagonal_matrix(ct["variance"])
    rows = product(held(S_ct), H)
    C_ct = held(where(valid, C_ct + rows, 0.0))
    H_ct = product(C_ct + rows, prior, H_ct)
    prior_ct = held(P_ct + symmetrised(product(transposed(H), C_ct)))
    return A_ct, H_ct, e_ct, S_ct, prior_ct


def smoother_gradient(named: Named, chosen: tuple[int, ...], ct: Named, lanes: int) -> Named:
    """Cotangents of the filter's outputs cov, M, J, G and z, by a scan forward over the samples."""
    if not ct:
        return {}
    second = bool(chosen) and ("smoothed" in ct or "Lam" in ct)

    def body(carry: After, item: Later) -> tuple[After, Named]:
        lam_ct, Lam_ct = carry  # cotangents of λ and Λ before this sample
        (P, M, J, G, z), later, ct = item
        lam = later["lam"]
        M_ct, J_ct = outer(lam, lam_ct), -outer(z, lam_ct)
        z_ct, G_ct = -applied(J, lam_ct), jnp.zeros_like(G)
        back, P_ct = applied(M, lam_ct), jnp.zeros_like(P)
        if second:
            Lam = later["Lam"]
            half, part = product(M, Lam_ct), product(J, Lam_ct)
            M_ct, J_ct = M_ct + 2.0 * product(Lam, half), J_ct + 2.0 * product(G, part)
            G_ct, Lam_ct = product_transposed(part, J), product_transposed(half, M)
            if "smoothed" in ct:
                change, place = symmetrised(ct["smoothed"]), jnp.asarray(chosen)
                some = taken(P, chosen)
                half = product(change, some)
                P_ct = P_ct.at[place[:, None], place[None]].add(change).at[place].add(-2.0 * product(half, Lam))
                Lam_ct = Lam_ct - product(transposed(some), half)
            if "Lam" in ct:
                Lam_ct = Lam_ct + symmetrised(ct["Lam"])
        if "move" in ct:
            P_ct, back = P_ct - symmetrised(outer(ct["move"], lam)), back - applied(P, ct["move"])
        if "lam" in ct:
            back = back + ct["lam"]
        return (back, Lam_ct), {"cov": P_ct, "M": M_ct, "J": J_ct, "G": G_ct, "z": z_ct}

    n, dtype = named["cov"].shape[1], named["cov"].dtype
    none = jnp.zeros((n, lanes), dtype), jnp.zeros((n, n, lanes) if second else (), dtype)
    later: Named = {name: named[name] for name in ("lam", "Lam") if name in named and (second or name == "lam")}
    parts = tuple(named[name] for name in FOR_SMOOTHER)
    return lax.scan(body, none, (parts, later, ct))[1]


def replaced[T](values: Sequence[T], places: Sequence[int], others: Sequence[T]) -> list[T]:
    """The values, those at some places replaced."""
    every = list(values)
    for i, value in zip(places, others, strict=True):
        every[i] = value
    return every
