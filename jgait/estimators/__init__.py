"""Published estimators, one package for each method; `get` returns one by name."""

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
    """Names of all estimators."""
    return tuple(_ESTIMATORS)


def about_of(name: str) -> About:
    """The `About` record of an estimator; the default record for an unknown name."""
    return get(name).about if name in _ESTIMATORS else About()


def get(name: str, *args: PyTree, **settings: PyTree) -> Estimator[PyTree, PyTree]:
    """An estimator by name, one of `names()`; its options follow, for example `leg_ekf.PAPER`.

    Raises:
        ValueError: if the name is unknown.
    """
    if name not in _ESTIMATORS:
        raise ValueError(f"estimator must be one of {', '.join(names())}; got {name!r}")
    return _ESTIMATORS[name](*args, **settings)
