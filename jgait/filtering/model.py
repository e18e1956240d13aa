"""A state-space model: functions on tuples of named scalars, and distributions of such tuples.

States, observations and controls are NamedTuples of scalars (nested NamedTuples are allowed). The same names
address the entries of a covariance. Vectors and matrices exist only inside the filters.
"""

from collections.abc import Callable
from typing import NamedTuple

from jaxtyping import PyTree

from jgait.filtering.covariance import Covariance


class Belief(NamedTuple):
    """A distribution of a state: the mean, and the covariance of the error about the mean."""

    mean: PyTree
    cov: Covariance

    def joined(self) -> "Belief":
        """The same belief in the structure of a filter's results, for loops that begin with it."""
        return Belief(self.mean, Covariance.from_dense(self.cov.dense(), self.cov.structure))


class Model(NamedTuple):
    """A state-space model; functions at module level, so that the model is hashable and compiles once.

    Attributes:
        initial: params → `Belief` one interval before the first sample.
        transition: (params, state, control, dt) → state after dt.
        transition_noise: (params, state, control, dt) → `Covariance`, or an error tuple of independent variances;
            computed at the mean before the interval.
        observation: (params, state, control) → expected observation.
        observation_noise: (params, state, control) → `Covariance`, or an observation tuple of variances; computed at
            the predicted mean.
        retract: (state, error) → state, for states on a manifold; None: their sum.
        local: (reference, state) → error with retract(reference, local(reference, state)) = state; None: difference.
        residual: (measured, predicted) → their difference, for angles that wrap; None: plain subtraction.

    A model with `retract` and `local` may define the propagation of errors, so that the zeros and ones of Jacobians
    are known; otherwise Jacobians are computed through these two, at several times the cost. To first order in `error`:

    Attributes:
        error_transition: (params, state, error, control, dt) → error after dt about the state after dt; or a tuple of
            such functions, each applied to the result of the previous: if each changes only a few components of the
            error, they need fewer operations than a single function.
        error_observation: (params, state, error, control) → observation tuple, the change of the observation.
        error_shift: (reference, delta, error) → error, relative to reference ⊕ delta, of the state reference ⊕ (delta +
            error).
    """

    initial: Callable[..., Belief]
    transition: Callable[..., PyTree]
    transition_noise: Callable[..., PyTree]
    observation: Callable[..., PyTree]
    observation_noise: Callable[..., PyTree]
    retract: Callable[..., PyTree] | None = None
    local: Callable[..., PyTree] | None = None
    residual: Callable[..., PyTree] | None = None
    error_transition: Callable[..., PyTree] | tuple[Callable[..., PyTree], ...] | None = None
    error_observation: Callable[..., PyTree] | None = None
    error_shift: Callable[..., PyTree] | None = None
