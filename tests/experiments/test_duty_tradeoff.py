"""Schedules found by gradient: the soft error is the filler's own at hard masks, gradients hold, fronts are fronts."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from made.gaps import varying

from experiments.udaya2010 import power_descent, power_tradeoff
from experiments.udaya2010.power_descent import Settings
from experiments.udaya2010.power_tradeoff import Shank, judge, pareto
from experiments.udaya2010.relaxed import relaxed_masks
from jgait.duty_cycle.fillers.base import Thigh
from jgait.duty_cycle.fillers.neighbours import NEIGHBOURS
from jgait.duty_cycle.power import GYROSCOPE

pytestmark = pytest.mark.release

RATE_HZ = 50.0
STRIDE = 50  # samples
COUNT = 250
BEGIN = 2 * STRIDE


def shank(seed: int, thigh: bool = False) -> Shank:
    rate, acc, phase, size = varying(COUNT, STRIDE, seed, seed)
    worn = Thigh(np.cos(phase) * size, 0.5 * acc) if thigh else None
    return Shank(rate, acc, BEGIN, STRIDE / RATE_HZ, worn)


def test_the_gradient_of_the_soft_error_is_that_of_differences():
    one = shank(2)
    stack = power_tradeoff._stacked([one])
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


def test_a_front_falls_pays_for_wake_ups_and_judges_what_it_did_not_see():
    own, other = [shank(k) for k in (1, 2, 3)], [shank(k) for k in (4, 5)]
    settings = Settings(steps=25, periods=(1.2,), batch=2)
    points = pareto(own, other, (0.02, 0.3), RATE_HZ, settings=settings, phases=2)
    assert len(points) == 2 and points[0].price == 0.3
    assert points[0].power < points[1].power and points[0].error > points[1].error
    for point in points:
        error, drawn = judge(point.plan, other, RATE_HZ, power_tradeoff.alone(NEIGHBOURS), phases=2)
        assert (error, drawn) == (point.error, point.power)
        assert point.saving == pytest.approx(1.0 - point.power / GYROSCOPE.on)
        assert point.power > GYROSCOPE.on * point.duty - 4e-3  # a walk of three strides ends anywhere in a period
