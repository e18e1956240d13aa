"""Functions of arrays by the library that the arrays come from, and programs compiled for where they run.

`xp.sqrt(x)` is NumPy's for NumPy's arrays and for numbers, and JAX's if any argument is JAX's. What is beside the
filters is written so: for one recording it runs on the host, where nothing is compiled, and inside `jax.jit`,
`jax.vmap` and `jax.grad` it is JAX.
"""

import functools
import platform
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import PyTree


def of_jax(*values: PyTree) -> bool:
    """Whether a value, or a part of a list or tuple, is an array of JAX."""
    return any(isinstance(value, jax.Array) or (isinstance(value, list | tuple) and of_jax(*value)) for value in values)


class _Namespace:
    """Names of NumPy, each function by its arguments; `xp.pi`, `xp.int32` are NumPy's own."""

    def __getattr__(self, name: str) -> Any:
        host = getattr(np, name)
        if isinstance(host, type) or not callable(host):
            return host
        traced = getattr(jnp, name)

        def either(*args: Any, **named: Any) -> Any:
            if of_jax(*args, *named.values()):
                return traced(*args, **named)
            value = host(*args, **named)
            # of numbers a number, which takes the type of the arrays that it meets
            plain = isinstance(value, np.generic) and all(isinstance(a, float | int) for a in args)
            return value.item() if plain else value

        setattr(self, name, either)
        return either


xp: Any = _Namespace()


def on_host(tree: PyTree) -> PyTree:
    """A tree whose arrays of JAX are NumPy's."""
    return jax.tree.map(lambda leaf: np.asarray(leaf) if isinstance(leaf, jax.Array) else leaf, tree)


def for_each(function: Callable[..., PyTree], *records: PyTree) -> PyTree:
    """The results of a function for each of some records, stacked; each record is a row of all arguments' arrays."""
    if all(of_jax(*jax.tree.leaves(record)) for record in records):
        return jax.vmap(function)(*records)
    rows = len(jax.tree.leaves(records)[0])
    each = [function(*jax.tree.map(lambda leaf, k=k: leaf[k], records)) for k in range(rows)]
    return jax.tree.map(lambda *parts: xp.stack(parts), *each)


def stacked[T](*records: T) -> T:
    """Records of the same structure as one, with a first axis for the records."""
    joined: T = jax.tree.map(lambda *leaves: xp.stack(leaves), *records)
    return joined


def picked(index: PyTree, *values: PyTree) -> tuple[PyTree, ...]:
    """The samples `index` (n,) of each of some signals (T,), by one function."""
    return tuple(xp.stack(values, axis=1)[index].T)


def interpolated(at: PyTree, knots: PyTree, values: PyTree) -> PyTree:
    """Values (n, m) at increasing knots (n,), interpolated linearly at other places (T,): (T, m), of their type."""
    if of_jax(at, knots, values):
        return jax.vmap(lambda column: jnp.interp(at, knots, column), 1, 1)(values)
    columns = [np.interp(at, knots, column) for column in np.asarray(values).T]
    return np.stack(columns, axis=1).astype(values.dtype)


def largest_so_far(values: PyTree) -> PyTree:
    """The largest of the values (n, …) up to each one."""
    return lax.cummax(values) if of_jax(values) else np.maximum.accumulate(values)


def put(values: PyTree, at: PyTree, new: PyTree, how: str = "set") -> PyTree:
    """A copy of the values in which rows `at` are set to `new`, or, as `how` says, their sum with it ("add") or the
    larger of both ("max"). Rows behind the last are left out.
    """
    if of_jax(values, at, new):
        return getattr(jnp.asarray(values).at[at], how)(new, mode="drop")
    inside, result = np.asarray(at) < len(values), np.array(values)
    rows, new = np.asarray(at)[inside], np.broadcast_to(new, (len(inside), *result.shape[1:]))[inside]
    if how == "set":
        result[rows] = new
    else:
        {"add": np.add, "max": np.maximum}[how].at(result, rows, new)
    return result


def places(flags: PyTree, size: int) -> PyTree:
    """(size,) the places of the first flags (T,) that are True, in order; −1 behind the last."""
    if of_jax(flags):
        return jnp.nonzero(flags, size=size, fill_value=-1)[0]
    there = np.flatnonzero(flags)[:size]
    return np.pad(there, (0, size - there.size), constant_values=-1)


