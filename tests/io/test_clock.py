"""Clocks of recordings: stamps that jitter, repeat, or count, and rates at which nobody records a walk."""

import numpy as np
import pytest

from jgait.io.clock import make_clock, unwrapped
from jgait.types import RecordingError

RATE_HZ, SAMPLES = 128.0, 3000


def stamps(jitter_s, lost=()):
    """Times [s] of samples that jitter, in order, without some samples."""
    kept = np.setdiff1d(np.arange(SAMPLES), lost)
    return np.sort(kept / RATE_HZ + np.random.default_rng(3).normal(0.0, jitter_s, len(kept)))


def codes(clock):
    return [note.code for note in clock.notes]


@pytest.mark.parametrize("jitter_s", [0.001, 0.002, 0.003])
@pytest.mark.parametrize("rate_hz", [None, RATE_HZ])
def test_jitter_does_not_bend_the_rate_and_makes_no_losses(jitter_s, rate_hz):
    clock = make_clock(SAMPLES, stamps(jitter_s), rate_hz, "s", "walk")
    assert clock.sampling_rate_hz == pytest.approx(RATE_HZ, rel=1e-3)
    np.testing.assert_array_equal(clock.rows, np.arange(SAMPLES))
    np.testing.assert_allclose(np.diff(clock.time), 1 / RATE_HZ, rtol=0.02)
    (note,) = (note for note in clock.notes if note.code == "times_corrected")
    assert note.values["jitter_ms"] == pytest.approx(1e3 * jitter_s, rel=0.1)


@pytest.mark.parametrize("lost", [[500], [500, 501, 502, 1500], range(800, 840)])
def test_losses_are_found_in_spite_of_jitter(lost):
    clock = make_clock(SAMPLES - len(lost), stamps(0.002, lost), None, "s", "walk")
    assert clock.sampling_rate_hz == pytest.approx(RATE_HZ, rel=1e-3)
    np.testing.assert_allclose(np.flatnonzero(clock.rows < 0), lost, atol=4)


def test_a_pause_of_the_radio_whose_samples_arrive_late_has_lost_none():
    time = np.arange(SAMPLES) / RATE_HZ
    time[1000:1020] = np.maximum(time[1000:1020], time[1020] - 0.0005 * np.arange(20, 0, -1))
    clock = make_clock(SAMPLES, time, None, "s", "walk")
    assert (clock.rows >= 0).all() and "times_corrected" in codes(clock)
    assert clock.sampling_rate_hz == pytest.approx(RATE_HZ, rel=1e-3)


