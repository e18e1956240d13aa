"""What a turn adds to the errors of one axis of a gyroscope."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jgait import simulate
from jgait.estimators import duty_cycled_gyro
from jgait.estimators.duty_cycled_gyro import DutyCycledParams, turns
from jgait.simulate.routes import u_turn
from jgait.simulate.sensors.presets import IDEAL
from jgait.types import SIDES


def test_the_rate_of_a_turn_is_the_mean_of_the_segments_that_measure_it():
    count, dt = 400, 0.01
    swing = np.sin(2.0 * np.pi * np.arange(count) * dt)
    rates = jnp.asarray(np.stack([1.5 + swing, 1.5 - swing, np.full(count, 99.0)]))
    on = np.ones((3, count), bool)
    on[2], on[:, 200:300] = False, False
    steps = jnp.full(count, dt).at[0].set(0.0)
    after, found = turns.turning(rates, jnp.asarray(on), steps, turns.no_turn(rates))
    assert found[0] == 0.0 and found[-1] == pytest.approx(1.5, abs=1e-3)
    # By hand: an exponential mean, kept while no gyroscope is on.
    assert found[49] == pytest.approx(1.5 * (1.0 - np.exp(-49 * dt / turns.TURN_MEAN)), rel=1e-9)
    np.testing.assert_array_equal(found[200:300], found[199])
    assert float(after.rate) == float(found[-1]) and float(after.since) == 0.0
    half, first = turns.turning(rates[:, :250], jnp.asarray(on[:, :250]), steps[:250], turns.no_turn(rates))
    second = turns.turning(rates[:, 250:], jnp.asarray(on[:, 250:]), steps[250:], half)[1]
    np.testing.assert_allclose(np.concatenate([first, second]), found, atol=1e-12)


def test_angles_after_a_u_turn_lie_within_their_deviations():
    ((recording, truth),) = simulate.cohort(
        jax.random.key(3), 1, u_turn(4.0), IDEAL, 50.0, simulate.FOUR, recorded=False
    )
    true = truth.estimate

    def beyond_and_error(p):
        found = duty_cycled_gyro.estimate(p, recording)
        beyond, squares = [], []
        for side in SIDES:
            for joint in ("hip_angle", "knee_angle"):
                ours, theirs, stated = (
                    np.asarray(getattr(getattr(legs, side), joint)) for legs in (found.legs, true.legs, found.stddev)
                )
                start = slice(*found.diagnostics["standing"])
                error = (ours - ours[start].mean()) - (theirs - theirs[start].mean())
                walks = np.arange(len(error)) > start.stop
                beyond.append(np.abs(error[walks]) > 2.0 * stated[walks])
                squares.append(error[walks] ** 2)
        return np.mean(beyond), np.degrees(np.sqrt(np.mean(squares)))

    usual, without = (beyond_and_error(p) for p in (DutyCycledParams(), DutyCycledParams(turn_tilt=1e-6)))
    assert usual[0] < 0.1 < without[0]
    assert usual[1] < 0.8 * without[1]
