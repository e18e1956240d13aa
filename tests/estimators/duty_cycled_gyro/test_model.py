"""The mechanics of the thigh's and the shin's filter."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from made.observability import observability_matrix, observability_rank

from jgait.estimators.duty_cycled_gyro import model as duty_model
from jgait.estimators.duty_cycled_gyro.params import (
    DutyControl,
    LinkParams,
    ShinObservation,
    ShinState,
    ThighObservation,
    ThighState,
)
from jgait.geometry.vectors import GRAVITY

LINK = LinkParams(0.4, 0.2, 2.0, 3.0, 0.1, 1e-4, 1e-4)
CONTROL = DutyControl(1.0, 1.0, 1.0)
BOTH = (
    (duty_model.THIGH, ThighState(0.2, 0.1, 0.3, 0.05, 0.4, 2.0, 0.01, 0.3, 2.0)),
    (duty_model.SHIN, ShinState(ThighState(0.6, 0.1, 0.3, 0.05, 0.4, 2.0, 0.01, -0.3, 2.0), 0.2, 1.0)),
)


def seen(model, *hidden):
    shown = ThighObservation(*(name not in hidden for name in ThighObservation._fields))
    return ShinObservation(shown, True, True) if model is duty_model.SHIN else shown


@pytest.mark.parametrize("number", [0, 1])
def test_every_state_is_observable_and_only_the_bias_is_lost_with_the_gyroscope(number):
    model, moving = BOTH[number]
    whole = len(jax.tree.leaves(moving))
    for state in (model.initial(LINK).mean, moving):

        def rank(*hidden, state=state):
            return observability_rank(model, LINK, state, CONTROL, 0.02, seen(model, *hidden))

        assert rank("swing", "rest_down", "rest_forward") == whole
        assert rank("gyro", "rest_down", "rest_forward") == whole - 1
        bias = np.zeros(whole)
        bias[ThighState._fields.index("velocity_bias")] = 1.0
        rows = observability_matrix(model, LINK, state, CONTROL, 0.02, seen(model, "gyro"))
        np.testing.assert_allclose(rows @ bias, 0.0, atol=1e-12)


def test_the_observation_is_that_of_a_swinging_link():
    """Position, velocity and specific force of both sensors from the angles by autodiff alone."""

    def thigh(t):
        return 0.4 * jnp.sin(3.0 * t) + 0.1

    def shank(t):
        return 0.6 * jnp.cos(4.0 * t) - 0.2

    def place(angle, length):
        return lambda t: length * jnp.stack([jnp.cos(angle(t)), jnp.sin(angle(t))])

    def sensor(t):
        return place(thigh, LINK.thigh_length)(t) + place(shank, LINK.lever)(t)

    t = 0.37
    for where, angle, model in ((place(thigh, LINK.lever), thigh, duty_model.THIGH), (sensor, shank, duty_model.SHIN)):
        (x, z), (vx, vz) = where(t), jax.jacfwd(where)(t)
        ax, az = jax.jacfwd(jax.jacfwd(where))(t)
        own = ThighState(x, vx, ax, z, vz, az, 0.02, angle(t), jax.grad(angle)(t))
        state = own
        if model is duty_model.SHIN:
            state = ShinState(own, thigh(t), jax.grad(thigh)(t))
        read = model.observation(LINK, state, CONTROL)
        read = read.shin if model is duty_model.SHIN else read
        up = -jnp.stack([jnp.cos(angle(t)), jnp.sin(angle(t))])
        forward = jnp.stack([-jnp.sin(angle(t)), jnp.cos(angle(t))])
        force = jnp.stack([ax - GRAVITY, az])
        np.testing.assert_allclose((read.acc_up, read.acc_forward), (force @ up, force @ forward), atol=1e-12)
        np.testing.assert_allclose(read[3:7], 0.0, atol=1e-12)
        assert float(read.gyro) == pytest.approx(float(own.rate) - 0.02 / LINK.lever)
