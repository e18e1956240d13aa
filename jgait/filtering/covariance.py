"""Tuples of named numbers and arrays as vectors of components, and covariances whose entries have these names."""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import Field
from functools import lru_cache
from typing import ClassVar, NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array, Float, PyTree, PyTreeDef

from jgait.geometry.arrays import xp
from jgait.geometry.vectors import root
from jgait.types import AnyArray

Scalar = Float[Array, ""] | float
"""One component: an array without axes, or a number that is known while a function is traced."""

type Numbers = AnyArray | np.number | np.bool | float | int
"""An array of any shape, or one number of Python or NumPy."""


@runtime_checkable
class Record(Protocol):
    """A dataclass that is registered with JAX as a pytree."""

    __dataclass_fields__: ClassVar[dict[str, Field[object]]]


type Tree = Numbers | Sequence[Tree] | Mapping[str, Tree] | Record | None
"""A user's tuple of numbers, arrays and tuples of these: parameters, a state, an observation or a control."""


def names_of(tree: Tree) -> tuple[str, ...]:
    """Names of a tuple's leaves in order; nested names are joined by dots: `up.forward`."""
    paths, _ = jax.tree_util.tree_flatten_with_path(tree)
    return tuple(jax.tree_util.keystr(path, simple=True, separator=".") for path, _ in paths)


@lru_cache(maxsize=256)
def _names(structure: PyTreeDef) -> tuple[str, ...]:
    return names_of(jax.tree.unflatten(structure, range(structure.num_leaves)))


