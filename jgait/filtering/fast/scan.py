r"""The filter over components as one scan of predict and update, and the smoother of means as one back.

The scan runs in segments of about √T samples, each under `jax.checkpoint`: a gradient in reverse mode stores the belief
at the start of each segment, and computes a segment again when the backward pass reaches it. Memory grows with √T,
and the stored values of one segment fit the processor's cache.

Barriers keep XLA from repeating operations in each loop that uses their results. The field `health` is a float that
is finite if all numbers are finite: a comparison costs almost nothing, while stored bools would split XLA's vector
loops.
"""

import math
from collections.abc import Callable, Iterable, Sequence, Set
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jax.typing import DTypeLike
from jaxtyping import Array

from jgait.filtering.covariance import Entries, Scalar
from jgait.filtering.fast.components import (
    Expansion,
    Flag,
    Matrix,
    barred,
    congruence,
    dot,
    from_upper,
    identity,
    known,
    minus,
    parted,
    plus,
    product,
    sound,
    symmetric,
    times,
    total,
    transposed,
    unknown,
    upper,
    where,
)
from jgait.filtering.inputs import Inputs
from jgait.filtering.linear import Leaves, Shape
from jgait.filtering.methods import EKF, KF, Method

SEGMENTED_FROM = 256
"""Least number of samples of a recording that is scanned in segments; shorter recordings have one segment."""

Carry = tuple[list[Scalar], list[Scalar]]
"""A belief as the carry of a scan: arrays of the mean, and of the upper triangle of the covariance."""


def refused(given: Inputs, method: Method, covariances: bool) -> str:
    """The reason why components cannot compute it; empty if they can."""
    needs = {
        f"the method {method!r}": not (isinstance(method, KF | EKF) and method.iterations == 1),
        "states on a manifold": given.shape.curved,
        "a residual of its own": given.shape.model.residual is not None,
        "smoothed covariances": covariances,
    }
    wrong = " and ".join(what for what, needed in needs.items() if needed)
    return wrong and (
        "execution='fast' has filters and smoothed means by KF() and EKF() on flat states without a residual; "
        f"this call has {wrong}, and needs 'core'"
    )


def solve(given: Inputs, fields: tuple[str, ...], smooth: bool) -> dict[str, Array]:
    """Fields of `Posterior` by name, and the smoothed means: arrays (T, size), (T, n, n) or (T,)."""
    kept, linear, matrices = forward(given, (*fields, "mean", "cov") if smooth else fields, smooth)
    field_values = {name: kept[name] for name in fields}
    if smooth:
        field_values["smoothed_mean"] = backward(given, kept["mean"], kept["cov"], linear, matrices)
    return {name: _stacked(name, values, given.shape.error.size) for name, values in field_values.items()}


def _stacked(name: str, values: Any, size: int) -> Array:
    """A field of components as an array."""
    if name == "cov":
        return jnp.stack([jnp.stack(row, axis=-1) for row in from_upper(values, size)], axis=-2)
    return jnp.stack(values, axis=-1) if isinstance(values, list) else values


def forward(
    given: Inputs, keep: tuple[str, ...], smooth: bool
) -> tuple[dict[str, Any], list[Array], Callable[[Iterable[Array]], Any]]:
    """The fields `keep`; and what the smoother needs: arrays, and the function from those of a sample to matrices."""
    shape = given.shape
    size, dtype = shape.error.size, shape.dtype
    series, at_sample = parted((given.measured, given.controls, given.dt, given.visible), jnp.ndim)
    matrices: list[Callable[[Iterable[Array]], Any]] = []

    def body(carry: Carry, leaves: list[Array]) -> tuple[Carry, tuple[dict[str, Any], list[Array]]]:
        measured, controls, dt, visible = at_sample(leaves)
        before = Components(carry[0], from_upper(carry[1], size))
        fields, A, g = advanced(shape, jax.tree.leaves(given.params), before, Reading(measured, controls, dt, visible))
        linear: list[Array] = []
        if smooth:
            gain, z = product(transposed(g.white_cross), g.inverse), [dot(c, g.white) for c in transposed(g.inverse)]
            linear, whole = parted((A, g.matrix, gain, z), unknown)
            matrices[:] = [whole]
        outputs = {name: arrays(fields[name], bool if name == "valid" else dtype) for name in keep}
        return arrays((fields["mean"], fields["cov"]), dtype), (outputs, arrays(linear, dtype))

    start = arrays((given.mean, triangle(given.cov.entries(), size, dtype)), dtype)
    kept, linear = segmented(body, start, series)
    return kept, linear, matrices[0] if smooth else tuple


