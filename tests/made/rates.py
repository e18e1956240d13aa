"""Recordings with a wrong clock or with wrong rates, and what an estimate says about them."""

import numpy as np

from jgait.estimators.notes import RATES_OFF


def changed(recording, placements, clock=1.0, rates=1.0):
    """The recording whose clock, and the rates of some of its sensors, are too large by factors."""
    sensors = {
        name: imu._replace(
            time=np.asarray(imu.time) / clock, gyr=np.asarray(imu.gyr) * (rates if name in placements else 1.0)
        )
        for name, imu in recording.sensors.items()
    }
    return recording._replace(sensors=sensors, sampling_rate_hz=recording.sampling_rate_hz * clock)


def factors_of(estimate):
    """Placement → factor of the notes on rates."""
    notes = estimate.diagnostics["notes"]
    return {note.values["placement"]: note.values["factor"] for note in notes if note.code == RATES_OFF.code}
