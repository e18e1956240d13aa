"""Published estimators, one method a file; `get` finds one by name."""

from collections.abc import Callable
from typing import Any

from jgait.estimators import (
    ankle_stride,
    duty_cycled_gyro,
    foot_ins,
    leg_ekf,
    stride_width_ekf,
    two_feet,
)
from jgait.estimators import (
    waist as waist_ofdri,
)
from jgait.estimators.interface import Estimator, Prepared

__all__ = ["Estimator", "Prepared", "get", "names"]

_ESTIMATORS: dict[str, Callable[..., Estimator]] = {
    "leg_ekf": leg_ekf.estimator,
    "foot_ins": foot_ins.estimator,
    "stride_width_ekf": stride_width_ekf.estimator,
    "two_feet": two_feet.estimator,
    "ankle_stride": ankle_stride.estimator,
    "waist_ofdri": waist_ofdri.estimator,
    "duty_cycled_gyro": duty_cycled_gyro.estimator,
}


def names() -> tuple[str, ...]:
    """The estimators there are."""
    return tuple(_ESTIMATORS)


def get(name: str, *args: Any) -> Estimator:
    """An estimator by name.

    Args:
        name: one of `names()`.
        args: its options, for example `leg_ekf.PAPER`.

    Raises:
        ValueError: if there is none of that name.
    """
    if name not in _ESTIMATORS:
        raise ValueError(f"estimator must be one of {', '.join(names())}; got {name!r}")
    return _ESTIMATORS[name](*args)
