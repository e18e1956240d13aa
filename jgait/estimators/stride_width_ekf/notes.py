"""Kinds of notes of `stride_width_ekf` about a recording."""

from jgait.notes import LOSSES, NO_RANGE, Kind

FOOT_BRIDGED = Kind(
    "foot_bridged", "check", "the {side} foot is not known at {samples} {samples:sample|samples}; bridged", LOSSES
)

FEW_STRIDES = Kind(
    "few_strides",
    "check",
    "a foot has {strides} {strides:stride|strides}, and two of each are needed: no widths",
    "Stride widths are stated from two strides of each foot on; a longer walk has them.",
)

RANGE_ABSENT = Kind("range_absent", "check", "{why}: widths have the mean of usual people", NO_RANGE)

RANGE_OFFSET_ABSENT = Kind(
    "range_offset_absent",
    "check",
    "the offset of the range between the feet is not given: {offset:g} m is taken, and widths are off by its error",
    "All stride widths of the recording are too large or too small by the same amount. Measure on the person how much "
    "farther apart the sensors of the feet are than the range says, and compute the result again.",
)

_WRONG = (
    "The range sensor may be broken, its unit or its times may be wrong, or echoes of other things than the leg are "
    "among its distances. Stride widths and step lengths are not valid, and count in no mean or median."
)

RANGES_MISFIT = Kind(
    "ranges_misfit", "check", "{misfits} of {ranges} ranges do not fit the paths of the feet: no width is valid", _WRONG
)

RANGES_LEFT_OUT = Kind(
    "ranges_left_out",
    "corrected",
    "left out {ranges} {ranges:range|ranges} {why}",
    "Distances between the feet that cannot be right, or come at the wrong moment, were not used.",
)
