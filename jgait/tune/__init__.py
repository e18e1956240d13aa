"""Gradient-based estimation of parameters from data: fit, cross-validation, identifiability."""

from jgait.tune.cross_validate import CrossValidation, cross_validate
from jgait.tune.descent import Progress, Report
from jgait.tune.explain import Assumption, Explanation, explain
from jgait.tune.fit import Fit, fit
from jgait.tune.identifiability import Identifiability, identifiability
from jgait.tune.lessons import Lesson, Lessons, Windows, lessons
from jgait.tune.objective import LOSSES, Loss, Objective, asked, lacking, objective, parsed
from jgait.tune.profile import Profile, profile

__all__ = [
    "LOSSES", "Assumption", "CrossValidation", "Explanation", "Fit", "Identifiability", "Lesson", "Lessons", "Loss",
    "Objective", "Profile", "Progress", "Report", "Windows", "asked", "cross_validate", "explain", "fit",
    "identifiability", "lacking", "lessons", "objective", "parsed", "profile",
]  # fmt: skip
