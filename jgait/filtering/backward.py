r"""The smoother's scan: what later samples say, in the modified Bryson–Frazier form, and its gradient.

With J = H A, M = (I − K H) A and G = S⁻¹ of each sample,

    λ ← Mᵀ λ − Jᵀ G e,   Λ ← Mᵀ Λ M + Jᵀ G J,   from the last sample to the first,
    x_s = x⁻ ⊕ (δ − P λ),   P_s = P − P Λ P.

This is the Rauch–Tung–Striebel smoother without an inverse of a covariance: the same on flat states, equal to first
order in the smoother's corrections on manifolds. Its gradient is a scan forward over the samples.

Source: G. J. Bierman, "Fixed interval smoothing with discrete measurements", Int. J. Control 18(1), 1973; H. Rauch,
F. Tung, C. Striebel (1965), AIAA Journal 3(8).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jax.typing import DTypeLike
from jaxtyping import PyTree

from jgait.filtering.lanes import (
    applied,
    held,
    outer,
    product,
    product_transposed,
    summed,
    symmetrised,
    transposed,
    where,
)
from jgait.filtering.padding import scanned

OUTPUTS = ("move", "cov", "vector", "matrix")
"""The outputs: −P λ (T, n), P − P Λ P (T, n, n), λ (T, n) and Λ (T, n, n) of the samples after each."""


@dataclass(frozen=True)
class Backward:
    """The backward scan as a function of a batch: P, M, J, G, G e over samples → `OUTPUTS`.

    Attributes:
        chosen: components whose covariances are computed; without any, Λ is zero.
        all: whether λ and Λ are returned.
    """

    chosen: tuple[int, ...]
    all: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the outputs, in order."""
        names = [name for name in OUTPUTS if self.chosen or name in ("move", "vector")]
        return tuple(name for name in names if self.all or name in ("move", "cov"))

    def shapes(self, *arguments: jax.ShapeDtypeStruct) -> list[jax.ShapeDtypeStruct]:
        """The shapes of the outputs without the batch axis."""
        length, n, _ = arguments[0].shape
        shapes = {"move": (n,), "vector": (n,), "cov": (len(self.chosen),) * 2, "matrix": (n, n)}
        return [jax.ShapeDtypeStruct((length, *shapes[name]), arguments[0].dtype) for name in self.names]

    def value(self, *arguments: PyTree, count: PyTree = None) -> list[PyTree]:
        """The outputs of the first `count` samples, or of all, time axis in front and batch behind."""
        lanes, (_, n, _, _), dtype = max(v.shape[-1] for v in arguments), arguments[0].shape, arguments[0].dtype
        return self.continued(self.start(n, lanes, dtype), arguments, count)[1]

    def start(self, size: int, lanes: int, dtype: DTypeLike) -> tuple[PyTree, PyTree]:
        """λ and Λ after the last sample, of `size` components."""
        return jnp.zeros((size, lanes), dtype), (jnp.zeros((size, size, lanes), dtype) if self.chosen else 0.0)

    def continued(self, start: PyTree, arguments: Sequence[PyTree], count: PyTree) -> tuple[PyTree, list[PyTree]]:
        """λ and Λ before the first sample, and the outputs, from λ and Λ after the last sample."""
        names = self.names

        def body(carry: PyTree, sample: PyTree) -> tuple[PyTree, list[PyTree]]:
            vector, matrix = carry
            cov, closed, rows, information, weighted = sample
            outputs = {"move": -applied(cov, vector), "vector": vector, "matrix": matrix}
            fine = held(jnp.isfinite(summed(outputs["move"])))
            if self.chosen:
                part = _taken(cov, self.chosen)
                known = _taken(transposed(part), self.chosen)
                smoothed = held(product_transposed(-product(part, matrix), part, known))
                fine = held(fine & jnp.isfinite(summed(smoothed)))
                outputs["cov"] = where(fine, smoothed, known)
                half = product(information, rows)
                matrix = product(product(transposed(closed), matrix), closed, product(transposed(rows), half))
            outputs["move"] = where(fine, outputs["move"], 0.0)
            vector = applied(transposed(closed), vector) - applied(transposed(rows), weighted)
            return (vector, matrix), [outputs[name] for name in names]

        return scanned(body, start, tuple(arguments), count, reverse=True)

    def closed(
        self,
        moving: tuple[int, ...],
        arguments: list[PyTree],
        outputs: list[PyTree],
        cotangents: list[PyTree],
        count: PyTree = None,
    ) -> list[PyTree]:
        """The closed form: cotangents of the arguments `moving`, by a scan forward over the first `count` samples."""
        names = self.names
        named = dict(zip(names, outputs, strict=True))
        given = {name: value for name, value in zip(names, cotangents, strict=True) if value is not None}
        second = bool(self.chosen) and ("cov" in given or "matrix" in given)
        lanes = max(v.shape[-1] for v in (*arguments, *outputs))

        def body(carry: PyTree, item: PyTree) -> tuple[PyTree, list[PyTree]]:
            l_ct, m_ct = carry  # cotangents of λ and Λ before this sample
            (cov, closed, rows, g, z), later, ct = item
            vector, matrix = later["vector"], later.get("matrix")
            closed_ct, rows_ct = outer(vector, l_ct), -outer(z, l_ct)
            z_ct, g_ct = -applied(rows, l_ct), jnp.zeros_like(g)
            vector_ct, cov_ct = applied(closed, l_ct), jnp.zeros_like(cov)
            if second:
                half, part = product(closed, m_ct), product(rows, m_ct)
                closed_ct = closed_ct + 2.0 * product(matrix, half)
                rows_ct = rows_ct + 2.0 * product(g, part)
                g_ct = product_transposed(part, rows)
                matrix_ct = product_transposed(half, closed)
                if "cov" in ct:
                    change, place = symmetrised(ct["cov"]), jnp.asarray(self.chosen)
                    part = _taken(cov, self.chosen)
                    half = product(change, part)
                    cov_ct = cov_ct.at[place[:, None], place[None]].add(change)
                    cov_ct = cov_ct.at[place].add(-2.0 * product(half, matrix))
                    matrix_ct = matrix_ct - product(transposed(part), half)
                if "matrix" in ct:
                    matrix_ct = matrix_ct + symmetrised(ct["matrix"])
                m_ct = matrix_ct
            if "move" in ct:
                cov_ct = cov_ct - symmetrised(outer(ct["move"], vector))
                vector_ct = vector_ct - applied(cov, ct["move"])
            if "vector" in ct:
                vector_ct = vector_ct + ct["vector"]
            every = [cov_ct, closed_ct, rows_ct, g_ct, z_ct]
            return (vector_ct, m_ct), [every[i] for i in moving]

        n, dtype = arguments[0].shape[1], arguments[0].dtype
        none = jnp.zeros((n, lanes), dtype), (jnp.zeros((n, n, lanes), dtype) if second else 0.0)
        needed = {name: value for name, value in named.items() if name == "vector" or (name == "matrix" and second)}
        return scanned(body, none, (arguments, needed, given), count)[1]


def _taken(matrix: PyTree, rows: tuple[int, ...]) -> PyTree:
    """Some rows of matrices."""
    if rows == tuple(range(rows[0], rows[-1] + 1)):
        return matrix[rows[0] : rows[-1] + 1]
    return matrix[jnp.asarray(rows)]
