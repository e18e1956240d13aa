"""The inputs of a filter: a model and a recording, checked, in one float type, as arrays.

No check raises inside compiled code: structures and shapes are known while tracing, and values are checked only
where they are concrete.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array, Bool, Float

from jgait.filtering.covariance import Covariance, Layout, Numbers, Scalar, Tree, names_of
from jgait.filtering.linear import Shape
from jgait.filtering.methods import Method
from jgait.filtering.model import Belief, Model
from jgait.geometry.arrays import reached


class Inputs(NamedTuple):
    """A filter's arguments, component by component."""

    shape: Shape
    params: Tree
    mean: list[Scalar]  #: initial mean (k scalars).
    cov: Covariance
    measured: list[Float[Array, "time"]]  #: the observed components that are ever measured.
    controls: list[Float[Array, "time"]]  #: components of the control.
    dt: Float[Array, "..."]  #: intervals [s], () or (T,).
    visible: list[Bool[Array, "time"] | bool]  #: the mask of `measured`, True if every sample is measured.

    @property
    def length(self) -> int:
        """T, the number of samples."""
        return len(self.measured[0])

    def arrays(self) -> list[Array]:
        """The arguments of `Recorded`, without a batch axis."""
        length, dtype = (self.length,), self.shape.dtype
        return [
            *jax.tree.leaves(self.params),
            jnp.stack(self.shape.arrays(self.mean)),
            self.cov.dense().astype(dtype),
            jnp.stack(self.measured, axis=-1),
            *(jnp.broadcast_to(leaf, length) for leaf in self.controls),
            jnp.broadcast_to(self.dt, length),
            jnp.stack([jnp.broadcast_to(jnp.asarray(leaf), length) for leaf in self.visible], axis=-1),
        ]


def checked(
    model: Model, params: Tree, observations: Tree, controls: Tree, dt: Numbers, mask: Tree, initial: Belief | None
) -> Inputs:
    """Check structure and shapes, and cast everything to one dtype; raises as `kalman_filter`."""
    observations, length = series(observations, "observation", None)
    controls, _ = series(controls, "control", length)
    dtype = common_dtype(params, observations, initial)
    params, controls = in_dtype((params, controls), dtype)
    belief = model.initial(params) if initial is None else initial
    if not isinstance(belief, Belief) or not isinstance(belief.cov, Covariance):
        raise ValueError(f"a belief is a jgait.filtering.Belief(mean, Covariance); got {belief!r}")
    if jnp.shape(dt) not in ((), (length,)):
        raise ValueError(f"dt must be a scalar or have shape ({length},), like the observations; got {jnp.shape(dt)}")
    first = jax.tree.map(lambda leaf: leaf[0], controls)
    observed = observed_layout(model, params, in_dtype(belief.mean, dtype), first, observations)
    visible, hidden = mask_components(mask, observed, length)
    shape = shape_of(model, params, controls, belief.mean, observed, dtype)
    shape = replace(shape, measured=tuple(i for i in shape.measured if i not in hidden))
    measured = _series(in_dtype(observations, dtype), length)
    return Inputs(
        shape, params, shape.state.components(belief.mean, dtype, "the mean of a belief"),
        shape.noise(belief.cov, shape.error, "the covariance of a belief"),
        [measured[i] for i in shape.measured], _series(controls, length), jnp.asarray(dt, dtype),
        [visible[i] for i in shape.measured],
    )  # fmt: skip


def shape_of(
    model: Model, params: Tree, controls: Tree, mean: Tree, observed: Layout, dtype: np.dtype[np.floating]
) -> Shape:
    """What is known of a model whose components are all measured; controls have the time axis in front.

    Raises ValueError if only one of `retract` and `local` is defined.
    """
    if (model.retract is None) != (model.local is None):
        given = "retract" if model.local is None else "local"
        raise ValueError(f"a model gives both retract and local, or neither; this one gives only {given}")
    error = state = Layout.of(mean)
    if model.local is not None:
        like = state.structure.unflatten([jax.ShapeDtypeStruct(shape, dtype) for shape in state.shapes])
        error = Layout.of(jax.eval_shape(model.local, like, like))
    measured, dtype = tuple(range(observed.size)), jnp.dtype(dtype)
    return Shape(
        model, jax.tree.structure(params), Layout.of(controls, axes=1), state, error, observed, measured, dtype
    )


def _series(tree: Tree, length: int) -> list[Array]:
    """The components of a tuple of arrays (T, …), each (T,)."""
    return [part for leaf in jax.tree.leaves(tree) for part in jnp.unstack(leaf.reshape(length, -1), axis=1)]


