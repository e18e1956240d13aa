"""`jax.jit` with compiler options that suit filters on the processor."""

import functools
import platform
from collections.abc import Callable
from pathlib import Path

import jax


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
    def wide() -> Callable[P, R]:
        return jax.jit(function, static_argnames=static_argnames, compiler_options=compiler_options() or None)

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        traced = any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves((args, kwargs)))
        return (plain if traced else wide())(*args, **kwargs)

    call.lower = lambda *args, **kwargs: wide().lower(*args, **kwargs)  # type: ignore[attr-defined]
    return call