def backward(
    given: Inputs,
    means: list[Array],
    covs: list[Array],
    linear: list[Array],
    matrices: Callable[[Iterable[Array]], Any],
) -> list[Array]:
    """The smoothed means, x − P λ with λ ← Aᵀ (λ − Hᵀ (z + Kᵀ λ)), from the last sample to the first."""
    size, dtype = given.shape.error.size, given.shape.dtype

    def body(lam: list[Scalar], sample: Any) -> tuple[list[Scalar], list[Scalar]]:
        mean, cov, entries = sample
        A, H, K, z = matrices(entries)
        move = [dot(row, lam) for row in from_upper(cov, size)]
        fine = jnp.isfinite(total(move))
        smoothed = [x - jnp.where(fine, d, 0.0) for x, d in zip(mean, move, strict=True)]
        correction = [plus(a, dot(k, lam)) for a, k in zip(z, transposed(K), strict=True)]
        rest = [minus(a, dot(h, correction)) for a, h in zip(lam, transposed(H), strict=True)]
        return arrays([dot(column, rest) for column in transposed(A)], dtype), arrays(smoothed, dtype)

    return segmented(body, [jnp.zeros((), dtype)] * size, (means, covs, linear), reverse=True)


def arrays[T](values: T, dtype: DTypeLike) -> T:
    """Scalars (Python floats or arrays), or a tree of them, as arrays of the dtype."""
    return jax.tree.map(lambda value: jnp.asarray(value, dtype), values)


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

    carry, outputs = start, []
    for part in (rest, segments) if reverse else (segments, rest):
        carry, output = part(carry)
        outputs.append(output)
    return jax.tree.map(lambda *parts: jnp.concatenate(parts), *(outputs[::-1] if reverse else outputs))


# --- predict and update ---


class Components(NamedTuple):
    """Mean (k scalars), and covariance of the error about the mean (n × n scalars)."""

    mean: list[Scalar]
    cov: Matrix


class Reading(NamedTuple):
    """One sample."""

    measured: list[Scalar]  #: observation (m scalars).
    control: list[Array]  #: components of the control.
    dt: Scalar  #: interval [s].
    visible: list[Flag]  #: which components are measured (m bools; True without a mask).


class Gains(NamedTuple):
    """The terms of an update, whitened by the innovation's factor L, S = L Lᵀ; zero where masked or not finite."""

    matrix: Matrix  #: H without the mask (m × n).
    noise: Matrix  #: R (m × m).
    cross: Matrix  #: H P⁻ without the mask (m × n).
    inverse: Matrix  #: L⁻¹, lower triangle.
    white_cross: Matrix  #: L⁻¹ H P⁻ (m × n).
    white: list[Scalar]  #: L⁻¹ (y − ŷ) (m).
    innovation: list[Scalar]  #: y − ŷ (m), 0 where masked.
    spread: Matrix  #: S (m × m), 1 on the diagonal where masked.
    log_det: Scalar  #: logarithm of the determinant of S.
    health: Scalar  #: finite where all numbers are and S could be factored; elsewhere the belief is left unchanged.


