r"""The filter's scan over a batch of recordings, and its gradient in closed form.

With the linearised model A, Q, H, R about the predictions, S = H P⁻ Hᵀ + R, G = S⁻¹ and the innovation e,

    P⁻ = A P Aᵀ + Q,   K = P⁻ Hᵀ G,   δ = K e,   P = P⁻ − K H P⁻.

The state after the update is x⁻ ⊕ δ. P stays about x⁻; on a manifold the map to errors about x⁻ ⊕ δ is part of the
next A. The gradient is a scan back over the samples: matrices by the derivatives of these equations, the model by
`jax.vjp` of its linearisation at one sample.

Source: C. Parellier, A. Barrau, S. Bonnabel, "Speeding-up backpropagation of gradients through the Kalman filter via
closed-form expressions", IEEE TAC 68(12), 2023 (arXiv 2303.16846), for the form of the backward scan.
"""

from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
from jax import lax
from jax.typing import DTypeLike
from jaxtyping import PyTree

from jgait.filtering.affine_step import affine_step
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
from jgait.filtering.methods import EKF, KF, IteratedSmoother, Method
from jgait.filtering.padding import scanned
from jgait.filtering.sharing import OFTEN, shared
from jgait.filtering.update import Update, joseph, kept, updated

OUTPUTS = (
    "predicted", "delta", "cov", "predicted_cov", "innovation", "variance", "nis", "log_det", "valid", "closed", "seen",
    "information", "weighted",
)  # fmt: skip
"""The outputs of a step, each an array over samples.

    predicted      x⁻ (k,)
    delta          δ (n,)
    cov            P (n, n), of errors about x⁻
    predicted_cov  P⁻ (n, n)
    innovation     e (m,)
    variance       diagonal of S (m,)
    nis            eᵀ G e
    log_det        log |S|
    valid          False where something was not finite
    closed         (I − K H) A (n, n)
    seen           H A (m, n)
    information    G (m, m)
    weighted       G e (m,)
"""

FOR_SMOOTHER = ("cov", "closed", "seen", "information", "weighted")
"""The outputs that the backward scan of the smoother uses."""

FOR_GRADIENT = ("predicted", "delta", "cov", "predicted_cov", "information", "weighted")
"""The outputs that the gradient's scan uses."""


def linearises_once(method: Method | IteratedSmoother) -> bool:
    """Whether the linearised model depends on the means alone: KF and EKF without iterations."""
    return isinstance(method, KF | EKF) and method.iterations == 1


def block_of(size: int, dtype: DTypeLike) -> int:
    """The number of recordings computed at once [1]: as many as leave a few matrices in the processor's first cache.

    Args:
        size: number of components of the error.
        dtype: of the matrices.
    """
    return 16 if size**2 * jnp.dtype(dtype).itemsize <= 512 else 8


