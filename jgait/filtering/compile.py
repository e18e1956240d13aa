"""`jax.jit` with compiler options that suit filters on the processor."""

import functools
import platform
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
from jaxtyping import PyTree


@functools.cache
def compiler_options() -> dict[str, Any]:
    """Compiler options for the default backend: on a CPU no calls of a library for small sums, and wide vectors.

    For sums as short as those of a filter, calling XLA's library YNNPACK takes longer than the sum. With AVX-512
    vectors have 512 bits; XLA uses 256 by default, because some older processors lower their clock rate.
    """
    if jax.default_backend() != "cpu":
        return {}
    options: dict[str, Any] = {"xla_cpu_experimental_ynn_fusion_type": ""}
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


def compiled(function: Callable[..., PyTree], *, static_argnames: tuple[str, ...] = ()) -> Callable[..., PyTree]:
    """`jax.jit` of a function, compiled with `compiler_options`.

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
        return jax.jit(function, static_argnames=static_argnames, compiler_options=compiler_options() or None)

    @functools.wraps(function)
    def call(*args: PyTree, **kwargs: PyTree) -> PyTree:
        traced = any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves((args, kwargs)))
        return (plain if traced else wide())(*args, **kwargs)

    call.lower = lambda *args, **kwargs: wide().lower(*args, **kwargs)  # type: ignore[attr-defined]
    return call