class Layout(NamedTuple):
    """The names and shapes of a tuple's leaves; hashable. Components are numbered leaf by leaf, row by row."""

    structure: PyTreeDef
    shapes: tuple[tuple[int, ...], ...]  #: shape of each leaf, () for a scalar.

    @classmethod
    def of(cls, tree: Tree, axes: int = 0) -> "Layout":
        """The layout of a tuple of numbers and arrays, whose first `axes` axes (time, batch) are no part of it."""
        leaves, structure = jax.tree.flatten(tree)
        return cls(structure, tuple(jnp.shape(leaf)[axes:] for leaf in leaves))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the leaves, see `names_of`."""
        return _names(self.structure)

    @property
    def size(self) -> int:
        """Number of components."""
        return sum(map(math.prod, self.shapes))

    def places(self, name: str) -> list[int]:
        """The numbers of the components of a leaf, or of all leaves below a name; KeyError if there is none."""
        numbers, first = list[int](), 0
        for leaf, shape in zip(self.names, self.shapes, strict=True):
            size = math.prod(shape)
            if leaf == name or leaf.startswith(f"{name}."):
                numbers.extend(range(first, first + size))
            first += size
        if not numbers:
            raise KeyError(f"no component {name!r}; there are {', '.join(self.names)}")
        return numbers

    def shape_of(self, name: str) -> tuple[int, ...]:
        """The shape of a leaf; of several leaves below a name, the number of their components."""
        return self.shapes[self.names.index(name)] if name in self.names else (len(self.places(name)),)

    def components(self, tree: Tree, dtype: DTypeLike, what: str) -> list[Scalar]:
        """The scalars of a tuple: Python numbers as floats, all else as arrays of the dtype.

        Raises ValueError if the tuple is of another type than expected, or a leaf has another shape.
        """
        leaves, structure = jax.tree.flatten(tree)
        if structure != self.structure:
            expected: PyTree = jax.tree.unflatten(self.structure, range(self.structure.num_leaves))
            raise ValueError(
                f"{what} must be a {type(expected).__name__} of ({', '.join(self.names)}); "
                f"got a {type(tree).__name__} of ({', '.join(names_of(tree))})"
            )
        scalars = list[Scalar]()
        for name, leaf, shape in zip(self.names, leaves, self.shapes, strict=True):
            if jnp.shape(leaf) != shape:
                raise ValueError(f"{what} must have '{name}' of shape {shape}; got {jnp.shape(leaf)}")
            if shape == ():
                scalars.append(float(leaf) if isinstance(leaf, int | float) else jnp.asarray(leaf, dtype))
            elif math.prod(shape):
                scalars.extend(jnp.unstack(jnp.asarray(leaf, dtype).reshape(-1)))
        return scalars

    def tuple(self, components: Sequence[Scalar]) -> PyTree:
        """The tuple of scalars, inverse of `components`."""
        leaves, rest = [], iter(components)
        for shape in self.shapes:
            parts = [next(rest) for _ in range(math.prod(shape))]
            leaves.append(jnp.stack(parts).reshape(shape) if shape != () else parts[0])
        return self.structure.unflatten(leaves)

    def split(self, values: Float[Array, "*batch size"]) -> PyTree:
        """The tuple of an array whose last axis has the components; other axes stay in front."""
        leaves, first = [], 0
        for shape in self.shapes:
            size = math.prod(shape)
            part = values[..., first] if shape == () else values[..., first : first + size]
            leaves.append(part.reshape(*values.shape[:-1], *shape))
            first += size
        return self.structure.unflatten(leaves)


type Places = tuple[tuple[int, int], ...]
"""Rows and columns, row ≤ column, of entries that are equal."""

type Entries = dict[tuple[int, int], Scalar]
"""(row, column), row ≤ column → entry."""


@jax.tree_util.register_pytree_node_class
class Covariance:
    """A symmetric matrix addressed by names.

    `cov["x", "thigh_angle"]` is an entry, with a leading time axis if there is one, and `cov["position", "velocity"]`
    the block of two arrays; `variances()` and `stddev()` return the tuple type of the covariance's components.
    """

    __slots__ = ("layout", "places", "values")

    def __init__(self, values: Sequence[PyTree], layout: Layout, places: tuple[Places, ...] | None = None) -> None:
        """Take one array (..., n, n); or scalars, each the entry at all of its `places`; other entries are zero."""
        self.values, self.layout, self.places = tuple(values), layout, places

    def tree_flatten(self) -> tuple[tuple[PyTree, ...], tuple[Layout, tuple[Places, ...] | None]]:
        """Leaves and structure, for jax."""
        return self.values, (self.layout, self.places)

    @classmethod
    def tree_unflatten(cls, form: tuple[Layout, tuple[Places, ...] | None], leaves: PyTree) -> "Covariance":
        """Inverse of `tree_flatten`, without checks, because JAX also passes placeholders as leaves."""
        return cls(leaves, *form)

    @classmethod
    def from_variances(cls, variances: Tree) -> "Covariance":
        """The covariance of independent components, from a tuple of their variances of the error's type.

        A number for an array is the variance of each of its entries.
        """
        layout = Layout.of(variances)
        entries = dict[tuple[int, int], Scalar]()
        for leaf in jax.tree.leaves(variances):
            for value in [leaf] if jnp.shape(leaf) == () else jnp.unstack(jnp.reshape(leaf, -1)):
                entries[len(entries), len(entries)] = value
        return cls.of(entries, layout)

    def expanded(self, layout: Layout) -> "Covariance":
        """The same covariance for a tuple with arrays where this one has numbers, which hold for each entry.

        Raises ValueError if the tuples have other names, or arrays of other shapes.
        """
        if self.layout == layout:
            return self
        if self.layout.structure != layout.structure:
            raise ValueError(f"a covariance of ({', '.join(layout.names)}); got {self!r}")
        components_of, numbers = list[list[int]](), 0
        for name, shape, given in zip(layout.names, layout.shapes, self.layout.shapes, strict=True):
            if given not in ((), shape):
                raise ValueError(f"'{name}' of shape () or {shape}; got {given}")
            every = list(range(numbers, numbers + math.prod(shape)))
            components_of += [every] if given == () else [[i] for i in every]
            numbers += len(every)
        entries = dict[tuple[int, int], Scalar]()
        for (i, j), value in self.entries().items():
            if len(components_of[i]) != len(components_of[j]):
                raise ValueError(f"entries of equal shapes; got one number for {layout.names} at {i}, {j}")
            entries |= dict.fromkeys(zip(components_of[i], components_of[j], strict=True), value)
        return self.of(entries, layout)

    @classmethod
    def from_dense(cls, matrix: Float[AnyArray, "*batch state state"], like: Tree | Layout) -> "Covariance":
        """The covariance from the upper triangle of a symmetric matrix (..., n, n), components in the order of `names`.

        `like` is any tuple of components, or its `Layout`. Raises ValueError if the matrix is not of its size.
        """
        matrix = xp.asarray(matrix)
        layout = like if isinstance(like, Layout) else Layout.of(like)
        size = layout.size
        if matrix.shape[-2:] != (size, size):
            raise ValueError(
                f"a covariance of {size} components ({', '.join(layout.names)}) needs a matrix of shape "
                f"(..., {size}, {size}); got {matrix.shape}"
            )
        return cls((matrix,), layout)

    @classmethod
    def of(cls, entries: Entries, layout: Layout) -> "Covariance":
        """From entries; equal objects become one value with several places."""
        distinct: dict[int, tuple[Scalar, list[tuple[int, int]]]] = {}
        for place, value in entries.items():
            if not (isinstance(value, float | int) and value == 0.0):
                distinct.setdefault(id(value), (value, []))[1].append(place)
        pairs = [*distinct.values()]
        return cls([value for value, _ in pairs], layout, tuple(tuple(where) for _, where in pairs))

    def entries(self) -> Entries:
        """The entries; those that are known to be zero are left out."""
        if self.places is None:
            size = self.layout.size
            return {(i, j): self.values[0][..., i, j] for i in range(size) for j in range(i, size)}
        return {place: value for value, where in zip(self.values, self.places, strict=True) for place in where}

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the components, in order."""
        return self.layout.names

    def _pair(self, pair: tuple[str, str]) -> tuple[list[int], list[int]]:
        if not (isinstance(pair, tuple) and len(pair) == 2):
            names = self.names
            raise KeyError(f"an entry has two names, such as cov[{names[0]!r}, {names[-1]!r}]; got {pair!r}")
        return self.layout.places(pair[0]), self.layout.places(pair[1])

    def __getitem__(self, pair: tuple[str, str]) -> Float[Array, "..."] | float:
        """The covariance of two named components, in either order; of arrays a block of both shapes."""
        rows, columns = self._pair(pair)
        shape = (*self.layout.shape_of(pair[0]), *self.layout.shape_of(pair[1]))
        if shape == () and self.places is not None:
            i, j = sorted((rows[0], columns[0]))
            return self.entries().get((i, j), 0.0)
        block = self.dense()[..., rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        return block.reshape(*block.shape[:-2], *shape)

    def with_entries(self, entries: Mapping[tuple[str, str], Numbers]) -> "Covariance":
        """The same covariance with some entries replaced, by pairs of names in either order.

        The value for two arrays is a block (rows, columns), or one number, the covariance of each entry of the first
        with the same entry of the second. Raises KeyError for an unknown name, ValueError for a pair in both orders.
        """
        if len({frozenset(pair) for pair in entries}) < len(entries):
            raise ValueError(f"an entry is given twice, in both orders of its names: {', '.join(map(str, entries))}")
        replaced: dict[tuple[int, int], PyTree] = {}
        for pair, value in entries.items():
            rows, columns = self._pair(pair)
            block = None if jnp.shape(value) == () else jnp.reshape(value, (len(rows), len(columns)))
            for (a, i), (b, j) in itertools.product(enumerate(rows), enumerate(columns)):
                single = value if a == b or len(rows) == 1 else 0.0
                replaced[min(i, j), max(i, j)] = single if block is None else block[a, b]
        return self.of(self.entries() | replaced, self.layout)

    def variances(self) -> PyTree:
        """The diagonal, as a tuple of the error's type."""
        if self.places is None:
            size = self.layout.size
            return self.layout.split(self.values[0].reshape(*self.values[0].shape[:-2], size * size)[..., :: size + 1])
        entries = self.entries()
        return self.layout.tuple([entries.get((i, i), 0.0) for i in range(self.layout.size)])

    def stddev(self) -> PyTree:
        """Standard deviations, as a tuple of the error's type; 0, with gradient 0, where a variance is not positive."""
        return jax.tree.map(root, self.variances())

    def dense(self) -> Float[Array, "*batch state state"]:
        """The whole matrix (..., n, n), components in the order of `names`."""
        size = self.layout.size
        if self.places is None:
            above = np.triu(np.ones((size, size), bool))
            return xp.where(above, self.values[0], xp.swapaxes(self.values[0], -1, -2))
        dtype = jnp.result_type(*self.values) if self.values else jnp.result_type(float)
        values = [jnp.asarray(value, dtype)[..., None, None] for value in self.values]
        return placed(values, self.places, (size, size), dtype)

    def __repr__(self) -> str:
        """The names of the components, without the entries."""
        return f"Covariance({', '.join(self.names)})"


def placed(values: Sequence[Array], places: Sequence[Places], shape: tuple[int, ...], dtype: DTypeLike) -> Array:
    """Symmetric matrices of the shape, (n, n) or (n, n, 1), that have each value at its places, and zeros."""
    total = jnp.zeros(shape, dtype)
    for value, where in zip(values, places, strict=True):
        pattern = np.zeros(shape, bool)
        rows, columns = np.transpose(where)
        pattern[rows, columns] = pattern[columns, rows] = True
        total = jnp.where(pattern, value, total)
    return total
