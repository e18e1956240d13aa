"""Virtual sensors: the readings of worn sensors for an exact motion.

`measure` simulates an inertial sensor with the errors of an `ImuErrors` (`presets` has those of published sensors),
`measure_range` the distance between the feet. Both are pure JAX: they can be jitted, mapped over people and
differentiated.
"""

from jgait.geometry.rotation import turn
from jgait.geometry.vectors import GRAVITY
from jgait.simulate.person import DEGREE
from jgait.simulate.sensors.imu import ImuErrors, check_errors, measure
from jgait.simulate.sensors.presets import HC_SR04, IDEAL, IDG300, MPU6000, ON_SHOE, OPAL
from jgait.simulate.sensors.range import Ranging, check_ranging, measure_range, nearest_point
from jgait.types import RangeReadings

__all__ = [
    "DEGREE", "GRAVITY", "HC_SR04", "IDEAL", "IDG300", "MPU6000", "ON_SHOE", "OPAL", "ImuErrors",
    "RangeReadings", "Ranging", "check_errors", "check_ranging", "measure", "measure_range", "nearest_point", "turn",
]  # fmt: skip
