"""Published estimators, one method a folder; `get` finds one by name."""

from collections.abc import Callable

from jaxtyping import PyTree

from jgait.estimators import ankle_stride, duty_cycled_gyro, foot_ins, leg_ekf, stride_width_ekf, waist
from jgait.estimators.about import About
from jgait.estimators.interface import Estimator, Prepared

__all__ = ["About", "Estimator", "Prepared", "about_of", "get", "names"]

_ESTIMATORS: dict[str, Callable[..., Estimator[PyTree, PyTree]]] = {
    "leg_ekf": leg_ekf.estimator,
    "foot_ins": foot_ins.estimator,
    "stride_width_ekf": stride_width_ekf.estimator,
    "ankle_stride": ankle_stride.estimator,
    "waist": waist.estimator,
    "waist_ofdri": waist.papers_estimator,
    "duty_cycled_gyro": duty_cycled_gyro.estimator,
}


def names() -> tuple[str, ...]:
    """The estimators there are."""
    return tuple(_ESTIMATORS)


def about_of(name: str) -> About:
    """What an estimator states about itself; of a name that is none, what holds for all."""
    return get(name).about if name in _ESTIMATORS else About()


def get(name: str, *args: PyTree, **settings: PyTree) -> Estimator[PyTree, PyTree]:
    """An estimator by name.

    Args:
        name: one of `names()`.
        args: its options, for example `leg_ekf.PAPER`.
        settings: the same by name, for example `options=leg_ekf.PAPER`.

    Raises:
        ValueError: if there is none of that name.
    """
    if name not in _ESTIMATORS:
        raise ValueError(f"estimator must be one of {', '.join(names())}; got {name!r}")
    return _ESTIMATORS[name](*args, **settings)
