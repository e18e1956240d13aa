"""Random states and observations of a model."""

import jax
import jax.numpy as jnp
from jax import lax
from jax.typing import DTypeLike
from jaxtyping import Array, PRNGKeyArray, PyTree

from jgait.filtering.covariance import Covariance, Entries, Layout, Numbers, Tree
from jgait.filtering.inputs import common_dtype, error_layout
from jgait.filtering.model import Model, Shape


def draw(
    key: PRNGKeyArray, model: Model, params: Tree, samples: int, *, dt: Numbers, controls: Tree = None
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
    dtype = common_dtype(params, belief.mean, controls)
    reading = model.observation(params, belief.mean, first)
    state, observed = Layout.of(belief.mean), Layout.of(reading)
    shape = Shape(
        model, jax.tree.structure(params), Layout.of(controls, 1), state, error_layout(model, state, dtype), observed,
        tuple(range(observed.size)), jnp.dtype(dtype),
    )  # fmt: skip

    def moved(x: Array, cov: Covariance | Tree, layout: Layout, normal: Array, what: str) -> Array:
        """The state (k,) with a random error."""
        error = _shocks(_dense(shape.noise(cov, layout, what), layout, dtype), normal)
        return jnp.stack(shape.retract(list(x), list(error)))

    begin, process, sensing = jax.random.split(key, 3)
    mean = jnp.stack(shape.arrays(state.components(belief.mean, dtype, "the mean of a belief")))
    normal = jax.random.normal(begin, (shape.error.size,), dtype)
    start = moved(mean, belief.cov, shape.error, normal, "the covariance of a belief")
    shocks = jax.random.normal(process, (samples, shape.error.size), dtype)
    errors = jax.random.normal(sensing, (samples, observed.size), dtype)
    interval = jnp.broadcast_to(jnp.asarray(dt, dtype), (samples,))

    def body(x: Array, sample: tuple[Array, Array, Tree, Array]) -> tuple[Array, tuple[Array, Array]]:
        shock, error, control, step = sample
        now = state.split(x)
        noise = model.transition_noise(params, now, control, step)
        after = state.components(model.transition(params, now, control, step), dtype, "what transition returns")
        x = moved(jnp.stack(shape.arrays(after)), noise, shape.error, shock, "what transition_noise returns")
        now = state.split(x)
        spread = shape.noise(model.observation_noise(params, now, control), observed, "what observation_noise returns")
        error = _shocks(_dense(spread, observed, dtype), error)
        reading = observed.components(model.observation(params, now, control), dtype, "what observation returns")
        return x, (x, jnp.stack(shape.arrays(reading)) + error)

    _, (states, observations) = lax.scan(body, start, (shocks, errors, controls, interval))
    return state.split(states), observed.split(observations)


def _shocks(cov: Array, normal: Array) -> Array:
    """A draw with the covariance (n, n), which may be singular, from independent normal numbers (n,)."""
    values, vectors = jnp.linalg.eigh(jnp.asarray(cov, normal.dtype))
    return (vectors * jnp.sqrt(jnp.maximum(values, 0.0))[None, :]) @ normal


def _dense(entries: Entries, layout: Layout, dtype: DTypeLike) -> Array:
    return Covariance.of(entries, layout).dense().astype(dtype)
