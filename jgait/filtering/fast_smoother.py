r"""Rauch–Tung–Striebel smoothing over components; see `smoother` for the equations.

The smoother runs in segments: the filter stores the belief at the start of each segment, and runs again in each.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import PyTree

from jgait.filtering.components import (
    added,
    barred,
    congruence,
    dot,
    minus,
    plus,
    product,
    sound,
    symmetric,
    total,
    transposed,
    upper,
    where,
)
from jgait.filtering.fast import (
    SEGMENTED_FROM,
    Carry,
    Noises,
    advanced,
    carried,
    constant_noises,
    field,
    filled,
    opened,
    sample_of,
    segment_length,
    series,
)
from jgait.filtering.inputs import Inputs
from jgait.filtering.inverse_factor import generalised_inverse_factor
from jgait.filtering.methods import EKF, KF
from jgait.filtering.sharing import shared
from jgait.filtering.structured import Components, Sample, affine_transition, turn
from jgait.filtering.tracing import Expansion


def rts(given: Inputs, method: KF | EKF, keep: tuple[str, ...]) -> tuple[PyTree, PyTree, dict[str, PyTree]]:
    """Smoothed means and covariances, and the filter's fields by name."""
    noises = constant_noises(given)

    def ahead(before: Carry, leaves: PyTree, real: PyTree) -> tuple[Carry, PyTree]:
        step = advanced(given, noises, opened(before, given), sample_of(leaves, given), method)
        return carried(step.after, given.dtype), (before, leaves, real)

    def back(carry: Carry, item: PyTree) -> tuple[Carry, Carry]:
        before, leaves, real = item
        sample, filtered = sample_of(leaves, given), opened(before, given)
        smoothed = smoothed_moments(given, noises, filtered, opened(carry, given), sample)
        moved = jax.tree.map(lambda a, b: jnp.where(real, a, b), carried(smoothed, given.dtype), before)
        return moved, carry

    (mean, cov), kept = there_and_back(given, noises, method, keep, None, shared(ahead), shared(back))
    return list(mean), list(cov), kept


def smoothed_moments(
    given: Inputs, noises: Noises, filtered: Components, following: Components, sample: Sample
) -> Components:
    """The smoothed belief at one sample, from its filtered belief and the smoothed belief at the next, `sample`."""
    cm, (x, cov), size = given.cm, filtered, len(given.cov)
    transition = affine_transition(cm, filtered, sample, noises.transition)
    trace = Expansion(given.dtype)
    step, ahead = trace.call(cm.local, transition.mean, following.mean), following.cov
    if cm.curved:
        back = trace.jacobian(lambda d: cm.local(transition.mean, cm.retract(following.mean, d)), [0.0] * size)[1]
        ahead = congruence(barred(back)[0], ahead)
    matrix = barred(transition.matrix)[0]
    cross = barred(product(matrix, cov))[0]
    prior = symmetric(size, lambda i, j: plus(dot(cross[i], matrix[j]), transition.noise[i][j]))
    inverse = barred(generalised_inverse_factor(barred(prior)[0], float(jnp.finfo(given.dtype).eps)))[0]
    gain = barred(product(transposed(barred(product(inverse, cross))[0]), inverse))[0]
    delta = [dot(row, step) for row in gain]
    left = [
        [minus(1.0 if i == j else 0.0, e) for j, e in enumerate(row)] for i, row in enumerate(product(gain, matrix))
    ]
    left = barred(left)[0]
    kept = barred(product(left, cov))[0]
    added_noise = barred(product(gain, barred(added(ahead, transition.noise))[0]))[0]
    smoothed = symmetric(size, lambda i, j: plus(dot(kept[i], left[j]), dot(added_noise[i], gain[j])))
    good = sound(barred(plus(total(delta), total(upper(smoothed))))[0])
    delta = [where(good, d, 0.0) for d in delta]
    smoothed = symmetric(size, lambda i, j: where(good, smoothed[i][j], cov[i][j]))
    if not cm.curved:
        return Components([plus(a, d) for a, d in zip(x, delta, strict=True)], smoothed)
    mean = barred(trace.call(cm.retract, x, delta))[0]
    return Components(mean, congruence(barred(turn(cm, trace, x, delta, mean))[0], smoothed))


def there_and_back(
    given: Inputs, noises: Noises, method: KF | EKF, keep: tuple[str, ...], start: PyTree,
    ahead: Callable[..., PyTree], back: Callable[..., PyTree],
) -> tuple[PyTree, dict[str, PyTree]]:  # fmt: skip
    """Scan forward and store the belief before each segment; then backward, with each segment forward once more.

    Args:
        given: model and recording.
        noises: the model's noises that are the same at every sample.
        method: how to linearise.
        keep: the filter's fields to return.
        start: carry of the backward pass at the last sample; None: the last filtered belief.
        ahead: (belief before, leaves of the sample, False if the sample is padding) → belief after, and the quantities
            that `back` needs.
        back: (carry, those quantities) → carry, output.
    """
    length = given.length
    size = length if length < SEGMENTED_FROM else segment_length(length)
    count = -(-length // size)
    real = jnp.arange(count * size) < length
    folded = jax.tree.map(lambda leaf: filled(leaf, count * size).reshape(count, size), (series(given), real))

    def forward(carry: PyTree, leaves: PyTree) -> tuple[PyTree, PyTree]:
        step = advanced(given, noises, opened(carry, given), sample_of(leaves, given), method)
        return carried(step.after, given.dtype), {name: field(step, name, given.dtype) for name in keep}

    forward = jax.checkpoint(shared(forward), prevent_cse=False)
    again = jax.checkpoint(lambda carry, item: ahead(carry, *item), prevent_cse=False)
    inner = jax.checkpoint(back, prevent_cse=False)

    @jax.checkpoint
    def there(carry: PyTree, part: PyTree) -> tuple[PyTree, PyTree]:
        after, kept = lax.scan(forward, carry, part[0])
        return after, (carry, kept)

    @jax.checkpoint
    def behind(carry: PyTree, part: PyTree) -> tuple[PyTree, PyTree]:
        first, (leaves, real) = part
        items = leaves, _sorted(real)
        stored = lax.scan(again, first, items)[1]
        return lax.scan(inner, carry, stored, reverse=True)

    last, (starts, kept) = lax.scan(there, carried(Components(given.mean, given.cov), given.dtype), folded)
    _, outputs = lax.scan(behind, last if start is None else start, (starts, folded), reverse=True)
    outputs, kept = jax.tree.map(lambda leaf: leaf.reshape(count * size)[:length], (outputs, kept))
    return outputs, {name: list(values) if isinstance(values, tuple) else values for name, values in kept.items()}


def _sorted(real: PyTree) -> PyTree:
    """The flags of a segment, already sorted (True first): the sort changes only the program that XLA compiles.

    With the sort, XLA does not compile a loop and its inner loops as one function: the mapped smoother of 15 states
    then compiled in 74 s of processor time instead of 90.
    """
    return lax.sort((~real).astype(jnp.int32)) == 0
