"""Kinds of notes that the waist's estimators make about a recording."""

from jgait.notes import Kind

AXES_CORRECTED = Kind(
    "axes_corrected", "info",
    "{placement}: its {up} axis looks up and its {forward} forward, leaning {lean_deg:.0f}° and turned "
    "{turned_deg:.0f}°",
    "The axes of this sensor follow from gravity and the movement, however it is worn.",
)  # fmt: skip

GYROSCOPE_CONTRADICTS = Kind(
    "gyroscope_contradicts", "check", "",
    "The sensor's axes or signs are not as the file states. Contacts and lengths hold, but left and right, and the "
    "directions of turns, may be mixed up or are not known.",
)  # fmt: skip

WALKING_MISSED = Kind(
    "walking_missed", "check", "",
    "Steps are missing, as in limping, or because axes or signs of the sensor are not as the file states, or because "
    "it slipped. Strides and distance are only those found; the distance's deviation contains what is missing between "
    "them. Strides that are two are in doubt, and count in no mean or median. Sensors on feet or shanks see all steps.",
)  # fmt: skip

LIES_TURNED = Kind(
    "sensor_turned_over", "check",
    "{placement}: for {seconds:.1f} s, first at {begin_s:.1f} s, the sensor is turned by up to {degrees:.0f}° "
    "against its pose in walking",
    "The sensor came off, was put on or taken off, or the person lay, sat or bent down. Steps in that time are not "
    "measured: strides and distance are those of the rest of the recording.",
)  # fmt: skip

BOUTS_WITHOUT_STANDING = Kind(
    "bouts_without_standing", "check",
    "{some} {some:stretch|stretches} of walking, first at {begin_s:.1f} s, {some:does|do} not begin from standing: the "
    "speed by integration is not to be relied on there",
    "The speed at the beginning is not known. Contacts are detected all the same.",
)  # fmt: skip

NOT_LEARNED = Kind(
    "strides_not_learned", "check", "",
    "Step lengths were learned from usual walking on level ground, at one pace and with a foot always on the ground. "
    "In shuffling, slow, limping or slower parts of walks and in running they are wrong by a third and more, on stairs "
    "more than twice too large; deviations of these strides, and of the distance, are therefore large. Contacts may be "
    "missed or added; cadence and durations have no deviation. Sensors on feet or shanks measure all of that.",
)  # fmt: skip

DISTANCE_DOUBTFUL = Kind(
    "distance_doubtful", "stop",
    "the distance of {distance_m:.1f} m is only known to within {within_m:.1f} m: it should not be used",
    "The estimator states that its uncertainty is too large for the number to be of use.",
    measure="distance",
)  # fmt: skip
