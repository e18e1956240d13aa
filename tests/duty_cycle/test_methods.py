"""What each filler computes, against the definition or a loop in NumPy."""

import numpy as np
import pytest
from made.gaps import COUNT, RATE_HZ, schedule, walk

from jgait.duty_cycle.fillers.base import Thigh
from jgait.duty_cycle.fillers.neighbours import NEIGHBOURS, neighbours
from jgait.duty_cycle.fillers.ridge import RIDGE, ridge


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


def test_ridge_is_the_batch_solution_of_what_was_measured():
    rate, acc = walk(seed=6)
    on = schedule()
    found = ridge(rate, on, acc, RATE_HZ, RIDGE._replace(forget=0.99))
    lags = np.arange(0, 21, 2)
    rows = np.clip(np.arange(COUNT)[:, None] - lags, 0, None)
    x = np.column_stack([(acc / RIDGE.acc_scale)[rows].reshape(COUNT, -1), np.ones(COUNT)])
    for t in (150, 265):
        seen = np.flatnonzero(on[:t])
        count = 0.99 ** (len(seen) - 1 - np.arange(len(seen)))
        gram = (x[seen] * count[:, None]).T @ x[seen] + RIDGE.penalty * 0.99 ** len(seen) * np.eye(x.shape[1])
        weights = np.linalg.solve(gram, (x[seen] * count[:, None]).T @ rate[seen])
        np.testing.assert_allclose(found.rate[t], x[t] @ weights, rtol=1e-7)


def test_ridge_that_waits_says_so_and_knows_more():
    rate, acc = walk(seed=7)
    on = schedule()
    now, later = ridge(rate, on, acc, RATE_HZ), ridge(rate, on, acc, RATE_HZ, latency_s=0.1)
    assert int(now.latency) == 0 and int(later.latency) == 5
    assert not np.allclose(now.rate, later.rate)
    with pytest.raises(ValueError, match="latency_s"):
        ridge(rate, on, acc, RATE_HZ, latency_s=-0.1)


@pytest.mark.parametrize("fill", [ridge, neighbours])
def test_a_thigh_helps_where_the_shank_feels_nothing(fill):
    rate, acc = walk(seed=8)
    deaf = np.tile([0.0, 0.0, 9.81], (COUNT, 1)) + np.random.default_rng(9).normal(size=(COUNT, 3))
    on = schedule()
    thigh = Thigh(np.roll(rate, 3), acc)
    assert error(fill(rate, on, deaf, RATE_HZ, thigh=thigh), rate, on) < 0.3
    assert error(fill(rate, on, deaf, RATE_HZ), rate, on) > 0.6
