"""A filter, or a filter and its smoother, over whole recordings as one function of a batch, with its gradient."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array

from jgait.filtering.batch import Batched
from jgait.filtering.gradient import filter_gradient, smoother_gradient
from jgait.filtering.linear import Linear
from jgait.filtering.methods import EKF, KF, Method
from jgait.filtering.model import Shape
from jgait.filtering.scan import After, Belief, Sample, busy_samples, filter_step, nothing_after, scanned, smoother_scan

FOR_SMOOTHER = ("cov", "M", "J", "G", "z")
FOR_GRADIENT = ("x", "delta", "cov", "G", "z")
BACK = ("move", "smoothed", "lam", "Lam")
"""The outputs of the smoother's scan."""

AXES = {"delta": 1, "move": 1, "lam": 1, "cov": 2, "prior": 2}
"""Number of axes of errors of the outputs."""

SEGMENT = 2**17
"""[samples] Recordings that are longer (22 minutes at 100 Hz) are smoothed in segments of this length: they are
filtered twice, and memory holds the covariances of one segment."""


def linearises_once(method: Method) -> bool:
    """Whether the linearised model depends on the means alone: KF and EKF without iterations."""
    return isinstance(method, KF | EKF) and method.iterations == 1


@dataclass(frozen=True)
class Recorded(Batched):
    """Parameters, start, recording → the outputs `keep` of `filter_step` and of `smoother_scan`, over samples.

    Arguments, each with the batch behind: leaves of the parameters, mean (k,), covariance (n, n), then a `Sample` with
    the time axis in front, its control as separate components.

    Attributes:
        shape: the model.
        method: how to linearise.
        keep: names of outputs.
        chosen: components whose smoothed covariances are computed.
        all: whether everything is computed that the gradient needs.
        segment: see `SEGMENT`.
    """

    shape: Shape
    method: Method
    keep: tuple[str, ...]
    chosen: tuple[int, ...] = ()
    all: bool = False
    segment: int = SEGMENT

    @property
    def block(self) -> int:
        """Of large models 32, which fill vector units; of small ones 16, whose matrices stay in the processor's first
        cache; in a smoother's gradient one, for its program is then half as long.
        """
        if self.all and self.smooth:
            return 1
        return 16 if self.shape.error.size**2 * jnp.dtype(self.shape.dtype).itemsize <= 512 else 32

    @property
    def smooth(self) -> bool:
        """Whether the smoother's scan is needed."""
        return any(name in BACK for name in self.keep)

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the outputs: `keep`, then what the gradient needs."""
        more = (*FOR_GRADIENT, *((*FOR_SMOOTHER, "lam", *(("Lam",) if self.chosen else ())) if self.smooth else ()))
        return tuple(dict.fromkeys((*self.keep, *more))) if self.all else self.keep

    @property
    def ahead(self) -> tuple[str, ...]:
        """The outputs of the filter's scan, with what the smoother's needs."""
        forward = (name for name in self.names if name not in BACK)
        return tuple(dict.fromkeys((*forward, *(FOR_SMOOTHER if self.smooth else ()))))

    @property
    def behind(self) -> tuple[str, ...]:
        """The outputs of the smoother's scan."""
        return tuple(name for name in self.names if name in BACK)

    def last(self, linear: Linear) -> After:
        """λ and Λ after the last sample."""
        return nothing_after(linear.width, linear.lanes, self.shape.dtype, bool(self.chosen))

    @property
    def whole(self) -> "Recorded":
        """The same with the outputs that the gradient needs."""
        return replace(self, all=True) if linearises_once(self.method) else self

    def part(self, outputs: list[Array]) -> list[Array]:
        """The outputs without those that the gradient needs."""
        return [self.cut(name, value) for name, value in zip(self.keep, outputs, strict=False)]

    def split(self, arguments: Sequence[Array]) -> tuple[list[Array], tuple[Array, Array], Sample]:
        """Parameters, mean and covariance at the start, samples."""
        count, controls = self.shape.params.num_leaves, self.shape.control.size
        mean, cov, measured, *rest = arguments[count:]
        return list(arguments[:count]), (mean, cov), Sample(measured, tuple(rest[:controls]), *rest[controls:])

    def model(self, arguments: Sequence[Array], lanes: int) -> tuple[Linear, Belief, Sample]:
        """The model, (x, δ, P) before the first sample, and the samples.

        A single recording has matrices whose rows fill vector units, if that adds few: with 15 errors it takes half of
        the time with 16 rows. In a gradient all recordings have matrices of the same size.
        """
        params, (mean, cov), samples = self.split(arguments)
        size = self.shape.error.size
        alone = (lanes == 1 and not self.all) or (self.all and self.block == 1)
        width = -(-size // 8) * 8
        width = width if alone and linearises_once(self.method) and 10 * width <= 11 * size else size
        mean, cov = (jnp.broadcast_to(v, (*v.shape[:-1], lanes)) for v in (mean, cov))
        cov = jnp.pad(cov, ((0, width - size), (0, width - size), (0, 0)))
        return Linear(self.shape, params, lanes, self.method, width), (mean, jnp.zeros_like(cov[0]), cov), samples

    def busy(self, samples: Sample, lanes: int) -> Array | None:
        """The number of samples before the padding; None where skipping it takes longer than computing it."""
        return busy_samples(samples) if lanes == 1 and linearises_once(self.method) else None

    def cut(self, name: str, value: Array) -> Array:
        """An output without the rows and columns beyond the model's errors."""
        size = self.shape.error.size
        return value[:, *[slice(size)] * AXES.get(name, 0)]

    def value(self, *arguments: Array) -> list[Array]:
        """The outputs, time axis in front and batch behind."""
        lanes = max(v.shape[-1] for v in arguments)
        linear, begin, samples = self.model(arguments, lanes)
        busy, length = self.busy(samples, lanes), len(samples.dt)
        if self.all or not self.smooth or length <= self.segment:
            named = scanned(filter_step(linear, self.ahead), begin, samples, busy)[1]
            if self.smooth:
                named |= smoother_scan(named, self.chosen, self.last(linear), self.behind, busy)[1]
            return [named[name] if self.all else self.cut(name, named[name]) for name in self.names]

        def smoothed(later: After, part: tuple[Belief, Sample, Array | None]) -> tuple[After, list[Array]]:
            begin, samples, busy = part
            part_outputs = scanned(filter_step(linear, self.ahead), begin, samples, busy)[1]
            later, back = smoother_scan(part_outputs, self.chosen, later, self.behind, busy)
            part_outputs |= back
            return later, [self.cut(name, part_outputs[name]) for name in self.names]

        # From the last segment to the first, each filtered again from the belief before it.
        count = -(-length // self.segment)
        missing = count * self.segment - length  # filled up with padding: no interval, nothing measured
        longer = jax.tree.map(lambda v: jnp.pad(v, [(0, missing), *[(0, 0)] * (v.ndim - 1)]), samples)
        parts = jax.tree.map(lambda v: v.reshape(count, self.segment, *v.shape[1:]), longer)
        busy = jax.vmap(busy_samples)(parts) if busy is not None else None
        step = filter_step(linear, ())
        begins = lax.scan(lambda b, part: (scanned(step, b, *part)[0], b), begin, (parts, busy))[1]
        outputs = lax.scan(smoothed, self.last(linear), (begins, parts, busy), reverse=True)[1]
        return [v.reshape(-1, *v.shape[2:])[:length] for v in outputs]

    def reverse(
        self, moving: tuple[int, ...], arguments: list[Array], outputs: list[Array], cotangents: list[Array | None]
    ) -> list[Array]:
        """The closed form: back through the smoother's scan, then through the filter's."""
        if not linearises_once(self.method):
            return super().reverse(moving, arguments, outputs, cotangents)
        lanes = max(v.shape[-1] for v in (*arguments, *outputs))
        linear, begin, samples = self.whole.model(arguments, lanes)
        named = dict(zip(self.whole.names, outputs, strict=True))
        more = linear.width - linear.size
        given = {
            name: jnp.pad(ct, [(0, 0), *[(0, more)] * AXES.get(name, 0), *[(0, 0)] * (ct.ndim - 1 - AXES.get(name, 0))])
            for name, ct in zip(self.keep, cotangents, strict=True) if ct is not None
        }  # fmt: skip
        busy = self.busy(samples, lanes)
        if self.smooth:
            later = {name: given.pop(name) for name in BACK if name in given}
            for name, ct in smoother_gradient(named, self.chosen, busy, later, lanes).items():
                given[name] = given[name] + ct if name in given else ct
        return filter_gradient(linear, begin, samples, busy, named, given, moving)
