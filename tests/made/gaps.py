"""Made shanks whose gyroscope sleeps part of the time."""

import numpy as np

RATE_HZ = 50.0

STRIDE = 55  # samples

COUNT = 300


def walk(count=COUNT, stride=float(STRIDE), seed=None):
    """A made shank: its rate [rad/s] and what an accelerometer 0.3 m under the knee feels [m/s²], nearly."""
    phase = 2 * np.pi * np.arange(count) / stride
    angle = 0.5 * np.sin(phase) + 0.15 * np.sin(2 * phase + 0.5) + 0.05 * np.sin(4 * phase)
    rate = np.gradient(angle) * RATE_HZ
    turning = np.gradient(rate) * RATE_HZ
    acc = np.stack([9.81 * np.sin(angle) + 0.3 * turning, 0.2 * rate, 9.81 * np.cos(angle) + 0.3 * rate**2], axis=1)
    if seed is not None:
        acc = acc + 0.3 * np.random.default_rng(seed).normal(size=acc.shape)
    return rate, acc


def varying(count, stride, seed, shift=0.0):
    """A shank whose strides vary, so that neighbours err: rate [rad/s] and acceleration [m/s²]."""
    phase = 2 * np.pi * np.arange(count) / stride
    size = 1.0 + 0.2 * np.sin(phase / 3.7 + shift)
    rate = size * (2.0 * np.sin(phase) + 1.5 * np.sin(2.0 * phase))
    acc = np.stack([4.0 * size * np.sin(phase), 0.3 * rate, 9.81 + 3.0 * np.sin(2.0 * phase)], axis=1)
    return rate, acc + 0.3 * np.random.default_rng(seed).normal(size=acc.shape)


def schedule(count=COUNT, first=130, on=30):
    """On for the first samples, then off for 70 and on by turns."""
    late = np.arange(count) - first
    return (late < 0) | (late % (70 + on) >= 70)
