"""Smoothing that linearises the model again about the smoothed trajectory, pass after pass.

Each pass is the filter and smoother of a linear model whose A, c, Q, H, R and e are known for all samples; the limit is
the most probable trajectory.
"""

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from jgait.filtering.batch import Batched, differentiable
from jgait.filtering.covariance import Places
from jgait.filtering.inputs import Inputs
from jgait.filtering.lanes import applied, product, product_transposed, summed, where
from jgait.filtering.linear import Known, Linear, distinct
from jgait.filtering.methods import EKF, IteratedSmoother
from jgait.filtering.posterior import NEEDS, closure, covariances, fields_of, states
from jgait.filtering.recorded import FOR_SMOOTHER, Recorded
from jgait.filtering.scan import Sample, filter_scan, nothing_after, smoother_scan

type Before = tuple[list[Float[Array, ""]], list[Float[Array, ""]], Float[Array, ""]]
"""State before an interval, control, dt."""


@dataclass(frozen=True)
class LinearSmoother(Batched):
    """Smoothed means (T, n), and covariances of some components, of linear models: A, c, Q, H, R, e over samples.

    The belief before the first sample is zero, without variance.
    """

    chosen: tuple[int, ...]

    @property
    def block(self) -> int:
        """Recordings computed at once."""
        return 8

    def value(self, *arguments: Array) -> list[Array]:
        """The outputs, time axis in front and batch behind."""
        lanes = max(v.shape[-1] for v in arguments)
        A, c, Q, H, R, e = (jnp.broadcast_to(v, (*v.shape[:-1], lanes)) for v in arguments)
        samples = Sample(e, (A, c, Q, H, R), jnp.ones_like(e[:, 0]), jnp.ones_like(e, bool))
        start = jnp.zeros_like(c[0]), jnp.zeros_like(c[0]), jnp.zeros_like(A[0])
        named = filter_scan(Known(lanes), start, samples, ("x", "delta", *FOR_SMOOTHER), None)[1]
        after = nothing_after(c.shape[1], lanes, c.dtype, bool(self.chosen))
        keep = ("move", "smoothed") if self.chosen else ("move",)
        back = smoother_scan(named, self.chosen, after, keep, None)[1]
        return [named["x"] + named["delta"] + back["move"], *([back["smoothed"]] if self.chosen else [])]


def iterated(
    given: Inputs, method: IteratedSmoother, fields: tuple[str, ...], chosen: tuple[int, ...]
) -> dict[str, Any]:
    """Smoothed mean and covariance after the last pass, and the fields of the first pass, the EKF's, by name."""
    shape, arrays = given.shape, [value[..., None] for value in given.arrays()]
    names = tuple(dict.fromkeys((*(n for field in fields for n in NEEDS[field]), "x", "delta", "move")))
    outputs = differentiable(Recorded(shape, EKF(), names), method.derivative)(*arrays)
    field_values = fields_of(given, fields, (), dict(zip(names, (v[..., 0] for v in outputs), strict=True)))
    params, (start, cov), samples = Recorded(shape, EKF(), names).split(arrays)
    inner, length = closure(shape, chosen), given.length + 1
    # The initial belief is the first sample: nothing moves into it, and nothing is measured.
    longer = jax.tree.map(lambda v: jnp.concatenate([v[:1], v])[..., 0], samples)
    longer = longer._replace(visible=longer.visible.at[0].set(False))
    linear, smooth = Linear(shape, params, length, EKF()), differentiable(LinearSmoother(inner), method.derivative)

    def smoothed_again(carry: tuple[Array, ...], _: None) -> tuple[tuple[Array, ...], None]:
        at = states(shape, *carry[:2])
        elements = about(linear, at, (start, cov), longer)
        return (at, *(v[..., 0] for v in smooth(*(v[..., None] for v in elements)))), None

    at = jnp.concatenate([start[:, 0][None], field_values["smoothed_mean"]])
    zero = jnp.zeros((length, shape.error.size), shape.dtype)
    covs = [jnp.zeros((length, len(inner), len(inner)), shape.dtype)] if inner else []
    at, delta, *covs = (v[1:] for v in lax.scan(smoothed_again, (at, zero, *covs), length=method.passes - 1)[0])
    field_values["smoothed_mean"] = states(shape, at, delta)
    if inner:
        field_values["smoothed_cov"] = covariances(shape, inner, at, delta, covs[0]), inner
    return field_values


