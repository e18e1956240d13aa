"""Covariances whose entries are addressed by the names of the components."""

from collections.abc import Mapping
from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree, PyTreeDef

from jgait.types import AnyArray, Values


def names_of(tree: PyTree) -> tuple[str, ...]:
    """Names of a tuple's leaves in order; nested names are joined by dots: `up.forward`."""
    paths, _ = jax.tree_util.tree_flatten_with_path(tree)
    return tuple(jax.tree_util.keystr(path, simple=True, separator=".") for path, _ in paths)


@lru_cache(maxsize=256)
def structure_names(structure: PyTreeDef) -> tuple[str, ...]:
    """Names of the leaves of a tree structure, see `names_of`."""
    return names_of(jax.tree.unflatten(structure, range(structure.num_leaves)))


@jax.tree_util.register_pytree_node_class
class Covariance:
    """A symmetric matrix addressed by names.

    `cov["x", "thigh_angle"]` is an entry, with a leading time axis if there is one; `variances()` and `stddev()`
    return the tuple type of the covariance's components.
    """

    __slots__ = ("entries", "structure")

    def __init__(self, entries: tuple[PyTree, ...] | AnyArray, structure: PyTreeDef) -> None:
        """Take the entries and the tree structure of the tuple of components.

        The entries are the upper triangle row by row (i ≤ j), each of its own, so that zeros stay known, or an array
        (..., n, n), which is one output of a program instead of n (n + 1) / 2.
        """
        self.entries = entries
        self.structure = structure

    def tree_flatten(self) -> tuple[tuple[PyTree, ...], tuple[PyTreeDef, bool]]:
        """Leaves and structure, for jax."""
        if isinstance(self.entries, tuple):
            return self.entries, (self.structure, False)
        return (self.entries,), (self.structure, True)

    @classmethod
    def tree_unflatten(cls, form: tuple[PyTreeDef, bool], leaves: PyTree) -> "Covariance":
        """Inverse of `tree_flatten`, without checks, because JAX also passes placeholders as leaves."""
        structure, whole = form
        return cls(leaves[0] if whole else tuple(leaves), structure)

    @property
    def upper(self) -> tuple[PyTree, ...]:
        """The upper triangle row by row (i ≤ j)."""
        if isinstance(self.entries, tuple):
            return self.entries
        size = self.structure.num_leaves
        return tuple(self.entries[..., i, j] for i in range(size) for j in range(i, size))

    @classmethod
    def from_variances(cls, variances: PyTree) -> "Covariance":
        """The covariance of independent components with the given variances.

        Args:
            variances: tuple of the error's type.

        Returns:
            A covariance whose other entries are Python zeros, so that a trace detects the structural zeros.
        """
        leaves, structure = jax.tree.flatten(variances)
        size = len(leaves)
        return cls(tuple(leaves[i] if i == j else 0.0 for i in range(size) for j in range(i, size)), structure)

    @classmethod
    def from_dense(cls, matrix: PyTree, like: PyTree) -> "Covariance":
        """The covariance from the upper triangle of a symmetric matrix (..., n, n).

        Args:
            matrix: (..., n, n), components in the order of `names`.
            like: any tuple of components, or its tree structure.

        Raises:
            ValueError: if the matrix does not have the size of the tuple.
        """
        matrix = jnp.asarray(matrix)
        structure = like if isinstance(like, jax.tree_util.PyTreeDef) else jax.tree.structure(like)
        size = structure.num_leaves
        if matrix.shape[-2:] != (size, size):
            raise ValueError(
                f"a covariance of {size} components ({', '.join(structure_names(structure))}) needs a matrix of shape "
                f"(..., {size}, {size}); got {matrix.shape}"
            )
        return cls(matrix, structure)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the components, in order."""
        return structure_names(self.structure)

    def _place(self, pair: tuple[str, str]) -> tuple[int, int]:
        names = self.names
        if not (isinstance(pair, tuple) and len(pair) == 2):
            raise KeyError(f"an entry has two names, such as cov[{names[0]!r}, {names[-1]!r}]; got {pair!r}")
        for name in pair:
            if name not in names:
                raise KeyError(f"no component {name!r}; there are {', '.join(names)}")
        i, j = sorted(names.index(name) for name in pair)
        return i, j

    def _number(self, i: int, j: int) -> int:
        """The number of entry (i, j), i ≤ j, in the upper triangle."""
        return i * self.structure.num_leaves - i * (i - 1) // 2 + j - i

    def _entry(self, i: int, j: int) -> PyTree:
        return self.entries[self._number(i, j)] if isinstance(self.entries, tuple) else self.entries[..., i, j]

    def __getitem__(self, pair: tuple[str, str]) -> PyTree:
        """The covariance of two named components, in either order."""
        return self._entry(*self._place(pair))

    def with_entries(self, entries: Mapping[tuple[str, str], PyTree]) -> "Covariance":
        """The same covariance with some entries replaced, each for both orders of its two names.

        Args:
            entries: pair of names, in either order → value.

        Raises:
            KeyError: if a name is not a component.
            ValueError: if an entry is given in both orders.
        """
        upper = list(self.upper)
        indices = [self._number(*self._place(pair)) for pair in entries]
        if len(set(indices)) < len(indices):
            raise ValueError(f"an entry is given twice, in both orders of its names: {', '.join(map(str, entries))}")
        for index, value in zip(indices, entries.values(), strict=True):
            upper[index] = value
        return Covariance(tuple(upper), self.structure)

    def variances(self) -> PyTree:
        """The diagonal, as a tuple of the error's type."""
        size = self.structure.num_leaves
        return jax.tree.unflatten(self.structure, [self._entry(i, i) for i in range(size)])

    def stddev(self) -> PyTree:
        """Standard deviations, as a tuple of the error's type; 0, with gradient 0, where a variance is not positive."""
        return jax.tree.map(_root, self.variances())

    def dense(self) -> Float[Array, "*batch state state"]:
        """The whole matrix (..., n, n), components in the order of `names`."""
        size = self.structure.num_leaves
        above = np.triu(np.ones((size, size), bool))
        if not isinstance(self.entries, tuple):
            return jnp.where(above, self.entries, jnp.swapaxes(self.entries, -1, -2))
        entries = jnp.broadcast_arrays(*(jnp.asarray(entry) for entry in self.entries))
        stacked = jnp.stack([entry.astype(jnp.result_type(*self.entries)) for entry in entries], axis=-1)
        place = np.zeros((size, size), np.int32)
        place[above] = np.arange(len(entries))
        return stacked[..., np.maximum(place, place.T)]

    def __repr__(self) -> str:
        """The names of the components, without the entries."""
        return f"Covariance({', '.join(self.names)})"


def _root(variance: Values) -> Values:
    variance = jnp.asarray(variance)
    positive = variance > 0.0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, variance, 1.0)), 0.0)