def check_linear(given: Inputs) -> None:
    """Raise ValueError if a Jacobian of the model depends on the state; the message names the function."""
    shape, leaves = given.shape, jax.tree.leaves(given.params)
    control, dt = [leaf[0] for leaf in given.controls], given.dt[0] if jnp.ndim(given.dt) else given.dt
    functions: dict[str, Callable[[list[Array]], list[Array]]] = {
        "transition": partial(shape.transition, leaves, (control, dt)),
        "observation": partial(shape.observation, leaves, control),
    }
    x = [jnp.zeros((), shape.dtype)] * shape.state.size
    for field, function in functions.items():
        jaxpr = jax.make_jaxpr(lambda x, way, of=function: jax.jvp(of, (x,), (way,))[1])(x, x).jaxpr
        if any(reached(jaxpr, {*jaxpr.invars[: len(x)]})):
            name = getattr(getattr(shape.model, field), "__name__", "")
            named = field if name.lstrip("_") in ("", field) else f"{field} ({name})"
            raise ValueError(
                f"the KF needs a linear model, but the Jacobian of {named} depends on the state; use EKF(), UKF() or "
                "CKF()"
            )


def common_dtype(*trees: Tree | Belief) -> np.dtype[np.floating]:
    """The widest float type among the leaves; Python numbers and integers have no influence."""
    leaves = jax.tree.leaves(trees)
    with jax.numpy_dtype_promotion("standard"):
        dtype = jnp.result_type(*leaves) if leaves else jnp.result_type(float)
    return dtype if jnp.issubdtype(dtype, jnp.floating) else jnp.result_type(float)


def in_dtype[T](tree: T, dtype: DTypeLike) -> T:
    """The same tree with every floating leaf cast to the dtype; integers and booleans do not change."""

    def cast(leaf: Numbers) -> Array:
        return jnp.asarray(leaf, dtype if jnp.issubdtype(jnp.result_type(leaf), jnp.floating) else None)

    return jax.tree.map(cast, tree)


def known_false(leaf: object) -> bool:
    """Whether a mask's leaf is the constant False: its component is never measured."""
    return isinstance(leaf, bool | np.bool_) and not leaf


def check_arguments(
    model: object, method: object, keep: tuple[str, ...], fields: tuple[str, ...], covariance: object
) -> None:
    """Raise ValueError if a static argument of a filter is not valid; `keep` is a part of `fields`."""
    if not isinstance(model, Model):
        raise ValueError(f"model must be a jgait.filtering.Model; got {model!r}")
    try:
        hash(model)
    except TypeError as error:
        raise ValueError(f"a model must be hashable, its functions at module level or frozen; {error}") from error
    if not isinstance(method, Method):
        raise ValueError(f"method must be KF(), EKF(), IteratedEKF(k), UKF() or CKF(); got {method!r}")
    if not isinstance(covariance, bool | tuple):
        raise ValueError(f"covariance is True, False or a tuple of names; got {covariance!r}")
    if isinstance(keep, str) or not set(keep) <= set(fields):
        raise ValueError(f"keep is a tuple of fields of Posterior ({', '.join(fields)}); got {keep!r}")


def check_values(observations: Tree, controls: Tree, dt: Numbers) -> None:
    """Raise ValueError for concrete values that no filter can use.

    These are lists, pandas' columns, non-numbers, NaN or infinity in observations or controls, and time intervals that
    are negative, or times.
    """
    for kind, tree in (("observation", observations), ("control", controls)):
        for path, leaf in jax.tree_util.tree_flatten_with_path(tree, is_leaf=_is_table)[0]:
            name = f"{kind} '{jax.tree_util.keystr(path, simple=True, separator='.')}'"
            if _is_table(leaf):
                raise ValueError(f"{name} must be an array; got a {type(leaf).__name__}: convert it by numpy.asarray")
            if isinstance(leaf, jax.core.Tracer | jax.ShapeDtypeStruct):
                continue
            array = np.asarray(leaf)
            if array.dtype.kind not in "fiub" and not jnp.issubdtype(array.dtype, jnp.floating):
                raise ValueError(f"{name} must be real numbers; got {array.dtype}")
            if bad := array.size - np.count_nonzero(np.isfinite(array)):
                advice = "put any finite number there and False in the mask" if kind == "observation" else "fill them"
                raise ValueError(f"{name} holds NaN or infinity ({bad} of {array.size} values); {advice}")
    if _is_table(dt):
        raise ValueError(f"dt must be a number or an array; got a {type(dt).__name__}: convert it by numpy.asarray")
    if isinstance(dt, jax.core.Tracer):
        return
    interval = np.asarray(dt)
    if interval.dtype.kind not in "fiu" or not np.all(np.isfinite(interval)) or np.any(interval < 0):
        worst = interval if interval.ndim == 0 else f"a minimum of {interval.min()}"
        raise ValueError(f"dt must be finite and not negative, the time since the sample before [s]; got {worst}")
    if interval.ndim == 1 and interval.size > 4 and np.all(np.diff(interval) > 0):
        raise ValueError(
            f"dt must be the time since the sample before [s]; got times that grow from {interval[0]:g} to "
            f"{interval[-1]:g}: take numpy.diff of them, with one value more for the first sample"
        )


