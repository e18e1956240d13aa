"""What a state-space model is: functions on tuples of named scalars, and beliefs about such tuples.

A state is a NamedTuple of scalars (nested NamedTuples are allowed), and so are observations and controls. A
covariance is addressed by the same names. Vectors and matrices exist only inside the filters.
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp


def names_of(tree: Any) -> tuple[str, ...]:
    """Names of a tuple's leaves in order; nested ones are joined by dots: `up.forward`."""
    paths, _ = jax.tree_util.tree_flatten_with_path(tree)
    return tuple(jax.tree_util.keystr(path).lstrip(".") for path, _ in paths)


@jax.tree_util.register_pytree_node_class
class Covariance:
    """A symmetric matrix addressed by names: the upper triangle, one array for each pair of components.

    `cov["x", "thigh_angle"]` is an entry, with the time axis in front where there is one; `variances()` and
    `stddev()` come as the tuple the covariance belongs to.
    """

    def __init__(self, upper: tuple[Any, ...], structure: Any) -> None:
        """Take the upper triangle row by row (i ≤ j) and the tree structure of the tuple it belongs to."""
        self.upper = upper
        self.structure = structure

    def tree_flatten(self) -> tuple[tuple[Any, ...], Any]:
        """Leaves and structure, for jax."""
        return self.upper, self.structure

    @classmethod
    def tree_unflatten(cls, structure: Any, upper: Any) -> "Covariance":
        """Inverse of `tree_flatten`; checks nothing, since jax also puts placeholders here."""
        return cls(tuple(upper), structure)

    @classmethod
    def from_variances(cls, variances: Any) -> "Covariance":
        """Independent components with the given variances.

        Args:
            variances: tuple of the error's type.
        """
        leaves, structure = jax.tree.flatten(variances)
        size = len(leaves)
        return cls(tuple(leaves[i] if i == j else 0.0 for i in range(size) for j in range(i, size)), structure)

    @classmethod
    def from_dense(cls, matrix: Any, like: Any) -> "Covariance":
        """From a matrix (..., n, n); `like` is any tuple of the type it belongs to.

        Raises:
            ValueError: if the matrix does not have the size of the tuple.
        """
        structure = like if isinstance(like, jax.tree_util.PyTreeDef) else jax.tree.structure(like)
        size = structure.num_leaves
        if matrix.shape[-2:] != (size, size):
            raise ValueError(f"a covariance of {size} components needs shape (..., {size}, {size}); got {matrix.shape}")
        return cls(tuple(matrix[..., i, j] for i in range(size) for j in range(i, size)), structure)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the components, in order."""
        return names_of(jax.tree.unflatten(self.structure, range(self.structure.num_leaves)))

    def _index(self, pair: tuple[str, str]) -> int:
        names = self.names
        for name in pair:
            if name not in names:
                raise KeyError(f"no component {name!r}; there are {', '.join(names)}")
        i, j = sorted(names.index(name) for name in pair)
        return i * len(names) - i * (i - 1) // 2 + j - i

    def __getitem__(self, pair: tuple[str, str]) -> Any:
        """The covariance of two named components, in either order."""
        return self.upper[self._index(pair)]

    def with_entries(self, entries: Mapping[tuple[str, str], Any]) -> "Covariance":
        """The same with some entries set, each for both orders of its two names."""
        upper = list(self.upper)
        for pair, value in entries.items():
            upper[self._index(pair)] = value
        return Covariance(tuple(upper), self.structure)

    def variances(self) -> Any:
        """The diagonal, as a tuple of the error's type."""
        size = self.structure.num_leaves
        diagonal = [self.upper[i * size - i * (i - 1) // 2] for i in range(size)]
        return jax.tree.unflatten(self.structure, diagonal)

    def stddev(self) -> Any:
        """Standard deviations, as a tuple of the error's type."""
        return jax.tree.map(lambda v: jnp.sqrt(jnp.maximum(v, 0.0)), self.variances())

    def dense(self) -> Any:
        """The whole matrix (..., n, n)."""
        size = self.structure.num_leaves
        entries = jnp.broadcast_arrays(*(jnp.asarray(u) for u in self.upper))
        dtype = jnp.result_type(*entries)
        place = {}
        for index, (i, j) in enumerate((i, j) for i in range(size) for j in range(i, size)):
            place[i, j] = place[j, i] = entries[index].astype(dtype)
        return jnp.stack([jnp.stack([place[i, j] for j in range(size)], -1) for i in range(size)], -2)

    def __repr__(self) -> str:
        """Names only: the entries are many."""
        return f"Covariance({', '.join(self.names)})"


class Belief(NamedTuple):
    """What is believed of a state: its mean, and the covariance of the error about it."""

    mean: Any
    cov: Covariance


class Model(NamedTuple):
    """A state-space model; functions at module level, so that the model is hashable and compiles once.

    Attributes:
        initial: params → `Belief` one interval before the first sample.
        transition: (params, state, control, dt) → state after dt.
        transition_noise: (params, state, control, dt) → `Covariance`, or an error tuple of independent variances.
        observation: (params, state, control) → what the sensors should read.
        observation_noise: (params, state, control) → `Covariance`, or an observation tuple of variances.
        retract: (state, error) → state, for states on a manifold; None adds.
        local: (reference, state) → error with retract(reference, local(reference, state)) = state; None subtracts.
        residual: (measured, predicted) → their difference, for angles that wrap; None subtracts.
    """

    initial: Callable[..., Belief]
    transition: Callable[..., Any]
    transition_noise: Callable[..., Any]
    observation: Callable[..., Any]
    observation_noise: Callable[..., Any]
    retract: Callable[..., Any] | None = None
    local: Callable[..., Any] | None = None
    residual: Callable[..., Any] | None = None


def as_covariance(noise: Any) -> Covariance:
    """A covariance as it is, or one of independent components from a tuple of variances."""
    return noise if isinstance(noise, Covariance) else Covariance.from_variances(noise)


def flat(tree: Any) -> Any:
    """A tuple of scalars as one vector (n,); the inside of the filters."""
    leaves = [jnp.asarray(leaf) for leaf in jax.tree.leaves(tree)]
    dtype = jnp.result_type(*leaves)
    return jnp.stack([leaf.astype(dtype) for leaf in leaves])


class Coordinates(NamedTuple):
    """A model's error coordinates about a reference state, as vectors."""

    model: Model
    error: Any  # tree structure of the error tuple

    def moved(self, reference: Any, delta: Any) -> Any:
        """The state at error `delta` (n,) from the reference."""
        error = jax.tree.unflatten(self.error, list(delta))
        if self.model.retract is None:
            return jax.tree.map(lambda a, b: a + b, reference, error)
        return self.model.retract(reference, error)

    def between(self, reference: Any, state: Any) -> Any:
        """The error (n,) that leads from the reference to the state."""
        if self.model.local is None:
            return flat(jax.tree.map(lambda a, b: b - a, reference, state))
        return flat(self.model.local(reference, state))


def coordinates(model: Model, state: Any) -> Coordinates:
    """Error coordinates of a model; their type is what `local` gives.

    Raises:
        ValueError: if only one of retract and local is given, or a state's leaf is not a scalar.
    """
    if (model.retract is None) != (model.local is None):
        raise ValueError("a model gives both retract and local, or neither")
    for name, leaf in zip(names_of(state), jax.tree.leaves(state), strict=True):
        if jnp.shape(leaf) != ():
            raise ValueError(f"a state is a tuple of scalars; '{name}' has shape {jnp.shape(leaf)}")
    if model.local is None:
        return Coordinates(model, jax.tree.structure(state))
    return Coordinates(model, jax.tree.structure(jax.eval_shape(model.local, state, state)))
