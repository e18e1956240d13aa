"""Power and masks with soft edges: they tend to the schedule, cost what it costs, and have gradients."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.udaya2010.relaxed import relaxed_masks, relaxed_power
from jgait.duty_cycle import power

RATE = 50.0


@pytest.mark.parametrize("duty", [10, 50, 90])
def test_the_smooth_power_is_the_exact_one_where_edges_are_far_apart(duty):
    schedule = power.schedule_of_duty(duty / 100)
    smooth = relaxed_power(schedule.duty, schedule.period, softness=0.005)
    # What is left of the rounding: exp(−0.2 s / 5 ms).
    assert float(smooth) == pytest.approx(power.mean_power(schedule), rel=1e-12)


def test_soft_masks_tend_to_the_schedule_and_cost_what_it_costs():
    schedule = power.schedule_of_duty(0.4)
    hard = power.masks(schedule, 1400, RATE)
    time = (jnp.arange(1400.0) + 0.5) / RATE
    soft = relaxed_masks(time, schedule.duty, schedule.period, softness=1e-4)
    np.testing.assert_allclose(soft.usable, hard.usable, atol=1e-12)
    np.testing.assert_allclose(soft.powered, hard.powered, atol=1e-12)
    wide = relaxed_masks(time, schedule.duty, schedule.period, softness=0.02)
    mean = float(power.mask_energy(wide, RATE)) / 28.0
    # A sum of samples over sigmoids one sample wide.
    assert mean == pytest.approx(float(relaxed_power(schedule.duty, schedule.period)), rel=1e-3)


@pytest.mark.parametrize(("duty", "period"), [(0.37, 3.1), (0.9, 2.2), (0.97, 4.0)])
def test_slopes_of_the_smooth_form_are_those_of_differences(duty, period):
    time = jnp.arange(300.0) / RATE + 0.003  # no sample halfway between edges, where the slope turns over
    weights = jnp.cos(jnp.arange(300.0))

    def both(values):
        used = relaxed_masks(time, values[0], values[1])
        return 1e3 * relaxed_power(values[0], values[1]) + weights @ used.usable + weights @ used.powered

    at = jnp.asarray([duty, period])
    slope = jax.grad(both)(at)
    h = 1e-6
    for i in range(2):
        step = h * jnp.eye(2)[i]
        assert float(slope[i]) == pytest.approx(float((both(at + step) - both(at - step)) / (2 * h)), rel=1e-5)
    assert np.all(np.isfinite(slope))
