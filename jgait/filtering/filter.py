"""Filters and smoothers of recordings: one `lax.scan` of predict and update, and one back; random recordings.

The scans are in `jgait.filtering.scan`, predict and update in `jgait.filtering.step`, and the Jacobians, by
`jax.linearize`, in `jgait.filtering.linear`.
"""

from typing import Any, Literal, get_args

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, PRNGKeyArray, PyTree

from jgait.filtering import inputs, posterior
from jgait.filtering.covariance import Covariance, Entries, Layout, Numbers, Tree
from jgait.filtering.methods import EKF, KF, Method
from jgait.filtering.model import Belief, Model
from jgait.filtering.posterior import FIELDS, KEEP, SUMMARY, Inferred, Posterior
from jgait.geometry.arrays import compiled

Execution = Literal["auto", "core", "fast"]
"""The computations of a filter; their results agree up to rounding.

core   `jgait.filtering.scan`: every model and method, short compilation
fast   `jgait.filtering.fast`: scalar components with the structure of the model, several times the rate of the core for
       filters and smoothed means by KF and EKF, on models with few states and observations, without a manifold and
       without a `residual`
auto   `fast` for small models that it can compute, else `core`
"""


def step(
    model: Model, params: Tree, belief: Belief, observation: Tree, *, dt: Numbers, control: Tree = None,
    mask: Tree = None, method: Method = EKF(),
) -> Posterior:  # fmt: skip
    """Predict over dt, then update: one sample online, jitted; `kalman_filter` scans the same step.

    Arguments as of `kalman_filter`, without the time axis: `belief` is that after the previous sample, `dt` the time
    since then [s].

    Returns:
        All fields of `Posterior`, without the time axis; `.belief()` is the input of the next step.

    Raises:
        ValueError: if an argument does not have the type that the model needs, or the observation has NaN.
    """

    def alone[T](tree: T) -> T:
        return jax.tree.map(lambda leaf: leaf if inputs.known_false(leaf) else jnp.asarray(leaf)[None], tree)

    sample = infer(
        model, params, alone(observation), smooth=False, dt=dt, controls=alone(control), mask=alone(mask),
        method=method, initial=belief, keep=FIELDS, execution="core",
    ).filtered  # fmt: skip
    return jax.tree.map(lambda leaf: leaf[0], sample)


def infer(
    model: Model, params: Tree, observations: Tree, *, smooth: bool, dt: Numbers, controls: Tree = None,
    mask: Tree = None, method: Method = EKF(), initial: Belief | None = None,
    keep: tuple[str, ...] = SUMMARY, covariance: bool | tuple[str, ...] = True, execution: Execution = "auto",
) -> Inferred:  # fmt: skip
    """Filter a recording, and smooth it if `smooth`, which is static, is True: means, covariances, filter's posterior.

    Other arguments and errors as of `kalman_smoother`; `covariance` selects smoothed ones, a filter has all or none.
    """
    inputs.check_arguments(model, method, keep, FIELDS, covariance)
    inputs.check_values(observations, controls, dt)
    keep = tuple(keep)
    if not any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves((params, observations, dt, initial))):
        constant = tuple(map(inputs.known_false, jax.tree.leaves(mask)))
        return _program(
            params, observations, controls, dt, mask, initial, model=model, smooth=smooth, method=method, keep=keep,
            covariance=covariance, execution=execution, constant=constant,
        )  # fmt: skip
    given = inputs.checked(model, params, observations, controls, dt, mask, initial)
    shape, chosen = given.shape, posterior.places_of(covariance, given.shape.error)
    fields = keep if smooth else tuple(dict.fromkeys(("mean", *(("cov",) if chosen else ()), *keep)))
    if isinstance(method, KF):
        inputs.check_linear(given)
    if execution not in (names := get_args(Execution)):
        raise ValueError(f"execution must be one of {', '.join(names)}; got {execution!r}")
    # The time to compile `fast` grows with error components × observed components: 1 s at 8 × 2, ten at 15 × 3 (its
    # gradient minutes), longer than most runs.
    small = execution == "auto" and shape.error.size * len(shape.measured) < 32
    # The scans are imported where one is compiled: a program that is kept from another run needs none.
    refused = "core"
    if small or execution == "fast":
        from jgait.filtering.fast import scan as fast

        refused = fast.refused(given, method, smooth and bool(chosen))
        if execution == "fast" and refused:
            raise ValueError(refused)
    if not refused:
        field_values = fast.solve(given, fields, smooth)
    else:
        from jgait.filtering.batch import differentiable
        from jgait.filtering.scan import Recorded

        inner = posterior.closure(shape, chosen) if smooth else ()
        kept = dict.fromkeys(name for field in fields for name in posterior.NEEDS[field])
        if smooth:
            kept |= dict.fromkeys(("x", "delta", "move", *(("smoothed",) if inner else ())))
        run = differentiable(Recorded(shape, method, tuple(kept), inner), method.derivative)
        outputs = run(*(value[..., None] for value in given.arrays()))
        field_values = posterior.fields_of(
            given, fields, inner, dict(zip(kept, (v[..., 0] for v in outputs), strict=True))
        )
    return posterior.inferred(given, field_values, keep, chosen, smooth)


