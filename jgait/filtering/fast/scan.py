r"""The filter over components as one scan, and the smoother of means as one back.

The scan runs in segments of about √T samples, each under `jax.checkpoint`: a gradient in reverse mode stores the belief
at the start of each segment, and computes a segment again when the backward pass reaches it. Memory grows with √T,
and the stored values of one segment fit the processor's cache.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jax.typing import DTypeLike

from jgait.filtering.fast.components import (
    Matrix,
    added,
    congruence,
    dot,
    from_upper,
    known,
    minus,
    plus,
    product,
    sound,
    total,
    transposed,
    upper,
)
from jgait.filtering.fast.step import (
    Components,
    Gains,
    Reading,
    ScalarModel,
    Statistics,
    Transition,
    affine_transition,
    corrected,
)
from jgait.filtering.inputs import Inputs
from jgait.filtering.methods import EKF, KF

SEGMENTED_FROM = 256
"""Least number of samples of a recording that is scanned in segments; shorter recordings have one segment."""

Carry = tuple[tuple[Any, ...], tuple[Any, ...]]
"""A belief as the carry of a scan: mean, and upper triangle of the covariance."""


def refused(given: Inputs, method: Any, covariances: bool) -> str:
    """The reason why components cannot compute it; empty if they can."""
    needs = {
        f"the method {method!r}": not (isinstance(method, KF | EKF) and method.iterations == 1),
        "states on a manifold": given.shape.curved,
        "smoothed covariances": covariances,
    }
    wrong = " and ".join(what for what, needed in needs.items() if needed)
    return wrong and (
        "execution='fast' has filters and smoothed means by KF() and EKF() on states that are no manifold; "
        f"this call has {wrong}, and needs 'core'"
    )


def solve(given: Inputs, fields: tuple[str, ...], smooth: bool) -> dict[str, Any]:
    """Fields of `Posterior` by name, and the smoothed means: arrays (T, size), (T, n, n) or (T,)."""
    if not smooth:
        return whole(given, segmented(forward(given, fields), first_carry(given), series(given)))
    form = Form([])
    every = tuple(dict.fromkeys((*fields, "mean", "cov")))
    kept = segmented(forward(given, every, form), first_carry(given), series(given))
    smoothed = backward(given, kept["mean"], kept["cov"], kept.pop(FORM), form)
    return whole(given, {name: kept[name] for name in fields} | {"smoothed_mean": smoothed})


def whole(given: Inputs, kept: dict[str, Any]) -> dict[str, Any]:
    """Fields of components as arrays."""
    size = given.shape.error.size
    found = {}
    for name, values in kept.items():
        if name in ("cov", "predicted_cov"):
            rows = [jnp.stack(row, axis=-1) for row in from_upper(values, size)]
            found[name] = jnp.stack(rows, axis=-2)
        else:
            found[name] = jnp.stack(values, axis=-1) if isinstance(values, tuple) else values
    return found


class Advanced(NamedTuple):
    """One predict and update; `gains`, `after` and `statistics` as in `corrected`."""

    transition: Transition
    predicted: Components
    gains: Gains
    after: Components
    statistics: Statistics


def advanced(given: Inputs, before: Components, sample: Reading) -> Advanced:
    """Predict, then update, over components."""
    model = ScalarModel(given.shape, given.params)
    transition = affine_transition(model, before, sample)
    prior = Components(transition.mean, added(congruence(transition.matrix, before.cov), transition.noise))
    after, gains, statistics = corrected(model, prior, sample)
    statistics = statistics._replace(health=plus(statistics.health, transition.health))
    return Advanced(transition, prior, gains, after, statistics)


FORM = "linear"
"""The name of what the smoother needs among the outputs of the scan."""


class Form:
    """A tuple of matrices whose unknown entries are the outputs of a scan; the known ones are kept here."""

    def __init__(self, leaves: list[Any]) -> None:
        self.leaves, self.structure = leaves, None

    def unknown(self, tree: Any, dtype: DTypeLike) -> tuple[Any, ...]:
        """The unknown entries, as outputs."""
        leaves, self.structure = jax.tree.flatten(tree)
        self.leaves = [leaf if known(leaf) else None for leaf in leaves]
        return arrays([leaf for leaf in leaves if not known(leaf)], dtype)

    def tree(self, unknown: Any) -> Any:
        """The matrices of one sample."""
        rest = iter(unknown)
        return jax.tree.unflatten(self.structure, [next(rest) if leaf is None else leaf for leaf in self.leaves])


def forward(given: Inputs, keep: tuple[str, ...], form: Form | None = None) -> Callable[[Carry, Any], Any]:
    """The body of the filter's scan: belief before, leaves of the sample → belief after, and the fields `keep`."""
    dtype = given.shape.dtype

    def body(carry: Carry, leaves: Any) -> tuple[Carry, dict[str, Any]]:
        step = advanced(given, opened(carry, given), sample_of(leaves, given))
        outputs = {name: field(step, name, dtype) for name in keep}
        if form is not None:
            g = step.gains
            gain, z = product(transposed(g.white_cross), g.inverse), [dot(c, g.white) for c in transposed(g.inverse)]
            outputs[FORM] = form.unknown((step.transition.matrix, g.matrix, gain, z), dtype)
        return carried(step.after, dtype), outputs

    return body


