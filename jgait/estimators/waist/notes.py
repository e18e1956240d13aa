"""Kinds of notes that the waist's estimators make about a recording."""

from jgait.notes import CORRECTED, LOSSES, NO_WALKING, Kind

SAMPLES_LOST = Kind(
    "waist_samples_lost",
    "check",
    "{samples} {samples:sample|samples} of {placement} {samples:is|are} lost; the filter goes on without "
    "{samples:it|them}",
    LOSSES,
    counts=True,
)

STRIDES_IN_LOSS = Kind(
    "waist_strides_missing",
    "check",
    "{strides} {strides:stride|strides} of {placement} {strides:is|are} left out: more than {seconds:g} s of "
    "{strides:it|them} is lost",
    "So much of these strides was lost that their lengths are not known. The distance goes on over the loss, and is "
    "less certain.",
)

AXES_CORRECTED = Kind(
    "axes_corrected",
    "corrected",
    "{placement}: its {up} axis looks up and its {forward} forward, leaning {lean_deg:.0f}° and turned "
    "{turned_deg:.0f}°; corrected",
    CORRECTED,
)

GYROSCOPE_REVERSED = Kind(
    "gyroscope_reversed",
    "check",
    "the gyroscope turns the other way than gravity: the axes are left-handed, or its sign is wrong; turned round, but "
    "left and right may be exchanged",
    "The sensor's axes or signs are not as the file states. Lengths hold, but left and right may be mixed up.",
)

GYROSCOPE_CONTRADICTS = Kind(
    "gyroscope_contradicts",
    "check",
    "{placement}: by its gyroscope it leans by up to {degrees:.0f}° away from what its accelerometer shows: the order "
    "or the signs of axes of one of them are wrong, or a bias is large; the accelerometer is used alone, and left and "
    "right are not known",
    "The sensor's axes or signs are not as the file states. Contacts and lengths come from the accelerometer; of turns "
    "only the size is known, neither which foot takes a stride nor which way a turn goes.",
)

WALKING_MISSED = Kind(
    "walking_missed",
    "check",
    "for {seconds:.1f} s between {begin_s:.1f} and {end_s:.1f} s the trunk moves as in walking, but no contact was "
    "found",
    "Part of the walk is missing, perhaps because axes or signs of the sensor are not as the file states, or because "
    "it slipped. Strides and distance are only those found; the distance's deviation contains what is missing.",
)

LIES_TURNED = Kind(
    "sensor_turned_over",
    "check",
    "{placement}: for {seconds:.1f} s, first at {begin_s:.1f} s, the sensor is turned by up to {degrees:.0f}° "
    "against its pose in walking",
    "The sensor came off, was put on or taken off, or the person lay, sat or bent down. Steps in that time are not "
    "measured: strides and distance are those of the rest of the recording.",
)

NO_CONTACTS = Kind("no_contacts", "stop", "nobody walks: no initial contact was found", NO_WALKING)

BOUTS_WITHOUT_STANDING = Kind(
    "bouts_without_standing",
    "check",
    "{some} of {bouts} bouts, the first from {begin_s:.1f} s, do not begin from standing: their speed by integration "
    "is not to be relied on",
    "The speed at their beginning is not known. Contacts are detected all the same.",
)

NO_TRUNK_STEPS = Kind(
    "no_trunk_steps",
    "stop",
    "no steps were found: {placement} does not walk, or too slowly for a sensor on the trunk",
    f"{NO_WALKING} Below some 0.5 m/s the trunk moves too little; sensors on feet or shanks see slow steps.",
)

SHORT_OR_SLOW = Kind(
    "short_or_slow_strides",
    "check",
    "{strides} of {of} strides, of {length_m:.2f} m at {speed:.2f} m/s in the median, are shorter or slower than those "
    "from which step lengths were learned, {least_m:.2f} m and more at {slowest:.2f} m/s and more; cadence and "
    "durations can be wrong by half",
    "Step lengths were learned from usual walking. In shuffling, slow or limping walks, lengths and distance are wrong "
    "by a third and more; their deviations are therefore large. Contacts may be missed or added; "
    "cadence and durations have no deviation.",
)

SLOWER_PART = Kind(
    "slower_part",
    "info",
    "{strides} of {of} strides last {seconds:.2f} s in the median, where strides of this walk usually last "
    "{usual:.2f} s: lengths in a slower part of a walk are less certain",
    "Step lengths were learned from walks at one pace. In a slower part of simulated walks they are much too "
    "large, in two recorded ones they are right. The deviations of these strides, and of the distance, contain both.",
)

STEPS_MISSED = Kind(
    "steps_missed",
    "check",
    "{found:.1f} contacts a second were found, but the trunk moves as in {steps:.1f} steps a second: contacts are "
    "missed, as in limping",
    "Durations of strides are then too long by two or more, and cadence and distance too small. The strides are in "
    "doubt and not in the means. Sensors on feet or shanks see all steps.",
)

FALLS_FREELY = Kind(
    "trunk_falls_freely",
    "check",
    "in {strides} of {of} strides {share_pct:.0f} % of gravity or less is felt once in each step: running, or faster "
    "than the walks from which step lengths were learned",
    "Step lengths were learned from usual walking, in which a foot is always on the ground. In running, lengths and "
    "distance are wrong by a third, and steps can be missed; deviations of these strides are therefore large.",
)

CLIMBS = Kind(
    "waist_climbs",
    "check",
    "{strides} of {of} strides rise or fall by {rise_m:.2f} m in the median, as on stairs",
    "Step lengths were learned on level ground. On stairs, lengths and distance are more than twice too large; "
    "deviations of these strides are therefore large. Sensors on feet or shanks measure stairs. Stairs are only seen "
    "where the person stands before and behind them.",
)

DISTANCE_DOUBTFUL = Kind(
    "distance_doubtful",
    "stop",
    "the distance{option} of {distance_m:.1f} m is only known to within {within_m:.1f} m: it should not be used",
    "The estimator states that its uncertainty is too large for the number to be of use.",
    measure="distance",
)
