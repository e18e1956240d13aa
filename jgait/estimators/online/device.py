"""An estimator that runs sample by sample: its state between blocks of samples as a few arrays, compiled once.

A call of a compiled program takes a microsecond or more for each array. So the state, some 200 arrays, is kept as one
array a type, samples and results are one matrix each, and a call processes up to `BLOCK` samples. Blocks of any size
share one compiled program.
"""

import functools
import math
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import PyTree

from jgait.filtering.compile import compiled, compiler_options, host
from jgait.types import Counts, Flags, Values

BLOCK = 16
"""[samples] Most samples of one call of the compiled program; longer blocks are divided."""


class Readings(NamedTuple):
    """One sample of k sensors, or n samples with an axis in front."""

    dt: Values  #: time since the previous sample [s]; 0 at the first.
    gyr: Values  #: (k, 3) angular rate [rad/s]; 0 where it is lost.
    acc: Values  #: (k, 3) specific force [m/s²]; 0 where it is lost.
    turned: Flags  #: (k,) bool, the angular rate was measured.
    felt: Flags  #: (k,) bool, the specific force was measured.


class Device(NamedTuple):
    """An estimator for sensors whose mounting is known, sample by sample."""

    source: str  #: "legs", "feet", "ankles" or "shanks", as in `jgait.analyse`.
    placements: tuple[str, ...]  #: placements of its sensors, in the order of the rows of a sample.
    constants: PyTree  #: parameters, mounting and sensor errors; arrays.
    #: (constants, first sample, options) → state before it; a function of a module.
    begin: Callable[[PyTree, Readings, PyTree], PyTree]
    #: (constants, state, samples, count, options) → state and results (`BLOCK`, …) after each of the first `count`
    #: samples of a block, whose later samples are zeros; a function of a module.
    advance: Callable[[PyTree, PyTree, Readings, Counts, PyTree], tuple[PyTree, PyTree]]
    options: PyTree  #: static options of `begin` and `advance`.
    sides: tuple[int, ...]  #: side of each leg or foot in the results, 0 right, 1 left.


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
    arrays = []
    for shape, kind in structure.leaves:
        first, size = at[kind], math.prod(shape)
        at[kind] = first + size
        arrays.append(by_type[kind][first : first + size].reshape(shape))
    return jax.tree.unflatten(structure.tree, arrays)


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


def _advanced(
    constants: list[PyTree], parts: list[PyTree], block: Values, count: Values, *, device: tuple[PyTree, ...],
    structures: tuple[Structure, Structure], width: int,
) -> tuple[list[PyTree], Values]:  # fmt: skip
    """The packed state after a block of samples, and the results as a matrix (`BLOCK`, width).

    The block is the only turn of a loop: XLA compiles a small loop to one function, and a program of some 500
    operations to as many, whose calls take longer than their arithmetic.
    """
    _, advance, options = device
    fixed, moving = structures

    def turn(kept: tuple[PyTree, ...]) -> tuple[PyTree, ...]:
        # as if all depended on the number of the turn, or XLA would compute a part before the loop
        (number, parts, _), columns, samples, real = lax.optimization_barrier((kept, constants, block, count))
        state = unpacked(parts, moving)
        after, outputs = advance(unpacked(columns, fixed), state, _samples(samples), real, options)
        rows = [jnp.asarray(leaf, block.dtype).reshape(block.shape[0], -1) for leaf in jax.tree.leaves(outputs)]
        return number + 1, packed(_like(after, state)), jnp.concatenate(rows, axis=1)

    turns = jnp.minimum(count, 1)  # not a constant, or XLA would remove the loop
    none = jnp.zeros((block.shape[0], width), block.dtype)
    return lax.while_loop(lambda kept: kept[0] < turns, turn, (jnp.zeros_like(turns), parts, none))[1:]


