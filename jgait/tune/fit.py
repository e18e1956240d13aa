"""Fitting parameters by gradient: optax in a `lax.scan`, in coordinates where every value is allowed."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax

from jgait.params import check_params, constrain, unconstrain
from jgait.tune.gradient import value_and_grad

Progress = Callable[[int, int, float], None]
"""Called with steps done, steps in all, and the loss now."""


class Fit[P](NamedTuple):
    """A finished fit.

    Attributes:
        params: the best parameters seen (lowest loss), natural units; what was fixed is the very object given.
        last: the parameters after the last step.
        free: the best in unconstrained coordinates; None where fixed.
        losses: (steps,) loss at the start of each step; finite always.
        gradient_norms: (steps,) norm of the gradient in unconstrained coordinates at the start of each step.
        accepted: (steps,) bool; False where the step led to a loss or gradient that is not finite and was taken back.
        rejected: how many were taken back.
        best_loss: loss at `params`.
        last_loss: loss at `last`.
    """

    params: P
    last: P
    free: P
    losses: np.ndarray
    gradient_norms: np.ndarray
    accepted: np.ndarray
    rejected: int
    best_loss: float
    last_loss: float


class _Carry(NamedTuple):
    """Between steps; `free` always has a finite loss and gradient."""

    step: Any
    free: Any
    optimizer: Any
    loss: Any
    gradient: Any
    scale: Any
    best: Any
    best_loss: Any


def _norm(tree: Any) -> Any:
    return jnp.sqrt(jax.tree.reduce(jnp.add, [jnp.sum(leaf * leaf) for leaf in jax.tree.leaves(tree)]))


def _finite(tree: Any) -> Any:
    return jax.tree.reduce(jnp.logical_and, [jnp.all(jnp.isfinite(leaf)) for leaf in jax.tree.leaves(tree)])


def _choose(condition: Any, yes: Any, no: Any) -> Any:
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), yes, no)


def _check_data(data: Any, batched: bool) -> None:
    """Refuse data that is no pytree of arrays with one leading length."""
    flat, _ = jax.tree_util.tree_flatten_with_path(data)
    if not flat:
        raise ValueError("data is empty: fit needs at least one array to compare with")
    lengths: dict[str, int] = {}
    for path, leaf in flat:
        name = "data" + jax.tree_util.keystr(path)
        if isinstance(leaf, str | bytes) or (not hasattr(leaf, "dtype") and not isinstance(leaf, int | float)):
            raise TypeError(f"{name} must be an array or a number; got {type(leaf).__name__}")
        if batched and np.ndim(leaf) == 0:
            raise ValueError(
                f"{name} is a single number; every leaf needs a leading axis of items (batched=False for one item)"
            )
        if batched:
            lengths[name] = np.shape(leaf)[0]
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"{name}: {length}" for name, length in lengths.items())
        raise ValueError(f"every leaf of data needs the same number of items; got {listed}")
    if batched and next(iter(lengths.values())) == 0:
        raise ValueError("data is empty: its leading axis has no items")


def _start(params: Any, transforms: Any) -> Any:
    """Free coordinates as arrays of one fixed type each, as a scan's carry must have."""
    check_params(params, transforms)

    def strong(leaf: Any) -> Any:
        kind = leaf.dtype if jnp.issubdtype(leaf.dtype, jnp.floating) else jnp.result_type(float)
        return jnp.asarray(leaf, kind)

    free = jax.tree.map(strong, unconstrain(params, transforms))
    if not jax.tree.leaves(free):
        raise ValueError("every parameter is fixed: free at least one of them by its transform")
    return free


def _objective(loss: Callable[..., Any], transforms: Any, batched: bool) -> Callable[..., Any]:
    """Mean loss over the items, as a function of free coordinates."""

    def objective(free: Any, params: Any, data: Any) -> Any:
        natural = constrain(free, transforms, params)
        if not batched:
            return loss(natural, data)
        return jnp.mean(jax.vmap(loss, in_axes=(None, 0))(natural, data))

    return objective


def _check_loss(loss: Callable[..., Any], params: Any, data: Any, batched: bool) -> None:
    item = jax.tree.map(lambda leaf: leaf[0], data) if batched else data
    out = jax.eval_shape(loss, params, item)
    leaves = jax.tree.leaves(out)
    if len(leaves) != 1 or leaves[0].shape != () or not jnp.issubdtype(leaves[0].dtype, jnp.floating):
        got = ", ".join(f"{leaf.dtype}{list(leaf.shape)}" for leaf in leaves) or repr(out)
        raise ValueError(f"loss must return one floating-point scalar for one item; got {got}")


