"""The printed models of three papers: their matrices entry by entry, and what is wrong with them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from made.observability import observability_rank

from experiments.bennett2013 import literal as bennett2013_literal
from experiments.potter import literal as potter_literal
from experiments.udaya2010 import literal as udaya
from jgait.estimators.duty_cycled_gyro.params import ThighState
from jgait.estimators.leg_ekf import model as leg_model
from jgait.estimators.stride_width_ekf import model as width_model
from jgait.estimators.stride_width_ekf.model import PathControl, WidthControl, WidthState

T = 0.02
STATES = (
    ThighState(0.2, 0.1, 0.3, 0.05, 0.4, 2.0, 0.01, 0.3, 2.0),
    udaya.ShinState(0.6, 0.1, 0.3, 0.05, 0.4, 2.0, 0.01, 0.2, 1.0, -0.3, 2.0),
)


def printed():
    """Models with their states, parameters and the control."""
    return zip((udaya.THIGH, udaya.SHIN), STATES, strict=True), (
        udaya.LiteralParams(2.0, 1.0, 1.0, 1.0, 1.0), udaya.LiteralControl(-0.06, -0.1, 0.2, 0.19),
    )  # fmt: skip


def linearised(function, state):
    """Jacobian of a function of a state tuple, by columns."""
    flat = jnp.asarray(list(state))
    return np.asarray(jax.jacfwd(lambda x: jnp.stack([*map(jnp.asarray, function(type(state)(*x)))]))(flat))


def test_most_states_of_the_duty_cycled_filters_are_not_observable():
    models, (params, control) = printed()
    assert [observability_rank(model, params, state, control, T) for model, state in models] == [5, 4]


def test_the_duty_cycled_matrices_are_those_of_the_paper():
    """Sections 8.1 and 8.2, entry by entry, from one; what is not listed is 0, or 1 on the diagonal of A."""
    models, (_, c) = printed()
    chains = {(1, 2): T, (2, 3): T, (4, 5): T, (5, 6): T}
    transitions = (chains | {(4, 8): 1.0, (8, 9): T}, chains | {(1, 3): T**2, (4, 6): T**2, (8, 10): T, (10, 11): T})
    rows = (
        {(1, 2): 1.0, (1, 8): -1.0, (2, 5): 1.0, (2, 8): -1.0, (3, 3): 1.0, (4, 6): 1.0, (5, 9): 1.0},
        {(1, 10): c.a1, (1, 11): c.b1, (2, 10): c.a2, (2, 11): c.b2, (3, 3): 1.0, (4, 6): 1.0, (5, 11): 1.0},
    )
    for (model, state), moves, reads in zip(models, transitions, rows, strict=True):
        n = len(state)
        a, h = np.eye(n), np.zeros((5, n))
        for matrix, entries in ((a, moves), (h, reads)):
            for (i, j), value in entries.items():
                matrix[i - 1, j - 1] = value
        np.testing.assert_allclose(linearised(lambda s, m=model: m.transition(None, s, c, T), state), a, atol=1e-15)
        np.testing.assert_allclose(linearised(lambda s, m=model: m.observation(None, s, c), state), h, atol=1e-15)


def test_the_duty_cycled_noise_is_indefinite():
    models, (params, control) = printed()
    for model, state in models:
        noise = np.asarray(model.transition_noise(params, state, control, T).dense())
        assert np.linalg.eigvalsh(noise).min() == pytest.approx(-2.4e-9 * params.noise, rel=0.01)


def test_element_c_of_the_leg_is_no_derivative():
    literal = bennett2013_literal
    p = leg_model.LegModelParams(0.4, 0.5, 1e-6, 1.0, 1e-12, 1e-4, 1e-4, 1e-6)
    state = leg_model.LegState(0.1, -0.8, -1.4, 2.0, -0.3, -1.5, 0.01, 0.02)
    c = -0.4 * np.sin(-1.4) + 0.5 * np.sin(-1.7)
    moved = literal.transition(p, state, leg_model.LegControl(1.0, 1.0), T)
    right = leg_model.transition(p, state, leg_model.LegControl(1.0, 1.0), T)
    assert float(moved.y) == pytest.approx(-0.8 + T * (c * 2.0 + 0.5 * np.cos(-1.7) * -1.5))
    assert moved._replace(y=0.0) == right._replace(y=0.0)


def test_the_signs_of_the_stride_width():
    literal = potter_literal
    state = WidthState(1.0, 2.0, 0.3, -0.2, 0.4, -0.4, 0.1, 0.2, 0.3, 0.4)
    control = WidthControl(PathControl(0.5, 0.1, 0.2, 0.6, 1.0), PathControl(0.4, -0.2, -0.3, 0.5, 0.0))
    moved, right = (m.transition(None, state, control, 1.0) for m in (literal, width_model))
    assert moved.y_right + moved.apart_y == pytest.approx(2.4 - 0.2 * np.cos(-0.7) - 0.4 * np.sin(-0.7))
    assert moved[:4] == right[:4] and moved.heading_left == right.heading_left
    x, y, s, c = 0.2, -0.4, np.sin(-0.4), np.cos(-0.4)
    assert literal.observation(None, state, control).along == pytest.approx(x * c - y * s)
