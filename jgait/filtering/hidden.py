"""Observations that are never measured: a mask that is the constant False removes them from the model.

A mask's leaf is constant if it is Python's or NumPy's scalar False, known while a program is traced. The leaf's
component is then None in observation, noise and mask, and the filter uses the other components.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import jax
import numpy as np
from jaxtyping import PyTree

from jgait.filtering.covariance import Covariance
from jgait.filtering.model import Model


def without_hidden(model: Model, observation: PyTree, mask: PyTree) -> tuple[Model, PyTree, PyTree]:
    """Model, observation and mask without the components that are never measured.

    Args:
        model: state-space model.
        observation: observation tuple.
        mask: observation tuple of masks, of which some may be the constant False; any other mask does not change.

    Returns:
        The three, unchanged if nothing is hidden. If everything is hidden, one component stays, masked everywhere.
    """
    structure: PyTree = jax.tree.structure(observation)
    if mask is None or structure != jax.tree.structure(mask):
        return model, observation, mask
    leaves = jax.tree.leaves(mask)
    hidden = [isinstance(leaf, bool | np.bool_) and not leaf for leaf in leaves]
    if not any(hidden):
        return model, observation, mask
    if all(hidden):
        hidden[0] = False
        leaves[0] = np.zeros(np.shape(jax.tree.leaves(observation)[0]), bool)
        mask = structure.unflatten(leaves)
    part = _Part(structure, tuple(hidden))
    return _reduced(model, part), part(observation), part(mask)


@dataclass(frozen=True)
class _Part:
    """The selection of measured components of an observation tuple; hashable, so that a reduced model compiles once."""

    structure: Any
    hidden: tuple[bool, ...]

    def __call__(self, values: PyTree) -> PyTree:
        leaves = zip(jax.tree.leaves(values), self.hidden, strict=True)
        return self.structure.unflatten([None if gone else leaf for leaf, gone in leaves])

    def noise(self, values: PyTree) -> PyTree:
        """The measured components of a tuple of variances, or of a covariance."""
        if not isinstance(values, Covariance):
            return self(values)
        kept = [i for i, gone in enumerate(self.hidden) if not gone]
        pairs = [(values.names[i], values.names[j]) for number, i in enumerate(kept) for j in kept[number:]]
        like = jax.tree.structure(self(self.structure.unflatten(range(len(self.hidden)))))
        return Covariance(tuple(values[pair] for pair in pairs), like)

    def whole(self, values: PyTree) -> PyTree:
        """The full tuple, 0 where a component is hidden."""
        left = iter(jax.tree.leaves(values))
        return self.structure.unflatten([0.0 if gone else next(left) for gone in self.hidden])


@lru_cache(maxsize=256)
def _reduced(model: Model, part: _Part) -> Model:
    error, residual = model.error_observation, model.residual
    return model._replace(
        observation=lambda p, state, control: part(model.observation(p, state, control)),
        observation_noise=lambda p, state, control: part.noise(model.observation_noise(p, state, control)),
        residual=None if residual is None else lambda a, b: part(residual(part.whole(a), part.whole(b))),
        error_observation=None if error is None else lambda *arguments: part(error(*arguments)),
    )