def fit[P](
    loss: Callable[[P, Any], Any],
    params: P,
    transforms: P,
    data: Any,
    optimizer: optax.GradientTransformation,
    *,
    steps: int = 100,
    batched: bool = True,
    gradient: str = "auto",
    progress: Progress | None = None,
    chunk: int | None = None,
) -> Fit[P]:
    """Minimise the mean loss over the items of `data`.

    Every step moves free coordinates (see `jgait.params`) by what the optimizer says. A step that leads to a loss or
    gradient that is not finite is taken back, the optimizer's state with it, and the next one is tried at half the
    length; each accepted step doubles the length again, up to the full one.

    Args:
        loss: (params, item) → scalar; pure JAX.
        params: NamedTuple in natural units, where to start.
        transforms: the same type, holding a `Transform` for each.
        data: pytree of arrays with a leading axis of items; one item without that axis if not `batched`.
        optimizer: from optax, for example `optax.adam(0.05)`.
        steps: how many.
        batched: whether `data` has an axis of items.
        gradient: how to differentiate, see `value_and_grad`.
        progress: called on the host after every chunk; it changes nothing in the result.
        chunk: steps between two calls of `progress`, 2 at least; None for about twenty calls.

    Returns:
        The best parameters seen and the history.

    Raises:
        TypeError: if `params` and `transforms` do not match, or `data` holds anything but numbers.
        ValueError: if there is nothing to fit or nothing to fit to, a starting value is outside its range, the loss
            is not a scalar, or it is not finite at the start.
    """
    if steps < 1 or (chunk is not None and chunk < 1):
        raise ValueError(f"steps and chunk must be at least 1; got steps={steps}, chunk={chunk}")
    _check_data(data, batched)
    free = _start(params, transforms)
    data = jax.tree.map(jnp.asarray, data)
    _check_loss(loss, params, data, batched)
    objective = _objective(loss, transforms, batched)
    optimizer = optax.with_extra_args_support(optimizer)
    differentiate = partial(value_and_grad, gradient=gradient)
    # The start is evaluated by the same program as every step, as step −1, so that only one is compiled.
    total = steps + 1
    # A scan of one step would be unrolled and round differently; two is the least.
    size = min(total, max(2, steps // 20 if chunk is None else chunk) if progress is not None else total)
    run = jax.jit(_runner(objective, differentiate, optimizer, size, steps))
    unknown = jax.eval_shape(objective, free, params, data)
    infinite = jnp.full((), jnp.inf, unknown.dtype)
    flat_slope = jax.tree.map(jnp.zeros_like, free)
    carry = _Carry(
        jnp.full((), -1, jnp.int32), free, optimizer.init(free), infinite, flat_slope, jnp.ones_like(infinite), free,
        infinite,
    )  # fmt: skip
    history: list[Any] = []
    for done in range(size, total + size, size):
        carry, part = run(carry, params, data)
        history.append(jax.tree.map(np.asarray, part))
        if not np.isfinite(float(carry.best_loss)):
            value = float(jax.jit(objective)(free, params, data))
            raise ValueError(f"the loss or its gradient is not finite at the start (loss {value})")
        if progress is not None and (done < steps or done >= total):
            progress(min(done, steps), steps, float(carry.loss))
    losses, norms, accepted = (np.concatenate(parts)[1:total] for parts in zip(*history, strict=True))
    best, last = (constrain(f, transforms, params) for f in (carry.best, carry.free))
    rejected = int(steps - accepted.sum())
    return Fit(best, last, carry.best, losses, norms, accepted, rejected, float(carry.best_loss), float(carry.loss))


def _runner(objective: Any, differentiate: Any, optimizer: Any, size: int, steps: int) -> Callable[..., Any]:
    """`size` steps as one scan; steps past the last one do nothing, so that every chunk is the same program."""

    def run(carry: _Carry, params: Any, data: Any) -> tuple[_Carry, Any]:
        def value(free: Any) -> Any:
            return objective(free, params, data)

        def move(c: _Carry) -> tuple[_Carry, Any]:
            extra = {"value": c.loss, "grad": c.gradient, "value_fn": value}
            # optax counts steps in integers, which a caller's strict promotion would refuse
            with jax.numpy_dtype_promotion("standard"):
                updates, state = optimizer.update(c.gradient, c.optimizer, c.free, **extra)
            starting = c.step < 0
            free = jax.tree.map(lambda f, u: jnp.where(starting, f, f + (c.scale * u).astype(f.dtype)), c.free, updates)
            state = _choose(starting, c.optimizer, state)
            loss, gradient = differentiate(value)(free)
            good = _finite((free, loss, gradient))
            better = good & (loss < c.best_loss)
            kept = _choose(good, c._replace(free=free, optimizer=state, loss=loss, gradient=gradient), c)
            best, best_loss = _choose(better, (free, loss), (c.best, c.best_loss))
            scale = jnp.where(good, jnp.minimum(2.0 * c.scale, 1.0), 0.5 * c.scale).astype(c.scale.dtype)
            new = kept._replace(step=c.step + 1, scale=scale, best=best, best_loss=best_loss)
            return new, (c.loss, _norm(c.gradient), good)

        def body(c: _Carry, _: None) -> tuple[_Carry, Any]:
            # Steps past the last one are computed and thrown away: cheaper to compile than a branch.
            resting = (c, (c.loss, _norm(c.gradient), jnp.ones((), bool)))
            return _choose(c.step < steps, move(c), resting)

        return jax.lax.scan(body, carry, None, length=size)

    return run
