"""The policy that wakes the gyroscope is causal, waits for the wake-up, plans best, and keeps to its budget."""

from itertools import product
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from made.gaps import varying

from experiments.udaya2010.trigger import TRIGGER, _planned, triggered
from jgait.duty_cycle import power
from jgait.duty_cycle.filling import FILLED, MEASURED
from jgait.duty_cycle.power import GYROSCOPE

pytestmark = pytest.mark.release

RATE_HZ = 50.0
STRIDE = 55  # samples
COUNT = 400
WARM = 2 * STRIDE
CHANGED = 300  # from here on the future differs
LEAD = power.wake_samples(GYROSCOPE, RATE_HZ)
BUDGET, BUCKET = 5e-3, 0.03  # [W], [J]
WAKE = 0.13
NAMES = ("usual", "other_future", "never", "always", "budget")


def walk():
    return varying(COUNT, STRIDE, 3)


@pytest.fixture(scope="module")
def told():
    """Five policies at once, by name."""
    rate, acc = walk()
    after = np.arange(COUNT) >= CHANGED
    rates = jnp.asarray(np.stack([rate, rate + 3.0 * after, rate, rate, rate]))
    accs = jnp.asarray(np.stack([acc, acc + 2.0 * after[:, None], acc, acc, acc]))
    wake = jnp.asarray([WAKE, WAKE, np.inf, 0.0, 0.0])
    budget = jnp.asarray([np.inf, np.inf, np.inf, np.inf, BUDGET])
    must = jnp.arange(COUNT) < WARM

    def one(r, a, w, b):
        return triggered(r, a, RATE_HZ, TRIGGER._replace(wake=w, budget=b, bucket=BUCKET), must=must)

    found = jax.tree.map(np.asarray, jax.jit(jax.vmap(one))(rates, accs, wake, budget))
    parts = {}
    for k, name in enumerate(NAMES):
        own = jax.tree.map(lambda leaf, k=k: leaf[k], found)
        parts[name] = SimpleNamespace(
            rate=own.filled.rate, how=own.filled.how, powered=own.used.powered, usable=own.used.usable,
            used=own.used, predicted=own.predicted, true=np.asarray(rates[k]),
        )  # fmt: skip
    return parts


def test_the_usual_one_switches_and_measured_samples_are_passed_on(told):
    t = told["usual"]
    assert t.powered[:WARM].all() and 0.1 < t.powered[WARM:].mean() < 0.95
    assert np.abs(np.diff(t.powered.astype(int))).sum() >= 3  # on again at least once
    np.testing.assert_array_equal(t.rate[t.usable], t.true[t.usable])
    np.testing.assert_array_equal(t.how, np.where(t.usable, MEASURED, FILLED))
    assert np.isfinite(t.predicted).all() and (t.predicted >= 0.0).all()


def test_it_is_causal_and_decides_before_the_sample(told):
    a, b = told["usual"], told["other_future"]
    for name in ("rate", "predicted"):
        np.testing.assert_array_equal(getattr(a, name)[:CHANGED], getattr(b, name)[:CHANGED])
        assert not np.array_equal(getattr(a, name)[CHANGED:], getattr(b, name)[CHANGED:])
    # Whether the first sample that differs is measured was decided before it.
    np.testing.assert_array_equal(a.powered[: CHANGED + 1], b.powered[: CHANGED + 1])


@pytest.mark.parametrize("name", NAMES)
def test_the_wake_up_is_waited_for(told, name):
    t = told[name]
    awake = np.concatenate([np.ones(LEAD, bool), t.powered])  # it is awake at the first sample
    expected = [awake[k : k + LEAD + 1].all() for k in range(COUNT)]
    np.testing.assert_array_equal(t.usable, expected)


def least_cost(errors, price, lead, first):
    """Over all ways to be powered; `first`: whether the first sample is, and it was on (awake) or off before."""
    best = {True: np.inf, False: np.inf}
    for powered in product((True, False), repeat=len(errors)):
        age, cost = lead if first else 0, 0.0
        waking = False
        for on, error in zip(powered, errors, strict=True):
            if waking and not on and age <= lead:
                cost = np.inf  # a wake-up is not broken off
            age = age + 1 if on else 0
            waking = on
            cost += price * on + error * (age <= lead)
        best[powered[0]] = min(best[powered[0]], cost)
    return best


@pytest.mark.parametrize("lead", [0, 2])
def test_the_plan_is_the_best_of_all(lead):
    rng = np.random.default_rng(5)
    prices = jnp.asarray([GYROSCOPE.on, GYROSCOPE.on, GYROSCOPE.off])
    plan = jax.jit(_planned, static_argnums=2)
    found = set()
    for _ in range(20):
        errors, price = rng.exponential(size=8) ** 2, rng.uniform(0.2, 1.0)
        off, wake = (bool(x) for x in plan(jnp.asarray(errors), jnp.asarray(price), lead, prices))
        awake, asleep = least_cost(errors, price, lead, True), least_cost(errors, price, lead, False)
        assert off == (awake[False] < awake[True])
        assert wake == (asleep[True] < asleep[False])
        found.add((off, wake))
    assert len(found) >= 2


def test_the_budget_is_kept_at_every_sample(told):
    t = told["budget"]
    spent = np.cumsum(t.powered[WARM:]) * GYROSCOPE.on / RATE_HZ
    allowed = BUCKET + BUDGET * np.arange(1, COUNT - WARM + 1) / RATE_HZ
    assert (spent <= allowed + 1e-12).all()
    assert spent[-1] > 0.6 * allowed[-1]  # and used: the threshold of zero wants all of it
