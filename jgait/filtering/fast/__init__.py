"""Filters over scalar components, for small models and very many samples; nothing outside this folder needs it but
`jgait.filtering.filter`.

Every component is a value of its own, an array over the recordings under `jax.vmap`. The zeros and ones of A, H, Q and
R are read from the trace of the model, so that they cost no operation.
"""

from jgait.filtering.fast.scan import refused, solve

__all__ = ["refused", "solve"]
