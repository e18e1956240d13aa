r"""The iterated smoother: a recording is linearised about its last smoothed trajectory, and smoothed as linear.

With x̄ the trajectory and m = f(x̄ before), x̄ = m ⊕ d, an error δ about x̄ moves by

    δ = U A δ before + T (w − d),   e = H δ + v,

where T maps errors about m, near d, to errors about x̄, and U those of m itself. All samples are linearised at once;
the linear filter and smoother depend on the numbers of components alone. The passes are the Gauss–Newton method for
the most probable trajectory.

Source: B. M. Bell, "The iterated Kalman smoother as a Gauss–Newton method", SIAM J. Optimization 4(3), 1994.
"""

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import PyTree

from jgait.filtering.backward import Backward
from jgait.filtering.batched_call import Batched, call
from jgait.filtering.component_model import Shape
from jgait.filtering.core import block_of
from jgait.filtering.finish import closure, covariances, selected, states
from jgait.filtering.inputs import Inputs
from jgait.filtering.lanes import applied, held, product, product_transposed, summed, where
from jgait.filtering.local_model import LocalModel
from jgait.filtering.methods import EKF
from jgait.filtering.recorded import Recorded
from jgait.filtering.update import joseph, updated


@dataclass(frozen=True)
class LinearSmoother(Batched):
    """Smoothed means (T, n) of a linear model whose A, c, Q, H, e and R are known, and covariances of some components.

    The belief before the first sample is zero, without variance.
    """

    size: int
    chosen: tuple[int, ...]
    dtype: Any

    @property
    def block(self) -> int:
        """Recordings computed at once."""
        return block_of(self.size, self.dtype)

    def shapes(self, *arguments: Any) -> list[Any]:
        """The shapes of the outputs: that of c, and (T, s, s)."""
        cov = (arguments[0].shape[0], *(len(self.chosen),) * 2)
        return [arguments[1], *[jax.ShapeDtypeStruct(cov, self.dtype)] * bool(self.chosen)]

    def value(self, *arguments: PyTree) -> list[PyTree]:
        """The outputs, time axis in front and batch behind."""
        lanes = max(v.shape[-1] for v in arguments)

        def body(carry: PyTree, sample: PyTree) -> tuple[PyTree, PyTree]:
            mean, cov = carry
            matrix, offset, noise, rows, innovation, spread = sample
            mean = applied(matrix, mean) + offset
            prior = held(product_transposed(product(matrix, cov), matrix) + noise)
            innovation = innovation - applied(rows, mean)
            update = updated(prior, rows, innovation, spread)
            rows, spread = (where(update.good, v, 0.0) for v in (rows, spread))
            gain = held(update.gain)
            mean, cov = mean + applied(gain, innovation), joseph(prior, gain, rows, spread)
            observed = product(rows, matrix)
            pieces = cov, matrix - product(gain, observed), observed, update.information, update.weighted
            return (mean, cov), (mean, *pieces)

        none = [jnp.zeros((*v.shape[1:-1], lanes), self.dtype) for v in arguments[1:3]]
        wide = [jnp.broadcast_to(v, (*v.shape[:-1], lanes)) for v in arguments]
        mean, *pieces = lax.scan(body, tuple(none), wide)[1]
        move, *cov = Backward(self.chosen).value(*pieces)
        return [mean + move, *cov]


def iterated(
    given: Inputs, count: int, keep: tuple[str, ...], components: tuple[int, ...]
) -> tuple[PyTree, PyTree, list[PyTree]]:
    """Smoothed mean (T, k) and covariance of the components, and the fields `keep` of the first pass, the EKF's."""
    shape, arrays = given.shape, given.arrays()
    *fields, points = call(Recorded(shape, EKF(), keep, True), *arrays)
    params, others = arrays[: shape.params.num_leaves], arrays[shape.params.num_leaves :]
    start, cov, measured, *controls, dt, visible = others
    local = LocalModel(shape, [leaf[..., None] for leaf in params], given.length + 1)
    # The initial belief is the first sample: nothing moves into it, and nothing is measured.
    lengthened = [jnp.concatenate([v[:1], v]) for v in (measured, dt, *controls)]
    samples = [list(jnp.moveaxis(v, 0, -1)) if v.ndim > 1 else v for v in lengthened]
    flags = jnp.concatenate([jnp.zeros_like(visible[:1]), visible]).T
    size, length, inner = shape.sizes[1], given.length + 1, closure(shape, components)
    smoother = LinearSmoother(size, inner, shape.dtype)

    def smoothed_again(carry: PyTree, _: None) -> tuple[PyTree, None]:
        at = _moved(shape, *carry[:2])
        elements = _linear(local, at, (start, cov), (samples[0], samples[2:], samples[1], flags))
        return (at, *call(smoother, *elements)), None

    zeros = [
        jnp.zeros((length, size), shape.dtype),
        *[jnp.zeros((length, *(len(inner),) * 2), shape.dtype)] * bool(inner),
    ]
    at = jnp.concatenate([start[None], points])
    at, delta, *covs = (v[1:] for v in lax.scan(smoothed_again, (at, *zeros), length=count - 1)[0])
    taken: PyTree = None
    if components:
        turned = covariances(shape, inner, *(v[..., None] for v in (at, delta, *covs)))
        taken = selected(turned, inner, components)[..., 0]
    return _moved(shape, at, delta), taken, fields


def _moved(shape: Shape, at: PyTree, delta: PyTree) -> PyTree:
    """The trajectory (T, k) moved by errors (T, n)."""
    return states(shape, at[..., None], delta[..., None])[..., 0]


def _linear(local: LocalModel, at: PyTree, start: PyTree, samples: PyTree) -> list[PyTree]:
    """A, c, Q, H, e and R of all samples, time in front; `start`: initial mean and covariance."""
    measured, controls, dt, visible = samples
    x = list(at.T)
    before = [jnp.concatenate([v[:1], v[:-1]]) for v in x]
    columns = local.error_moved(before, controls, dt, local.identity())
    matrix, noise = jnp.stack(columns), local.transition_noise(before, controls, dt)
    came = jnp.stack(local.moved(before, controls, dt))
    finite = jnp.isfinite(summed(came) + summed(matrix) + summed(noise))
    first = jnp.arange(len(at)) == 0
    # A transition that is not finite leaves the state where it was, as in the filter.
    unit = jnp.stack(local.identity())
    matrix = where(~first, where(finite, matrix, unit), 0.0)
    noise = where(first, start[1][:, :, None], where(finite, noise, 0.0))
    arrived = list(where(first, start[0][:, None], where(finite, came, jnp.stack(before))))
    gap = local.between(arrived, x)
    turned = held(jnp.stack(local.turned(arrived, gap, local.identity())))
    rows, innovation, spread = local.linearised_observation(x, controls, measured, visible)
    elements = (
        jnp.stack(local.carried(arrived, gap, list(matrix))), -applied(turned, jnp.stack(gap)),
        product_transposed(product(turned, noise), turned), rows, innovation, spread,
    )  # fmt: skip
    return [jnp.moveaxis(v, -1, 0) for v in elements]
