"""The parts of the waist's estimator on problems whose answer is known: pendulum, bouts, the height of a sensor."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jgait.estimators.waist import WaistParams, with_body
from jgait.estimators.waist.inputs import CLOSING, bouts
from jgait.estimators.waist.model import constant_variance, pendulum
from jgait.events.trunk import Contacts
from jgait.geometry.vectors import GRAVITY


def test_the_pendulum_of_zijlstra_and_hof():
    p = WaistParams(excursion_power=1.0, surge_power=0.0, pendulum_length=0.9)
    h = np.array([0.01, 0.03, 0.05])
    np.testing.assert_allclose(pendulum(p, h, np.full(3, 0.3)), 2.0 * np.sqrt(2.0 * 0.9 * h - h * h), rtol=1e-12)
    # who does not rise takes no step, and no derivative is infinite there
    slope = jax.grad(lambda x: pendulum(p, x, jnp.asarray(0.3)))(0.0)
    assert pendulum(p, 0.0, 0.3) == 0.0 and float(slope) == 0.0
    # both powers, by hand
    both = WaistParams(excursion_power=0.8, surge_power=0.1, pendulum_length=0.9)
    chord, quick = 2.0 * np.sqrt(2.0 * 0.03 / 0.9 - (0.03 / 0.9) ** 2), 0.3 / np.sqrt(GRAVITY * 0.9)
    expected = 0.9 * chord**0.8 * quick**0.1
    np.testing.assert_allclose(pendulum(both, 0.03, 0.3), expected, rtol=1e-12)


HZ, STEP = 100.0, 0.5


def bout_of(steps, stands_s, forward=None, until_s=1.0):
    """The nodes of one bout whose contacts are at these steps after 2 s, right and left in turn, before standing."""
    time = 2.0 + STEP * np.asarray(steps, float)
    side, every = np.arange(time.size) % 2, np.ones(time.size)
    contacts = Contacts(time, side, every > 0.0, time, every / STEP, 0.9 * every)
    still = [(0, round(until_s * HZ)), (round(stands_s * HZ), round(stands_s * HZ) + 200)]
    (bout,) = bouts(contacts, still, HZ, np.zeros(1000) if forward is None else forward)
    return bout


def test_a_closing_step_without_a_jolt_comes_between_the_last_contact_and_standing():
    bout = bout_of([0, 1, 2, 3], 4.7)  # 2.4 steps after the last contact
    assert sum(node.contact for node in bout) == 5
    assert bout[-2].at == pytest.approx(HZ * (2.0 + (3.0 + CLOSING) * STEP))
    assert (bout[-2].side, bout[-2].step, bout[-2].stands, bout[-1].stands) == (0, True, False, True)
    # who stands still sooner has closed the step before
    assert sum(node.contact for node in bout_of([0, 1, 2, 3], 4.4)) == 4


def test_a_first_contact_just_before_the_end_of_a_rest_is_a_weight_shift():
    bout = bout_of([0, 1, 2, 3], 4.4, until_s=2.1)
    assert (bout[0].stands, bout[0].at) == (True, 209.0)
    assert [node.at for node in bout if node.contact] == [250.0, 300.0, 350.0]


def test_an_unknown_height_is_a_wider_deviation():
    unknown, person, sensor = (
        constant_variance(with_body(WaistParams(), body)) for body in ({}, {"height": 1.6}, {"sensor_height": 0.96})
    )
    assert unknown > person > sensor > WaistParams().pendulum_constant_sd ** 2
