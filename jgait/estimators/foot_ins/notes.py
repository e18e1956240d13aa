"""Kinds of notes of `foot_ins` about a recording."""

from jgait.notes import FEW_RESTS, Kind

NEVER_RESTS = Kind(
    "foot_never_rests",
    "check",
    "{placement} never rests for half a second: its gyroscope's bias is not known, headings drift more",
    FEW_RESTS,
)

STRIDES_MISSING = Kind(
    "strides_missing",
    "check",
    "{strides} strides of {placement} are left out: more than {seconds:g} s of them is lost",
    "So much of these strides was lost that they are missing here; totals and the distance are too small by them.",
)
