"""The quality of strides: how far they can be trusted, as a number, learned from strides beside a reference.

`stride` has the evidence, which estimators fill on the way; `model` turns it into a factor on the stated deviations and
into the probability that a stride is wrong; `notes` writes sentences from it.
"""

from jgait.quality.model import DOUBTFUL, QualityParams, doubt, factor, judged, learned, log_likelihood
from jgait.quality.notes import Trust, doubts_of, trust, with_notes
from jgait.quality.stride import EVIDENCE, StrideQuality

__all__ = [
    "DOUBTFUL", "EVIDENCE", "QualityParams", "StrideQuality", "Trust", "doubt", "doubts_of", "factor", "judged",
    "learned", "log_likelihood", "trust", "with_notes",
]  # fmt: skip
