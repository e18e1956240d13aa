"""Random states and observations of a model."""

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, PRNGKeyArray, PyTree

from jgait.filtering.covariance import Covariance, Entries, Layout, Numbers, Tree
from jgait.filtering.inputs import common_dtype, in_dtype, shape_of
from jgait.filtering.model import Model


def draw(
    key: PRNGKeyArray, model: Model, params: Tree, samples: int, *, dt: Numbers, controls: Tree = None
) -> tuple[PyTree, PyTree]:
    """Draw one random recording of T = `samples` from a model: for tests, power studies, and checks of a fit.

        x₀ ~ N(m₀, P₀),  x_k = f(x_{k−1}) ⊕ N(0, Q),  y_k = h(x_k) + N(0, R)

    Arguments as of `kalman_filter`; pure, for `jax.vmap` over keys. Returns states and observations in the model's
    types, time axis in front. Raises ValueError if a result of the model's functions has the wrong type.
    """
    belief = model.initial(params)
    first = None if controls is None else jax.tree.map(lambda leaf: leaf[0], controls)
    dtype = common_dtype(params, belief.mean, controls)
    observed = Layout.of(model.observation(params, belief.mean, first))
    shape = shape_of(model, params, controls, belief.mean, observed, dtype)
    state, leaves = shape.state, jax.tree.leaves(in_dtype(params, dtype))

    def shocks(entries: Entries, layout: Layout, normal: Array) -> Array:
        """A draw with a covariance, which may be singular, from independent normal numbers (n,)."""
        values, vectors = jnp.linalg.eigh(Covariance.of(entries, layout).dense().astype(dtype))
        return (vectors * jnp.sqrt(jnp.maximum(values, 0.0))[None, :]) @ normal

    def body(x: Array, sample: tuple[Array, Array, Tree, Array]) -> tuple[Array, tuple[Array, Array]]:
        shock, error, control, step = sample
        u = shape.arrays(shape.control.components(control, dtype, "the control"))
        noise = shape.transition_noise(leaves, (u, step), list(x))
        now = shape.retract(shape.transition(leaves, (u, step), list(x)), list(shocks(noise, shape.error, shock)))
        reading = jnp.stack(shape.observation(leaves, u, now))
        reading = reading + shocks(shape.observation_noise(leaves, u, now), observed, error)
        return jnp.stack(now), (jnp.stack(now), reading)

    begin, process, sensing = jax.random.split(key, 3)
    cov = shape.noise(belief.cov, shape.error, "the covariance of a belief").entries()
    mean = shape.arrays(state.components(belief.mean, dtype, "the mean of a belief"))
    error = shocks(cov, shape.error, jax.random.normal(begin, (shape.error.size,), dtype))
    start = jnp.stack(shape.retract(mean, list(error)))
    normal = [
        jax.random.normal(k, (samples, of.size), dtype) for k, of in ((process, shape.error), (sensing, observed))
    ]
    series: PyTree = (*normal, controls, jnp.broadcast_to(jnp.asarray(dt, dtype), (samples,)))
    _, (states, observations) = lax.scan(body, start, series)
    return state.split(states), observed.split(observations)
