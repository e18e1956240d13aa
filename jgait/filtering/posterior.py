"""What a filter and a smoother return, from what their scans compute about the predicted states.

On a manifold an error about one state is another error about the next: δ + e about x is T e about x ⊕ δ, with
T = ∂/∂e of (x ⊕ (δ + e)) ⊖ (x ⊕ δ). Arrays have the time axis in front.
"""

import math
from collections.abc import Callable
from functools import cache, partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, PyTree

from jgait.filtering.covariance import Covariance, Layout
from jgait.filtering.inputs import Inputs
from jgait.filtering.linear import Shape
from jgait.filtering.model import Belief
from jgait.filtering.step import product, product_transposed
from jgait.geometry.arrays import reached, xp
from jgait.geometry.vectors import root
from jgait.notes import record
from jgait.types import Counts, Maybe


@record
class Posterior(NamedTuple):
    """A filtered recording; every leaf has the time axis in front, and a field not in `keep` is None."""

    mean: PyTree = None  #: filtered mean, in the state's type.
    cov: Maybe[Covariance] = None  #: covariance of `mean`.
    innovation: PyTree = None  #: measured − predicted, in the observation's type; 0 where masked.
    innovation_stddev: PyTree = None  #: standard deviation of `innovation`, in the observation's type; 1 where masked.
    #: (T,) log-density of each sample given the past [nat], linearised at the prediction; NaN if a parameter is NaN.
    log_likelihood: Maybe[Float[Array, "*batch time"]] = None
    #: (T,) normalised innovation squared, χ² with `count` degrees of freedom, linearised at the prediction.
    nis: Maybe[Float[Array, "*batch time"]] = None
    count: PyTree = None  #: (T,) number of measured components, as a float.
    #: (T,) False where the numbers were not finite and the prediction was kept; the five fields above are then 0.
    valid: Maybe[Bool[Array, "*batch time"]] = None

    def belief(self, at: Counts | tuple[()] = ()) -> Belief:
        """The belief after sample `at`, or after the only one, of `step`."""
        return Belief(*jax.tree.map(lambda leaf: leaf[at], (self.mean, self.cov)))

    def student_t(self, freedom: float) -> Float[Array, "*batch time"]:
        """(T,) log-density of each sample [nat] under Student's t with the innovation's covariance for its scale.

        With few degrees of freedom, samples far from their prediction count little; with many it is `log_likelihood`.
        """
        size = self.count
        log_det = -2.0 * self.log_likelihood - self.nis - size * math.log(2.0 * math.pi)
        constant = jax.lax.lgamma(0.5 * (freedom + size)) - math.lgamma(0.5 * freedom)
        constant -= 0.5 * size * math.log(math.pi * freedom)
        return constant - 0.5 * log_det - 0.5 * (freedom + size) * jnp.log1p(self.nis / freedom)


FIELDS = Posterior._fields
"""The names of the fields that a filter can return, see `Posterior`."""

KEEP = ("mean", "cov", "innovation", "log_likelihood", "nis", "count", "valid")
"""The fields of a posterior that a filter returns by default."""

SUMMARY = ("log_likelihood", "nis", "count", "valid")
"""Fields of the filter's posterior that measure how well the model fits."""

NEEDS = {
    "mean": ("x", "delta"), "cov": ("x", "delta", "cov"), "innovation": ("innovation",),
    "innovation_stddev": ("variance", "valid"), "log_likelihood": ("nis", "log_det", "valid"), "nis": ("nis",),
    "count": ("valid",), "valid": ("valid",),
}  # fmt: skip
"""Field of `Posterior` → outputs of the scan that it is computed from."""


@record
class Inferred(NamedTuple):
    """A filtered or smoothed recording."""

    mean: PyTree  #: mean in the state's type, time axis in front.
    cov: Maybe[Covariance]  #: covariance of `mean`, or None if `covariance` is False.
    filtered: Posterior  #: the filter's `Posterior`, with the fields in `keep`.

    @property
    def log_likelihood(self) -> Float[Array, "*batch"]:
        """Log-likelihood of all observations, each given the past [nat]."""
        return xp.sum(self.filtered.log_likelihood)

    @property
    def nis(self) -> Float[Array, "*batch"]:
        """Mean normalised innovation squared: 1 if the model's noise is equal to the noise of the observations."""
        return xp.sum(self.filtered.nis) / xp.maximum(xp.sum(self.filtered.count), 1.0)


