"""The quality of what sensors measured: facts as values, evidence and doubt, and notes written from them.

Readers and estimators fill one `SensorQuality` for each sensor; no computation reads a note. `stride` has the evidence
about each stride, `model` turns the evidence into a factor on the stated deviation and into the probability that the
stride is wrong, with numbers that were learned from strides beside a reference; `judge` and `notes` write sentences.
"""

from jgait.quality.judge import DOUBTED_SHARE, UNCERTAIN, Trust, doubts_of, judged, trust
from jgait.quality.model import (
    DOUBTFUL_FROM,
    QualityParams,
    doubt,
    factor,
    learned,
    length_share,
    log_likelihood,
    widened,
    with_share,
    with_time_spread,
)
from jgait.quality.sensor import SOUND, SensorQuality, above, merged, of_sensor, opposite
from jgait.quality.stride import EVIDENCE, StrideQuality

__all__ = [
    "DOUBTED_SHARE", "DOUBTFUL_FROM", "EVIDENCE", "SOUND", "UNCERTAIN", "QualityParams", "SensorQuality",
    "StrideQuality", "Trust", "above", "doubt", "doubts_of", "factor", "judged", "learned", "length_share",
    "log_likelihood", "merged", "of_sensor", "opposite", "trust", "widened", "with_share", "with_time_spread",
]  # fmt: skip