def triangle(entries: Entries, size: int, dtype: DTypeLike) -> list[Scalar]:
    """The upper triangle of a noise matrix; numbers are known."""
    values = (entries.get((i, j), 0.0) for i in range(size) for j in range(i, size))
    return [float(v) if isinstance(v, int | float) else jnp.asarray(v, dtype) for v in values]


def advanced(shape: Shape, params: Leaves, before: Components, sample: Reading) -> tuple[dict[str, Any], Matrix, Gains]:
    """Predict, then update: fields of `Posterior` (covariances as upper triangles), A, and the terms of the update."""
    prior, matrix, health = predicted(shape, params, before, sample)
    g = gains(shape, params, prior, sample)
    moves = [dot(column, g.white) for column in transposed(g.white_cross)]
    good, nis, count = sound(g.health), dot(g.white, g.white), total(where(s, 1.0, 0.0) for s in sample.visible)
    statistics = {
        "innovation": g.innovation,
        "innovation_stddev": [lax.sqrt(row[a]) for a, row in enumerate(g.spread)],
        "log_likelihood": -0.5 * (nis + g.log_det + count * math.log(2.0 * math.pi)),
        "nis": nis,
        "count": count,
    }
    fields = {
        "mean": [plus(a, d) for a, d in zip(prior.mean, moves, strict=True)],
        "cov": upper(_joseph(prior.cov, g)),
        "valid": sound(plus(g.health, health)),
        **jax.tree.map(lambda value: where(good, value, 0.0), statistics),
    }
    return fields, matrix, g


def predicted(shape: Shape, params: Leaves, before: Components, sample: Reading) -> tuple[Components, Matrix, Scalar]:
    """The prediction, A, and a float that is finite where the transition was.

    The transition is linearised at the mean; where it is not finite, the identity without noise replaces it.
    """
    x, size = before.mean, len(before.cov)
    control, dt = sample.control, sample.dt
    trace = Expansion(shape.dtype)
    moved, slopes = trace.jacobian(lambda x: shape.transition(params, (control, dt), x), x)
    entries = trace.call(lambda x: triangle(shape.transition_noise(params, (control, dt), x), size, shape.dtype), x)
    safe = {id(value) for value in (*x, dt)}
    health = barred(plus(_summary((*moved, *(e for row in slopes for e in row)), safe), _summary(entries)))
    good = sound(health)
    pairs = zip(slopes, identity(size), strict=True)
    matrix = barred([[where(good, a, b) for a, b in zip(row, unit, strict=True)] for row, unit in pairs])
    mean = [where(good, a, b) for a, b in zip(moved, x, strict=True)]
    noise = from_upper([where(good, e, 0.0) for e in entries], size)
    spread = congruence(matrix, before.cov)
    return Components(mean, symmetric(size, lambda i, j: plus(spread[i][j], noise[i][j]))), matrix, health


def _summary(values: Sequence[Scalar], safe: Set[int] = frozenset()) -> Scalar:
    """The sum of all distinct unknown values: finite if all are finite; a sum that overflows counts as a failure."""
    return total({id(value): value for value in values if not known(value) and id(value) not in safe}.values())


