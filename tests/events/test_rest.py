"""Standing still is detected where a person stands, and nowhere else."""

import numpy as np
import pytest

from jgait.events import rest
from jgait.types import Imu

RNG = np.random.default_rng(0)


def _walk(rate_hz=100.0):
    """2 s standing, 3 s walking, 4 s standing; a biased and noisy gyroscope."""
    time = np.arange(int(9 * rate_hz)) / rate_hz
    moving = (time >= 2) & (time < 5)
    swing = np.where(moving, 3.0 * np.sin(2 * np.pi * (time - 2)), 0.0)
    gyr = np.stack([0.03 + 0 * time, swing, -0.02 + 0 * time], axis=1)
    return gyr + RNG.normal(scale=0.01, size=gyr.shape)


def test_the_longest_standing_is_found_and_none_where_nobody_stands():
    start, end = rest.longest_still(_walk()[:500], 100.0)
    assert start == 0 and 165 <= end <= 200
    start, end = rest.longest_still(_walk(), 100.0)
    assert 495 <= start <= 535 and end == 900
    assert rest.longest_still(_walk()[200:500], 100.0) is None
    assert rest.longest_still(np.full((500, 3), 1.0), 100.0) is None
    assert rest.longest_still(np.zeros((20, 3)), 100.0) is None, "shorter than a window"
    assert rest.longest_still(np.zeros((120, 3)), 100.0, at_least_s=2.0) is None, "shorter than asked for"
    assert rest.longest_still(np.zeros((220, 3)), 100.0, at_least_s=2.0) == (0, 220)


def test_masked_samples_do_not_count():
    gyr = _walk()
    spoilt = gyr.copy()
    spoilt[50:60] = 1e3
    mask = np.ones(len(gyr), bool)
    mask[50:60] = False
    start, end = rest.longest_still(spoilt[:300], 100.0, mask=mask[:300])
    assert start == 0 and end >= 165
    start, end = rest.longest_still(spoilt[:300], 100.0)
    assert end <= 30 or start >= 80
    assert rest.longest_still(np.zeros((200, 3)), 100.0, mask=np.zeros(200, bool)) is None


@pytest.mark.parametrize("noise", [0.02, 0.4])
def test_the_noise_of_an_accelerometer_for_200_g_is_no_movement_of_the_trunk(noise):
    """Four seconds of standing, four of walking, four of standing."""
    time = np.arange(1200) / 100.0
    walks = (time >= 4.0) & (time < 8.0)
    draw = np.random.default_rng(1)
    step = np.where(walks, np.sin(4.0 * np.pi * time), 0.0)[:, None]
    gyr = 0.4 * step + draw.normal(scale=0.01, size=(1200, 3))
    acc = np.array([0.0, 0.0, 9.81]) + 2.0 * step + draw.normal(scale=noise, size=(1200, 3))
    mask = np.ones(1200, bool)
    found = rest.trunk_rest(Imu(time, gyr, acc, mask), np.eye(3), mask, 100.0)
    assert found.notes == () and found.time > 4.0
    assert found.still[:350].all() and found.still[850:].all() and not found.still[430:770].any()