def _is_table(leaf: object) -> bool:
    """Whether this is a list of numbers, which JAX would take for so many observations, or a column of a table."""
    listed = isinstance(leaf, list) and all(isinstance(value, int | float) for value in leaf)
    return listed or hasattr(leaf, "to_numpy")


def observed_layout(model: Model, params: Tree, mean: Tree, control: Tree, observation: Tree) -> Layout:
    """The layout of the model's observations; raises ValueError with the field's name if these have another one."""
    expected = jax.eval_shape(model.observation, params, mean, control)
    layout, given = Layout.of(expected), Layout.of(observation, axes=1)
    name, fields = type(expected).__name__, layout.names
    if layout.structure != given.structure:
        got = f"a {type(observation).__name__} of ({', '.join(given.names)})"
        got = f"a bare array; pass {name}({fields[0]}=…)" if jax.tree_util.all_leaves([observation]) else got
        raise ValueError(f"the model observes a {name} of ({', '.join(fields)}); got {got}")
    for field, shape, other in zip(fields, layout.shapes, given.shapes, strict=True):
        if shape != other:
            wanted, got = (f"(T{''.join(f', {n}' for n in axes) or ','})" for axes in (shape, other))
            raise ValueError(f"observation '{field}' must have shape {wanted}, one value a sample; got {got}")
    return layout


def series[T: Tree](tree: T, kind: str, length: int | None) -> tuple[T, int]:
    """The leaves as arrays, and their number of samples T; raises ValueError that names a leaf of another shape."""
    for name, leaf in zip(names_of(tree), jax.tree.leaves(tree), strict=True):
        shape = jnp.shape(leaf)
        if not shape:
            raise ValueError(f"{kind} '{name}' must have shape (T,) or (T, …), one value a sample; got {shape}")
        length = shape[0] if length is None else length
        if shape[0] != length:
            raise ValueError(f"{kind} '{name}' has {shape[0]} samples; expected {length}")
    if not length:
        raise ValueError("a filter needs at least one sample; got none")
    return jax.tree.map(jnp.asarray, tree), length


def mask_components(mask: Tree, observed: Layout, length: int) -> tuple[list[Bool[Array, "time"] | bool], set[int]]:
    """The mask of each component of the observation, an array (T,) of bools or True; and those never measured.

    A component is never measured if its mask is Python's or NumPy's scalar False. If none is measured, one stays,
    masked everywhere. Raises ValueError if the mask is neither one bool array (T,) nor an observation tuple of such
    arrays; an array of the observation may have a mask for each entry.
    """
    if mask is None:
        return [True] * observed.size, set()
    if jax.tree.structure(mask) == observed.structure:
        leaves = jax.tree.leaves(mask)
    elif jax.tree_util.all_leaves([mask]):
        leaves = [mask] * len(observed.shapes)
    else:
        kind = type(observed.structure.unflatten([None] * len(observed.shapes))).__name__
        raise ValueError(
            f"the mask is one array of bools or a {kind} of them ({', '.join(observed.names)}); "
            f"got a {type(mask).__name__} of ({', '.join(names_of(mask))})"
        )
    masks, hidden = list[Array | bool](), set[int]()
    for name, leaf, shape in zip(observed.names, leaves, observed.shapes, strict=True):
        size = math.prod(shape)
        if known_false(leaf):
            hidden |= set(range(len(masks), len(masks) + size))
            leaf = jnp.zeros(length, bool)
        axes, dtype = jnp.shape(leaf), jnp.result_type(leaf)
        if axes not in ((length,), (length, *shape)) or dtype != jnp.bool_:
            raise ValueError(f"the mask of '{name}' must be bool of shape ({length},); got {dtype} of {axes}")
        whole = jnp.broadcast_to(jnp.asarray(leaf).reshape(length, -1), (length, size))
        masks += list(jnp.unstack(whole, axis=1))
    return masks, hidden if len(hidden) < observed.size else hidden - {0}
