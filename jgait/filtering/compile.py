"""`jax.jit` with the widest vector instructions of the processor."""

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
from jaxtyping import PyTree


@functools.cache
def wide_vectors() -> dict[str, Any]:
    """Compiler options for the default backend: 512-bit vectors on processors with AVX-512, else none.

    XLA uses 256 bits by default, because some older processors lower their clock rate for wider vectors.
    """
    if jax.default_backend() != "cpu":
        return {}
    try:
        flags = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return {}
    return {"xla_cpu_prefer_vector_width": 512} if " avx512f " in flags else {}


def compiled(function: Callable[..., PyTree], *, static_argnames: tuple[str, ...] = ()) -> Callable[..., PyTree]:
    """`jax.jit` of a function, compiled for wide vectors where the processor has them.

    Compiler options apply to the outermost `jit` only: inside another `jit`, this is a plain `jax.jit`.

    Args:
        function: function to compile, typically `jax.vmap` of a filter over recordings.
        static_argnames: as in `jax.jit`.

    Returns:
        The compiled function; `.lower` as in `jax.jit`.
    """
    plain = jax.jit(function, static_argnames=static_argnames)

    @functools.cache
    def wide() -> PyTree:
        return jax.jit(function, static_argnames=static_argnames, compiler_options=wide_vectors() or None)

    @functools.wraps(function)
    def call(*args: PyTree, **kwargs: PyTree) -> PyTree:
        traced = any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves((args, kwargs)))
        return (plain if traced else wide())(*args, **kwargs)

    call.lower = lambda *args, **kwargs: wide().lower(*args, **kwargs)  # type: ignore[attr-defined]
    return call
