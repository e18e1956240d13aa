"""An estimator that runs sample by sample: its state between blocks of samples as a few arrays, compiled once.

A call of a compiled program takes a microsecond or more for each array. So the state, some 200 arrays, is kept as one
array a type, samples and results are one matrix each, and a call processes up to `BLOCK` samples. Blocks of any size
share one compiled program.
"""

import functools
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from jgait.filtering.compile import compiled, compiler_options
from jgait.types import Counts, Flags, Values

BLOCK = 32
"""[samples] Most samples of one call of the compiled program; longer blocks are divided."""


class Readings(NamedTuple):
    """One sample of k sensors, or n samples with an axis in front.

    Attributes:
        dt: time since the previous sample [s]; 0 at the first.
        gyr: (k, 3) angular rate [rad/s]; 0 where it is lost.
        acc: (k, 3) specific force [m/s²]; 0 where it is lost.
        turned: (k,) bool, the angular rate was measured.
        felt: (k,) bool, the specific force was measured.
    """

    dt: Values
    gyr: Values
    acc: Values
    turned: Flags
    felt: Flags


class Device(NamedTuple):
    """An estimator for sensors whose mounting is known, sample by sample.

    Attributes:
        source: "legs", "feet", "ankles" or "shanks", as in `jgait.analyse`.
        estimator: name of the estimator.
        placements: placements of its sensors, in the order of the rows of a sample.
        constants: parameters, mounting and sensor errors; arrays.
        begin: (constants, first sample, options) → state before it; a function of a module.
        advance: (constants, state, samples, count, options) → state and results (`BLOCK`, …) after each of the first
            `count` samples of a block; a function of a module. Later samples are zeros.
        options: static options of `begin` and `advance`.
        sides: side of each leg or foot in the results, 0 right, 1 left.
    """

    source: str
    estimator: str
    placements: tuple[str, ...]
    constants: PyTree
    begin: Callable[[PyTree, Readings, PyTree], PyTree]
    advance: Callable[[PyTree, PyTree, Readings, Counts, PyTree], tuple[PyTree, PyTree]]
    options: PyTree
    sides: tuple[int, ...]


class Structure(NamedTuple):
    """The structure of a tree of arrays with their shapes and types; hashable."""

    tree: jax.tree_util.PyTreeDef
    leaves: tuple[tuple[tuple[int, ...], np.dtype], ...]

    @classmethod
    def of(cls, tree: PyTree) -> "Structure":
        """The structure of a tree."""
        leaves, structure = jax.tree.flatten(tree)
        return cls(structure, tuple((tuple(leaf.shape), np.dtype(leaf.dtype)) for leaf in leaves))


def packed(tree: PyTree) -> list[PyTree]:
    """A tree of arrays as one flat array a type."""
    leaves = jax.tree.leaves(tree)
    kinds = sorted({np.dtype(leaf.dtype) for leaf in leaves}, key=str)
    return [jnp.concatenate([leaf.ravel() for leaf in leaves if leaf.dtype == kind]) for kind in kinds]


def unpacked(parts: list[PyTree], structure: Structure) -> PyTree:
    """Inverse of `packed`."""
    at = {np.dtype(part.dtype): 0 for part in parts}
    by_type = {np.dtype(part.dtype): part for part in parts}
    found = []
    for shape, kind in structure.leaves:
        first, size = at[kind], int(np.prod(shape))
        at[kind] = first + size
        found.append(by_type[kind][first : first + size].reshape(shape))
    return jax.tree.unflatten(structure.tree, found)


def _samples(rows: Values) -> Readings:
    """Rows (n, 1 + 8 k), or one row, as samples."""
    sensors = rows[..., 1:].reshape(*rows.shape[:-1], -1, 8)
    return Readings(rows[..., 0], sensors[..., :3], sensors[..., 3:6], sensors[..., 6] > 0.5, sensors[..., 7] > 0.5)


def _like(tree: PyTree, other: PyTree) -> PyTree:
    """A tree with the types of another, so that it can be carried through a loop."""
    return jax.tree.map(lambda new, old: jnp.asarray(new, old.dtype), tree, other)


def _strong(tree: PyTree) -> PyTree:
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.asarray(leaf).dtype), tree)


