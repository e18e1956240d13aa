"""Fillers by a filter's prediction: the interface of all fillers, and what the models predict."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from made.gaps import COUNT, RATE_HZ, STRIDE, schedule, walk

from experiments.udaya2010.oscillator import FILLERS
from jgait.duty_cycle.fillers.base import FILLED, HELD, MEASURED
from jgait.params import check_params

pytestmark = pytest.mark.release


@pytest.mark.parametrize(
    ("name", "most"), [("resonate", 0.1), ("oscillate", 0.2), ("oscillate_alone", 0.3), ("extrapolate", 2.0)]
)
def test_the_interface_of_all_fillers_and_the_error_of_a_known_walk(name, most):
    rate, acc = walk(seed=1)
    on, one = schedule(), FILLERS[name]
    little = on & (np.arange(COUNT) < STRIDE)
    rates, masks = jnp.asarray(np.stack([rate, np.where(on, rate, 1e3), rate])), jnp.asarray([on, on, little])
    found = jax.jit(jax.vmap(lambda r, u: one.fill(r, u, jnp.asarray(acc), RATE_HZ, one.params)))(rates, masks)
    np.testing.assert_array_equal(found.rate[0][on], rate[on])
    np.testing.assert_array_equal(found.how[0], np.where(on, MEASURED, FILLED))
    np.testing.assert_array_equal(found.rate[1], found.rate[0])
    assert (np.asarray(found.how[2])[~little] == HELD).all() and np.isfinite(found.rate).all()
    check_params(one.params, one.transforms)
    assert np.sqrt(np.mean((np.asarray(found.rate[0]) - walk()[0])[~on] ** 2) / np.mean(rate**2)) < most
