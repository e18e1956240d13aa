"""Kinds of notes of `leg_ekf` about a recording."""

from jgait.notes import FEW_RESTS, LOSSES, Kind

ZERO_OF_WALKING = Kind(
    "zero_of_walking", "check",
    "nobody stands still: hip and knee angles count from the usual mean of walking, and are less certain",
    FEW_RESTS,
)  # fmt: skip

NOT_ESTIMATED = Kind(
    "not_estimated", "check",
    "{side}: no angles are stated for {seconds:.2f} s from {begin_s:.2f} s, where samples are missing; angles after it "
    "start again from gravity and are less certain, and the distance of the legs alone lacks the steps in it",
    LOSSES,
)  # fmt: skip

ONE_LEG = Kind(
    "one_leg", "check",
    "leg_ekf measures the {side} leg only: its own distance comes out some 10 % short, unless the scale of distances "
    "was learned from one leg",
    "Angles and strides of leg_ekf are of this leg. The steps of the other leg are not measured; the distance of "
    "leg_ekf is less certain for it.",
)  # fmt: skip

STANDS_OTHERWISE = Kind(
    "stands_otherwise", "check",
    "{placement}: its tilt in standing at {at_s:.1f} s differs by {degrees:.0f}° from that in the standing that "
    "calibrates it: the sensor slipped on the segment, or the person stands in another way",
    "If a sensor slips, the angles of its joints are wrong by as much from then on. Compare the angles in standing "
    "before and after, and leave out what follows the slip.",
)  # fmt: skip

SLIPPED = Kind(
    "sensor_slipped", "check",
    "{placement}: it slipped on the segment: from {from_s:.1f} s on its tilt differs by {degrees:.0f}° from that in "
    "the standing that calibrates it",
    "Angles of hip and knee of this leg are wrong by as much from then on, and do not count. Cut the recording there, "
    "and analyse both parts, if the person stands in each.",
)  # fmt: skip

SHANKS_APART = Kind(
    "shanks_apart", "check",
    "by its accelerometer shank_right walks {right:.3g} m and shank_left {left:.3g} m; one of the two sensors is wrong",
    "Both legs of a person walk the same way, but for a step. Likely a wrong axis, unit or scale of a sensor, or lost "
    "samples: neither the distance nor the angles of that leg can be trusted.",
)  # fmt: skip
