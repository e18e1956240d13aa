"""The two detectors that the paper compares itself with, on a made shank."""

import numpy as np

from experiments.silva2017 import baselines

RATE, STRIDES = 100.0, 6
TIME = np.arange(1024) / RATE


def sagittal():
    """A push-off, a forward swing (negative) and a landing each stride."""
    middles = 2.0 + 1.2 * np.arange(STRIDES)

    def bumps(offset, width):
        return sum(np.exp(-0.5 * ((TIME - at - offset) / width) ** 2) for at in middles)

    return 3.0 * bumps(-0.26, 0.06) - 6.0 * bumps(0.0, 0.09) + 2.5 * bumps(0.24, 0.05)


def test_baselines_count_swings():
    gyr = np.stack([0 * TIME, sagittal(), 0 * TIME], axis=1)
    assert int(baselines.feliz(gyr, RATE).sum()) == STRIDES
    shaken = np.abs(sagittal()) * np.sign(np.sin(40.0 * TIME)) + 9.81
    acc = np.stack([0 * TIME, 0 * TIME, shaken], axis=1)
    assert int(baselines.jimenez(acc, RATE).sum()) == STRIDES
    assert not np.any(baselines.jimenez(np.tile([0.0, 0.0, 9.81], (len(TIME), 1)), RATE))