@functools.cache
def _compiled(
    device: tuple[PyTree, ...], structures: tuple[Structure, Structure], width: int
) -> Callable[..., tuple[list[PyTree], Values]]:
    """`_advanced` for a device, compiled once for all persons."""
    fixed = functools.partial(_advanced, device=device, structures=structures, width=width)
    options = compiler_options()
    if options:  # a constant that is computed before the loop is one more call
        options = options | {"xla_disable_hlo_passes": "while-loop-invariant-code-motion"}
    return jax.jit(fixed, compiler_options=options or None)


_begin = compiled(_begun, static_argnames=("device",))


type Field = tuple[jax.tree_util.PyTreeDef, list[tuple[slice, tuple[int, ...], np.dtype]]]
"""A field of the results: its tree, and columns, shape and type of each leaf."""


def _fields(outputs: PyTree) -> tuple[dict[str, Field], int]:
    """The fields of results (n, …), and the number of columns of their matrix."""
    width = 0
    fields: dict[str, Field] = {}
    for name, value in zip(outputs._fields, outputs, strict=True):
        leaves, tree = jax.tree.flatten(value)
        columns = []
        for leaf in leaves:
            size = math.prod(leaf.shape[1:])
            columns.append((slice(width, width + size), leaf.shape[1:], np.dtype(leaf.dtype)))
            width += size
        fields[name] = (tree, columns)
    return fields, width


class Results:
    """Results of n samples; each field is taken out of a matrix (n, width) when it is asked for."""

    def __init__(self, matrix: np.ndarray, fields: dict[str, Field]) -> None:
        self._matrix, self._fields = matrix, fields

    def __contains__(self, name: str) -> bool:
        return name in self._fields

    def field(self, name: str, at: PyTree = slice(None)) -> PyTree:
        """A field of the results, leaves (n, …), at all or some of the samples; None if it is None."""
        tree, leaves = self._fields[name]
        rows = self._matrix[at]
        parts = (rows[:, columns].reshape(-1, *shape).astype(kind, copy=False) for columns, shape, kind in leaves)
        return jax.tree.unflatten(tree, parts)


class Runner:
    """A device and its state, which has a fixed size; its programs are compiled here, before the first sample."""

    def __init__(self, device: Device) -> None:
        self.device = device
        self._dtype = jnp.zeros(()).dtype
        self._parts: list[PyTree] | None = None
        functions = device.begin, device.advance, device.options
        self._on = host() or jax.config.jax_default_device
        with jax.default_device(self._on):
            constants = jax.tree.map(jnp.asarray, device.constants)
            self._begun = functools.partial(_begin, constants, device=functions)
            empty = np.zeros((BLOCK, 1 + 8 * len(device.placements)), self._dtype)
            state = self._begun(empty[0])
            shapes = jax.eval_shape(
                lambda c, s, b: device.advance(c, s, _samples(b), np.int32(1), device.options)[1],
                constants, state, empty,
            )  # fmt: skip
            self._fields, width = _fields(shapes)
            self._constants = packed(constants)
            self._loop = _compiled(functions, (Structure.of(constants), Structure.of(state)), width)
            self._loop(self._constants, packed(state), empty, np.int32(0))

    @property
    def state_bytes(self) -> int:
        """Memory of the state [bytes]; 0 before the first sample."""
        return sum(part.nbytes for part in self._parts or [])

    def push(self, rows: np.ndarray) -> Results:
        """The results after each of n > 0 samples, (n, 1 + 8 k): dt, and gyr, acc, turned, felt of each sensor."""
        with jax.default_device(self._on):
            return self._pushed(rows)

    def _pushed(self, rows: np.ndarray) -> Results:
        rows = rows.astype(self._dtype, copy=False)
        if self._parts is None:
            self._parts = packed(self._begun(rows[0]))
        done = []
        for first in range(0, len(rows), BLOCK):
            part = rows[first : first + BLOCK]
            block = np.zeros((BLOCK, rows.shape[1]), self._dtype)
            block[: len(part)] = part
            self._parts, results = self._loop(self._constants, self._parts, block, np.int32(len(part)))
            while not results.is_ready():  # a third of a millisecond; to wake a sleeping thread adds up to a half of it
                pass
            done.append(np.asarray(results)[: len(part)])
        return Results(done[0] if len(done) == 1 else np.concatenate(done), self._fields)