def _begun(constants: PyTree, row: Values, *, device: tuple[PyTree, ...]) -> PyTree:
    begin, _, options = device
    return _strong(begin(constants, _samples(row), options))


def _looped(
    constants: PyTree, parts: list[PyTree], block: Values, count: Values, *, device: tuple[PyTree, ...],
    structure: Structure, width: int,
) -> tuple[list[PyTree], Values]:  # fmt: skip
    _, advance, options = device

    state = unpacked(parts, structure)
    after, found = advance(constants, state, _samples(block), count, options)
    rows = [jnp.asarray(leaf, block.dtype).reshape(block.shape[0], -1) for leaf in jax.tree.leaves(found)]
    return packed(_like(after, state)), jnp.concatenate(rows, axis=1)


@functools.cache
def _compiled(
    device: tuple[PyTree, ...], structure: Structure, width: int
) -> Callable[..., tuple[list[PyTree], Values]]:
    """`_looped` for a device, compiled once for all persons."""
    fixed = functools.partial(_looped, device=device, structure=structure, width=width)
    return jax.jit(fixed, compiler_options=compiler_options() or None)


_begin = compiled(_begun, static_argnames=("device",))


class Results:
    """Results of n samples; each field is taken out of a matrix (n, width) when it is asked for."""

    def __init__(self, matrix: np.ndarray, fields: dict[str, tuple[int, Structure]]) -> None:
        self._matrix, self._fields = matrix, fields

    def __contains__(self, name: str) -> bool:
        return name in self._fields

    def field(self, name: str, at: PyTree = slice(None)) -> PyTree:
        """A field of the results, leaves (n, …), at all or some of the samples; None if it is None."""
        first, structure = self._fields[name]
        found = []
        for shape, kind in structure.leaves:
            size = int(np.prod(shape))
            values = self._matrix[at, first : first + size].reshape(-1, *shape)
            found.append(values if values.dtype == kind else values.astype(kind))
            first += size
        return jax.tree.unflatten(structure.tree, found)


class Runner:
    """A device and its state, which has a fixed size."""

    def __init__(self, device: Device) -> None:
        self.device = device
        self._constants = jax.tree.map(jnp.asarray, device.constants)
        self._dtype = jnp.zeros(()).dtype
        self._parts: list[PyTree] | None = None
        self._loop: Callable[..., tuple[list[PyTree], Values]] | None = None
        self._fields: dict[str, tuple[int, Structure]] = {}

    @property
    def state_bytes(self) -> int:
        """Memory of the state [bytes]; 0 before the first sample."""
        return sum(part.nbytes for part in self._parts or [])

    def _start(self, row: np.ndarray) -> None:
        device = self.device.begin, self.device.advance, self.device.options
        state = _begin(self._constants, row, device=device)
        block = jax.ShapeDtypeStruct((BLOCK, row.size), self._dtype)
        found = jax.eval_shape(
            lambda c, s, b: self.device.advance(c, s, _samples(b), np.int32(1), self.device.options)[1],
            self._constants, state, block,
        )  # fmt: skip
        width = 0
        for name, value in zip(found._fields, found, strict=True):
            structure = Structure.of(jax.tree.map(lambda leaf: jax.ShapeDtypeStruct(leaf.shape[1:], leaf.dtype), value))
            self._fields[name] = width, structure
            width += sum(int(np.prod(shape)) for shape, _ in structure.leaves)
        self._parts = packed(state)
        self._loop = _compiled(device, Structure.of(state), width)

    def push(self, rows: np.ndarray) -> Results:
        """The results after each of n > 0 samples, (n, 1 + 8 k): dt, and gyr, acc, turned, felt of each sensor."""
        rows = rows.astype(self._dtype, copy=False)
        if self._loop is None:
            self._start(rows[0])
        assert self._loop is not None
        done = []
        for first in range(0, len(rows), BLOCK):
            part = rows[first : first + BLOCK]
            block = np.zeros((BLOCK, rows.shape[1]), self._dtype)
            block[: len(part)] = part
            self._parts, results = self._loop(self._constants, self._parts, block, np.int32(len(part)))
            done.append(np.asarray(results)[: len(part)])
        return Results(done[0] if len(done) == 1 else np.concatenate(done), self._fields)
