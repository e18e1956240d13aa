r"""Smoothed means over components: a backward scan of the information of later samples, as `backward`.

    λ ← Aᵀ ((I − K H)ᵀ λ − Hᵀ S⁻¹ e),   m_s = m − P λ,   λ of the samples after this one

`Pieces` of the forward pass are stored for one segment at a time.

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
    dot,
    known,
    minus,
    plus,
    product,
    sound,
    times,
    total,
    transposed,
    where,
)
from jgait.filtering.fast import (
    Advanced,
    Noises,
    advanced,
    arrays,
    carried,
    constant_noises,
    first_carry,
    forward,
    listed,
    opened,
    sample_of,
    segment_length,
    series,
)
from jgait.filtering.inputs import Inputs
from jgait.filtering.padding import folded, unfolded
from jgait.filtering.sharing import shared
from jgait.filtering.structured import Components


class Pieces(NamedTuple):
    """The quantities of one sample that the backward pass needs."""

    after: Components  #: the filtered belief.
    gain: Matrix  #: K (n × m), zero where masked.
    matrix: Matrix  #: H (m × n).
    pull: list[PyTree]  #: S⁻¹ e (m), zero where masked.
    transition: Matrix  #: A.


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


def bryson_frazier(given: Inputs, keep: tuple[str, ...]) -> tuple[PyTree, dict[str, PyTree]]:
    """Smoothed means, and the filter's fields `keep` by name."""
    noises, dtype = constant_noises(given), given.dtype
    parcel = Parcel(dtype)

    def ahead(carry: PyTree, leaves: PyTree, real: PyTree) -> tuple[PyTree, PyTree]:
        step = advanced(given, noises, opened(carry, given), sample_of(leaves, given))
        return carried(step.after, dtype), parcel.packed(pieces(step, real))

    def back(carry: PyTree, contents: PyTree) -> tuple[PyTree, PyTree]:
        piece, vector = parcel.opened(contents), list(carry)
        return arrays(_before(piece, vector), dtype), arrays(_smoothed(piece.after, vector), dtype)

    start = (jnp.zeros((), dtype),) * len(given.cov)
    mean, kept = there_and_back(given, noises, keep, start, shared(ahead), shared(back))
    return list(mean), kept


def pieces(step: Advanced, real: PyTree) -> Pieces:
    """The pieces of a step; `real` is False where the sample is padding of the last segment."""
    g = step.gains
    pull = [where(real, dot(column, g.white), 0.0) for column in transposed(g.inverse)]
    return Pieces(step.after, product(transposed(g.white_cross), g.inverse), g.matrix, pull, step.transition.matrix)


def _before(piece: Pieces, vector: list[PyTree]) -> list[PyTree]:
    """λ⁺ of the previous sample, from λ⁺ of this sample."""
    gains = transposed(piece.gain)
    weights = [plus(dot(gain, vector), pull) for gain, pull in zip(gains, piece.pull, strict=True)]
    vector = [minus(a, dot(row, weights)) for a, row in zip(vector, transposed(piece.matrix), strict=True)]
    return [dot(column, vector) for column in transposed(piece.transition)]


def _smoothed(after: Components, vector: list[PyTree]) -> list[PyTree]:
    """The smoothed mean."""
    delta = [times(-1.0, dot(row, vector)) for row in after.cov]
    good = sound(barred(total(delta))[0])
    return [plus(a, where(good, d, 0.0)) for a, d in zip(after.mean, delta, strict=True)]


def there_and_back(
    given: Inputs, noises: Noises, keep: tuple[str, ...], start: PyTree,
    ahead: Callable[..., PyTree], back: Callable[..., PyTree],
) -> tuple[PyTree, dict[str, PyTree]]:  # fmt: skip
    """Scan forward and store the belief before each segment; then backward, with each segment forward once more.

    Args:
        given: model and recording.
        noises: the model's noises that are the same at every sample.
        keep: the filter's fields to return.
        start: carry of the backward pass at the last sample.
        ahead: (belief before, leaves of the sample, False if the sample is padding) → belief after, and the quantities
            that `back` needs.
        back: (carry, those quantities) → carry, output.
    """
    length = given.length
    samples, last = folded((series(given), jnp.arange(length)), segment_length(length))
    real = jnp.arange(last.size).reshape(last.shape) == last  # False where the last segment is filled up
    once = jax.checkpoint(forward(given, noises, keep), prevent_cse=False)
    again = jax.checkpoint(lambda carry, item: ahead(carry, *item), prevent_cse=False)
    inner = jax.checkpoint(back, prevent_cse=False)

    @jax.checkpoint
    def there(carry: PyTree, part: PyTree) -> tuple[PyTree, PyTree]:
        after, kept = lax.scan(once, carry, part)
        return after, (carry, kept)

    @jax.checkpoint
    def behind(carry: PyTree, part: PyTree) -> tuple[PyTree, PyTree]:
        first, items = part
        stored = lax.scan(again, first, items)[1]
        return lax.scan(inner, carry, stored, reverse=True)

    _, (starts, kept) = lax.scan(there, first_carry(given), samples)
    _, outputs = lax.scan(behind, start, (starts, (samples, real)), reverse=True)
    outputs, kept = unfolded((outputs, kept), length)
    return outputs, listed(kept)
