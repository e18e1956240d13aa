r"""One sample of the gradient of the filter's scan, in closed form.

With a bar for cotangents, K = P⁻ Hᵀ G, z = G e, u = Kᵀ δ̄, and P̄ that of the covariance after the update,

    ē = u,   S̄ = Kᵀ P̄ K − sym(u zᵀ),   C̄ = z δ̄ᵀ − 2 Kᵀ P̄ + S̄ H  (of C = H P⁻),   H̄ = (C̄ + S̄ H) P⁻,
    P̄⁻ = P̄ + sym(Hᵀ C̄),   Ā = 2 P̄⁻ A P,   Q̄ = P̄⁻,   and P̄ of the sample before: Aᵀ P̄⁻ A,

and further terms where the outputs of the sample have cotangents of their own. The model's functions are
differentiated by `jax.vjp` of their linearisation.

Source: C. Parellier, A. Barrau, S. Bonnabel, "Speeding-up backpropagation of gradients through the Kalman filter via
closed-form expressions", IEEE TAC 68(12), 2023 (arXiv 2303.16846), for the form of the backward scan.
"""

import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from jgait.filtering.batched_call import replaced
from jgait.filtering.component_model import Shape
from jgait.filtering.lanes import (
    applied,
    diagonal,
    diagonal_matrix,
    held,
    lifted,
    outer,
    product,
    product_transposed,
    summed,
    symmetrised,
    transposed,
    unheld_product,
    unheld_product_transposed,
    where,
)
from jgait.filtering.local_model import Linearised, LocalModel
from jgait.filtering.sharing import OFTEN, shared, stored_for


def adjoint(
    shape: Shape,
    params: list[PyTree],
    slots: "Slots",
    lanes: int,
    at: PyTree,
    sample: PyTree,
    known: dict[str, PyTree],
    back: PyTree,
    ct: dict[str, PyTree],
) -> tuple[PyTree, list[PyTree], list[PyTree]]:
    """Cotangents of (x⁻, δ, P) before a sample, of the parameters, and of the sample.

    Args:
        shape: the model.
        params: leaves of its parameters.
        slots: which arguments have cotangents.
        lanes: number of recordings.
        at: (x⁻, δ, P) before the sample.
        sample: observation, controls, interval, mask.
        known: the outputs `information` and `weighted` of the sample.
        back: cotangents of (x⁻, δ, P) after the sample.
        ct: cotangents of outputs of the sample, by name.
    """
    before, delta, cov = at
    size, width = shape.sizes[1], len(delta)
    flat = [jnp.broadcast_to(v, (*v.shape[:-1], lanes)) for v in slots.values(sample)]

    def transition(before: list[PyTree], delta: list[PyTree], moving: list[PyTree], parts: list[PyTree]) -> PyTree:
        local = LocalModel(shape, slots.with_params(params, moving), lanes, width)
        _, controls, dt, _ = slots.with_values(sample, parts)
        return local.linearised_transition(before, delta, local.retracted(before, delta), controls, dt)

    def observation(predicted: PyTree, moving: list[PyTree], parts: list[PyTree]) -> PyTree:
        local = LocalModel(shape, slots.with_params(params, moving), lanes, width)
        measured, controls, _, visible = slots.with_values(sample, parts)
        return local.linearised_observation(list(predicted), controls, list(measured), visible)

    # Two parts, so that an observation that is not finite does not spoil the derivatives of its prediction.
    wide = [jnp.broadcast_to(params[i], (*params[i].shape[:-1], lanes)) for i in slots.params]
    stored = stored_for(lanes)
    moved_model, pull = jax.vjp(stored(transition), list(before), list(delta[:size]), wide, flat)
    seen_model, pull_seen = jax.vjp(stored(observation), moved_model[2], wide, flat)
    lin = Linearised(*held(*moved_model, *seen_model))
    a = lin.matrix
    finite = held(jnp.isfinite(summed(lin.predicted) + summed(a) + summed(diagonal(lin.noise))))
    prior = held(where(finite, unheld_product_transposed(product(a, cov), a, lin.noise), cov))
    g = known["information"]
    valid = held(finite & (g[0, 0] > 0.0))
    h = where(valid, lin.observation, 0.0)
    gain = held(product(transposed(product(h, prior)), g))
    x_ct, delta_ct, cov_ct = back
    x_ct = x_ct + ct.get("predicted", 0.0)
    delta_ct = delta_ct + ct.get("delta", 0.0)
    cov_ct = symmetrised(cov_ct + ct["cov"]) if "cov" in ct else cov_ct
    model_ct, prior_ct = _updated(ct, h, prior, g, known["weighted"], gain, a, delta_ct, cov_ct, valid)
    closed_ct, h_ct, e_ct, total_ct = model_ct
    half = product(prior_ct, a)
    a_ct = product(2.0 * half, cov, closed_ct)
    on_x, *seen_ct = shared(pull_seen, OFTEN)(held(*(where(valid, v, 0.0) for v in (h_ct, e_ct, total_ct))))
    pulled_x = x_ct + where(valid, on_x, 0.0)
    x_back, delta_back, *moved_ct = shared(pull, OFTEN)(held(a_ct, prior_ct, pulled_x))
    delta_back += [jnp.zeros_like(delta_back[0])] * (width - size)
    state = jnp.stack(x_back), jnp.stack(delta_back), unheld_product(transposed(a), half)
    # What was not finite did not change the belief, and says nothing of the parameters.
    back = tuple(where(finite, f, p) for f, p in zip(state, (x_ct, delta_ct, cov_ct), strict=True))
    both = tuple(moved_ct), tuple(seen_ct)
    return back, *jax.tree.map(lambda m, s: where(finite, m, 0.0) + where(valid, s, 0.0), *both)


