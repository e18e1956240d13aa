"""Clipped readings are found, and the peaks of a gyroscope that its range cut off are restored."""

import numpy as np
import pytest

from jgait.signal import clipping

RATE = 200.0
LIMIT = 8.7


def swings(highest=11.0):
    """Ten strides of a foot's rates [rad/s], the largest about the second axis."""
    time = np.arange(0.0, 10.0, 1.0 / RATE)
    phase = 2.0 * np.pi * time
    pitch = highest * (0.72 * np.sin(phase) + 0.4 * np.sin(2.0 * phase + 0.4))
    noise = 0.01 * np.random.default_rng(0).normal(size=(time.size, 3))
    return np.stack([0.3 * np.cos(phase), pitch, 0.2 * pitch], axis=1) + noise


@pytest.mark.parametrize("softness", [0.0, 0.02])
def test_peaks_are_restored_and_say_how_unsure_they_are(softness):
    true = swings()
    read = np.clip(true, -LIMIT, LIMIT)
    read = np.where(np.abs(true) > LIMIT, read + softness * np.random.default_rng(1).normal(size=read.shape), read)
    found = clipping.restored(read)
    cut = np.abs(true[:, 1]) > LIMIT
    assert cut.sum() > 100 and (found.clipped & cut).sum() > 0.95 * cut.sum()
    assert (found.clipped & ~cut).sum() <= 0.1 * cut.sum()
    np.testing.assert_array_equal(found.signal[~found.clipped], read[~found.clipped])
    # What is missing of the angle over a peak: most of it is restored, the rest agrees with the deviation.
    before, after = (np.sum((true - rate)[:, 1] * found.clipped) / RATE / 10.0 for rate in (read, found.signal))
    assert abs(after) < 0.25 * abs(before)
    assert 0.2 * before**2 < np.sum((found.doubt / RATE) ** 2) / 10.0 < 2.0 * before**2


ONE_PEAK = np.concatenate([np.clip(swings()[:200], -LIMIT, LIMIT), swings()[200:300]])  # may be chance


@pytest.mark.parametrize("rate", [swings(), swings(3.0), ONE_PEAK, np.zeros((50, 3)), np.zeros((0, 3))])
def test_a_rate_within_the_range_stays_as_it_is(rate):
    found = clipping.restored(rate)
    np.testing.assert_array_equal(found.signal, rate)
    assert not found.clipped.any() and not found.doubt.any()


def test_equal_readings_at_the_limit():
    values = np.array([[0.01], [9.0], [9.0], [1.0], [-9.0], [-9.0], [-9.0], [3.0], [3.0], [0.0]])
    np.testing.assert_array_equal(np.flatnonzero(clipping.at_limit(values, 8.0)), [1, 2, 4, 5, 6])
    np.testing.assert_array_equal(np.flatnonzero(clipping.at_limit(values, 8.0, 3)), [4, 5, 6])
    assert not clipping.at_limit(values, 9.5).any() and not clipping.at_limit(np.zeros((0, 2)), 1.0).any()


@pytest.mark.parametrize("resolution", [0.005, 0.96])
def test_equal_readings_of_a_coarse_signal_are_no_limit_but_many_are(resolution):
    """Twenty landings of different heights, 0.02 s wide at 100 Hz; the highest has two equal readings."""
    time = np.arange(0.0, 20.0, 0.01)
    height = np.random.default_rng(2).uniform(15.0, 28.0, 20)
    height[7] = 31.0
    true = height[time.astype(int)] * np.exp(-(((time % 1.0 - 0.505) / 0.03) ** 2))
    read = resolution * np.round(true / resolution)[:, None]
    assert np.sum(read == read.max()) == 2
    cut = np.clip(read, None, resolution * np.round(21.0 / resolution))
    assert clipping.at_limit(cut, 18.0).sum() > 10
    assert not (resolution > 0.1 and clipping.at_limit(read, 18.0).any())


def impacts(resolution):
    """Ten impacts of different sizes, of which one sample each is above 40 [m/s²]."""
    signal = np.random.default_rng(0).normal(size=(1000, 3))
    signal[50::100, 0] += np.linspace(42.0, 80.0, 10)
    return resolution * np.round(signal / resolution)


def test_impacts_that_a_range_cuts_off_for_single_samples():
    true = impacts(0.001)
    found = clipping.cut_short(np.clip(true, -39.2, 39.2), 18.0)
    np.testing.assert_array_equal(np.flatnonzero(found), np.arange(50, 1000, 100))
    assert not clipping.cut_short(true, 18.0).any()
    assert not clipping.cut_short(np.clip(true, -39.2, 39.2), 50.0).any()
    assert not clipping.cut_short(np.clip(impacts(1.0), -39.0, 39.0), 18.0).any()  # equal peaks can be chance
    round_peaks = 30.0 * np.sin(np.arange(1000.0) * 2.0 * np.pi / 100.0)[:, None]
    assert not clipping.cut_short(round_peaks, 18.0).any()
    assert not clipping.cut_short(np.zeros((0, 3)), 18.0).any()


def test_readings_that_are_written_twice_are_no_limit():
    """A table at a higher rate holds some readings; the largest of them is not cut off, those at the limit are."""
    rate = swings(5.0)
    rows = np.arange(int(1.28 * len(rate))) * 100 // 128
    rate[rows[1:][np.diff(rows) == 0][100], 1] = 5.5  # the largest one is written twice
    assert not clipping.at_limit(rate[rows], 4.0).any() and not clipping.forces_clipped(rate[rows], 4.0).any()
    cut = np.clip(rate, -4.5, 4.5)
    np.testing.assert_array_equal(clipping.at_limit(cut[rows], 4.0), clipping.at_limit(cut, 4.0)[rows])


@pytest.mark.parametrize("rate_hz", [100.0, 200.0])
def test_peaks_of_the_specific_force_are_restored_and_say_how_unsure_they_are(rate_hz):
    """More than half of the velocity that clipping takes is given back."""
    time = np.arange(0.0, 20.0, 1.0 / rate_hz)
    within = time % 1.0 - 0.5
    true = np.stack([0.0 * time, 70.0 * np.exp(-((within / 0.03) ** 2)), np.full(time.size, 9.81)], axis=1)
    true += 0.05 * np.random.default_rng(0).normal(size=true.shape)
    read = np.clip(true, -39.24, 39.24)
    clipped = clipping.forces_clipped(read, 18.0)
    np.testing.assert_array_equal(clipped, (true > 39.24).any(axis=1))
    found = clipping.restored_forces(read, clipped)
    np.testing.assert_array_equal(found.clipped, clipped)
    np.testing.assert_array_equal(found.signal[~found.clipped], read[~found.clipped])
    before, after = ((true - force)[:, 1].sum() / rate_hz / 20.0 for force in (read, found.signal))
    assert before > 0.5 and abs(after) < 0.5 * before
    spread = np.sqrt(np.sum(found.doubt**2) / 20.0) / rate_hz
    assert abs(after) < spread < before
    assert not clipping.restored_forces(read, np.zeros(len(read), bool)).clipped.any()
