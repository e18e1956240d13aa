"""Which directions of a state the observations of a model can tell."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree

from jgait.filtering import Model


def observability_matrix(model: Model, params: Any, state: Any, control: Any, dt: Any, seen: Any = None) -> np.ndarray:
    """[H; H A; …; H Aⁿ⁻¹] of a model linearised at a state (n m, n), by autodiff, in float64 on the host.

    Args:
        model: state-space model without manifold.
        params: of the model.
        state: tuple of n scalars, where to linearise.
        control: of the model.
        dt: interval [s].
        seen: observation tuple of m bools: rows that count; None: all.
    """
    flat, back = ravel_pytree(jax.tree.map(lambda v: jnp.asarray(v, jnp.result_type(float)), state))

    def moved(x: Any) -> Any:
        return ravel_pytree(model.transition(params, back(x), control, dt))[0]

    def read(x: Any) -> Any:
        return ravel_pytree(model.observation(params, back(x), control))[0]

    step = np.asarray(jax.jacfwd(moved)(flat), np.float64)
    row = np.asarray(jax.jacfwd(read)(flat), np.float64)
    if seen is not None:
        row = row[np.asarray(jax.tree.leaves(seen), bool)]
    rows = [row]
    for _ in range(flat.size - 1):
        rows.append(rows[-1] @ step)
    return np.concatenate(rows)


def observability_rank(model: Model, params: Any, state: Any, control: Any, dt: Any, seen: Any = None) -> int:
    """How many directions of the state the observations can tell: the rank of `observability_matrix`.

    Arguments as there. Directions that are seen only through a billionth of another do not count.
    """
    matrix = observability_matrix(model, params, state, control, dt, seen)
    return int(np.linalg.matrix_rank(matrix, rtol=1e-9 if jnp.result_type(float) == jnp.float64 else 1e-6))
