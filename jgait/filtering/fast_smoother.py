r"""Smoothing over components, in segments: the filter stores the belief at the start of each, and is run again there.

With covariances, Rauch–Tung–Striebel as in `smoother`. Where means are enough, the modified Bryson–Frazier form,
which needs no inverse of P⁻: backwards over the samples, with the whitened gains W = L⁻¹ H P⁻ and v = L⁻¹ (y − ŷ),

    λ⁻ = λ⁺ − Hᵀ L⁻ᵀ (W λ⁺ + v),   m_s = m⁻ − P⁻ λ⁻,   λ⁺ of the sample before = Aᵀ λ⁻,   λ⁺ = 0 at the end.

Source: G. Bierman, "Fixed interval smoothing with discrete measurements", Int. J. Control 18(1), 1973.
"""

from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

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
    arrays,
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
from jgait.filtering.linearise import EKF, KF
from jgait.filtering.structured import Components, Sample, affine_transition, turn
from jgait.filtering.tracing import Expansion


def bryson_frazier(given: Inputs, method: KF | EKF, keep: tuple[str, ...]) -> tuple[Any, None, dict[str, Any]]:
    """Smoothed means, without covariances, and the filter's fields by name."""
    noises = constant_noises(given)
    size = len(given.cov)

    def back(adjoint: Any, before: Any, leaves: Any, real: Any) -> tuple[Any, Any]:
        step = advanced(given, noises, opened(before, given), sample_of(leaves, given), method)
        g, after = step.gains, list(adjoint)
        told = [plus(dot(row, after), v) for row, v in zip(g.white_cross, g.white, strict=True)]
        told = [where(real, value, 0.0) for value in told]
        weights = barred([dot(column, told) for column in zip(*g.inverse, strict=True)])[0]
        adjoint = barred(
            [minus(a, dot(column, weights)) for a, column in zip(after, zip(*g.matrix, strict=True), strict=True)]
        )[0]
        mean = [minus(m, dot(row, adjoint)) for m, row in zip(step.predicted.mean, step.predicted.cov, strict=True)]
        for matrix in reversed(step.transition.steps):
            adjoint = [dot(column, adjoint) for column in zip(*matrix, strict=True)]
        return arrays(adjoint, given.dtype), arrays(mean, given.dtype)

    start = tuple(jnp.zeros((), given.dtype) for _ in range(size))
    mean, kept = _there_and_back(given, noises, method, keep, start, back)
    return list(mean), None, kept


def rts(given: Inputs, method: KF | EKF, keep: tuple[str, ...]) -> tuple[Any, Any, dict[str, Any]]:
    """Smoothed means and covariances, and the filter's fields by name."""
    noises = constant_noises(given)

    def back(carry: Carry, before: Carry, leaves: Any, real: Any) -> tuple[Carry, Carry]:
        sample, filtered = sample_of(leaves, given), opened(before, given)
        smoothed = smoothed_moments(given, noises, filtered, opened(carry, given), sample)
        moved = jax.tree.map(lambda a, b: jnp.where(real, a, b), carried(smoothed, given.dtype), before)
        return moved, carry

    (mean, cov), kept = _there_and_back(given, noises, method, keep, None, back)
    return list(mean), list(cov), kept


def smoothed_moments(
    given: Inputs, noises: Noises, filtered: Components, following: Components, sample: Sample
) -> Components:
    """The smoothed belief at one sample, from its filtered one and the smoothed one at `sample`, the next."""
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


def _there_and_back(
    given: Inputs, noises: Noises, method: KF | EKF, keep: tuple[str, ...], start: Any, back: Any
) -> tuple[Any, dict[str, Any]]:
    """Scan forward in segments and keep the belief before each; then backward, each segment forward once more.

    `back(carry, before, leaves, real)` gets the belief before a sample, the sample, and whether it is one at all
    (not filled in), and returns its carry and output.
    """
    length = given.length
    size = length if length < SEGMENTED_FROM else segment_length(length)
    count = -(-length // size)
    real = jnp.arange(count * size) < length
    folded = jax.tree.map(lambda leaf: filled(leaf, count * size).reshape(count, size), (series(given), real))

    def forward(carry: Any, leaves: Any) -> tuple[Any, Any]:
        step = advanced(given, noises, opened(carry, given), sample_of(leaves, given), method)
        return carried(step.after, given.dtype), (carry, {name: field(step, name, given.dtype) for name in keep})

    forward = jax.checkpoint(forward, prevent_cse=False)

    @jax.checkpoint
    def ahead(carry: Any, part: Any) -> tuple[Any, Any]:
        after, (_, kept) = lax.scan(forward, carry, part[0])
        return after, (carry, kept)

    @jax.checkpoint
    def behind(carry: Any, part: Any) -> tuple[Any, Any]:
        first, (leaves, flags) = part
        befores = lax.scan(lambda c, leaf: (lambda s: (s[0], c))(forward(c, leaf)), first, leaves)[1]
        inner = jax.checkpoint(lambda c, item: back(c, *item), prevent_cse=False)
        return lax.scan(inner, carry, (befores, leaves, flags), reverse=True)

    last, (starts, kept) = lax.scan(ahead, carried(Components(given.mean, given.cov), given.dtype), folded)
    _, outputs = lax.scan(behind, last if start is None else start, (starts, folded), reverse=True)
    outputs, kept = jax.tree.map(lambda leaf: leaf.reshape(count * size)[:length], (outputs, kept))
    return outputs, {name: list(values) if isinstance(values, tuple) else values for name, values in kept.items()}