def gains(shape: Shape, params: Leaves, prior: Components, sample: Reading) -> Gains:
    """Linearise the observation at the prediction, and factor the innovation's covariance."""
    visible, count = sample.visible, len(sample.measured)
    trace = Expansion(shape.dtype)
    expected, matrix = trace.jacobian(lambda x: shape.observation(params, sample.control, x), prior.mean)
    innovation = [minus(y, e) for y, e in zip(sample.measured, expected, strict=True)]
    entries = trace.call(
        lambda x: triangle(shape.observation_noise(params, sample.control, x), count, shape.dtype),
        prior.mean,
    )
    # What is not seen tells nothing, even where it is not finite.
    matrix = [[e if known(e) else where(s, e, 0.0) for e in row] for s, row in zip(visible, matrix, strict=True)]
    both = symmetric(count, lambda a, b: visible[a] if a == b else visible[a] & visible[b])
    noise, unit = from_upper(entries, count), identity(count)
    shown = symmetric(count, lambda a, b: where(both[a][b], noise[a][b], unit[a][b]))
    curved = [where(s, e, 0.0) for s, e, row in zip(visible, expected, matrix, strict=True) if not all(map(known, row))]
    summary = barred(_summary((*curved, *(e for row in matrix for e in row), *upper(shown))))
    usable = sound(summary)
    matrix = [[e if known(e) else where(usable, e, 0.0) for e in row] for row in matrix]
    noise = symmetric(count, lambda a, b: where(usable, shown[a][b], unit[a][b]))
    innovation = [where(s, e, 0.0) for s, e in zip(visible, innovation, strict=True)]
    cross = barred(product(matrix, prior.cov))

    def spread_entry(a: int, b: int) -> Scalar:
        return where(both[a][b], plus(dot(cross[a], matrix[b]), noise[a][b]), unit[a][b])

    innovation, spread = barred((innovation, symmetric(count, spread_entry)))
    inverse, log_det, health = inverse_factor(spread, plus(summary, total(innovation)))
    inverse, error = barred((inverse, [where(sound(e), e, 0.0) for e in innovation]))
    white_cross, white = barred((product(inverse, _masked(visible, cross)), [dot(row, error) for row in inverse]))
    return Gains(matrix, noise, cross, inverse, white_cross, white, innovation, spread, log_det, health)


def _masked(visible: list[Flag], rows: Matrix) -> Matrix:
    """Rows that are zero where they are not seen."""
    return [[where(s, e, 0.0) for e in row] for s, row in zip(visible, rows, strict=True)]


def inverse_factor(spread: Matrix, summary: Scalar) -> tuple[Matrix, Scalar, Scalar]:
    """L⁻¹ for spread = L Lᵀ, the logarithm of its determinant, and a float that is finite if the factor exists.

    If the factor does not exist, L⁻¹ is zero. A pivot that is not positive is replaced before its square root is
    computed, so that gradients stay finite.
    """
    size = len(spread)
    health = plus(summary, total(spread[j][j] for j in range(size)))
    lower: Matrix = [[0.0] * size for _ in range(size)]  # L below its diagonal
    roots: list[Scalar] = []  # reciprocals of the diagonal
    for j in range(size):
        pivot = minus(spread[j][j], dot(lower[j][:j], lower[j][:j]))
        roots.append(lax.rsqrt(jnp.where(pivot > 0.0, pivot, 1.0)))
        health = jnp.where(pivot > 0.0, health, jnp.inf)
        for i in range(j + 1, size):
            lower[i][j] = times(minus(spread[i][j], dot(lower[i][:j], lower[j][:j])), roots[j])
        if j % 2 == 1 and j + 1 < size:
            lower, roots = barred((lower, roots))
    log_det = -2.0 * total(jnp.log(value) for value in roots)
    good = sound(health)
    inverse: Matrix = [[0.0] * size for _ in range(size)]
    for j in range(size):
        inverse[j][j] = where(good, roots[j], 0.0)
        for i in range(j + 1, size):
            inner = total(times(lower[i][k], inverse[k][j]) for k in range(j, i))
            inverse[i][j] = times(-roots[i], inner)
    return inverse, log_det, health


def _joseph(cov: Matrix, g: Gains) -> Matrix:
    """(I − K H) P (I − K H)ᵀ + K R Kᵀ."""
    gain = barred(product(transposed(g.white_cross), g.inverse))
    pairs = zip(identity(len(cov)), product(gain, g.matrix), strict=True)
    left = barred([[minus(a, e) for a, e in zip(unit, row, strict=True)] for unit, row in pairs])
    half = barred(product(left, cov))
    noisy = product(gain, g.noise)
    return symmetric(len(cov), lambda i, j: plus(dot(half[i], left[j]), dot(noisy[i], gain[j])))
