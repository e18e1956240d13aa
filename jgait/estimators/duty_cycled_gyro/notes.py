"""Kinds of notes of `duty_cycled_gyro` about a recording."""

from jgait.notes import UNSURE_FORWARD, Kind

WORN_ALONE = Kind(
    "worn_alone", "check", "{placement} is worn alone: which way is forward is computed from its swing", UNSURE_FORWARD
)

RATE_HELD = Kind(
    "rate_held",
    "check",
    "{placement}: {samples} {samples:sample|samples}, the first at {begin_s:.2f} s and the last at {end_s:.2f} s, "
    "{samples:has|have} no rate and no angles: too few strides, or none alike, were measured before for the filler",
    "Angles are missing there. A longer warm-up measures more strides before the gyroscope sleeps; turns, starts and "
    "stops are unlike strides.",
)
