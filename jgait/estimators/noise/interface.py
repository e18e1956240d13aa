"""The record of a noise model."""

from collections.abc import Callable
from typing import Any, NamedTuple

from jgait.types import Values


class NoiseModel(NamedTuple):
    """A noise model.

    Attributes:
        start: its parameters with which every factor is 1, a NamedTuple with declared ranges and priors.
        log_scale: (parameters, features (T, F)) → (T,), the logarithm of the factor on a variance; pure JAX.
    """

    start: Any
    log_scale: Callable[[Any, Values], Values]
