r"""The filter over components as one scan; under `jax.vmap` every component is an array over the recordings.

For derivatives, the scan runs in segments of about √T samples, each under `jax.checkpoint`: a gradient in reverse
mode stores the belief at the start of each segment, and computes a segment again when the backward pass reaches the
segment. Memory grows with √T, and the stored values of one segment fit the processor's cache.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jax.custom_derivatives import SymbolicZero
from jax.typing import DTypeLike
from jaxtyping import PyTree

from jgait.filtering.batched_call import replaced
from jgait.filtering.components import Matrix, added, congruence, from_upper, known, plus, sound, total, upper
from jgait.filtering.covariance_update import Gains
from jgait.filtering.inputs import Inputs
from jgait.filtering.methods import KF, Method, depends_on_place, reached
from jgait.filtering.padding import folded, unfolded
from jgait.filtering.sharing import shared
from jgait.filtering.structured import (
    Components,
    Noise,
    Sample,
    Statistics,
    Transition,
    affine_transition,
    corrected,
)

SEGMENTED_FROM = 256
"""Least number of samples of a recording that is scanned in segments; shorter recordings have one segment."""

Carry = tuple[tuple[PyTree, ...], tuple[PyTree, ...]]
"""A belief as the carry of a scan: mean, and upper triangle of the covariance."""


class Noises(NamedTuple):
    """The noise covariances that are the same at every sample, else None."""

    transition: Noise | None
    observation: Noise | None


class Advanced(NamedTuple):
    """One predict and update; `gains`, `after` and `statistics` as in `structured.corrected`."""

    transition: Transition
    predicted: Components
    gains: Gains
    after: Components
    statistics: Statistics


def check_linear(given: Inputs, method: Method) -> None:
    """Raise if the method is `KF` and the model is nonlinear.

    Raises:
        ValueError: if a Jacobian depends on the state; the message names the function.
    """
    if not isinstance(method, KF):
        return
    control, dt = _first(given)
    functions = {
        "transition": lambda x: jnp.stack(given.cm.transition(list(x), control, dt)),
        "observation": lambda x: jnp.stack(given.cm.observation(list(x), control)),
    }
    for name, function in functions.items():
        if depends_on_place(function, jnp.zeros(len(given.mean), given.dtype)):
            raise ValueError(
                f"the KF needs a linear model, but the Jacobian of {given.cm.names[name]} depends on the state; use "
                "EKF(), UKF() or CKF()"
            )


def advanced(given: Inputs, noises: Noises, before: Components, sample: Sample) -> Advanced:
    """Predict, then update, over components."""
    transition = affine_transition(given.cm, before, sample, noises.transition)
    prior = Components(transition.mean, added(congruence(transition.matrix, before.cov), transition.noise))
    after, gains, statistics = corrected(given.cm, prior, sample, noises.observation)
    statistics = statistics._replace(health=plus(statistics.health, transition.health))
    return Advanced(transition, prior, gains, after, statistics)


def scanned(given: Inputs, keep: tuple[str, ...], *, segments: bool) -> dict[str, Any]:
    """The filter's scan: fields of `Posterior` by name, each a list of (T,) arrays, or one (T,) array.

    Args:
        given: model and recording.
        keep: fields to return.
        segments: scan in checkpointed segments, for gradients; a scan without segments is faster.
    """
    body, start, leaves = forward(given, constant_noises(given), keep), first_carry(given), series(given)
    kept = segmented(body, start, leaves, given.length) if segments else lax.scan(body, start, leaves)[1]
    # Under vmap a reshape keeps the recordings' axis in front; both functions of `with_gradient_of` need the same axis.
    return listed(jax.tree.map(lambda leaf: leaf.reshape(1, given.length).reshape(given.length), kept))


def forward(given: Inputs, noises: Noises, keep: tuple[str, ...]) -> Callable[[Carry, PyTree], PyTree]:
    """The body of the filter's scan: belief before, leaves of the sample → belief after, and the fields `keep`."""

    def body(carry: Carry, leaves: PyTree) -> tuple[Carry, dict[str, PyTree]]:
        step = advanced(given, noises, opened(carry, given), sample_of(leaves, given))
        return carried(step.after, given.dtype), {name: field(step, name, given.dtype) for name in keep}

    return shared(body)


def listed(kept: dict[str, PyTree]) -> dict[str, Any]:
    """Fields by name, their components in lists."""
    return {name: list(values) if isinstance(values, tuple) else values for name, values in kept.items()}


def field(step: Advanced, name: str, dtype: DTypeLike) -> PyTree:
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