def as_given(result: PyTree, *given: PyTree) -> PyTree:
    """The result of a function of JAX, as NumPy's arrays if it was given no array of JAX."""
    return result if of_jax(*given) else on_host(result)


# --- programs ---


def host() -> jax.Device | None:
    """The CPU for single recordings, where JAX would take another device by itself; else None.

    Samples follow one another, so that a single recording takes longer on a GPU, which is for many at once. A default
    device that is set is left as it is.
    """
    if jax.default_backend() == "cpu" or jax.config.jax_default_device is not None:
        return None
    try:
        return jax.local_devices(backend="cpu")[0]
    except RuntimeError:  # JAX_PLATFORMS without a CPU
        return None


def backend() -> str:
    """The platform that computes: of the default device if one is set, else of JAX's default backend."""
    device = jax.config.jax_default_device
    return jax.default_backend() if device is None else str(getattr(device, "platform", device))


def compiler_options() -> dict[str, str | int]:
    """Compiler options for what computes: on a CPU no calls of a library for small sums, and wide vectors.

    For sums as short as those of a filter, calling XLA's library YNNPACK takes longer than the sum. With AVX-512
    vectors have 512 bits; XLA uses 256 by default, because some older processors lower their clock rate.
    """
    return _options(backend())


@functools.cache
def _options(computes: str) -> dict[str, str | int]:
    if computes != "cpu":
        return {}
    options: dict[str, str | int] = {"xla_cpu_experimental_ynn_fusion_type": ""}
    if " avx512f " in processor():
        options["xla_cpu_prefer_vector_width"] = 512
    try:
        jax.jit(lambda: 0, compiler_options=options).lower().compile()
    except jax.errors.JaxRuntimeError:  # an XLA without these options
        return {}
    return options


@functools.cache
def processor() -> str:
    """The processor's model and instructions, as far as the system names them."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return f"{platform.machine()} {platform.processor()}"
    return "\n".join(sorted({f"{line} " for line in lines if line.startswith(("model name", "flags", "Features"))}))


def compiled[**P, R](function: Callable[P, R], *, static_argnames: tuple[str, ...] = ()) -> Callable[P, R]:
    """`jax.jit` of a function, typically `jax.vmap` of a filter over recordings, compiled with `compiler_options`.

    Compiler options apply to the outermost `jit` only: inside another `jit`, this is a plain `jax.jit`.
    """
    plain = jax.jit(function, static_argnames=static_argnames)

    @functools.cache
    def wide() -> Callable[P, R]:
        return jax.jit(function, static_argnames=static_argnames, compiler_options=compiler_options() or None)

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        traced = any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves((args, kwargs)))
        return (plain if traced else wide())(*args, **kwargs)

    call.lower = lambda *args, **kwargs: wide().lower(*args, **kwargs)  # type: ignore[attr-defined]
    return call


def reached(jaxpr: Any, sources: set[Any]) -> list[bool]:
    """For each output of a jaxpr, whether any of the source variables can influence it.

    Called functions are analysed too; in a loop or branch every input counts as an influence on every output.
    """
    touched = set(sources)

    def hit(variable: Any) -> bool:
        return not hasattr(variable, "val") and variable in touched  # a literal has a value

    for equation in jaxpr.eqns:
        inputs = [hit(v) for v in equation.invars]
        if not any(inputs):
            continue
        body = _called(equation)
        if body is not None:
            outputs = reached(body, {v for v, touches in zip(body.invars, inputs, strict=True) if touches})
        else:
            outputs = [True] * len(equation.outvars)
        touched |= {v for v, touches in zip(equation.outvars, outputs, strict=True) if touches}
    return [hit(v) for v in jaxpr.outvars]


def _called(equation: Any) -> Any:
    """The jaxpr that an equation calls once with the equation's inputs, or None."""
    if equation.primitive.name in ("scan", "while", "cond"):
        return None
    inner = equation.params.get("jaxpr", equation.params.get("call_jaxpr"))
    body = getattr(inner, "jaxpr", inner)
    if body is None or len(body.invars) != len(equation.invars) or len(body.outvars) != len(equation.outvars):
        return None
    return body
