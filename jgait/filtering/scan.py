"""The one place that scans: a filter forward over the samples of a batch, and its smoother back.

A filter's carry is the belief (x, δ, P): the predicted state x, the correction δ, and the covariance P of errors about
x. The estimate is x ⊕ δ; on a manifold, the map to errors about it is part of the next A.

The smoother is the modified Bryson–Frazier form. With J = H A and M = (I − K H) A of each sample,

    λ ← Mᵀ λ − Jᵀ G e,   Λ ← Mᵀ Λ M + Jᵀ G J,   from the last sample to the first,
    x_s = x ⊕ (δ − P λ),   P_s = P − P Λ P.

This is the Rauch–Tung–Striebel smoother without an inverse of a covariance: the same on flat states, equal to first
order in the smoother's corrections on manifolds.

Source: G. J. Bierman, "Fixed interval smoothing with discrete measurements", Int. J. Control 18(1), 1973; H. Rauch,
F. Tung, C. Striebel (1965), AIAA Journal 3(8).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float

from jgait.filtering.linear import Linear, Shape, widened, widest
from jgait.filtering.methods import EKF, KF, Method
from jgait.filtering.step import (
    Update,
    applied,
    held,
    predict,
    product,
    product_transposed,
    summed,
    transposed,
    unseen,
    update,
    where,
)  # fmt: skip

FOR_SMOOTHER = ("cov", "M", "J", "G", "z")
FOR_GRADIENT = ("x", "delta", "cov", "G", "z")
BACK = ("move", "smoothed", "lam", "Lam")
"""The outputs of the smoother's scan."""

AXES = {"delta": 1, "move": 1, "lam": 1, "cov": 2}
"""Number of axes of errors of the outputs."""


class Sample(NamedTuple):
    """One sample of a batch, or all of them with the time axis in front."""

    measured: Float[Array, "m B"]
    control: tuple[Float[Array, "B"], ...]
    dt: Float[Array, "B"]  #: [s]
    visible: Bool[Array, "m B"]


type Belief = tuple[Float[Array, "k B"], Float[Array, "n B"], Float[Array, "n n B"]]
"""x, δ, P."""

type After = tuple[Float[Array, "n B"], Float[Array, "..."]]
"""λ, and Λ (n, n, B), or 0 where no covariances are smoothed."""


def filter_step(linear: Linear, keep: Sequence[str]) -> Callable[[Belief, Sample], tuple[Belief, dict[str, Array]]]:
    """Predict and update at a sample, for `lax.scan`; the belief after it, and the outputs `keep`.

    x, delta, cov    the belief after the sample
    innovation, variance, nis, log_det, valid    of the update; valid is False where something was not finite
    G, z             S⁻¹ and S⁻¹ e
    M, J             (I − K H) A and H A
    """

    def body(belief: Belief, sample: Sample) -> tuple[Belief, dict[str, Array]]:
        x, delta, P = belief
        A, Q, after = held(*linear.transition(x, delta, P, sample.control, sample.dt))
        prior, finite = predict(P, A, Q, after)
        x = where(finite, after, x)

        def observed() -> tuple[Update, Array]:
            return updated(linear, x, prior, sample, finite)

        if linear.lanes == 1:  # a single recording need not compute an update where nothing is measured
            size = len(sample.measured)
            none = jnp.zeros_like(sample.measured)
            new, e = lax.cond(jnp.any(sample.visible), observed, lambda: (unseen(prior, size, finite), none))
        else:
            new, e = observed()
        delta = where(finite, new.delta, delta)
        outputs = {
            "x": x, "delta": delta, "cov": new.P, "innovation": e, "variance": new.variance, "nis": new.nis,
            "log_det": new.log_det, "valid": new.good, "G": new.G, "z": new.z,
        }  # fmt: skip
        if "J" in keep:
            A = where(finite, A, jnp.eye(len(A), dtype=A.dtype)[:, :, None])
            outputs["J"] = product(new.H, A)
            outputs["M"] = A - product(new.K, outputs["J"])
        return (x, delta, new.P), {name: outputs[name] for name in keep}

    return body


def updated(linear: Linear, x: Array, prior: Array, sample: Sample, finite: Array) -> tuple[Update, Array]:
    """The update of a prediction, and the innovation; iterated, each time of the same P⁻, if the method says so."""
    H, R, e = held(*linear.observation(x, sample.control, sample.measured, sample.visible, None, prior))
    first = new = update(prior, H, R, e, finite)
    for _ in range(1, linear.method.iterations):
        near = prior - product(new.K, product(new.H, prior))
        H, R, again = linear.observation(x, sample.control, sample.measured, sample.visible, new.delta, near)
        new = update(prior, H, R, again + applied(H, new.delta), first.good & new.good)
    return new._replace(variance=first.variance, nis=first.nis, log_det=first.log_det), where(new.good, e, 0.0)


def smoother_scan(
    named: dict[str, Array], chosen: tuple[int, ...], start: After, keep: Sequence[str]
) -> tuple[After, dict[str, Array]]:
    """From the last sample to the first; λ and Λ before the first sample, and the outputs `keep`.

    move       −P λ, to be added to δ
    smoothed   P − P Λ P of the components `chosen`; without any, Λ is not computed
    lam, Lam   λ and Λ of the samples after each
    """

    def body(carry: After, sample: tuple[Array, ...]) -> tuple[After, dict[str, Array]]:
        lam, Lam = carry
        P, M, J, G, z = sample
        move = -applied(P, lam)
        fine = held(jnp.isfinite(summed(move)))
        outputs = {"lam": lam, "Lam": Lam}
        if chosen:
            part = taken(P, chosen)
            known = taken(transposed(part), chosen)
            smoothed = held(product_transposed(-product(part, Lam), part, known))
            outputs["smoothed"] = where(fine & held(jnp.isfinite(summed(smoothed))), smoothed, known)
            Lam = product(product(transposed(M), Lam), M, product(transposed(J), product(G, J)))
        outputs["move"] = where(fine, move, 0.0)
        lam = applied(transposed(M), lam) - applied(transposed(J), z)
        return (lam, Lam), {name: outputs[name] for name in keep}

    return lax.scan(body, start, tuple(named[name] for name in FOR_SMOOTHER), reverse=True)


