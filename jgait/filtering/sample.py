"""Random states and observations of a model."""

import jax
import jax.numpy as jnp
from jax import lax
from jax.typing import DTypeLike
from jaxtyping import PRNGKeyArray, PyTree

from jgait.filtering import checks
from jgait.filtering.component_model import Shape, component_model, error_structure, scalars
from jgait.filtering.components import Matrix
from jgait.filtering.model import Model
from jgait.types import Values


def draw(
    key: PRNGKeyArray, model: Model, params: PyTree, samples: int, *, controls: PyTree = None, dt: Values = 1.0
) -> tuple[PyTree, PyTree]:
    """Draw one random recording from a model, for tests, power studies, and checks that a fit recovers parameters.

        x₀ ~ N(m₀, P₀),  x_k = f(x_{k−1}) ⊕ N(0, Q),  y_k = h(x_k) + N(0, R)

    Args:
        key: PRNG key.
        model: state-space model.
        params: any pytree, passed on to the model's functions.
        samples: T, number of samples.
        controls: control tuple of (T,) arrays, or None.
        dt: interval [s], scalar or (T,), as in `kalman_filter`.

    Returns:
        States and observations in the model's types, time axis in front. Pure, for `jax.vmap` over keys.

    Raises:
        ValueError: if a result of the model's functions has the wrong type.
    """
    belief = model.initial(params)
    first = None if controls is None else jax.tree.map(lambda leaf: leaf[0], controls)
    dtype = checks.common_dtype(params, belief.mean, controls)
    reading = model.observation(params, belief.mean, first)
    state: PyTree = jax.tree.structure(belief.mean)
    shape = Shape(model, None, None, state, error_structure(model, state, dtype), jax.tree.structure(reading), dtype)
    cm = component_model(shape, params)
    begin, process, sensing = jax.random.split(key, 3)
    _, size, observed = shape.sizes
    start = scalars(belief.mean, state, dtype, "the mean of a belief")
    start = cm.retract(start, list(_shocks(belief.cov.dense(), jax.random.normal(begin, (size,), dtype))))
    shocks = jax.random.normal(process, (samples, size), dtype)
    errors = jax.random.normal(sensing, (samples, observed), dtype)
    interval = jnp.broadcast_to(jnp.asarray(dt, dtype), (samples,))

    def body(x: PyTree, sample: PyTree) -> tuple[PyTree, PyTree]:
        shock, error, control, step = sample
        noise = _shocks(_dense(cm.transition_noise(list(x), control, step), dtype), shock)
        x = _typed(cm.retract(cm.transition(list(x), control, step), list(noise)), dtype)
        error = _shocks(_dense(cm.observation_noise(x, control), dtype), error)
        return x, (x, [a + e for a, e in zip(cm.observation(x, control), error, strict=True)])

    _, (states, observations) = lax.scan(body, _typed(start, dtype), (shocks, errors, controls, interval))
    return shape.state.unflatten(states), shape.observed.unflatten(observations)


def _shocks(cov: PyTree, normal: PyTree) -> PyTree:
    """A draw with the covariance (n, n), which may be singular, from independent normal numbers (n,)."""
    values, vectors = jnp.linalg.eigh(jnp.asarray(cov, normal.dtype))
    return (vectors * jnp.sqrt(jnp.maximum(values, 0.0))[None, :]) @ normal


def _typed(values: list[PyTree], dtype: DTypeLike) -> list[PyTree]:
    return [jnp.asarray(value, dtype) for value in values]


def _dense(matrix: Matrix, dtype: DTypeLike) -> PyTree:
    return jnp.stack([jnp.stack(_typed(row, dtype)) for row in matrix])
