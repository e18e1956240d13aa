"""Every filler keeps the interface; hold, replicate, neighbours and the pace do what they say."""

from functools import cache
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from made.gaps import COUNT, RATE_HZ, STRIDE, schedule, walk

from jgait.duty_cycle.fillers import FILLERS, NEIGHBOURS, hold, neighbours, replicate
from jgait.duty_cycle.filling import FILLED, HELD, MEASURED, Thigh, check_signals, pace
from jgait.mounting import shank as shank_axes
from jgait.params import check_params

CHANGED = 250  # from here on the future differs


@cache
def told(name):
    """Five recordings through one filler at once: as it is; other values where off; another future; little measured."""
    rate, acc = walk(seed=1)
    on = schedule()
    other = np.where(on, rate, 1e3)
    after = np.arange(COUNT) >= CHANGED
    future, felt = rate + 3.0 * after, acc + 2.0 * after[:, None]
    little = on & (np.arange(COUNT) < STRIDE)
    rates = jnp.asarray(np.stack([rate, other, future, rate]))
    masks = jnp.asarray(np.stack([on, on, on ^ (after & ~on), little]))
    accs = jnp.asarray(np.stack([acc, acc, felt, acc]))
    one = FILLERS[name]
    found = jax.jit(jax.vmap(lambda r, u, a: one.fill(r, u, a, RATE_HZ, one.params)))(rates, masks, accs)
    return SimpleNamespace(rates=rates, masks=masks, rate=np.asarray(found.rate), how=np.asarray(found.how),
                           latency=int(found.latency[0]))  # fmt: skip


@pytest.mark.parametrize("name", list(FILLERS))
def test_every_filler_keeps_the_interface(name):
    t, one = told(name), FILLERS[name]
    check_params(one.params, one.transforms)
    on = np.asarray(t.masks[0])  # measured samples are passed on, and every sample is flagged
    np.testing.assert_array_equal(t.rate[0][on], np.asarray(t.rates[0])[on])
    assert np.isfinite(t.rate).all()
    np.testing.assert_array_equal(t.how[0], np.where(on, MEASURED, HELD if name == "hold" else FILLED))
    for part in (t.rate, t.how):  # what is off is inert
        np.testing.assert_array_equal(part[1], part[0])
    until = CHANGED - t.latency  # the future beyond the latency changes nothing
    np.testing.assert_array_equal(t.rate[2][:until], t.rate[0][:until])
    assert not np.allclose(t.rate[2], t.rate[0])
    off = ~np.asarray(t.masks[3])  # less than two strides measured: held and flagged
    assert (t.how[3][off] == HELD).all()
    np.testing.assert_array_equal(t.rate[3][off], np.asarray(t.rates[3])[STRIDE - 1])


def test_the_accelerometer_is_asked_for_where_it_is_needed():
    one = FILLERS["neighbours"]
    assert one.needs_acc
    with pytest.raises(ValueError, match="acc is None"):
        one.fill(walk(120)[0], schedule(120), None, RATE_HZ, one.params)


def test_hold_keeps_the_last_measured_value_and_replicate_repeats_an_even_walk_exactly():
    rate, acc = walk()
    np.testing.assert_array_equal(hold(rate, schedule(), acc, RATE_HZ).rate[130:135], rate[129])
    rate, acc = walk(COUNT)
    found = replicate(rate, schedule(), acc, RATE_HZ)
    # The period's estimate is a parabola's vertex: off by some thousandths of a sample.
    np.testing.assert_allclose(found.rate[60:-1], rate[60:-1], atol=0.05)  # the last is a one-sided difference


