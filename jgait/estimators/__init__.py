"""Published estimators, one package for each method; `get` returns one by name."""

import importlib

from jaxtyping import PyTree

from jgait.estimators.about import About
from jgait.estimators.interface import Estimator, Prepared

__all__ = ["About", "Estimator", "Prepared", "about_of", "get", "names"]

_ESTIMATORS = {
    "leg_ekf": "leg_ekf.estimator",
    "foot_ins": "foot_ins.estimator",
    "stride_width_ekf": "stride_width_ekf.estimator",
    "ankle_stride": "ankle_stride.estimator",
    "waist": "waist.estimator",
    "waist_ofdri": "waist.papers_estimator",
    "duty_cycled_gyro": "duty_cycled_gyro.estimator",
}
"""Name → the package of the method, which is imported when it is asked for, and the function that makes the estimator.
"""


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
    package, function = _ESTIMATORS[name].split(".")
    made: Estimator[PyTree, PyTree] = getattr(importlib.import_module(f"{__name__}.{package}"), function)(
        *args, **settings
    )
    return made
