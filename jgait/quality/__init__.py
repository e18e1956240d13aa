"""The quality of what sensors measured: facts as values, evidence and doubt, and notes written from them.

Readers and estimators fill one `SensorQuality` for each sensor; no computation reads a note. `evidence` has these
facts and the evidence about each stride; `model` turns the evidence into a factor on the stated deviation and into the
probability that the stride is wrong, with numbers that were learned from strides beside a reference. `notes` writes
sentences about sensors.
"""

from jgait.quality.evidence import EVIDENCE, SOUND, SensorQuality, StrideQuality, above, merged, of_sensor, opposite
from jgait.quality.model import (
    DOUBTED_SHARE,
    DOUBTFUL_FROM,
    UNCERTAIN,
    QualityParams,
    Trust,
    doubt,
    doubts_of,
    factor,
    judged,
    learned,
    length_share,
    trust,
    widened,
    with_share,
    with_time_spread,
)

__all__ = [
    "DOUBTED_SHARE", "DOUBTFUL_FROM", "EVIDENCE", "SOUND", "UNCERTAIN", "QualityParams", "SensorQuality",
    "StrideQuality", "Trust", "above", "doubt", "doubts_of", "factor", "judged", "learned", "length_share",
    "merged", "of_sensor", "opposite", "trust", "widened", "with_share", "with_time_spread",
]  # fmt: skip