def _jitted(
    params: Tree, observations: Tree, controls: Tree, dt: Numbers, mask: Tree, initial: Belief | None, *,
    constant: tuple[bool, ...], **static: Any,
) -> Inferred:  # fmt: skip
    leaves, structure = jax.tree.flatten(mask)
    mask = jax.tree.unflatten(structure, [False if gone else leaf for leaf, gone in zip(leaves, constant, strict=True)])
    return infer(
        static.pop("model"), params, observations, controls=controls, dt=dt, mask=mask, initial=initial, **static
    )


_STATIC = ("model", "smooth", "method", "keep", "covariance", "execution", "constant")
_program = compiled(_jitted, static_argnames=_STATIC)


def kalman_filter(
    model: Model, params: Tree, observations: Tree, *, dt: Numbers, controls: Tree = None, mask: Tree = None,
    method: Method = EKF(), initial: Belief | None = None, keep: tuple[str, ...] = KEEP, execution: Execution = "auto",
) -> Posterior:  # fmt: skip
    """Filter a recording: a jitted `lax.scan` over its samples, differentiable by all its arguments.

    Args:
        model: state-space model; functions at module level, since the model is a static argument of `jax.jit`.
        params: any pytree, passed on to the model's functions; differentiable.
        observations: observation tuple of arrays with the time axis in front; a masked component may be any finite
            number.
        dt: interval [s], scalar or (T,); dt[k] is the time from sample k−1 to k, so dt[0] = 0 puts the initial
            belief at the first sample. Samples at the end with an interval of 0 and no measurement are padding: they
            do not change the results of others.
        controls: control tuple of arrays with the time axis in front, or None; entry k acts over the interval that
            ends at sample k.
        mask: observation tuple of (T,) bools, one (T,) bool for whole samples, or None. A leaf that is Python's False
            removes its component from the model, which is faster; the component is None in innovations.
        method: `KF()`, `EKF()`, `IteratedEKF(k)`, `UKF()` or `CKF()`; with derivative="forward" for `jax.jvp` and
            `jax.jacfwd`.
        initial: belief before the first interval; None: the model's `initial`.
        keep: fields of `Posterior` to return; other fields are neither computed nor stored.
        execution: the computation, see `jgait.filtering.filter.Execution`; results agree up to rounding.

    Returns:
        The posterior, every leaf with the time axis in front, in the widest float type of parameters, observations
        and initial belief.

    Raises:
        ValueError: if observations, controls, mask or dt have wrong types or shapes, or observations have NaN.
    """
    inferred = infer(
        model, params, observations, smooth=False, dt=dt, controls=controls, mask=mask, method=method,
        initial=initial, keep=keep, covariance="cov" in keep, execution=execution,
    )  # fmt: skip
    return inferred.filtered if "mean" in keep else inferred.filtered._replace(mean=None)


def kalman_smoother(
    model: Model, params: Tree, observations: Tree, *, dt: Numbers, controls: Tree = None, mask: Tree = None,
    method: Method = EKF(), initial: Belief | None = None, keep: tuple[str, ...] = KEEP,
    covariance: bool | tuple[str, ...] = True, execution: Execution = "auto",
) -> Inferred:  # fmt: skip
    """Filter forward, then smooth backward: every sample's estimate uses the whole recording.

    Arguments and errors as of `kalman_filter`; `keep` is of the filter's posterior, which is returned beside means and
    covariances. `covariance`: False omits the smoothed covariances, which is several times faster. A tuple of names
    selects components of the error, ("position",) all components of the position: the `Covariance` then has the
    error's tuple with None for the other components.
    """
    return infer(
        model, params, observations, smooth=True, dt=dt, controls=controls, mask=mask, method=method, initial=initial,
        keep=keep, covariance=covariance, execution=execution,
    )  # fmt: skip


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
    dtype = inputs.common_dtype(params, belief.mean, controls)
    observed = Layout.of(model.observation(params, belief.mean, first))
    shape = inputs.shape_of(model, params, controls, belief.mean, observed, dtype)
    state, leaves = shape.state, jax.tree.leaves(inputs.in_dtype(params, dtype))

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
