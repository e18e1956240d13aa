r"""Smoothing without an inverse of P⁻: a backward scan carries the information of the later samples.

With K = P⁻ Hᵀ S⁻¹, the filter's update m = m⁻ ⊕ K e, and λ⁺ = 0, Λ⁺ = 0 after the last sample,

    m_s = m ⊕ (−P λ⁺),                          P_s = P − P Λ⁺ P
    λ⁻ = (I − K H)ᵀ Tᵀ λ⁺ − Hᵀ S⁻¹ e,           Λ⁻ = (I − K H)ᵀ Tᵀ Λ⁺ T (I − K H) + Hᵀ S⁻¹ H
    λ⁺ of the sample before = Aᵀ λ⁻,            Λ⁺ = Aᵀ Λ⁻ A

T maps errors about the predicted state to errors about the updated state, T = 1 on flat states: on a manifold this
smoother has the filter's linearisation. Rauch, Tung and Striebel's form computes the difference of two states
instead, so the two smoothers differ by the square of the smoother's correction times the update's correction: for
attitudes of ε and δ rad by ε² δ / 12.

P − P Λ⁺ P is a difference: where smoothing makes a variance c times smaller, its relative rounding error is about c
times that of the filter's variance. `Pieces` of the forward pass are stored for one segment at a time.

Source: G. Bierman, "Fixed interval smoothing with discrete measurements", Int. J. Control 18(1), 1973.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jax.typing import DTypeLike
from jaxtyping import PyTree

from jgait.filtering.components import (
    Matrix,
    barred,
    congruence,
    dot,
    from_upper,
    identity,
    is_zero,
    known,
    minus,
    plus,
    product,
    sound,
    symmetric,
    times,
    total,
    transposed,
    upper,
    where,
)
from jgait.filtering.fast import (
    SEGMENTED_FROM,
    Advanced,
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
from jgait.filtering.methods import EKF, KF
from jgait.filtering.sharing import shared
from jgait.filtering.structured import Components, turn
from jgait.filtering.tracing import Expansion


class Pieces(NamedTuple):
    """The quantities of one sample that the backward pass needs.

    Attributes:
        after: the filtered belief.
        gain: K (n × m), zero where masked.
        matrix: H (m × n).
        precision: S⁻¹, zero where masked.
        pull: S⁻¹ e (m), zero where masked.
        turn: T, or None on flat states.
        steps: the transition's matrices.
    """

    after: Components
    gain: Matrix
    matrix: Matrix
    precision: Matrix
    pull: list[PyTree]
    turn: Matrix | None
    steps: list[Matrix]


class Parcel:
    """A tree of scalars as a tuple of arrays, without constants of the trace and without repeated objects."""

    def __init__(self, dtype: DTypeLike) -> None:
        """Take the arrays' float type; `packed` stores the tree's structure in `form`."""
        self.dtype = dtype
        self.form: PyTree = None

    def packed(self, tree: PyTree) -> tuple[PyTree, ...]:
        """The arrays of a tree."""
        leaves, structure = jax.tree.flatten(tree)
        places: dict[int, int] = {}
        contents: list[PyTree] = []
        for leaf in leaves:
            if not known(leaf) and id(leaf) not in places:
                places[id(leaf)] = len(contents)
                contents.append(leaf)
        self.form = structure, [leaf if known(leaf) else places[id(leaf)] for leaf in leaves]
        return arrays(contents, self.dtype)

    def opened(self, contents: Sequence[PyTree]) -> PyTree:
        """The tree of packed arrays, inverse of `packed`."""
        structure, places = self.form
        return structure.unflatten([place if known(place) else contents[place] for place in places])


def bryson_frazier(
    given: Inputs, method: KF | EKF, keep: tuple[str, ...], chosen: tuple[int, ...]
) -> tuple[PyTree, PyTree, dict[str, PyTree]]:
    """Smoothed means, covariances of the chosen error components, and the filter's fields by name.

    Args:
        given: model and recording.
        method: how the filter linearises.
        keep: the filter's fields to return.
        chosen: error components whose covariances are returned, in order; if empty, the covariances are None.
    """
    noises = constant_noises(given)
    size, dtype = len(given.cov), given.dtype
    parcel = Parcel(dtype)

    def ahead(carry: PyTree, leaves: PyTree, real: PyTree) -> tuple[PyTree, PyTree]:
        step = advanced(given, noises, opened(carry, given), sample_of(leaves, given), method)
        return carried(step.after, dtype), parcel.packed(pieces(step, real))

    def back(carry: PyTree, contents: PyTree) -> tuple[PyTree, PyTree]:
        vector, entries = list(carry[0]), from_upper(carry[1], size) if chosen else None
        piece = parcel.opened(contents)
        smoothed = _smoothed(given, piece.after, vector, entries, chosen)
        vector, entries = _before(piece, vector, entries)
        told = arrays(upper(entries), dtype) if entries is not None else ()
        return (arrays(vector, dtype), told), (arrays(smoothed[0], dtype), arrays(smoothed[1], dtype))

    zero = jnp.zeros((), dtype)
    start = (zero,) * size, (zero,) * (size * (size + 1) // 2 if chosen else 0)
    (mean, cov), kept = there_and_back(given, noises, method, keep, start, shared(ahead), shared(back))
    return list(mean), list(cov) if chosen else None, kept


def pieces(step: Advanced, real: PyTree) -> Pieces:
    """The pieces of a step; `real` is False where the sample is padding of the last segment."""
    g = step.gains
    columns = transposed(g.inverse)
    count = len(columns)

    def weight(a: int, b: int) -> PyTree:
        here = real & step.seen[a] & step.seen[b]
        return where(here, dot(columns[a], columns[b]), 0.0)

    pull = [where(real, dot(column, g.white), 0.0) for column in columns]
    return Pieces(
        step.after, product(transposed(g.white_cross), g.inverse), g.matrix, symmetric(count, weight), pull, step.turn,
        step.transition.steps,
    )  # fmt: skip


def _before(piece: Pieces, vector: list[PyTree], entries: Matrix | None) -> tuple[list[PyTree], Matrix | None]:
    """λ⁺ and Λ⁺ of the previous sample, from λ⁺ and Λ⁺ of this sample."""
    shown, gains = transposed(piece.matrix), transposed(piece.gain)
    if piece.turn is not None:
        vector = _transposed_times(piece.turn, vector)
    weights = [plus(dot(gain, vector), pull) for gain, pull in zip(gains, piece.pull, strict=True)]
    vector = [minus(a, dot(row, weights)) for a, row in zip(vector, shown, strict=True)]
    for step in reversed(piece.steps):
        vector = _transposed_times(step, vector)
    if entries is None:
        return vector, None
    if piece.turn is not None:
        entries = congruence(transposed(piece.turn), entries)
    left = [
        [minus(a, dot(row, h)) for a, h in zip(given, shown, strict=True)]
        for given, row in zip(entries, product(entries, piece.gain), strict=True)
    ]  # Λ (I − K H)
    pushed = [  # S⁻¹ H − Kᵀ Λ (I − K H)
        [minus(dot(row, h), dot(gain, column)) for h, column in zip(shown, transposed(left), strict=True)]
        for row, gain in zip(piece.precision, gains, strict=True)
    ]
    sides = transposed(pushed)
    entries = symmetric(len(left), lambda i, j: plus(*_thinner(left, shown, sides, i, j)))
    for step in reversed(piece.steps):
        entries = congruence(transposed(step), entries)
    return vector, entries


def _thinner(left: Matrix, shown: Matrix, sides: Matrix, i: int, j: int) -> tuple[PyTree, PyTree]:
    """The two summands of entry (i, j) or (j, i) of the symmetric Λ⁻: of the entry with fewer products with H."""
    a, b = (i, j) if sum(map(is_zero, shown[i])) >= sum(map(is_zero, shown[j])) else (j, i)
    return left[a][b], dot(shown[a], sides[b])


def _transposed_times(matrix: Matrix, vector: list[PyTree]) -> list[PyTree]:
    return [dot(column, vector) for column in zip(*matrix, strict=True)]


def _smoothed(
    given: Inputs, after: Components, vector: list[PyTree], entries: Matrix | None, chosen: tuple[int, ...]
) -> tuple[list[PyTree], list[PyTree]]:
    """The smoothed mean, and the upper triangle of the covariance of the chosen components."""
    cm, (x, cov) = given.cm, after
    delta = [times(-1.0, dot(row, vector)) for row in cov]
    good = sound(barred(total(delta))[0])
    delta = [where(good, d, 0.0) for d in delta]
    trace = Expansion(given.dtype)
    mean = trace.call(cm.retract, x, delta) if cm.curved else [plus(a, d) for a, d in zip(x, delta, strict=True)]
    if entries is None:
        return mean, []
    around = turn(cm, trace, x, delta, mean) if cm.curved else identity(len(x))
    rows = [around[i] for i in chosen]
    shows = [j for j in range(len(cov)) if any(not is_zero(row[j]) for row in rows)]
    half = product([cov[j] for j in shows], entries)

    def left(a: int, b: int) -> PyTree:
        return minus(cov[shows[a]][shows[b]], dot(half[a], cov[shows[b]]))

    smoothed = congruence([[row[j] for j in shows] for row in rows], symmetric(len(shows), left))
    found = upper(smoothed)
    good = sound(barred(total(found))[0])
    kept = [cov[chosen[a]][chosen[b]] for a in range(len(chosen)) for b in range(a, len(chosen))]
    return mean, [where(good, value, other) for value, other in zip(found, kept, strict=True)]


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