@dataclass(frozen=True)
class Filter:
    """The filter as a function of a batch: parameters, start, recording → the outputs `keep` over samples.

    Arguments, each with the batch behind: leaves of the parameters, mean (k,), covariance (n, n), measured (T, m),
    leaves (T,) of the controls, dt (T,), seen (T, m).
    """

    shape: Shape
    method: Method
    keep: tuple[str, ...]

    def shapes(self, *arguments: jax.ShapeDtypeStruct) -> list[jax.ShapeDtypeStruct]:
        """The shapes of the outputs without the batch axis."""
        (k, n, m), length = self.shape.sizes, arguments[-1].shape[0]
        own = {
            "predicted": (k,), "delta": (n,), "cov": (n, n), "predicted_cov": (n, n), "innovation": (m,),
            "variance": (m,), "nis": (), "log_det": (), "valid": (), "closed": (n, n), "seen": (m, n),
            "information": (m, m), "weighted": (m,),
        }  # fmt: skip
        return [
            jax.ShapeDtypeStruct((length, *own[name]), jnp.bool_ if name == "valid" else self.shape.dtype)
            for name in self.keep
        ]

    def _split(self, arguments: tuple[PyTree, ...]) -> tuple[list[PyTree], tuple[PyTree, PyTree], PyTree, int]:
        count = self.shape.params.num_leaves
        params = list(arguments[:count])
        mean, cov, measured = arguments[count : count + 3]
        *controls, dt, seen = arguments[count + 3 :]
        lanes = max(v.shape[-1] for v in arguments)
        return params, (mean, cov), (measured, controls, dt, seen), lanes

    def value(self, *arguments: PyTree, count: PyTree = None) -> list[PyTree]:
        """The outputs of the first `count` samples, or of all, time axis in front and batch behind."""
        params, (mean, cov), samples, lanes = self._split(arguments)
        local = LocalModel(self.shape, params, lanes)
        n = self.shape.sizes[1]
        start = (
            jnp.broadcast_to(mean, (mean.shape[0], lanes)),
            jnp.zeros((n, lanes), self.shape.dtype),
            jnp.broadcast_to(cov, (n, n, lanes)),
        )

        def body(carry: PyTree, sample: PyTree) -> tuple[PyTree, list[PyTree]]:
            told = self.step(local, carry, sample)
            return (told["predicted"], told["delta"], told["cov"]), [told[name] for name in self.keep]

        # Methods without a closed form are differentiated through the scan, which then stores the beliefs alone.
        body = body if linearises_once(self.method) else jax.checkpoint(body, prevent_cse=False)
        return scanned(body, start, samples, count)[1]

    def step(self, local: LocalModel, carry: PyTree, sample: PyTree) -> dict[str, PyTree]:
        """One predict and update: all outputs at a sample, from (x⁻, δ, P) at the sample before."""
        before, delta, cov = carry
        measured, controls, dt, seen = sample
        x = local.retracted(list(before), list(delta))
        if not linearises_once(self.method):
            lin, prior, update, innovation, first = affine_step(self.method, local, (before, delta, x, cov), sample)
            finite = held(jnp.isfinite(summed(lin.predicted) + summed(diagonal(prior))))
            prior, update = where(finite, prior, cov), kept(update, finite)
            return self._updated(carry, lin, finite, prior, update, innovation, first)
        # Stored values make the program of one recording shorter, that of several longer.
        stored = partial(shared, uses=OFTEN) if local.lanes == 1 else lambda function: function
        moved = stored(local.linearised_transition)(list(before), list(delta), list(x), controls, dt)
        matrix, noise, predicted = held(*moved)
        half = product(matrix, cov)
        finite = held(jnp.isfinite(summed(predicted) + summed(half[:, 0]) + summed(diagonal(noise))))
        # Selected in the loop of the product: a loop of its own takes longer than a product.
        prior = held(where(finite, unheld_product_transposed(half, matrix, noise), cov))

        def observed() -> dict[str, PyTree]:
            shown = stored(local.linearised_observation)(list(predicted), controls, list(measured), seen)
            lin = Linearised(matrix, noise, predicted, *held(*shown))
            update = updated(prior, lin.observation, lin.innovation, lin.observation_noise, finite)
            return self._updated(carry, lin, finite, prior, update, lin.innovation, update)

        if local.lanes > 1:
            return observed()
        # A single recording need not compute an update where nothing is measured.
        return lax.cond(jnp.any(seen), observed, lambda: self._predicted(carry, matrix, finite, predicted, prior))

    def _updated(
        self, carry: PyTree, lin: Linearised, finite: PyTree, prior: PyTree, update: Update, innovation: PyTree,
        first: Update,
    ) -> dict[str, PyTree]:  # fmt: skip
        """The outputs from an update, and from the innovation and the update of the first iteration.

        Where the prediction is not `finite` (B,), `prior` is the covariance before, and nothing is updated.
        """
        before, delta, _ = carry
        gain = held(update.gain)
        rows, spread = (where(update.good, v, 0.0) for v in (lin.observation, lin.observation_noise))
        valid = held(finite & update.good)
        move = applied(gain, where(update.good, lin.innovation, 0.0))
        told = {"predicted": where(finite, lin.predicted, before), "delta": where(finite, move, delta),
                "cov": held(joseph(prior, gain, rows, spread)), "predicted_cov": prior,
                "innovation": where(valid, innovation, 0.0), "variance": diagonal(first.total),
                "nis": where(valid, summed(innovation * first.weighted), 0.0), "log_det": first.log_det,
                "information": update.information, "weighted": update.weighted, "valid": valid}  # fmt: skip
        if set(FOR_SMOOTHER) & set(self.keep):
            rows, unit = product(rows, lin.matrix), diagonal_matrix(jnp.ones_like(delta))
            told["seen"] = where(valid, rows, 0.0)
            told["closed"] = where(finite, unheld_product(-gain, told["seen"], lin.matrix), unit)
        return self._used(told)

    def _predicted(
        self, carry: PyTree, matrix: PyTree, finite: PyTree, predicted: PyTree, prior: PyTree
    ) -> dict[str, PyTree]:
        """The outputs where nothing is measured, as from an update with H = 0, e = 0 and R = 1."""
        before, delta, cov = carry
        _, n, m = self.shape.sizes
        none, zero = jnp.zeros((m, 1), cov.dtype), jnp.zeros(1, cov.dtype)
        return self._used({
            "predicted": where(finite, predicted, before), "delta": where(~finite, delta, 0.0), "cov": prior,
            "predicted_cov": prior, "innovation": none, "variance": none + 1.0, "nis": zero, "log_det": zero,
            "information": diagonal_matrix(none + 1.0), "weighted": none, "valid": finite,
            "seen": jnp.zeros((m, n, 1), cov.dtype),
            "closed": where(finite, matrix, diagonal_matrix(jnp.ones_like(delta))),
        })  # fmt: skip

    def _used(self, told: dict[str, PyTree]) -> dict[str, PyTree]:
        """The outputs that are kept, and the belief."""
        return {name: value for name, value in told.items() if name in (*self.keep, "predicted", "delta", "cov")}

    def closed(
        self,
        moving: tuple[int, ...],
        arguments: list[PyTree],
        outputs: list[PyTree],
        cotangents: list[PyTree],
        count: PyTree = None,
    ) -> list[PyTree]:
        """The closed form: cotangents of the arguments `moving`, by a scan back over the first `count` samples."""
        params, (mean, cov), samples, lanes = self._split(tuple(arguments))
        told = dict(zip(self.keep, outputs, strict=True))
        given = {name: value for name, value in zip(self.keep, cotangents, strict=True) if value is not None}
        first = [jnp.broadcast_to(v, (*v.shape[:-1], lanes)) for v in (mean, jnp.zeros_like(told["delta"][0]), cov)]
        behind, controls = len(params), len(samples[1])
        slots = _Slots(frozenset(moving), behind, controls)

        def body(carry: PyTree, item: PyTree) -> tuple[PyTree, PyTree]:
            back, total = carry
            at, (sample, known, ct) = item
            found, own, each = self._adjoint(params, slots, lanes, at, sample, known, back, ct)
            return (found, [a + b for a, b in zip(total, own, strict=True)]), each

        zero = tuple(jnp.zeros_like(v) for v in first)
        none = [jnp.zeros((*params[i].shape[:-1], lanes), params[i].dtype) for i in slots.params]
        known = {name: told[name] for name in ("predicted_cov", "information", "weighted")}
        beliefs = [told[name] for name in ("predicted", "delta", "cov")]
        (start, sums), each = scanned(
            body, (zero, none), (samples, known, given), count, reverse=True, before=(first, beliefs)
        )
        found = dict(zip(slots.params, sums, strict=True)) | {behind: start[0], behind + 1: start[2]}
        found |= dict(zip(slots.samples, each, strict=True))
        return [found[i] for i in moving]

    def _adjoint(
        self,
        params: list[PyTree],
        slots: "_Slots",
        lanes: int,
        at: PyTree,
        sample: PyTree,
        known: dict[str, PyTree],
        back: PyTree,
        ct: dict[str, PyTree],
    ) -> tuple[PyTree, list[PyTree], list[PyTree]]:
        """Cotangents of (x⁻, δ, P) before a sample, of the parameters, and of the sample."""
        before, delta, cov = at
        flat = [jnp.broadcast_to(v, (*v.shape[:-1], lanes)) for v in slots.values(sample)]

        def transition(before: list[PyTree], delta: list[PyTree], own: list[PyTree], each: list[PyTree]) -> PyTree:
            local = LocalModel(self.shape, slots.with_params(params, own), lanes)
            _, controls, dt, _ = slots.with_values(sample, each)
            return local.linearised_transition(before, delta, local.retracted(before, delta), controls, dt)

        def observation(predicted: PyTree, own: list[PyTree], each: list[PyTree]) -> PyTree:
            local = LocalModel(self.shape, slots.with_params(params, own), lanes)
            measured, controls, _, seen = slots.with_values(sample, each)
            return local.linearised_observation(list(predicted), controls, list(measured), seen)

        # Two parts, so that an observation that is not finite does not spoil the derivatives of its prediction.
        wide = [jnp.broadcast_to(params[i], (*params[i].shape[:-1], lanes)) for i in slots.params]
        moved_model, pull = jax.vjp(shared(transition, OFTEN), list(before), list(delta), wide, flat)
        seen_model, pull_seen = jax.vjp(shared(observation, OFTEN), moved_model[2], wide, flat)
        lin = Linearised(*held(*moved_model, *seen_model))
        a, h, e = lin.matrix, lin.observation, lin.innovation
        prior = known["predicted_cov"]
        g, z = known["information"], known["weighted"]
        finite = held(jnp.isfinite(summed(lin.predicted) + summed(a) + summed(diagonal(lin.noise))))
        valid = held(finite & (g[0, 0] > 0.0))
        h, e = where(valid, h, 0.0), where(valid, e, 0.0)
        cross = held(product(h, prior))
        gain = held(product(transposed(cross), g))

        def given(name: str, like: PyTree) -> PyTree:
            return ct[name] if name in ct else jnp.zeros_like(like)

        x_ct = back[0] + given("predicted", back[0])
        delta_ct = back[1] + given("delta", back[1])
        cov_ct = symmetrised(back[2] + ct["cov"]) if "cov" in ct else back[2]
        # δ = K e and P = P⁻ − K H P⁻
        gain_ct, e_ct = outer(delta_ct, e), applied(transposed(gain), delta_ct)
        a_ct, h_ct = None, 0.0
        if "closed" in ct or "seen" in ct:  # J = H A, M = A − K J
            rows = product(h, a)
            closed, rows_ct = given("closed", a), given("seen", rows)
            gain_ct = gain_ct - product_transposed(closed, rows)
            rows_ct = rows_ct - product(transposed(gain), closed)
            h_ct, a_ct = product_transposed(rows_ct, a), closed + product(transposed(h), rows_ct)
        spread = product(transposed(gain), cov_ct)
        cross_ct = product_transposed(g, gain_ct) - 2.0 * spread
        g_ct = product(cross, gain_ct) - product_transposed(product(cross, cov_ct), cross)
        if "information" in ct:
            g_ct = g_ct + ct["information"]
        if "weighted" in ct:
            g_ct, e_ct = g_ct + outer(ct["weighted"], e), e_ct + applied(g, ct["weighted"])
        if "nis" in ct:
            g_ct, e_ct = g_ct + outer(lifted(ct["nis"], e) * e, e), e_ct + 2.0 * lifted(ct["nis"], z) * z
        if "innovation" in ct:
            e_ct = e_ct + ct["innovation"]
        total_ct = -product(product(g, symmetrised(g_ct)), g)
        if "log_det" in ct:
            total_ct = total_ct + lifted(ct["log_det"], g) * g
        if "variance" in ct:
            total_ct = total_ct + diagonal_matrix(ct["variance"])
        cross_ct = where(valid, cross_ct + product(total_ct, h), 0.0)
        h_ct = product(cross_ct, prior, h_ct + product(total_ct, cross))
        # The symmetric part of Hᵀ (H P⁻)_ct, as one product
        left, right = jnp.concatenate([h, cross_ct]), jnp.concatenate([cross_ct, h])
        prior_ct = product(transposed(left), 0.5 * right, cov_ct)
        if "predicted_cov" in ct:
            prior_ct = prior_ct + symmetrised(ct["predicted_cov"])
        prior_ct = held(prior_ct)
        # P⁻ = A P Aᵀ + Q
        half = held(product(prior_ct, a))
        a_ct = product(2.0 * half, cov, a_ct)
        on_x, *seen_ct = shared(pull_seen, OFTEN)(held(*(where(valid, v, 0.0) for v in (h_ct, e_ct, total_ct))))
        pulled_x = x_ct + where(valid, on_x, 0.0)
        x_back, delta_back, *moved_ct = shared(pull, OFTEN)(held(a_ct, prior_ct, pulled_x))
        state = jnp.stack(x_back), jnp.stack(delta_back), unheld_product(transposed(a), half)
        # What was not finite did not change the belief, and says nothing of the parameters.
        back = tuple(where(finite, f, p) for f, p in zip(state, (x_ct, delta_ct, cov_ct), strict=True))
        own, each = jax.tree.map(
            lambda m, s: where(finite, m, 0.0) + where(valid, s, 0.0), tuple(moved_ct), tuple(seen_ct)
        )
        return back, own, each


class _Slots:
    """Where the moving arguments are: parameters, and parts of a sample."""

    def __init__(self, moving: frozenset[int], count: int, controls: int) -> None:
        self.count, self.controls = count, controls
        self.params = [i for i in range(count) if i in moving]
        self.samples = [i for i in range(count + 2, count + 4 + controls) if i in moving]

    def with_params(self, params: list[PyTree], own: list[PyTree]) -> list[PyTree]:
        every = list(params)
        for i, value in zip(self.params, own, strict=True):
            every[i] = value
        return every

    def _flat(self, sample: PyTree) -> list[PyTree]:
        measured, controls, dt, _ = sample
        return [measured, *controls, dt]

    def values(self, sample: PyTree) -> list[PyTree]:
        every = self._flat(sample)
        return [every[i - self.count - 2] for i in self.samples]

    def with_values(self, sample: PyTree, values: list[PyTree]) -> PyTree:
        every = self._flat(sample)
        for i, value in zip(self.samples, values, strict=True):
            every[i - self.count - 2] = value
        return every[0], every[1 : 1 + self.controls], every[-1], sample[3]