def about(linear: Linear, at: Float[Array, "time k"], start: tuple[Array, Array], samples: Sample) -> list[Array]:
    """A, c, Q, H, R and e of errors about a trajectory, time in front; `start`: initial mean and covariance.

    The noise is r = x ⊖ f(x'), of errors about f(x'). With T = ∂e/∂r, errors move by e = T (∂r/∂e' e' − r + w).
    """
    shape, places = linear.shape, list[Places]()

    def moved(params: list[Array], given: Before, e: list[Array]) -> list[Array]:
        before, u, dt = given
        after = shape.model.transition(*linear.unpacked(params, shape.retract(before, e), u), dt)
        return shape.arrays(shape.state.components(after, shape.dtype, "what transition returns"))

    def off(params: list[Array], given: tuple[list[Array], Before], e: list[Array]) -> list[Array]:
        return shape.local(moved(params, given[1], e), given[0])

    def turned(_: list[Array], given: tuple[list[Array], list[Array]], d: list[Array]) -> list[Array]:
        return shape.local(given[0], shape.retract(given[1], d))

    def transition_terms(
        params: list[Array], before: list[Array], now: list[Array], first: list[Array], begins: Array, u: list[Array],
        dt: Array,
    ) -> tuple[list[Array], list[Array], list[Array], list[Array]]:  # fmt: skip
        came = moved(params, (before, u, dt), [jnp.zeros((), shape.dtype)] * shape.error.size)
        finite = jnp.isfinite(sum(came))
        arrived = [jnp.where(begins, a, jnp.where(finite, b, c)) for a, b, c in zip(first, came, before, strict=True)]
        gap = shape.local(arrived, now)
        noise = shape.model.transition_noise(*linear.unpacked(params, before, u), dt)
        entries = shape.noise(noise, shape.error, "what transition_noise returns")
        return gap, arrived, shape.retract(arrived, gap), distinct(entries, places=places, shape=shape)

    x, zero = list(at.T), [jnp.zeros_like(at[:, 0])] * shape.error.size
    begins = jnp.arange(len(at)) == 0
    controls = [*samples.control]
    before = [jnp.concatenate([v[:1], v[:-1]]) for v in x]
    gap, arrived, place, noise = linear.over(
        transition_terms, before, x, [v[0] for v in start[0]], begins, controls, samples.dt
    )
    slope = [-v for v in linear.pushed(off, (x, (before, controls, samples.dt)), zero, linear.directions)[1]]
    turn = linear.pushed(turned, (place, arrived), gap, linear.directions)[1]
    D, T, Q = jnp.stack(slope), jnp.stack(turn), linear.matrix(noise, places, shape.error.size)
    # A transition that is not finite leaves the state where it was, as in the filter.
    finite = jnp.isfinite(summed(D) + summed(Q))
    D = where(finite, D, jnp.eye(len(D), dtype=D.dtype)[:, :, None])
    D = where(begins, jnp.zeros_like(D), D)
    Q = where(finite, Q, 0.0)
    Q = where(begins, jnp.broadcast_to(start[1], Q.shape), Q)
    H, R, e = linear.observation(x, controls, list(samples.measured.T), list(samples.visible.T))
    elements = product(T, D), -applied(T, jnp.stack(gap)), product_transposed(product(T, Q), T), H, R, e
    return [jnp.moveaxis(v, -1, 0) for v in elements]
