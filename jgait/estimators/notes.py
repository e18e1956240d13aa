"""Kinds of notes about a recording that several estimators use."""

from jgait.notes import CLIPPING, FEW_RESTS, LOSSES, NO_GRAVITY, NO_WALKING, SCALE, Kind

NO_STEPS = Kind("no_walking", "stop", "{placement} does not walk", NO_WALKING)

CLIPPED = Kind(
    "signal_clipped",
    "check",
    "{placement}: the {signal} clips in {samples} {samples:sample|samples}; lengths of strides there are less certain, "
    "and rather too small",
    CLIPPING,
)

STRIDES_UNCERTAIN = Kind(
    "samples_lost",
    "check",
    "{samples} {samples:sample|samples} of {placement} {samples:is|are} lost, at most {longest_s:.2f} s in a row; "
    "strides across {samples:it|them} are less certain, or are missing",
    LOSSES,
    counts=True,
)

LONGEST_LOSS = 0.25
"""[s] A stride with more lost samples than this is left out; half the duration of a swing."""

STRIDES_MISSING = Kind(
    "strides_missing",
    "check",
    "{strides} {strides:stride|strides} of {placement} {strides:is|are} left out: more than {seconds:g} s of "
    "{strides:it|them}, or the stance before or after, is lost",
    "So much of these strides was lost that they are missing here; totals, and the distance of one estimator, are too "
    "small by them. The distance of all sensors together counts what is walked there.",
)

SCALE_NOTED = 0.01
"""[1] Least difference of an accelerometer at rest from gravity that is noted; chosen."""

SCALE_CORRECTED = Kind(
    "accelerometer_scale",
    "corrected",
    "the accelerometer of {placement} differs from gravity by {percent:+.1f} % {when}; corrected",
    SCALE,
)

ACCELEROMETER_OFF = Kind(
    "accelerometer_off",
    "check",
    "the accelerometer of {placement} differs from gravity by {percent:+.1f} % {when}, a scale or a bias that is not "
    "usual",
    "One attitude cannot separate a wrong scale from a bias. If it is the scale, all lengths are wrong by as much; "
    "their deviations are larger for it. Calibrate the sensor, or look at its unit and range.",
)

RATES_OFF = Kind(
    "rates_off",
    "check",
    "{placement}: signals from stance to stance fit only with rates {factor:.2f} times as large: the gyroscope's scale "
    "or unit, or the sampling rate, is wrong",
    "With a wrong sampling rate all lengths and speeds are wrong, by about twice as much as the rate; with a wrong "
    "scale those of this sensor. Their deviations are larger for it. If it is the sampling rate, the right one is the "
    "stated one divided by this factor; compare the length of the recording in seconds.",
)

LEVER_IMPLAUSIBLE = Kind(
    "lever_implausible",
    "check",
    "{placement}: its strides fit a sensor {off_m:.2f} m away from where it is worn",
    "The place of the sensor above the ankle is learned from all strides of a recording. Movements that are not "
    "walking, such as moving the legs while sitting, cycling, jogging or stairs, falsify it, and then the lengths of "
    "all strides; their deviations contain that. Cut such parts out of the recording.",
)

SAMPLED_SLOWLY = Kind(
    "sampled_slowly",
    "check",
    "{placement} has only {rate_hz:.3g} samples a second; strides need {least_hz:g} to be as certain as usual",
    "Between slow samples the motion of a swing is lost. Single strides are less certain; their mean holds better.",
)


NO_ACCELEROMETER = Kind(
    "no_accelerometer", "check", "no accelerometer: angles come from the gyroscopes alone and drift", NO_GRAVITY
)

NO_FIRST_STANDING = Kind(
    "no_first_standing",
    "check",
    "the recording does not start standing still; its first angles are uncertain",
    FEW_RESTS,
)
