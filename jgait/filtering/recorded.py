"""A filter or smoother over whole recordings as one function of a batch, so that a block stays in the cache."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import PyTree

from jgait.filtering.backward import Backward
from jgait.filtering.batched_call import Batched, Reverse
from jgait.filtering.component_model import Shape
from jgait.filtering.core import FOR_GRADIENT, FOR_SMOOTHER, OUTPUTS, Filter, block_of, cut, linearises_once, width_of
from jgait.filtering.finish import covariances, selected, states
from jgait.filtering.methods import Method
from jgait.filtering.padding import added_up, folded, held_on, samples_of, unfolded
from jgait.filtering.sharing import OFTEN, shared
from jgait.filtering.structured import LOG_2PI

NEEDS = {
    "mean": ("predicted", "delta"), "cov": ("predicted", "delta", "cov"),
    "predicted_mean": ("predicted", "delta", "valid"),
    "predicted_cov": ("predicted", "delta", "cov", "predicted_cov", "valid"), "innovation": ("innovation",),
    "innovation_stddev": ("variance",), "log_likelihood": ("nis", "log_det", "valid"), "nis": ("nis",),
    "count": ("valid",), "valid": ("valid",),
}  # fmt: skip
"""Field of `Posterior` → outputs of the core that it is computed from."""

SEGMENT = 2**17
"""[samples] Recordings that are longer (22 minutes at 100 Hz) are smoothed in segments of this length: they are
filtered twice, and memory holds the covariances of one segment."""

LASTING = ("predicted", "cov", "predicted_cov", "variance", "valid")
"""The outputs that are not zero where nothing is measured."""


@dataclass(frozen=True)
class Recorded(Batched):
    """The arguments of `core.Filter` → fields of `Posterior`; then the smoothed mean and covariance, if there are any.

    Attributes:
        shape: the model.
        method: how to linearise.
        keep: fields of `Posterior`.
        smooth: whether the smoothed mean is returned.
        components: components of the error whose smoothed covariances are returned.
        inner: their `closure`.
        all: whether the outputs of the scans are returned too.
        even: whether the scans run over padding too: their length is then constant.
        segment: see `SEGMENT`.
    """

    shape: Shape
    method: Method
    keep: tuple[str, ...]
    smooth: bool = False
    components: tuple[int, ...] = ()
    inner: tuple[int, ...] = ()
    all: bool = False
    even: bool = False
    segment: int = SEGMENT

    @property
    def block(self) -> int:
        """Recordings computed at once; one for a smoother's gradient, whose program is then half as long.

        The gradient of a filter takes less time by 16 at once, at the cost of a longer program.
        """
        return block_of(self.shape.sizes[1], self.shape.dtype) if not self.all else 1 if self.smooth else 16

    @property
    def whole(self) -> "Recorded":
        """The same with the outputs of the scans."""
        return replace(self, all=True)

    @property
    def constant(self) -> "Recorded":
        """The same with scans of constant length."""
        return replace(self, even=True)

    def lesser(self, used: Sequence[bool]) -> "tuple[Recorded, list[bool]]":
        """The same without the covariances of the smoother, which are half of its work, if these are not used."""
        kept = [True] * len(used)
        covs = {self._field_count() - 1} if self.components else set()
        if self.all and covs:
            first = len(used) - len(self.backward.names)
            covs |= {first + i for i, name in enumerate(self.backward.names) if name in ("cov", "matrix")}
        if not covs or any(used[i] for i in covs):
            return self, kept
        return replace(self, components=(), inner=()), [i not in covs for i in range(len(used))]

    def filter(self, lanes: int) -> Filter:
        """The filter of recordings with the outputs that the fields, the smoother and the gradient need."""
        names = {name for field in self.keep for name in NEEDS[field]}
        names |= {"predicted", "delta", *FOR_SMOOTHER} if self.smooth else set()
        names |= set(FOR_GRADIENT) if self.all and self.reverse else set()
        size = self.shape.sizes[1]
        # The outputs of the scans have the same sizes for all recordings: those of one, where each is computed alone.
        alone = linearises_once(self.method) and (self.block == 1 or not self.all)
        width = width_of(size, 1 if self.all else lanes) if alone else size
        return Filter(self.shape, self.method, tuple(name for name in OUTPUTS if name in names), width)

    @property
    def backward(self) -> Backward:
        """The smoother's scan."""
        return Backward(self.inner, self.all)

    def _field_count(self) -> int:
        return len(self.keep) + self.smooth + bool(self.components)

    def part(self, outputs: list[PyTree]) -> list[PyTree]:
        """The outputs without those of the scans."""
        return outputs if self.all else outputs[: self._field_count()]

    def shapes(self, *arguments: jax.ShapeDtypeStruct) -> list[jax.ShapeDtypeStruct]:
        """The shapes of the outputs without the batch axis."""
        (k, n, m), length = self.shape.sizes, arguments[-1].shape[0]
        sizes = {"mean": (k,), "predicted_mean": (k,), "cov": (n, n), "predicted_cov": (n, n), "innovation": (m,),
                 "innovation_stddev": (m,)}  # fmt: skip
        shapes = [sizes.get(name, ()) for name in self.keep]
        shapes += [(k,)] * self.smooth + [(len(self.components),) * 2] * bool(self.components)
        flags = [name == "valid" for name in self.keep] + [False] * (len(shapes) - len(self.keep))
        outputs = [
            jax.ShapeDtypeStruct((length, *shape), jnp.bool_ if flag else self.shape.dtype)
            for shape, flag in zip(shapes, flags, strict=True)
        ]
        if not self.all:
            return outputs
        own_filter = self.filter(1)
        scans = own_filter.shapes(*arguments)
        if self.smooth:
            like = [jax.ShapeDtypeStruct((length, *[own_filter.width] * 2), self.shape.dtype)]
            scans += self.backward.shapes(*like)
        return outputs + scans

    def value(self, *arguments: PyTree) -> list[PyTree]:
        """The outputs, time axis in front and batch behind."""
        if self.smooth and not self.all and arguments[-1].shape[0] > self.segment:
            return self._in_segments(arguments)
        count = self._count(arguments)
        scan = self.filter(max(v.shape[-1] for v in arguments))
        ahead = dict(zip(scan.keep, scan.value(*arguments, count=count), strict=True))
        back: dict[str, PyTree] = {}
        if self.smooth:
            outputs = self.backward.value(*(ahead[name] for name in FOR_SMOOTHER), count=count)
            back = dict(zip(self.backward.names, outputs, strict=True))
        ahead, back = self._lasting(ahead, back, lambda v: held_on(v, count))
        if not self.all:
            return self._fields(ahead, back, arguments[-1])

        def at_sample(item: PyTree) -> list[PyTree]:
            """The outputs at one sample; in a program with a gradient, a loop is shorter than whole arrays."""
            return [v[0] for v in self._fields(*jax.tree.map(lambda v: v[None], item))]

        used = {name: ahead[name] for name in self._used()}
        fields = lax.map(at_sample, (used, back, arguments[-1]))
        return [*fields, *ahead.values(), *back.values()]

    def _in_segments(self, arguments: Sequence[PyTree]) -> list[PyTree]:
        """As `value`: from the last segment to the first, each filtered again from the belief before it."""
        length, fixed = arguments[-1].shape[0], self.shape.params.num_leaves + 2
        count, lanes = self._count(arguments), max(v.shape[-1] for v in arguments)
        scan, known = self.filter(lanes), arguments[:fixed]
        series = folded(list(arguments[fixed:]), self.segment)
        counts = jnp.clip(count - self.segment * jnp.arange(len(series[0])), 0, self.segment)

        def ahead(belief: PyTree, segment: PyTree) -> tuple[PyTree, PyTree]:
            own, samples = segment
            return replace(scan, keep=()).continued(belief, (*known, *samples), own)[0], belief

        def back(later: PyTree, segment: PyTree) -> tuple[PyTree, list[PyTree]]:
            belief, own, samples = segment
            outputs = scan.continued(belief, (*known, *samples), own)[1]
            named = dict(zip(scan.keep, outputs, strict=True))
            later, smoothed = self.backward.continued(later, [named[name] for name in FOR_SMOOTHER], own)
            return later, self._fields(named, dict(zip(self.backward.names, smoothed, strict=True)), samples[-1])

        beliefs = lax.scan(ahead, scan.start(*arguments), (counts, series))[1]
        none = self.backward.start(scan.width, lanes, self.shape.dtype)
        fields = unfolded(lax.scan(back, none, (beliefs, counts, series), reverse=True)[1], length)
        zero = [name in ("innovation", "log_likelihood", "nis", "count") for name in self.keep]
        lasting = [not is_zero for is_zero in zero] + [True] * (len(fields) - len(zero))
        return [held_on(v, count) if lasts else v for v, lasts in zip(fields, lasting, strict=True)]

    def _count(self, arguments: Sequence[PyTree]) -> PyTree:
        """The number of samples that the scans compute; None for all."""
        return None if self.even else samples_of(*arguments[-2:])

    def _lasting(self, ahead: dict[str, PyTree], back: dict[str, PyTree], change: Callable[[PyTree], PyTree]) -> PyTree:
        """The outputs of the scans, those that are returned and not zero in padding changed."""
        changed = {*LASTING} if self.all else {*LASTING} & self._used()
        ahead = {name: change(value) if name in changed else value for name, value in ahead.items()}
        return ahead, {name: change(value) if name == "cov" else value for name, value in back.items()}

    def _fields(self, ahead: dict[str, PyTree], back: dict[str, PyTree], flags: PyTree) -> list[PyTree]:
        """The outputs from those of the scans; `flags` (T, m, B): what is measured."""
        ahead, back = (cut(part, self.shape.sizes[1]) for part in (ahead, back))
        x, delta = ahead.get("predicted"), ahead.get("delta")
        every = tuple(range(self.shape.sizes[1]))
        count = jnp.sum(jnp.where(flags, 1.0, 0.0), axis=1, dtype=self.shape.dtype)
        fields: list[PyTree] = []
        for name in self.keep:
            match name:
                case "mean" | "predicted_mean":
                    value = states(self.shape, x, delta)
                    if name == "predicted_mean":  # where nothing was updated, the belief
                        value = jnp.where(ahead["valid"][:, None], ahead["predicted"], value)
                case "cov" | "predicted_cov":
                    value = covariances(self.shape, every, x, delta, ahead["cov"])
                    if name == "predicted_cov":
                        value = jnp.where(ahead["valid"][:, None, None], ahead[name], value)
                case "innovation_stddev":
                    positive = ahead["variance"] > 0.0
                    value = jnp.where(positive, jnp.sqrt(jnp.where(positive, ahead["variance"], 1.0)), 0.0)
                case "count":
                    value = jnp.where(ahead["valid"], count, 0.0)
                case "log_likelihood":
                    terms = ahead["nis"] + ahead["log_det"] + count * LOG_2PI
                    value = jnp.where(ahead["valid"], -0.5 * terms, 0.0)
                case _:
                    value = ahead[name]
            fields.append(value)
        if self.smooth:
            fields.append(states(self.shape, x, delta, back["move"]))
        if self.components:
            value = covariances(self.shape, self.inner, x, delta, back["cov"], back["move"])
            fields.append(selected(value, self.inner, self.components))
        return fields

    @property
    def reverse(self) -> Reverse | None:
        """The closed form, where the filter has one."""
        return self._reverse if linearises_once(self.method) else None

    def _reverse(
        self, moving: tuple[int, ...], arguments: list[PyTree], outputs: list[PyTree], cotangents: list[PyTree]
    ) -> list[PyTree]:
        """Cotangents of the arguments `moving`: back through the fields, the smoother's scan, and the filter's."""
        scan = self.filter(max(v.shape[-1] for v in arguments))
        first, names, count = self._field_count(), scan.keep, self._count(arguments)
        middle = first + len(names)
        ahead = dict(zip(names, outputs[first:middle], strict=True))
        back = dict(zip(self.backward.names, outputs[middle:], strict=True)) if self.smooth else {}
        given = [i for i in range(first) if cotangents[i] is not None]
        fixed = {name: value for name, value in ahead.items() if value.dtype == jnp.bool_}
        real = {name: value for name, value in ahead.items() if name not in fixed and name in self._used()}

        def pulled(item: PyTree) -> PyTree:
            """The cotangents of the scans' outputs at one sample; a loop is a shorter program than whole arrays."""
            real, back, fixed, flags, fields_ct = jax.tree.map(lambda v: v[None], item)

            def fields(real: dict[str, PyTree], back: dict[str, PyTree]) -> list[PyTree]:
                computed = self._fields(real | fixed, back, flags)
                return [computed[i] for i in given]

            shown, pull = jax.vjp(shared(fields, OFTEN), real, back)
            wide = [jnp.broadcast_to(v, f.shape) for v, f in zip(fields_ct, shown, strict=True)]
            return jax.tree.map(lambda v: v[0], shared(pull, OFTEN)(wide))

        smoothed = {name: back[name] for name in ("move", "cov") if name in back}
        fields_ct = [cotangents[i] for i in given]
        ahead_ct, back_ct = lax.map(pulled, (real, smoothed, fixed, arguments[-1], fields_ct))
        ahead_ct, back_ct = self._lasting(ahead_ct, back_ct, lambda v: added_up(v, count))
        _add(ahead_ct, names, cotangents[first:middle])
        if self.smooth:
            _add(back_ct, self.backward.names, cotangents[middle:])
            parts = [ahead[name] for name in FOR_SMOOTHER]
            every = [back_ct.get(name) for name in self.backward.names]
            into = tuple(range(len(parts)))
            _add(ahead_ct, FOR_SMOOTHER, self.backward.closed(into, parts, list(back.values()), every, count))
        return scan.closed(moving, arguments, list(ahead.values()), [ahead_ct.get(name) for name in names], count)

    def _used(self) -> set[str]:
        """The outputs of the filter's scan that the fields are computed from."""
        return {name for field in self.keep for name in NEEDS[field]} | (
            {"predicted", "delta"} if self.smooth else set()
        )


def _add(sums: dict[str, PyTree], names: tuple[str, ...], values: list[PyTree]) -> None:
    """Add cotangents by name; None is zero."""
    for name, value in zip(names, values, strict=True):
        if value is not None:
            sums[name] = sums[name] + value if name in sums else value
