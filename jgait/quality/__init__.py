"""The quality of what sensors measured: facts as values, which estimators compute with, and notes written from them.

Readers and estimators fill one `SensorQuality` for each sensor; no computation reads a note.
"""

from jgait.quality.sensor import SOUND, SensorQuality, above, merged, of_sensor, opposite

__all__ = ["SOUND", "SensorQuality", "above", "merged", "of_sensor", "opposite"]