def backward(given: Inputs, means: Any, covs: Any, unknown: Any, form: Form) -> tuple[Any, ...]:
    """The smoothed means, x − P λ with λ ← Aᵀ (λ − Hᵀ (z + Kᵀ λ)), from the last sample to the first."""
    size, dtype = given.shape.error.size, given.shape.dtype

    def body(lam: tuple[Any, ...], sample: Any) -> tuple[tuple[Any, ...], Any]:
        mean, cov, entries = sample
        A, H, K, z = form.tree(entries)
        move = [dot(row, lam) for row in from_upper(cov, size)]
        fine = jnp.isfinite(total(move))
        smoothed = arrays([x - jnp.where(fine, d, 0.0) for x, d in zip(mean, move, strict=True)], dtype)
        seen: Matrix = [[plus(a, dot(k, lam))] for a, k in zip(z, transposed(K), strict=True)]
        rest = [minus(a, row[0]) for a, row in zip(lam, product(transposed(H), seen), strict=True)]
        return arrays([dot(column, rest) for column in transposed(A)], dtype), smoothed

    start = (jnp.zeros((), dtype),) * size
    return segmented(body, start, (means, covs, unknown), reverse=True)


def field(step: Advanced, name: str, dtype: DTypeLike) -> Any:
    """One field of `Posterior` at one sample, as arrays."""
    statistics = step.statistics
    match name:
        case "mean" | "predicted_mean":
            return arrays((step.after if name == "mean" else step.predicted).mean, dtype)
        case "cov" | "predicted_cov":
            return arrays(upper((step.after if name == "cov" else step.predicted).cov), dtype)
        case "innovation":
            return arrays(statistics.innovation, dtype)
        case "innovation_stddev":
            return arrays(statistics.stddev, dtype)
        case "valid":
            return jnp.asarray(sound(statistics.health))
        case _:
            return jnp.asarray(getattr(statistics, name), dtype)


def segmented(body: Callable[[Any, Any], Any], start: Any, leaves: Any, reverse: bool = False) -> Any:
    """The outputs of `lax.scan`, in checkpointed segments; `body` has the leaves of one sample as input.

    If the segment length does not divide T, the samples that are left over are a segment of their own.
    """
    length = len(jax.tree.leaves(leaves)[0])
    size = length if length < SEGMENTED_FROM else math.isqrt(length)
    body = jax.checkpoint(body, prevent_cse=False)

    @jax.checkpoint
    def segment(carry: Any, part: Any) -> Any:
        return lax.scan(body, carry, part, reverse=reverse)

    if size == length:
        return segment(start, leaves)[1]
    end = length // size * size

    def segments(carry: Any) -> Any:
        folded = jax.tree.map(lambda leaf: leaf[:end].reshape(-1, size, *leaf.shape[1:]), leaves)
        carry, outputs = lax.scan(segment, carry, folded, reverse=reverse)
        return carry, jax.tree.map(lambda leaf: leaf.reshape(end, *leaf.shape[2:]), outputs)

    def rest(carry: Any) -> Any:
        return segment(carry, jax.tree.map(lambda leaf: leaf[end:], leaves))

    if reverse:
        carry, last = rest(start)
        first = segments(carry)[1]
    else:
        carry, first = segments(start)
        last = rest(carry)[1]
    return jax.tree.map(lambda a, b: jnp.concatenate([a, b]), first, last)


def series(given: Inputs) -> Any:
    """The inputs of a scan: arrays (T,) only; see `sample_of`."""
    seen = [leaf for leaf in given.seen if not isinstance(leaf, bool)]
    return given.measured, list(given.controls), given.dt if jnp.ndim(given.dt) else None, seen


def sample_of(leaves: Any, given: Inputs) -> Reading:
    """One sample from the leaves of `series`."""
    measured, control, dt, observed = leaves
    rest = iter(observed)
    flags = [leaf if isinstance(leaf, bool) else next(rest) for leaf in given.seen]
    return Reading(measured, given.shape.control.tuple(control), given.dt if dt is None else dt, flags)


def carried(moments: Components, dtype: DTypeLike) -> Carry:
    """A belief as arrays of the dtype."""
    return arrays(moments.mean, dtype), arrays(upper(moments.cov), dtype)


def first_carry(given: Inputs) -> Carry:
    """The belief before the first sample."""
    cov = ScalarModel(given.shape, given.params).matrix(given.cov, range(given.shape.error.size))
    return carried(Components(list(given.mean), cov), given.shape.dtype)


def opened(carry: Carry, given: Inputs) -> Components:
    """Inverse of `carried`."""
    return Components(list(carry[0]), from_upper(carry[1], given.shape.error.size))


def arrays(values: list[Any], dtype: DTypeLike) -> tuple[Any, ...]:
    """Scalars (Python floats or arrays) as arrays of the dtype."""
    return tuple(jnp.asarray(value, dtype) for value in values)
