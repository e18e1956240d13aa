"""Schedules found by gradient: the gradient of the soft error."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from made.gaps import varying

from experiments.udaya2010 import power_descent, power_tradeoff
from experiments.udaya2010.power_tradeoff import Shank
from experiments.udaya2010.relaxed import relaxed_masks
from jgait.duty_cycle.fillers import NEIGHBOURS

pytestmark = pytest.mark.release

RATE_HZ = 50.0
STRIDE = 50  # samples
COUNT = 250
BEGIN = 2 * STRIDE


def test_the_gradient_of_the_soft_error_is_that_of_differences():
    rate, acc = varying(COUNT, STRIDE, seed=2, shift=2)
    stack = power_tradeoff._stacked([Shank(rate, acc, BEGIN, STRIDE / RATE_HZ, None)])
    far = power_descent.distances(stack.apart[0], NEIGHBOURS, 1.0 / RATE_HZ)
    rows = jnp.arange(0, COUNT, 3)
    time = jnp.asarray((np.arange(COUNT) - BEGIN) / RATE_HZ)

    @jax.jit
    def error(duty, period):
        usable = relaxed_masks(time, duty, period, softness=0.05).usable
        usable = jnp.where(time < 0.0, 1.0, usable)
        return power_descent.relaxed_error(usable, stack.rate[0], far, rows, rows >= BEGIN, NEIGHBOURS)

    slopes = jax.grad(error, argnums=(0, 1))(0.37, 1.31)
    for k, slope in enumerate(slopes):
        step = np.eye(2)[k] * 1e-6
        by_hand = (error(*(np.array([0.37, 1.31]) + step)) - error(*(np.array([0.37, 1.31]) - step))) / 2e-6
        assert abs(float(slope)) > 1e-4
        assert float(slope) == pytest.approx(float(by_hand), rel=1e-4)
