"""Kinds of notes of `foot_ins` about a recording."""

from jgait.notes import FEW_RESTS, Kind

NEVER_RESTS = Kind(
    "foot_never_rests",
    "check",
    "{placement} never rests for half a second: its gyroscope's bias is not known, headings drift more",
    FEW_RESTS,
)