def taken(matrix: Array, rows: tuple[int, ...]) -> Array:
    """Some rows of matrices."""
    if rows == tuple(range(rows[0], rows[-1] + 1)):
        return matrix[rows[0] : rows[-1] + 1]
    return matrix[jnp.asarray(rows)]


@dataclass(frozen=True)
class Recorded:
    """Parameters, start, recording → the outputs `keep` of `filter_step` and of `smoother_scan`, over samples.

    Arguments, each (..., B), or (..., 1) if it is the same for the whole batch: leaves of the parameters, mean (k,),
    covariance (n, n), then a `Sample` with the time axis in front, its control as separate components.
    """

    shape: Shape
    method: Method
    keep: tuple[str, ...]  #: names of outputs.
    chosen: tuple[int, ...] = ()  #: components whose smoothed covariances are computed.
    all: bool = False  #: whether everything is computed that the gradient needs, behind `keep`.
    #: number of samples from which on a recording (22 minutes at 100 Hz) is smoothed in segments of this length: it is
    #: filtered twice, and memory holds the covariances of one segment.
    segment: int = 2**17

    @property
    def linearises_once(self) -> bool:
        """Whether the linearised model depends on the means alone: KF and EKF without iterations."""
        return isinstance(self.method, KF | EKF) and self.method.iterations == 1

    @property
    def smooth(self) -> bool:
        """Whether the smoother's scan is needed."""
        return any(name in BACK for name in self.keep)

    @property
    def block(self) -> int:
        """The number of recordings that a CPU computes at once [1]; more of them leave its cache.

        Of large models 32, which fill vector units; of small ones 16, whose matrices stay in the processor's first
        cache; in a smoother's gradient one, for its program is then half as long.
        """
        if self.all and self.smooth:
            return 1
        return 16 if self.shape.error.size**2 * jnp.dtype(self.shape.dtype).itemsize <= 512 else 32

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the outputs: `keep`, then what the gradient needs."""
        more = (*FOR_GRADIENT, *((*FOR_SMOOTHER, "lam", *(("Lam",) if self.chosen else ())) if self.smooth else ()))
        return tuple(dict.fromkeys((*self.keep, *more))) if self.all else self.keep

    def model(self, arguments: Sequence[Array], lanes: int) -> tuple[Linear, Belief, Sample]:
        """The model, (x, δ, P) before the first sample, and the samples.

        A single recording has matrices whose rows fill vector units, if that adds few: with 15 errors it takes half of
        the time with 16 rows. In a gradient all recordings have matrices of the same size.
        """
        count, controls, size = self.shape.params.num_leaves, self.shape.control.size, self.shape.error.size
        mean, cov, measured, *rest = arguments[count:]
        samples = Sample(measured, tuple(rest[:controls]), *rest[controls:])
        alone = self.block == 1 if self.all else lanes == 1
        width = -(-size // 8) * 8
        width = width if alone and self.linearises_once and 10 * width <= 11 * size else size
        cov = jnp.pad(widened(cov, lanes), ((0, width - size), (0, width - size), (0, 0)))
        linear = Linear(self.shape, arguments[:count], lanes, self.method, width)
        return linear, (widened(mean, lanes), jnp.zeros_like(cov[0]), cov), samples

    def cut(self, name: str, value: Array) -> Array:
        """An output without the rows and columns beyond the model's errors."""
        size = self.shape.error.size
        return value[:, *[slice(size)] * AXES.get(name, 0)]

    def value(self, *arguments: Array) -> list[Array]:
        """The outputs, time axis in front and batch behind."""
        lanes = widest(arguments)
        linear, begin, samples = self.model(arguments, lanes)
        ahead, behind = ([name for name in self.names if (name in BACK) == back] for back in (False, True))
        if self.smooth:
            ahead = list(dict.fromkeys((*ahead, *FOR_SMOOTHER)))
        none = jnp.zeros_like(begin[1]), jnp.zeros_like(begin[2] if self.chosen else begin[2][0, 0, 0])

        def outputs_of(named: dict[str, Array], later: After) -> tuple[After, list[Array]]:
            if self.smooth:
                later, back = smoother_scan(named, self.chosen, later, behind)
                named |= back
            return later, [named[name] if self.all else self.cut(name, named[name]) for name in self.names]

        length, step = len(samples.dt), filter_step(linear, ahead)
        if self.all or not self.smooth or length <= self.segment:
            return outputs_of(lax.scan(step, begin, samples)[1], none)[1]
        # From the last segment to the first, each filtered again from the belief before it; the last is filled up with
        # padding: no interval, nothing measured.
        missing = -length % self.segment
        longer = jax.tree.map(lambda v: jnp.pad(v, [(0, missing), *[(0, 0)] * (v.ndim - 1)]), samples)
        parts = jax.tree.map(lambda v: v.reshape(-1, self.segment, *v.shape[1:]), longer)
        only = filter_step(linear, ())
        begins = lax.scan(lambda begin, part: (lax.scan(only, begin, part)[0], begin), begin, parts)[1]
        outputs = lax.scan(
            lambda later, part: outputs_of(lax.scan(step, *part)[1], later), none, (begins, parts), reverse=True
        )[1]
        return [v.reshape(-1, *v.shape[2:])[:length] for v in outputs]
