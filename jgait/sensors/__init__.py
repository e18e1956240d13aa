"""Virtual sensors: what worn sensors make of an exact motion."""

from jgait.sensors.imu import DEGREE, IDEAL, IDG300, SensorNoise, measure, turn
from jgait.kinematics import GRAVITY

__all__ = ["DEGREE", "GRAVITY", "IDEAL", "IDG300", "SensorNoise", "measure", "turn"]
