"""Random states and observations of a model."""

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import PRNGKeyArray, PyTree

from jgait.filtering import checks
from jgait.filtering.model import Model
from jgait.filtering.vectors import pack, unpack, vector_model
from jgait.types import Values


def _root(cov: PyTree) -> Values:
    """A factor of a covariance (n, n), which may be singular."""
    values, vectors = jnp.linalg.eigh(cov)
    return vectors * jnp.sqrt(jnp.maximum(values, 0.0))[None, :]


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
    vm = vector_model(model, params, belief.mean, reading, dtype)
    begin, process, sensing = jax.random.split(key, 3)
    size = vm.error.num_leaves
    start = pack(belief.mean, vm.state, dtype, "mean")
    spread = _root(jnp.asarray(belief.cov.dense(), dtype))
    start = vm.retract(start, spread @ jax.random.normal(begin, (size,), dtype))
    shocks = jax.random.normal(process, (samples, size), dtype)
    errors = jax.random.normal(sensing, (samples, vm.observed.num_leaves), dtype)
    interval = jnp.broadcast_to(jnp.asarray(dt, dtype), (samples,))

    def body(x: PyTree, sample: PyTree) -> tuple[PyTree, PyTree]:
        shock, error, control, step = sample
        noise = _root(vm.transition_noise(x, control, step))
        x = vm.retract(vm.transition(x, control, step), noise @ shock)
        return x, (x, vm.observation(x, control) + _root(vm.observation_noise(x, control)) @ error)

    _, (states, observations) = lax.scan(body, start, (shocks, errors, controls, interval))
    return unpack(states, vm.state), unpack(observations, vm.observed)
