"""Figures of estimates and their reference, readable in grey, with units.

Every function makes a new matplotlib figure and returns it; `save` writes it to a file. This package contains all
figures of the library; the module of a figure is imported when the figure is asked for. Functions for the papers'
figures of data:

| paper | figure | call |
|---|---|---|
| Bennett | 3, 4: hip and knee angle | `joint_angles` |
| | 5, 6: foot relative to the hip | `foot_displacement`; as a path `foot_path` |
| | 7: displacement forward | `distance` |
| Udaya Shankar | 6: rates with sleep | `sleeping_gyroscopes` |
| Köse | 1, 2: accelerations, events, wavelet | `trunk_contacts` |
| Potter | 6: each foot in a separate world frame | `foot_paths` of `foot_ins` |
| | 7, 8, 9: both feet, in sections, width over time | `two_feet` |

`experiments` draws what only a paper shows: Udaya Shankar's Figures 5, 6 and 7, Köse's Figure 4, and Silva's Figure 3.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jgait.plot.cohort import before_after, bland_altman, per_subject
    from jgait.plot.duty import sleeping_gyroscopes
    from jgait.plot.explain import explanation, study
    from jgait.plot.feet import foot_height, foot_paths, two_feet
    from jgait.plot.legs import distance, foot_displacement, foot_path, joint_angles, leg_strides, stride_series
    from jgait.plot.style import save
    from jgait.plot.tuning import correlation, profile, training
    from jgait.plot.waist import trunk_contacts
    from jgait.plot.walk import signals, stick_figure, stride_signals

__all__ = [
    "before_after", "bland_altman", "correlation", "distance", "explanation", "foot_displacement", "foot_height",
    "foot_path", "foot_paths", "joint_angles", "leg_strides", "per_subject", "profile", "save", "signals",
    "sleeping_gyroscopes", "stick_figure", "stride_series", "stride_signals", "study", "training", "trunk_contacts",
    "two_feet",
]  # fmt: skip

_FIGURES = {
    "cohort": ("before_after", "bland_altman", "per_subject"),
    "duty": ("sleeping_gyroscopes",),
    "explain": ("explanation", "study"),
    "feet": ("foot_height", "foot_paths", "two_feet"),
    "legs": ("distance", "foot_displacement", "foot_path", "joint_angles", "leg_strides", "stride_series"),
    "style": ("save",),
    "tuning": ("correlation", "profile", "training"),
    "waist": ("trunk_contacts",),
    "walk": ("signals", "stick_figure", "stride_signals"),
}
"""Module → its figures."""


def __getattr__(name: str) -> Any:
    for module, figures in _FIGURES.items():
        if name in figures:
            return getattr(importlib.import_module(f"{__name__}.{module}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
