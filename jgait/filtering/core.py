r"""The filter's scan over a batch of recordings, and its gradient in closed form.

With the linearised model A, Q, H, R about the predictions, S = H P⁻ Hᵀ + R, G = S⁻¹ and the innovation e,

    P⁻ = A P Aᵀ + Q,   K = P⁻ Hᵀ G,   δ = K e,   P = P⁻ − K H P⁻.

The state after the update is x⁻ ⊕ δ. P stays about x⁻; on a manifold the map to errors about x⁻ ⊕ δ is part of the
next A. The gradient is a scan back over the samples, see `adjoint`.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jax import lax
from jax.typing import DTypeLike
from jaxtyping import PyTree

from jgait.filtering.adjoint import Slots, adjoint
from jgait.filtering.affine_step import affine_step
from jgait.filtering.component_model import Shape
from jgait.filtering.lanes import (
    applied,
    diagonal,
    diagonal_matrix,
    held,
    product,
    summed,
    unheld_product,
    unheld_product_transposed,
    where,
)
from jgait.filtering.local_model import Linearised, LocalModel
from jgait.filtering.methods import EKF, KF, IteratedSmoother, Method
from jgait.filtering.padding import scanned
from jgait.filtering.sharing import stored_for
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

FOR_GRADIENT = ("predicted", "delta", "cov", "information", "weighted")
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


def width_of(size: int, lanes: int) -> int:
    """The rows of the matrices of errors of `size` components: for one recording whole vectors, if that adds few.

    Measured: a filter and smoother with 15 errors take a fifth less time with 16 rows.
    """
    wide = -(-size // 8) * 8
    return wide if lanes == 1 and 10 * wide <= 11 * size else size


def cut(outputs: dict[str, PyTree], size: int) -> dict[str, PyTree]:
    """Outputs over samples without the rows of errors beyond `size`."""
    axes = {"delta": 1, "move": 1, "cov": 2, "predicted_cov": 2}
    return {name: value[:, *[slice(size)] * axes.get(name, 0)] for name, value in outputs.items()}


@dataclass(frozen=True)
class Filter:
    """The filter as a function of a batch: parameters, start, recording → the outputs `keep` over samples.

    Arguments, each with the batch behind: leaves of the parameters, mean (k,), covariance (n, n), measured (T, m),
    leaves (T,) of the controls, dt (T,), visible (T, m): the mask.

    Attributes:
        shape: the model.
        method: how to linearise.
        keep: names of the outputs.
        width: rows of errors in the outputs and within, n or more; those behind the model's own are zero.
    """

    shape: Shape
    method: Method
    keep: tuple[str, ...]
    width: int

    def shapes(self, *arguments: jax.ShapeDtypeStruct) -> list[jax.ShapeDtypeStruct]:
        """The shapes of the outputs without the batch axis."""
        (k, _, m), n, length = self.shape.sizes, self.width, arguments[-1].shape[0]
        shapes = {
            "predicted": (k,), "delta": (n,), "cov": (n, n), "predicted_cov": (n, n), "innovation": (m,),
            "variance": (m,), "nis": (), "log_det": (), "valid": (), "closed": (n, n), "seen": (m, n),
            "information": (m, m), "weighted": (m,),
        }  # fmt: skip
        return [
            jax.ShapeDtypeStruct((length, *shapes[name]), jnp.bool_ if name == "valid" else self.shape.dtype)
            for name in self.keep
        ]

    def _split(self, arguments: tuple[PyTree, ...]) -> tuple[list[PyTree], tuple[PyTree, PyTree], PyTree, int]:
        count = self.shape.params.num_leaves
        params = list(arguments[:count])
        mean, cov, measured = arguments[count : count + 3]
        *controls, dt, visible = arguments[count + 3 :]
        lanes = max(v.shape[-1] for v in arguments)
        return params, (mean, cov), (measured, controls, dt, visible), lanes

    def value(self, *arguments: PyTree, count: PyTree = None) -> list[PyTree]:
        """The outputs of the first `count` samples, or of all, time axis in front and batch behind."""
        return self.continued(self.start(*arguments), arguments, count)[1]

    def continued(self, start: PyTree, arguments: tuple[PyTree, ...], count: PyTree) -> tuple[PyTree, list[PyTree]]:
        """(x⁻, δ, P) at the last sample, and the outputs, from (x⁻, δ, P) before the first sample."""
        params, _, samples, lanes = self._split(arguments)
        local = LocalModel(self.shape, params, lanes, self.width)

        def body(carry: PyTree, sample: PyTree) -> tuple[PyTree, list[PyTree]]:
            outputs = self.step(local, carry, sample)
            return (outputs["predicted"], outputs["delta"], outputs["cov"]), [outputs[name] for name in self.keep]

        # Methods without a closed form are differentiated through the scan, which then stores the beliefs alone.
        body = body if linearises_once(self.method) else jax.checkpoint(body, prevent_cse=False)
        return scanned(body, start, samples, count)

    def start(self, *arguments: PyTree) -> tuple[PyTree, PyTree, PyTree]:
        """(x⁻, δ, P) before the first sample."""
        _, belief, _, lanes = self._split(arguments)
        return self._start(*belief, lanes)

    def _start(self, mean: PyTree, cov: PyTree, lanes: int) -> tuple[PyTree, PyTree, PyTree]:
        """(x⁻, δ, P) before the first sample."""
        more = (0, self.width - len(cov))
        wide = jnp.pad(cov, (more, more, (0, 0))) if more[1] else cov
        zero = jnp.zeros((self.width, lanes), self.shape.dtype)
        mean, wide = (jnp.broadcast_to(v, (*v.shape[:-1], lanes)) for v in (mean, wide))
        return mean, zero, wide

    def step(self, local: LocalModel, carry: PyTree, sample: PyTree) -> dict[str, PyTree]:
        """One predict and update: all outputs at a sample, from (x⁻, δ, P) at the sample before."""
        before, delta, cov = carry
        measured, controls, dt, visible = sample
        error = list(delta[: self.shape.sizes[1]])
        x = local.retracted(list(before), error)
        if not linearises_once(self.method):
            lin, prior, update, innovation, first = affine_step(self.method, local, (before, delta, x, cov), sample)
            finite = held(jnp.isfinite(summed(lin.predicted) + summed(diagonal(prior))))
            prior, update = where(finite, prior, cov), kept(update, finite)
            return self._updated(carry, lin, finite, prior, update, innovation, first)
        stored = stored_for(local.lanes)
        moved = stored(local.linearised_transition)(list(before), error, list(x), controls, dt)
        matrix, noise, predicted = held(*moved)
        half = product(matrix, cov)
        finite = held(jnp.isfinite(summed(predicted) + summed(half[:, 0]) + summed(diagonal(noise))))
        # Selected in the loop of the product: a loop of its own takes longer than a product.
        prior = held(where(finite, unheld_product_transposed(half, matrix, noise), cov))

        def observed() -> dict[str, PyTree]:
            shown = stored(local.linearised_observation)(list(predicted), controls, list(measured), visible)
            lin = Linearised(matrix, noise, predicted, *held(*shown))
            update = updated(prior, lin.observation, lin.innovation, lin.observation_noise, finite)
            return self._updated(carry, lin, finite, prior, update, lin.innovation, update)

        if local.lanes > 1:
            return observed()
        # A single recording need not compute an update where nothing is measured.
        return lax.cond(jnp.any(visible), observed, lambda: self._predicted(carry, matrix, finite, predicted, prior))

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
        outputs = {"predicted": where(finite, lin.predicted, before), "delta": where(finite, move, delta),
                   "cov": held(joseph(prior, gain, rows, spread)), "predicted_cov": prior,
                   "innovation": where(valid, innovation, 0.0), "variance": diagonal(first.total),
                   "nis": where(valid, summed(innovation * first.weighted), 0.0), "log_det": first.log_det,
                   "information": update.information, "weighted": update.weighted, "valid": valid}  # fmt: skip
        if set(FOR_SMOOTHER) & set(self.keep):
            unit = diagonal_matrix(jnp.ones_like(delta))
            outputs["seen"] = where(valid, product(rows, lin.matrix), 0.0)
            outputs["closed"] = where(finite, unheld_product(-gain, outputs["seen"], lin.matrix), unit)
        return self._used(outputs)

    def _predicted(
        self, carry: PyTree, matrix: PyTree, finite: PyTree, predicted: PyTree, prior: PyTree
    ) -> dict[str, PyTree]:
        """The outputs where nothing is measured, as from an update with H = 0, e = 0 and R = 1."""
        before, delta, cov = carry
        n, m = len(cov), self.shape.sizes[2]
        none, zero = jnp.zeros((m, 1), cov.dtype), jnp.zeros(1, cov.dtype)
        return self._used({
            "predicted": where(finite, predicted, before), "delta": where(~finite, delta, 0.0), "cov": prior,
            "predicted_cov": prior, "innovation": none, "variance": none + 1.0, "nis": zero, "log_det": zero,
            "information": diagonal_matrix(none + 1.0), "weighted": none, "valid": finite,
            "seen": jnp.zeros((m, n, 1), cov.dtype),
            "closed": where(finite, matrix, diagonal_matrix(jnp.ones_like(delta))),
        })  # fmt: skip

    def _used(self, outputs: dict[str, PyTree]) -> dict[str, PyTree]:
        """The outputs that are kept, and the belief."""
        return {name: value for name, value in outputs.items() if name in (*self.keep, "predicted", "delta", "cov")}

    def closed(
        self,
        moving: tuple[int, ...],
        arguments: list[PyTree],
        outputs: list[PyTree],
        cotangents: list[PyTree],
        count: PyTree = None,
    ) -> list[PyTree]:
        """The closed form: cotangents of the arguments `moving`, by a scan back over the first `count` samples."""
        params, belief, samples, lanes = self._split(tuple(arguments))
        named = dict(zip(self.keep, outputs, strict=True))
        given = {name: value for name, value in zip(self.keep, cotangents, strict=True) if value is not None}
        first = self._start(*belief, lanes)
        behind, controls = len(params), len(samples[1])
        slots = Slots(frozenset(moving), behind, controls)

        def body(carry: PyTree, item: PyTree) -> tuple[PyTree, PyTree]:
            back, total = carry
            at, (sample, known, ct) = item
            cotangents, params_ct, sample_ct = adjoint(self.shape, params, slots, lanes, at, sample, known, back, ct)
            return (cotangents, [a + b for a, b in zip(total, params_ct, strict=True)]), sample_ct

        zero = tuple(jnp.zeros_like(v) for v in first)
        none = [jnp.zeros((*params[i].shape[:-1], lanes), params[i].dtype) for i in slots.params]
        known = {name: named[name] for name in ("information", "weighted")}
        beliefs = [named[name] for name in ("predicted", "delta", "cov")]
        (start, sums), samples_ct = scanned(
            body, (zero, none), (samples, known, given), count, reverse=True, before=(list(first), beliefs)
        )
        n = self.shape.sizes[1]
        gradients = dict(zip(slots.params, sums, strict=True)) | {behind: start[0], behind + 1: start[2][:n, :n]}
        gradients |= dict(zip(slots.samples, samples_ct, strict=True))
        return [gradients[i] for i in moving]
