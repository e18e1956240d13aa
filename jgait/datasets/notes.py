"""Kinds of notes that the loaders of several public data sets share."""

from jgait.notes import LEFT_OUT, LOSSES, ORIGIN, Kind

SAMPLES_MASKED = Kind(
    "samples_masked", "check", "{placement}: {masked} of {samples} samples {masked:is|are} masked", LOSSES
)

FILE_ABSENT = Kind("file_absent", "info", "{dataset} lacks {file}; jgait.datasets.fetch({dataset!r}) gets it", LEFT_OUT)
"""A file of the set is not on this computer."""

SENSOR_FILE_ABSENT = Kind("sensor_file_absent", "info", "no file for {placements}", LEFT_OUT)

UNITS_CONVERTED = Kind("units_converted", "info", "g and deg/s upstream", ORIGIN)

SIDE_UNKNOWN = Kind(
    "side_unknown",
    "info",
    "which foot it was is not known; called foot_right",
    "Results of the right foot may be those of the left.",
)

AXES_TURNED = Kind("axes_turned", "info", "z down upstream: sensor axes turned half a turn about x", ORIGIN)
