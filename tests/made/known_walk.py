"""A walk known in every sample, to be written in the formats of measuring systems and read again."""

import numpy as np

RATE = 100.0
SAMPLES = 250
GRAVITY = 9.80665
PLACES = ("lower_back", "foot_right", "foot_left")


def signals(place: str, samples: int = SAMPLES, rate: float = RATE) -> tuple[np.ndarray, np.ndarray]:
    """Angular rate [rad/s] and specific force [m/s²], each (T, 3), of nobody in particular, gravity along x."""
    number = 1.0 + PLACES.index(place)
    t = np.arange(samples)[:, None] / rate
    phase = np.array([0.0, 1.0, 2.0]) + number
    gyr = (1.0 + number) * np.sin(2.0 * np.pi * (0.9 + 0.1 * number) * t + phase) + 0.1 * np.cos(11.0 * t + phase)
    acc = np.array([GRAVITY, 0.0, 0.0]) + 0.3 * number * np.cos(2.0 * np.pi * 1.8 * t + phase)
    return gyr, acc


def agrees(imu, place: str, within: float = 1e-9) -> None:
    """Every sample of a sensor is what was written, in SI units, at its time."""
    gyr, acc = signals(place)
    assert imu.mask.all()
    np.testing.assert_allclose(imu.gyr, gyr, rtol=0.0, atol=within)
    np.testing.assert_allclose(imu.acc, acc, rtol=0.0, atol=10.0 * within)
    np.testing.assert_allclose(imu.time, np.arange(SAMPLES) / RATE, rtol=0.0, atol=1e-9)
