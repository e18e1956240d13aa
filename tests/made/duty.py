"""An estimate as `duty_cycled_gyro` gives it, of a right leg whose shank's gyroscope sleeps a while."""

import numpy as np
from made.notes import note

from jgait.duty_cycle.filling import FILLED, HELD, MEASURED
from jgait.types import Estimate, Legs, LegTrajectory

RATE, SAMPLES = 50.0, 2000


def flags():
    """How the shank's rate is known, sample by sample."""
    how = np.full(SAMPLES, MEASURED)
    how[500:600], how[800:1000] = HELD, FILLED
    return how


def made(*, joints=True):
    """With both sensors, or with that of the shank alone."""
    time = np.arange(SAMPLES) / RATE
    wave, spread = np.sin(2.0 * np.pi * time), np.full(SAMPLES, 0.02)
    told = {"gyro_energy_saved": 0.4, "usable_share": 0.5, "mean_power": 0.02, "battery_life": 7200.0,
            "battery_life_always_on": 3600.0, "latency": 0.0, "notes": (note("a fact"),),
            "standing": (0, 50)}  # fmt: skip
    for name in ("thigh_right", "shank_right") if joints else ("shank_right",):
        how = flags() if name == "shank_right" else np.full(SAMPLES, MEASURED)
        told |= {f"angle_{name}": 0.3 * wave, f"angle_stddev_{name}": spread, f"gyro_{name}": wave, f"how_{name}": how}
    trajectory = LegTrajectory(0.3 * wave, 0.6 * wave, wave, wave) if joints else None
    stddev = Legs(LegTrajectory(*(spread,) * 4), None) if joints else None
    return Estimate(time, Legs(trajectory, None), stddev, None, np.ones(SAMPLES, bool), told)
