"""Optimisers of optax in the one form that the steps of a fit run, and the optimiser of a fit that names none."""

import inspect

import jax
import jax.numpy as jnp
import optax
from jaxtyping import PyTree

from jgait.tune.checkpoint import UNKNOWN, described


def _quasi_newton() -> optax.GradientTransformationExtraArgs:
    """L-BFGS without a line search. Where the loss is not convex and the direction is uphill, the memory is cleared."""
    inner = optax.lbfgs(1.0, linesearch=None)

    def update(gradient: PyTree, state: PyTree, free: PyTree, **_: PyTree) -> PyTree:
        proposed = inner.update(gradient, state, free)
        steepest = inner.update(gradient, inner.init(free), free)
        down = optax.tree.vdot(gradient, proposed[0]) < 0.0
        return jax.tree.map(lambda a, b: jnp.where(down, a, b), proposed, steepest)

    return optax.GradientTransformationExtraArgs(inner.init, update)


QUASI_NEWTON = _quasi_newton()
"""The optimiser of a fit that names none; its steps are shortened until the loss falls, see `descent`."""

_KEPT: dict[str, optax.GradientTransformationExtraArgs] = {}
"""Description of an optimiser → the optimiser, so that equal optimisers share compiled programs."""


def supported(
    optimizer: optax.GradientTransformation | optax.MultiSteps | None,
) -> optax.GradientTransformationExtraArgs:
    """An optimiser whose parameters are the free coordinates, and whose state consists of arrays of numbers.

    Arguments that an optimiser does not take are dropped. The slow parameters of `optax.lookahead` become part of the
    state, and the free coordinates are the fast ones. Random keys, as of `optax.add_noise`, are stored as their data.
    Raises TypeError if it is no optimiser of optax.
    """
    optimizer = QUASI_NEWTON if optimizer is None else optimizer
    if isinstance(optimizer, optax.MultiSteps):
        optimizer = optax.GradientTransformationExtraArgs(optimizer.init, optimizer.update)
    if not isinstance(optimizer, optax.GradientTransformation):
        raise TypeError(f"optimizer must come from optax, such as optax.adam(0.05); got {optimizer!r}")
    inner = optax.with_extra_args_support(optimizer)
    arguments = inspect.signature(inner.update).parameters
    takes_all = any(argument.kind is inspect.Parameter.VAR_KEYWORD for argument in arguments.values())

    def point_of(fast: PyTree, slow: PyTree) -> PyTree:
        return fast if slow is None else optax.LookaheadParams(fast, slow)

    def init(free: PyTree) -> PyTree:
        slow = free if _looks_ahead(inner, free) else None
        return jax.tree.map(_data, inner.init(point_of(free, slow))), slow

    def update(gradient: PyTree, state: PyTree, free: PyTree, **more: PyTree) -> PyTree:
        state, slow = state
        point = point_of(free, slow)
        like = inner.init(point)  # for the kinds of keys alone: the compiler drops the rest
        more = more if takes_all else {name: value for name, value in more.items() if name in arguments}
        change, new = inner.update(gradient, jax.tree.map(_restored, state, like), point, **more)
        new = jax.tree.map(lambda leaf, old: jnp.asarray(_data(leaf), old.dtype), new, state)
        if slow is None:
            return change, (new, None)
        return change.fast, (new, jax.tree.map(jnp.add, slow, change.slow))

    whole = optax.GradientTransformationExtraArgs(init, update)
    text = described(whole)
    return whole if UNKNOWN in text else _KEPT.setdefault(text, whole)


def _looks_ahead(optimizer: optax.GradientTransformation, free: PyTree) -> bool:
    """Whether the optimiser contains `optax.lookahead`, which takes two copies of the parameters."""
    try:
        state = jax.eval_shape(optimizer.init, optax.LookaheadParams.init_synced(free))
    except Exception:  # such as of a mask, which fits the parameters themselves alone
        return False
    kind = optax.LookaheadState
    return any(isinstance(part, kind) for part in jax.tree.leaves(state, is_leaf=lambda part: isinstance(part, kind)))


def _data(leaf: PyTree) -> PyTree:
    leaf = jnp.asarray(leaf)
    return jax.random.key_data(leaf) if jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key) else leaf


def _restored(data: PyTree, like: PyTree) -> PyTree:
    like = jnp.asarray(like)
    is_key = jnp.issubdtype(like.dtype, jax.dtypes.prng_key)
    return jax.random.wrap_key_data(data, impl=jax.random.key_impl(like)) if is_key else data
