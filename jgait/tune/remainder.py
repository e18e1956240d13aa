"""What a loss still computes once all that its free parameters leave as it is has been computed."""

import re
from collections.abc import Hashable, Iterator
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array, Float, PyTree

from jgait.estimators.programs import bucket
from jgait.geometry.arrays import on_host
from jgait.params import Transform
from jgait.tune.checks import over_transforms
from jgait.tune.lessons import Lesson, lengthened
from jgait.tune.objective import Objective
from jgait.tune.problem import Items, Problem, of_subject


@dataclass(frozen=True)
class Remainder:
    """(params, constants) → loss of an item, by the operations that depend on the free parameters alone.

    Two with equal transforms and the same form of operations, which then differ by constants only, share programs.
    """

    transforms: PyTree
    operations: Any = field(compare=False)  #: those of one item, as they were traced.
    form: Hashable

    def __call__(self, params: PyTree, constants: tuple[list[Array], list[Array]]) -> Float[Array, ""]:
        """The loss; `constants` as of `_constants`."""
        arrays, numbers = constants
        left = iter(numbers)

        def filled(arguments: Any) -> list[Any]:  # the numbers of this item in the place of those that were traced
            return [type(v)(next(left), v.aval) if _is_number(v) else v for v in arguments]

        steps = [step.replace(invars=filled(step.invars)) for step in self.operations.eqns]
        operations = self.operations.replace(eqns=steps, outvars=filled(self.operations.outvars))
        (loss,) = jax.core.eval_jaxpr(operations, arrays, *_moving(self.transforms, params))
        return jnp.asarray(loss)


def reduced(problem: Problem, params: PyTree, free: PyTree, items: Items) -> tuple[Problem, Items, DTypeLike]:
    """The problem whose loss computes only what depends on the free parameters, its items, and the loss's dtype.

    A loss of `tune.objective` computes on the host whatever is known there, by the programs that estimates share. What
    is left, traced for each item, replaces it if it has no loop over samples, as of a filter, and is the same for all
    items but for numbers; else the problem and the items are returned as they are.

    Parameters per subject, and all items, have a leading axis. Raises ValueError if the loss of an item is not one
    floating-point number.
    """
    if not (isinstance(problem.loss, Objective) and isinstance(items.data, Lesson)):
        return problem, items, loss_type(problem, params, items)
    first, made = None, []
    for k in range(items.subject.size):
        traced = _traced(problem, params, free, jax.tree.map(lambda leaf, k=k: np.asarray(leaf)[k], items))
        if first is None:
            if not {"scan", "while"}.isdisjoint(_names(traced.jaxpr)):
                return problem, items, traced.out_avals[0].dtype
            first = traced.jaxpr
            form = _form(first)
        elif _form(traced.jaxpr) != form:
            return problem, items, traced.out_avals[0].dtype
        made.append(_constants(traced))
    data = jax.tree.map(lambda *parts: np.stack(parts), *made)
    return (
        problem._replace(loss=Remainder(problem.transforms, first, form)),
        Items(data, items.subject),
        traced.out_avals[0].dtype,
    )


def loss_type(problem: Problem, params: PyTree, items: Items) -> DTypeLike:
    """The dtype of the loss of one item. Raises ValueError if the loss is not one floating-point number."""
    data, subject = jax.tree.map(lambda leaf: leaf[0], tuple(items))
    out = jax.eval_shape(lambda p, item: problem.loss(of_subject(p, problem.transforms, subject), item), params, data)
    leaves = jax.tree.leaves(out)
    if len(leaves) != 1 or leaves[0].shape != () or not jnp.issubdtype(leaves[0].dtype, jnp.floating):
        got = ", ".join(f"{leaf.dtype}{list(leaf.shape)}" for leaf in leaves) or repr(out)
        raise ValueError(f"loss must return one floating-point scalar for one item; got {got}")
    return leaves[0].dtype


def _moving(transforms: PyTree, params: PyTree) -> list[PyTree]:
    """The natural values of the free parameters."""
    natural_values: list[PyTree] = []
    over_transforms(lambda t, v: natural_values.append(v) if t.to_natural is not None else None, transforms, params)
    return natural_values


def _traced(problem: Problem, params: PyTree, free: PyTree, item: Items) -> Any:
    """The loss of one item as operations on the natural values of the free parameters."""
    loss = problem.loss

    def of_item(transform: Transform, value: PyTree) -> PyTree:
        return np.asarray(value)[item.subject] if transform.per_subject else value

    known = over_transforms(of_item, problem.transforms, on_host(params))
    lesson = lengthened(item.data, bucket(item.data.look.size))  # as estimates are, whose programs it shares
    reals = [leaf for leaf in jax.tree.leaves(item.data) if np.issubdtype(leaf.dtype, np.floating) and leaf.size]
    sound = not reals or any(np.isfinite(leaf).any() for leaf in reals)

    def whole(moving: list[Array]) -> PyTree:
        values = iter(moving)
        mixed = over_transforms(lambda t, v: v if t.to_natural is None else next(values), problem.transforms, known)
        with np.errstate(all="ignore"):  # padding, and samples that are not valid
            return jnp.where(np.bool_(sound), loss(mixed, lesson), jnp.nan)

    start = over_transforms(
        lambda _, v, f: v if f is None else jnp.asarray(v, f.dtype), problem.transforms, known, free
    )
    return jax.make_jaxpr(whole)(_moving(problem.transforms, start))


def _is_number(value: Any) -> bool:
    """Whether an argument of an operation is a number that was known when it was traced."""
    return hasattr(value, "val")


def _constants(traced: Any) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """The arrays that the operations read, and the numbers among their arguments, in order."""
    arguments = [v for step in traced.jaxpr.eqns for v in step.invars] + list(traced.jaxpr.outvars)
    numbers = [np.asarray(v.val, v.aval.dtype) for v in arguments if _is_number(v)]
    return [np.asarray(array) for array in traced.consts], numbers


def _names(operations: Any) -> Iterator[str]:
    """Names of the operations, those of inner programs among them."""
    for step in operations.eqns:
        yield step.primitive.name
        for inner in jax.tree.leaves(list(step.params.values()), is_leaf=lambda node: hasattr(node, "eqns")):
            if hasattr(inner, "eqns"):
                yield from _names(inner)


def _form(operations: Any) -> Hashable:
    """What is equal for operations that differ by constants only."""
    places = {v: k for k, v in enumerate([*operations.constvars, *operations.invars])}
    rows: list[Hashable] = [tuple(str(v.aval) for v in places)]
    for step in operations.eqns:
        given = tuple(str(v.aval) if _is_number(v) else places[v] for v in step.invars)
        places |= {v: len(places) + k for k, v in enumerate(step.outvars)}
        rows.append((step.primitive.name, given, re.sub(" at 0x[0-9a-f]+", "", str(step.params))))
    return tuple(rows), tuple(str(v.aval) if _is_number(v) else places[v] for v in operations.outvars)
