"""An estimator that runs sample by sample: its state between blocks of samples as a few arrays, compiled once.

A call of a compiled program takes a microsecond or more for each array. So the state, some 200 arrays, and the results
are kept as one array a type, samples are one matrix, and a call processes up to `BLOCK` samples. Blocks of any size
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

from jgait.geometry.arrays import compiled, compiler_options, host
from jgait.notes import record
from jgait.types import Counts, Flags, Values

BLOCK = 16
"""[samples] Most samples of one call of the compiled program; longer blocks are divided. Chosen by hand."""


class Readings(NamedTuple):
    """One sample of k sensors, or n samples with an axis in front."""

    dt: Values  #: time since the previous sample [s]; 0 at the first.
    gyr: Values  #: (k, 3) angular rate [rad/s]; 0 where it is lost.
    acc: Values  #: (k, 3) specific force [m/s²]; 0 where it is lost.
    turned: Flags  #: (k,) bool, the angular rate was measured.
    acc_measured: Flags  #: (k,) bool, the specific force was measured.


@record
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


def packed(tree: PyTree, rows: tuple[int, ...] = ()) -> list[PyTree]:
    """A tree of arrays as one flat array a type, or one of rows if all leaves have them."""
    leaves = jax.tree.leaves(tree)
    return [
        jnp.concatenate([leaf.reshape(*rows, -1) for leaf in leaves if leaf.dtype == kind], axis=-1)
        for kind in sorted({np.dtype(leaf.dtype) for leaf in leaves}, key=str)
    ]


def unpacked(parts: list[PyTree], structure: Structure, rows: tuple[int, ...] = ()) -> PyTree:
    """Inverse of `packed`; the structure is that of the whole tree, or of one row."""
    by_type, at = {np.dtype(part.dtype): part for part in parts}, {np.dtype(part.dtype): 0 for part in parts}
    arrays = []
    for shape, kind in structure.leaves:
        first, at[kind] = at[kind], at[kind] + math.prod(shape)
        arrays.append(by_type[kind][..., first : at[kind]].reshape(*rows, *shape))
    return jax.tree.unflatten(structure.tree, arrays)


def _samples(rows: Values) -> Readings:
    """Rows (n, 1 + 8 k), or one row, as samples."""
    sensors = rows[..., 1:].reshape(*rows.shape[:-1], -1, 8)
    return Readings(rows[..., 0], sensors[..., :3], sensors[..., 3:6], sensors[..., 6] > 0.5, sensors[..., 7] > 0.5)


def _begun(constants: PyTree, row: Values, *, device: tuple[PyTree, ...]) -> list[PyTree]:
    begin, _, options = device
    return packed(begin(constants, _samples(row), options))


_begin = compiled(_begun, static_argnames=("device",))


@functools.cache
def _compiled(
    device: tuple[PyTree, ...], fixed: Structure, moving: Structure, results: Structure
) -> Callable[..., PyTree]:
    """The program of a device, compiled once for all persons: (constants, state, block, count) → state and results.

    The block is the only turn of a loop: XLA compiles a small loop to one function, and a program of some 500
    operations to as many, whose calls take longer than their arithmetic.
    """
    _, advance, options = device

    def advanced(constants: list[PyTree], parts: list[PyTree], block: Values, count: Values) -> PyTree:
        def turn(kept: tuple[PyTree, ...]) -> tuple[PyTree, ...]:
            # as if all depended on the number of the turn, or XLA would compute a part before the loop
            (number, parts, _), columns, samples, real = lax.optimization_barrier((kept, constants, block, count))
            state = unpacked(parts, moving)
            after, outputs = advance(unpacked(columns, fixed), state, _samples(samples), real, options)
            after = jax.tree.map(lambda new, old: jnp.asarray(new, old.dtype), after, state)
            return number + 1, packed(after), packed(outputs, (BLOCK,))

        turns = jnp.minimum(count, 1)  # not a constant, or XLA would remove the loop
        none = packed([jnp.zeros(*leaf) for leaf in results.leaves], (BLOCK,))
        return lax.while_loop(lambda kept: kept[0] < turns, turn, (jnp.zeros_like(turns), parts, none))[1:]

    more = compiler_options()
    if more:  # a constant that is computed before the loop is one more call
        more = more | {"xla_disable_hlo_passes": "while-loop-invariant-code-motion"}
    return jax.jit(advanced, compiler_options=more or None)


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
            empty = np.zeros((BLOCK, 1 + 8 * len(device.placements)), self._dtype)

            def all_(constants: PyTree, rows: Values) -> tuple[PyTree, PyTree]:
                state = device.begin(constants, _samples(rows[0]), device.options)
                return state, device.advance(constants, state, _samples(rows), np.int32(1), device.options)[1]

            state, results = jax.eval_shape(all_, constants, empty)
            self._row = Structure.of(
                jax.tree.map(lambda leaf: jax.ShapeDtypeStruct(leaf.shape[1:], leaf.dtype), results)
            )
            self._begun = functools.partial(_begin, constants, device=functions)
            self._constants = packed(constants)
            self._loop = _compiled(functions, *map(Structure.of, (constants, state, results)))
            self._loop(self._constants, self._begun(empty[0]), empty, np.int32(0))

    @property
    def state_bytes(self) -> int:
        """Memory of the state [bytes]; 0 before the first sample."""
        return sum(part.nbytes for part in self._parts or [])

    def push(self, rows: np.ndarray) -> PyTree:
        """The results after each of n > 0 samples, (n, 1 + 8 k): the fields of `Readings` one after another."""
        rows = rows.astype(self._dtype, copy=False)
        done = []
        with jax.default_device(self._on):
            for first in range(0, len(rows), BLOCK):
                part = rows[first : first + BLOCK]
                block = np.zeros((BLOCK, rows.shape[1]), self._dtype)
                block[: len(part)] = part
                before = self._begun(rows[0]) if self._parts is None else self._parts
                self._parts, results = self._loop(self._constants, before, block, np.int32(len(part)))
                while not results[0].is_ready():  # a third of a millisecond; to wake a sleeping thread adds half of it
                    pass
                done.append([np.asarray(array)[: len(part)] for array in results])
        parts = done[0] if len(done) == 1 else [np.concatenate(each) for each in zip(*done, strict=True)]
        return unpacked(parts, self._row, (len(rows),))
