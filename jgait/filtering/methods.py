r"""The methods: how a filter replaces the nonlinear functions of a model by affine ones.

EKF       the Jacobian at the mean, by autodiff
UKF, CKF  statistical linear regression over sigma points, see `jgait.filtering.regression`
KF        like the EKF, for functions whose Jacobian does not depend on the state

`iterations` is the number of linearisations of each update; every iteration updates the same prior, of UKF and CKF by
posterior linearisation. `derivative` says how JAX differentiates the filter first: "reverse" for `jax.grad` and for
`jax.jvp` of a gradient, in closed form where there is one; "forward" for `jax.jvp` and `jax.jacfwd` alone.
"""

import math
from dataclasses import dataclass
from typing import ClassVar, Literal

Derivative = Literal["reverse", "forward"]


class _Method:
    """What the methods share; raises ValueError for a number of iterations or a mode that is none."""

    derivative: Derivative

    def __post_init__(self) -> None:
        number: object = getattr(self, "iterations", 1)
        if not isinstance(number, int) or isinstance(number, bool) or number < 1:
            raise ValueError(f"iterations must be a whole number from 1 up; got {number!r}")
        if self.derivative not in ("reverse", "forward"):
            raise ValueError(f"derivative must be 'reverse' or 'forward'; got {self.derivative!r}")


# The methods are frozen dataclasses, not tuples: EKF(1) and CKF(1) would be equal as tuples, and jit, which compares
# static arguments to find a compiled function, would use the wrong one.
@dataclass(frozen=True)
class KF(_Method):
    """Kalman filter: for linear models; raises for a model whose Jacobian depends on the state."""

    iterations: ClassVar[int] = 1
    derivative: Derivative = "reverse"


@dataclass(frozen=True)
class EKF(_Method):
    """Extended Kalman filter; with more than one iteration the update is linearised again at its result."""

    iterations: int = 1
    derivative: Derivative = "reverse"


@dataclass(frozen=True)
class UKF(_Method):
    """Unscented Kalman filter: 2n + 1 sigma points at √(α² (n + κ)) standard deviations.

    The defaults have no negative weights and give the exact variance of a quadratic function of one Gaussian variable.
    """

    #: spread of the points; a small spread increases rounding errors: differences are divided by its square.
    alpha: float = 1.0
    beta: float = 2.0  #: weight of the central point in the covariance; 2 suits Gaussian distributions.
    kappa: float = 0.0  #: additional spread of the points.
    iterations: int = 1
    derivative: Derivative = "reverse"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.alpha > 0.0 or not math.isfinite(self.alpha):
            raise ValueError(f"UKF needs alpha > 0; got {self.alpha!r}")


@dataclass(frozen=True)
class CKF(_Method):
    """Cubature Kalman filter: 2n equally weighted points at √n standard deviations."""

    iterations: int = 1
    derivative: Derivative = "reverse"


Method = KF | EKF | UKF | CKF


def IteratedEKF(iterations: int = 3) -> EKF:  # noqa: N802 - named like the method
    """The EKF whose updates are linearised `iterations` times."""
    return EKF(iterations)