def with_gradient_of(function: Callable[..., PyTree], twin: Callable[..., PyTree]) -> Callable[..., PyTree]:
    """`function`, with derivatives of any order and mode computed from an equal function.

    Args:
        function: function of positional pytrees that closes over no array.
        twin: an equal function that is suitable for differentiation.
    """
    result = jax.custom_jvp(function)

    def rule(primals: PyTree, tangents: PyTree) -> PyTree:
        leaves = jax.tree.leaves(primals)
        structure: PyTree = jax.tree.structure(primals)
        moves = structure.flatten_up_to(tangents)
        places = [i for i, move in enumerate(moves) if not isinstance(move, SymbolicZero)]

        def of_moving(*values: PyTree) -> PyTree:
            return twin(*structure.unflatten(replaced(leaves, places, values)))

        return jax.jvp(of_moving, tuple(leaves[i] for i in places), tuple(moves[i] for i in places))

    result.defjvp(rule, symbolic_zeros=True)
    return result


def segmented(body: Callable[[PyTree, PyTree], PyTree], start: PyTree, leaves: PyTree, length: int) -> PyTree:
    """The outputs of `lax.scan`, computed in checkpointed segments; `body` has the leaves of one sample as input.

    If the segment length does not divide T, the last segment is padded with copies of the last sample, whose outputs
    are dropped; the copies have no influence on other samples, because they come last.
    """
    body = jax.checkpoint(body, prevent_cse=False)
    if length < SEGMENTED_FROM:
        return lax.scan(body, start, leaves)[1]

    @jax.checkpoint
    def segment(carry: PyTree, part: PyTree) -> PyTree:
        return lax.scan(body, carry, part)

    return unfolded(lax.scan(segment, start, folded(leaves, segment_length(length)))[1], length)


def segment_length(length: int) -> int:
    """A divisor of the length near its square root, or the square root rounded up; all of it if it is short."""
    if length < SEGMENTED_FROM:
        return length
    root = math.isqrt(length)
    for candidate in sorted(range(max(1, root // 2), 2 * root), key=lambda size: abs(math.log(size / root))):
        if length % candidate == 0:
            return candidate
    return root + 1


def series(given: Inputs) -> PyTree:
    """The inputs of a scan: arrays (T,) only; see `sample_of`."""
    seen = [leaf for leaf in given.seen if not isinstance(leaf, bool)]
    return given.measured, given.controls, given.dt if jnp.ndim(given.dt) else None, seen


def sample_of(leaves: PyTree, given: Inputs) -> Sample:
    """One sample from the leaves of `series`."""
    measured, control, dt, observed = leaves
    rest = iter(observed)
    flags = [leaf if isinstance(leaf, bool) else next(rest) for leaf in given.seen]
    return Sample(measured, control, given.dt if dt is None else dt, flags)


def carried(moments: Components, dtype: DTypeLike) -> Carry:
    """A belief as arrays of the dtype."""
    return arrays(moments.mean, dtype), arrays(upper(moments.cov), dtype)


def first_carry(given: Inputs) -> Carry:
    """The belief before the first sample."""
    return carried(Components(given.mean, given.cov), given.dtype)


def opened(carry: Carry, given: Inputs) -> Components:
    """Inverse of `carried`."""
    return Components(list(carry[0]), from_upper(carry[1], len(given.cov)))


def arrays(values: list[PyTree], dtype: DTypeLike) -> tuple[PyTree, ...]:
    """Scalars (Python floats or arrays) as arrays of the dtype."""
    return tuple(jnp.asarray(value, dtype) for value in values)


def _first(given: Inputs) -> tuple[PyTree, PyTree]:
    return jax.tree.map(lambda leaf: leaf[0], given.controls), given.dt[0] if jnp.ndim(given.dt) else given.dt


def constant_noises(given: Inputs) -> Noises:
    """The noise covariances that depend neither on the state nor on the sample."""
    control, dt = _first(given)
    varying = [jnp.asarray(value, given.dtype) for value in given.mean], control
    cm = given.cm
    if jnp.ndim(given.dt):
        transition = _constant(lambda x, u, h: cm.transition_noise(x, u, h), (*varying, dt), given.dtype)
    else:
        transition = _constant(lambda x, u: cm.transition_noise(x, u, dt), varying, given.dtype)
    return Noises(transition, _constant(cm.observation_noise, varying, given.dtype))


def _constant(function: Callable[..., Matrix], arguments: PyTree, dtype: DTypeLike) -> Noise | None:
    """The function's result if it does not depend on the arguments, else None."""
    closed = jax.make_jaxpr(lambda *given: upper(function(*given)))(*arguments)
    if any(reached(closed.jaxpr, set(closed.jaxpr.invars))):
        return None
    matrix = function(*arguments)
    entries = [value if known(value) else jnp.asarray(value, dtype) for value in upper(matrix)]
    return Noise(from_upper(entries, len(matrix)), total(entry for entry in entries if not known(entry)))