@pytest.mark.parametrize("felt", [True, False])
def test_the_pace_is_told_through_gaps(felt):
    rate, acc = walk(500, 60.3, seed=3)
    on = schedule(500, first=150, on=60)
    s = check_signals(rate, jnp.asarray(on), acc if felt else None, RATE_HZ, None)
    p = pace(s, RATE_HZ)
    np.testing.assert_allclose(p.period[150:], 60.3 / RATE_HZ, atol=0.01)
    np.testing.assert_allclose(p.strides[149], 150 / 60.3, atol=0.1)
    assert bool(p.known[149]) and not bool(p.known[30])


def error(found, rate, on):
    return np.sqrt(np.mean((np.asarray(found.rate) - rate)[~on] ** 2) / np.mean(rate**2))


def test_neighbours_are_those_of_the_definition():
    rate, acc = walk(200, 54.3, seed=5)
    on, p = schedule(200), NEIGHBOURS
    found = neighbours(rate, on, acc, RATE_HZ)
    keep = np.exp(-1.0 / (p.history_s * RATE_HZ))
    for t in (140, 165, 199):
        alike, values = [], []
        for s in np.flatnonzero(on[:t]):
            ages = np.arange(s + 1)  # both histories, as far as the older one goes back
            cost = ((acc[t - ages] - acc[s - ages]) ** 2).sum(axis=1) / p.acc_scale**2
            weight = (keep**ages).sum()
            alike.append((keep**ages * cost).sum() / weight + p.short * (1.0 - (1.0 - keep) * weight))
            values.append(rate[s])
        alike, nearest = np.array(alike), min(alike)
        kernel = np.exp(-(alike - nearest) / (2.0 * p.bandwidth**2 * (nearest + p.floor)))
        if not on[t]:
            np.testing.assert_allclose(found.rate[t], (kernel * values).sum() / kernel.sum(), rtol=1e-9)


def test_neighbours_follow_a_walk_whose_stride_changes_in_the_gap():
    stride = np.where(np.arange(400) < 150, 55.0, 60.0)
    phase = np.cumsum(2 * np.pi / stride)
    rate = 3.0 * np.sin(phase) + np.sin(2 * phase)
    acc = np.stack([5.0 * np.sin(phase + 1.0), np.zeros(400), 9.81 + 3.0 * np.cos(2 * phase)], axis=1)
    on = np.arange(400) < 150
    found = neighbours(rate, on, acc, RATE_HZ)
    assert error(found, rate, on) < 0.08  # a replica of the last cycle loses 1/11 of a cycle at each


def test_a_thigh_helps_where_the_shank_feels_nothing():
    rate, acc = walk(seed=8)
    deaf = np.tile([0.0, 0.0, 9.81], (COUNT, 1)) + np.random.default_rng(9).normal(size=(COUNT, 3))
    on = schedule()
    thigh = Thigh(np.roll(rate, 3), acc)
    assert error(neighbours(rate, on, deaf, RATE_HZ, thigh=thigh), rate, on) < 0.3
    assert error(neighbours(rate, on, deaf, RATE_HZ), rate, on) > 0.6


def test_a_real_shank_is_filled_better_than_the_paper_fills_it(data):
    """First 14 s of the steady walk, ten units of 1.4 s, four of ten on; the paper has 0.267, replicate 0.18."""
    walk = data("tripod", "Sub_FZ/PWS")[0]
    imu = walk.recording.sensors["shank_right"]
    axes = shank_axes.functional_axes(imu)
    begin = walk.info["windows"]["steady"][0]
    part = slice(begin, begin + round(14 * walk.recording.sampling_rate_hz), 2)
    rate, acc = np.asarray(imu.gyr)[part] @ axes.rows[1], np.asarray(imu.acc)[part] @ axes.rows.T
    on = np.arange(len(rate)) // 90 % 5 < 2  # 1.4 s at 64 Hz
    one = FILLERS["neighbours"]
    found = one.fill(rate, on, acc, walk.recording.sampling_rate_hz / 2, one.params)
    error = np.asarray(found.rate) - rate
    assert np.sqrt(np.mean(error**2) / np.mean(rate**2)) < 0.10
