"""A table of signals as a user would have it."""

import numpy as np
import pandas as pd

RATE = 100.0

NEEDED = ("thigh_right", "shank_right")


def signals(samples=600, seed=0):
    """Two seconds of standing, then swinging like a leg; deg/s and m/s²."""
    rng = np.random.default_rng(seed)
    time = np.arange(samples) / RATE
    swing = np.where(time > 2, 200 * np.sin(2 * np.pi * time), 0.0)
    gyr = rng.normal(scale=0.5, size=(samples, 3)) + swing[:, None] * [0.0, 0.1, 1.0]
    acc = rng.normal(scale=0.05, size=(samples, 3)) + [9.81, 0.0, 0.0] + swing[:, None] * [0.01, 0.0, 0.0]
    return {"gyr": gyr, "acc": acc}


def table(samples=600, placements=NEEDED, time=True):
    columns = {"time": np.arange(samples) / RATE} if time else {}
    for seed, placement in enumerate(placements):
        for kind, values in signals(samples, seed).items():
            columns.update({f"{placement}_{kind}_{axis}": values[:, i] for i, axis in enumerate("xyz")})
    return pd.DataFrame(columns)
