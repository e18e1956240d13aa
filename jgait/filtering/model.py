"""A state-space model: functions on tuples of named scalars, and beliefs about such tuples.

A state is a NamedTuple of scalars (nested NamedTuples are allowed), and so are observations and controls. A
covariance is addressed by the same names. Vectors and matrices exist only inside the filters.
"""

from collections.abc import Callable
from typing import NamedTuple

from jaxtyping import PyTree

from jgait.filtering.covariance import Covariance


class Belief(NamedTuple):
    """A distribution of a state: its mean, and the covariance of the error about it."""

    mean: PyTree
    cov: Covariance


class Model(NamedTuple):
    """A state-space model; functions at module level, so that the model is hashable and compiles once.

    Attributes:
        initial: params → `Belief` one interval before the first sample.
        transition: (params, state, control, dt) → state after dt.
        transition_noise: (params, state, control, dt) → `Covariance`, or an error tuple of independent variances;
            taken at the mean before the interval.
        observation: (params, state, control) → what the sensors should read.
        observation_noise: (params, state, control) → `Covariance`, or an observation tuple of variances; taken at
            the predicted mean.
        retract: (state, error) → state, for states on a manifold; None adds.
        local: (reference, state) → error with retract(reference, local(reference, state)) = state; None subtracts.
        residual: (measured, predicted) → their difference, for angles that wrap; None subtracts.

    A model with `retract` and `local` may state how errors move, so that their structure (what is zero, what is one)
    is known; otherwise it is computed through those two, at several times the cost. To first order in `error`:

    Attributes:
        error_transition: (params, state, error, control, dt) → error after dt about the state after dt; or a tuple of
            such functions, the next taking the error that the one before gives: where each changes but a few
            components of the error, they take fewer operations than all at once.
        error_observation: (params, state, error, control) → observation tuple, by how much it differs.
        error_shift: (reference, delta, error) → error about reference ⊕ delta of the state reference ⊕ (delta +
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
