"""Tuples of named numbers and arrays as lists of scalars: the order of components in vectors and matrices."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import Field
from functools import lru_cache
from typing import Any, ClassVar, NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array, Float, PyTree, PyTreeDef

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
    """The names and shapes of a tuple's leaves; hashable. Components are numbered leaf by leaf, row by row.

    Attributes:
        structure: tree structure of the tuple.
        shapes: shape of each leaf, () for a scalar.
    """

    structure: PyTreeDef
    shapes: tuple[tuple[int, ...], ...]

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
        """The numbers of the components of a leaf, or of all leaves below a name.

        Raises:
            KeyError: if no leaf has the name.
        """
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

        Raises:
            ValueError: if the tuple is of another type than expected, or a leaf has another shape.
        """
        leaves, structure = jax.tree.flatten(tree)
        if structure != self.structure:
            expected: Any = jax.tree.unflatten(self.structure, range(self.structure.num_leaves))
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