def places_of(covariance: bool | tuple[str, ...], error: Layout) -> tuple[int, ...]:
    """The numbers of the error components with the given names; raises ValueError for an unknown name."""
    if isinstance(covariance, bool):
        return tuple(range(error.size)) if covariance else ()
    wanted = set[int]()
    for name in covariance:
        try:
            wanted.update(error.places(name))
        except KeyError as unknown:
            names = ", ".join(error.names)
            raise ValueError(f"covariance names components of the error ({names}); got {name!r}") from unknown
    return tuple(sorted(wanted))


def fields_of(
    given: Inputs, fields: tuple[str, ...], inner: tuple[int, ...], outputs: dict[str, Array]
) -> dict[str, Array]:
    """Fields of `Posterior`, "smoothed_mean" and "smoothed_cov", from the outputs of `Recorded` (T, …)."""
    shape, out, valid = given.shape, outputs, outputs.get("valid", jnp.zeros(0))
    mean = states(shape, out["x"], out["delta"]) if "x" in out else jnp.zeros(0)  # not read
    field_values: dict[str, Array] = {}
    for name in fields:
        match name:
            case "mean":
                value = mean
            case "cov":
                value = covariances(shape, tuple(range(shape.error.size)), out["x"], out["delta"], out["cov"])
            case "innovation_stddev":
                value = jnp.where(valid[:, None], root(out["variance"]), 0.0)
            case "count" | "log_likelihood":
                visible = jnp.stack([jnp.broadcast_to(jnp.asarray(s), given.length) for s in given.visible], axis=1)
                value = jnp.sum(visible, axis=1, dtype=shape.dtype)
                if name == "log_likelihood":
                    value = -0.5 * (out["nis"] + out["log_det"] + value * math.log(2.0 * math.pi))
                value = jnp.where(valid, value, 0.0)
            case _:
                value = out[name]
        field_values[name] = value
    if "move" in out:
        error = turned(shape, out["x"], out["delta"], out["move"])
        field_values["smoothed_mean"] = states(shape, mean, error)
        if inner:
            about = covariances(shape, inner, out["x"], out["delta"], out["smoothed"])
            field_values["smoothed_cov"] = covariances(shape, inner, mean, error, about)
    return field_values


def inferred(
    given: Inputs, field_values: dict[str, Array], keep: tuple[str, ...], chosen: tuple[int, ...], smooth: bool
) -> Inferred:
    """The result from the fields by name: arrays (T, size), of covariances (T, n, n), or (T,)."""
    shape = given.shape
    if "log_likelihood" in field_values:
        params = [leaf for leaf in jax.tree.leaves(given.params) if jnp.issubdtype(leaf.dtype, jnp.floating)]
        if params:  # no update is valid, and none counts: the sum would be 0
            lost = jnp.any(jnp.stack([jnp.any(jnp.isnan(leaf)) for leaf in params]))
            field_values["log_likelihood"] = jnp.where(lost, jnp.nan, field_values["log_likelihood"])
    named = dict.fromkeys(("innovation", "innovation_stddev"), part_of(shape.observed, shape.measured).split)
    named |= {"mean": shape.state.split, "cov": partial(Covariance.from_dense, like=shape.error)}
    fields = {name: named[name](v) if name in named else v for name, v in field_values.items() if name in FIELDS}
    if not smooth:
        posterior = Posterior(**{name: value for name, value in fields.items() if name in (*keep, "mean", "cov")})
        return Inferred(posterior.mean, posterior.cov, posterior)
    posterior = Posterior(**{name: fields[name] for name in keep})
    cov = None
    if chosen:
        inner = closure(shape, chosen)
        place = jnp.asarray([inner.index(i) for i in chosen])
        matrix = field_values["smoothed_cov"]
        matrix = matrix if inner == chosen else matrix[:, place[:, None], place[None]]
        cov = Covariance.from_dense(matrix, part_of(shape.error, chosen))
    return Inferred(shape.state.split(field_values["smoothed_mean"]), cov, posterior)


