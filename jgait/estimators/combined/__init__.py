"""All sensors of a recording together: every estimator that has its sensors, joined into one estimate.

`sources` runs the estimators, `crosscheck` compares the sensors, `strides` and `distance` join the results.
"""

from jgait.estimators.combined.analysis import Analysis, Comparison, analyse
from jgait.estimators.combined.crosscheck import Findings, crosscheck
from jgait.estimators.combined.sources import MEASURES, SourceEstimate
from jgait.estimators.combined.strides import JoinedStrides

__all__ = ["MEASURES", "Analysis", "Comparison", "Findings", "JoinedStrides", "SourceEstimate", "analyse", "crosscheck"]