def test_a_clock_that_drifts_is_followed_and_few_late_stamps_among_losses_change_nothing():
    time = stamps(0.002)
    slow = 0.02 * np.sin(time / 4.0)
    clock = make_clock(SAMPLES, time + slow, None, "s", "walk")
    wanted = np.arange(SAMPLES) / RATE_HZ + slow
    np.testing.assert_allclose(clock.time - clock.time.mean(), wanted - wanted.mean(), atol=0.002)
    lost = np.random.default_rng(1).choice(np.arange(10, SAMPLES), SAMPLES // 4, replace=False)
    time = stamps(0.0, lost)
    time[400] += 0.006
    clock = make_clock(len(time), time, None, "s", "walk")
    assert codes(clock) == ["deduced", "data_lost"]
    assert clock.sampling_rate_hz == pytest.approx(RATE_HZ, rel=1e-3)


STAMPS = {
    "a timer of Windows": lambda time: np.floor(time / 0.015625) * 0.015625,
    "steps of 10 ms": lambda time: np.round(time, 2),
    "whole seconds": np.floor,
    "packets of 3": lambda time: time[np.arange(len(time)) // 3 * 3],
    "packets of 20": lambda time: time[np.arange(len(time)) // 20 * 20],
    "arrival of packets of 5": lambda time: _arrival(time, 5),
    "arrival of packets of 20": lambda time: _arrival(time, 20),
    "jitter that turns rows round": lambda time: time + np.random.default_rng(3).normal(0.0, 0.6 * time[1], len(time)),
}


def _arrival(time, number):
    """Times at which packets arrive, some ms late, and their samples 0.5 ms after each other."""
    row = np.arange(len(time))
    last = np.minimum((row // number + 1) * number, len(row)) - 1
    late = np.abs(np.random.default_rng(2).normal(0.0, 0.004, len(time)))[last]
    return np.maximum.accumulate(time[last] + late + 0.0005 * (row % number))


@pytest.mark.parametrize("rate_hz", [50.0, 75.0, 100.0, 128.0, 200.0])
@pytest.mark.parametrize("name", STAMPS)
def test_coarse_stamps_and_packets_give_even_times_at_the_right_rate(name, rate_hz):
    time = np.arange(round(25 * rate_hz)) / rate_hz
    clock = make_clock(len(time), STAMPS[name](time), None, "s", "walk")
    assert clock.sampling_rate_hz == pytest.approx(rate_hz, rel=4e-3)
    assert np.sum(clock.rows < 0) <= 0.004 * len(time)
    exact = name == "steps of 10 ms" and rate_hz in (50.0, 100.0)
    assert exact or "times_corrected" in codes(clock)


def test_rows_that_are_copies_are_left_out_and_others_of_one_time_are_samples():
    time, copies = np.arange(SAMPLES) / RATE_HZ, np.arange(5, SAMPLES, 10)
    twice = np.sort(np.append(time, time[copies]))
    clock = make_clock(len(twice), twice, None, "s", "walk", again=np.diff(twice) == 0)
    assert clock.sampling_rate_hz == pytest.approx(RATE_HZ, rel=1e-6) and len(clock.time) == SAMPLES
    assert len(make_clock(len(twice), twice, None, "s", "walk").time) == len(twice)


def test_a_counter_of_packets_counts_the_samples_in_them():
    packets = np.repeat(np.delete(np.arange(2**16 - 30, 2**16 + 30), [20, 21]) % 2**16, 10)[:-3]
    numbers = unwrapped(packets)
    np.testing.assert_array_equal(np.flatnonzero(np.diff(numbers) != 1), [199])
    assert numbers[200] - numbers[199] == 21
    assert unwrapped(np.repeat([1, 2, 3], [10, 4, 10])) is None


REFUSED = {
    "numbers of samples": (
        np.arange(600) + 7, None, None,
        r"time counts the samples \(7, 8, …\), so sampling_rate_hz is needed; if it is in ms",
    ),
    "ticks": (
        np.arange(600) * 328, None, None,
        "the time's steps are 328, so the sampling rate would be 0.003049 Hz in s, 3.049 Hz in ms, 3049 Hz in us, "
        r"3.049e\+06 Hz in ns; expected 9.1 to 2000 Hz. Write the time in s; divide ticks",
    ),
    "a clock that steps back": (
        np.concatenate([np.arange(400), 150 + np.arange(200)]) / 100, None, None,
        "another recording begins: split the recording there, and do not sort",
    ),
    "a clock that was set forward": (
        np.arange(600) / 100 + np.where(np.arange(600) < 300, 0.0, 3600.0), None, None,
        "3600.0 s are missing after row 299 .*; split the recording there",
    ),
    "rows in disorder": (np.roll(np.arange(600), 200) / 100, None, None, "the rows are in disorder: sort them by time"),
    "slow stamps": (np.arange(600) * 0.2, None, None, "steps are 0.2, so the sampling rate would be 5 Hz in s"),
    "slow rate": (None, 5.0, None, "sampling_rate_hz is 5 Hz; walking needs at least 9.1 Hz"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_clocks_that_are_refused(name):
    time, rate_hz, unit, message = REFUSED[name]
    with pytest.raises(RecordingError, match=message):
        make_clock(600, time, rate_hz, unit, "walk")