def part_of(layout: Layout, chosen: tuple[int, ...]) -> Layout:
    """The layout of a tuple with None for the leaves of which no component is chosen."""
    leaves, shapes, first = [], [], 0
    for shape in layout.shapes:
        size = math.prod(shape)
        here = sum(first <= i < first + size for i in chosen)
        leaves.append(0 if here else None)
        shapes += [shape if here == size else (here,)] if here else []
        first += size
    return Layout(jax.tree.structure(layout.structure.unflatten(leaves)), tuple(shapes))


def states(shape: Shape, x: Float[Array, "time k"], delta: Float[Array, "time n"]) -> Float[Array, "time k"]:
    """The states x ⊕ δ."""
    return _over_time(shape.retract, x, delta) if shape.curved else x + delta


def turned(
    shape: Shape, x: Float[Array, "time k"], delta: Float[Array, "time n"], error: Float[Array, "time n"]
) -> Float[Array, "time n"]:
    """Errors about x as errors about x ⊕ δ, for errors near δ."""
    return _over_time(shape.turned, x, delta, error) if shape.curved else error


def covariances(
    shape: Shape, chosen: tuple[int, ...], x: Float[Array, "time k"], delta: Float[Array, "time n"],
    cov: Float[Array, "time s s"],
) -> Float[Array, "time s s"]:  # fmt: skip
    """Covariances about x ⊕ δ of the components `chosen`, a `closure`, from those about x: T P Tᵀ.

    Only the rows of T that are not constant are computed.
    """
    pattern, varies = influences(shape)
    rows = [place for place, i in enumerate(chosen) if varies[i]]
    columns = [place for place, j in enumerate(chosen) if pattern[[chosen[i] for i in rows], j].any()]
    if not rows:
        return cov
    seeds = np.eye(shape.error.size)[[chosen[j] for j in columns]]

    def some(x: list[Array], delta: list[Array], seed: list[Array]) -> list[Array]:
        every = shape.turned(x, delta, seed)
        return [every[chosen[i]] for i in rows]

    of_seed = jax.vmap(lambda seed: _over_time(some, x, delta, jnp.broadcast_to(seed, delta.shape)).T)
    T = jnp.moveaxis(of_seed(jnp.asarray(seeds, shape.dtype)), 0, 1)  # (row, column, time)
    P = jnp.moveaxis(cov, 0, -1)
    P = P.at[jnp.asarray(rows)].set(product(T, P[jnp.asarray(columns)]))
    P = P.at[:, jnp.asarray(rows)].set(product_transposed(P[:, jnp.asarray(columns)], T))
    return jnp.moveaxis(P, -1, 0)


def closure(shape: Shape, components: tuple[int, ...]) -> tuple[int, ...]:
    """The components of the error that influence the covariances of `components` about another state."""
    pattern, needed = influences(shape)[0], {*components}
    while (more := {*np.flatnonzero(pattern[sorted(needed)].any(axis=0)).tolist()} | needed) != needed:
        needed = more
    return tuple(sorted(needed))


@cache
def influences(shape: Shape) -> tuple[Bool[np.ndarray, "n n"], Bool[np.ndarray, "n"]]:
    """Which components of an error (columns) influence which (rows) by T, and which rows of T are not constant.

    A constant row is that of the identity, for T is the identity at δ = 0.
    """
    k, n = shape.state.size, shape.error.size
    if not shape.curved:
        return np.eye(n, dtype=bool), np.zeros(n, bool)
    scalars = [jax.ShapeDtypeStruct((), shape.dtype)]
    jaxpr = jax.make_jaxpr(shape.turned)(scalars * k, scalars * n, scalars * n).jaxpr
    touched = [reached(jaxpr, {v}) for v in jaxpr.invars[k + n :]]
    return np.array(touched).T, np.array(reached(jaxpr, {*jaxpr.invars[: k + n]}))


def _over_time(function: Callable[..., list[Array]], *arrays: Float[Array, "time size"]) -> Float[Array, "time size"]:
    """The outputs of a function of lists of scalars at each sample of arrays (T, size)."""
    return jnp.stack(jax.vmap(function)(*(list(jnp.unstack(v, axis=-1)) for v in arrays)), axis=-1)