def _updated(
    ct: dict[str, PyTree], h: PyTree, prior: PyTree, g: PyTree, z: PyTree, gain: PyTree, a: PyTree, delta_ct: PyTree,
    cov_ct: PyTree, valid: PyTree,
) -> tuple[tuple[PyTree, PyTree, PyTree, PyTree], PyTree]:  # fmt: skip
    """Cotangents of (A by the output `closed`, H, e, R), and of P⁻."""
    e_ct = applied(transposed(gain), delta_ct)
    spread = product(transposed(gain), cov_ct)
    cross_ct, from_gain = outer(z, delta_ct) - 2.0 * spread, spread
    closed_ct, h_ct = None, 0.0
    if "closed" in ct or "seen" in ct:  # J = H A, M = A − K J
        rows = product(h, a)
        closed, rows_ct = ct.get("closed", jnp.zeros_like(cov_ct)), ct.get("seen", jnp.zeros_like(h))
        whitened = -product_transposed(g, product_transposed(closed, rows))
        cross_ct, from_gain = cross_ct + whitened, spread - whitened
        rows_ct = rows_ct - product(transposed(gain), closed)
        h_ct = product_transposed(rows_ct, a)
        closed_ct = product(transposed(h), rows_ct, closed)
    along = e_ct
    if "weighted" in ct:
        pulled = applied(g, ct["weighted"])
        e_ct, along = e_ct + pulled, along + pulled
    if "nis" in ct:
        pulled = lifted(ct["nis"], z) * z
        e_ct, along = e_ct + 2.0 * pulled, along + pulled
    if "innovation" in ct:
        e_ct = e_ct + ct["innovation"]
    total_ct = symmetrised(product(from_gain, gain, -outer(along, z)))
    if "information" in ct:
        total_ct = total_ct - product(product(g, symmetrised(ct["information"])), g)
    if "log_det" in ct:
        total_ct = total_ct + lifted(ct["log_det"], g) * g
    if "variance" in ct:
        total_ct = total_ct + diagonal_matrix(ct["variance"])
    rows_of_total = product(held(total_ct), h)
    cross_ct = held(where(valid, cross_ct + rows_of_total, 0.0))
    h_ct = product(cross_ct + rows_of_total, prior, h_ct)
    prior_ct = held(cov_ct + symmetrised(product(transposed(h), cross_ct)))
    if "predicted_cov" in ct:
        prior_ct = held(prior_ct + symmetrised(ct["predicted_cov"]))
    return (closed_ct, h_ct, e_ct, total_ct), prior_ct


class Slots:
    """Where the moving arguments are: parameters, and parts of a sample."""

    def __init__(self, moving: frozenset[int], count: int, controls: int) -> None:
        self.params = [i for i in range(count) if i in moving]
        self.samples = [i for i in range(count + 2, count + 4 + controls) if i in moving]
        self.parts = [i - count - 2 for i in self.samples]  # of a sample: measured, controls, dt

    def with_params(self, params: list[PyTree], moving: list[PyTree]) -> list[PyTree]:
        """The parameters, the moving ones replaced."""
        return replaced(params, self.params, moving)

    def _flat(self, sample: PyTree) -> list[PyTree]:
        measured, controls, dt, _ = sample
        return [measured, *controls, dt]

    def values(self, sample: PyTree) -> list[PyTree]:
        """The moving parts of a sample."""
        every = self._flat(sample)
        return [every[i] for i in self.parts]

    def with_values(self, sample: PyTree, values: list[PyTree]) -> PyTree:
        """The sample, its moving parts replaced."""
        measured, *controls, dt = replaced(self._flat(sample), self.parts, values)
        return measured, controls, dt, sample[3]
