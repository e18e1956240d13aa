"""Removal of the padding of estimates, for all estimators."""

import jax
import numpy as np
from jaxtyping import PyTree

from jgait.types import Estimate


def trimmed(result: Estimate, samples: int, per_stride: tuple[str, ...]) -> Estimate:
    """An estimate without padding, as NumPy arrays; strides, and diagnostics `per_stride`, in order of their ends."""
    result = jax.tree.map(np.asarray, result)
    padded = np.size(result.time)

    def shorter(leaf: PyTree) -> PyTree:
        return leaf[:samples] if np.ndim(leaf) and leaf.shape[0] == padded else leaf

    by_stride = {name: result.diagnostics[name] for name in per_stride if name in result.diagnostics}
    rest = {name: value for name, value in result.diagnostics.items() if name not in by_stride}
    tables = (result.strides, result.strides_stddev, by_stride)
    if result.strides is not None:
        rows = np.flatnonzero(result.strides.valid)
        rows = rows[np.argsort(result.strides.end[rows], kind="stable")]
        tables = jax.tree.map(lambda column: column[rows], tables)
    bare = result._replace(strides=None, strides_stddev=None, diagnostics=rest)
    short = jax.tree.map(shorter, bare)
    return short._replace(
        strides=tables[0], strides_stddev=tables[1], diagnostics={**short.diagnostics, **tables[2]}
    )  # fmt: skip
