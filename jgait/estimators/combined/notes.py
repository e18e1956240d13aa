"""Kinds of notes about sensors of a recording that contradict each other."""

from jgait.notes import WRONG_PLACE, Kind

WRONG_UNIT = (
    "One sensor is in another unit than the others. Its numbers are not used; state the unit of this sensor, or "
    "convert its columns."
)
WRONG_CLOCK = (
    "Contacts and joint angles that need both this sensor and another are wrong by this time. The sensor's own strides "
    "hold; they are not combined with those of the others. Synchronise the sensors and compute the result again."
)

GYR_UNIT = Kind(
    "sensor_gyr_unit", "stop", "the gyroscope of {placement} seems to be in {unit}: it turns at {rate:.3g} rad/s where "
    "the other sensors let expect about {expected:.2g}; the sensor is left out", WRONG_UNIT,
)  # fmt: skip
ACC_UNIT = Kind(
    "sensor_acc_unit", "stop", "the accelerometer of {placement} seems to be in {unit}: it reads {force:.3g} m/s² in "
    "the median, where gravity alone is 9.81; the sensor is left out", WRONG_UNIT,
)  # fmt: skip
TURNED_OVER = Kind(
    "upside_down", "info", "{placement} seems to be upside down: its axis that looks down looks up in {other}",
    "The estimators compute the sensor's axes from the walk, so no result is worse for it, unless the sensor is not "
    "where its label says.",
)  # fmt: skip
FOOT_ON_SHANK = Kind(
    "foot_on_shank", "check", "{foot} and {shank} have changed places: in stances the shank's sensor rests, and the "
    "foot's turns; taken the other way round", WRONG_PLACE,
)  # fmt: skip
CLOCK_OFF = Kind(
    "clock_off", "check", "the clock of {placement} seems to be about {seconds:.1f} s {direction}: its leg swings at "
    "another time than the other sensors show", WRONG_CLOCK,
)  # fmt: skip
TRUNK_CLOCK_OFF = Kind(
    "trunk_clock_off", "check", "the clock of {placement} seems to be about {seconds:.1f} s {direction}: it moves when "
    "the legs rest, and rests when they move", WRONG_CLOCK,
)  # fmt: skip
LEGS_TOGETHER = Kind(
    "legs_together", "check", "{placement} and {other} swing {seconds:.2f} s apart, where half a stride is {half:.2f} "
    "s: one of the two clocks seems to be off, or both are on one leg", WRONG_CLOCK,
)  # fmt: skip
