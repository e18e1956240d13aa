import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jgait.geometry.jets import Jet
from jgait.simulate.smooth import (
    ORDER,
    bump,
    curve_at,
    glide,
    pieces,
    polynomial,
    ramp,
    smooth_bump,
    smooth_curve,
    smooth_step,
    step,
)

U = jnp.linspace(-0.5, 1.5, 401)


def test_a_step_is_flat_outside_and_its_derivatives_are_exact_inside():
    value, u = np.asarray(step(U)), np.asarray(U)
    np.testing.assert_allclose(value[u <= 0.0], 0.0, atol=1e-15)
    np.testing.assert_allclose(value[u >= 1.0], 1.0, atol=1e-14)
    assert np.all(np.diff(value) >= -1e-15)
    h = 1e-5
    numeric = (step(U + h) - step(U - h)) / (2.0 * h)
    np.testing.assert_allclose(jax.jit(jax.vmap(jax.grad(step)))(U), numeric, atol=1e-7)
    derivative = step
    for _ in range(ORDER):
        derivative = jax.grad(derivative)
        assert np.all(np.abs(jax.jit(jax.vmap(derivative))(jnp.array([0.0, 1.0]))) < 1e-9)


def test_a_ramp_is_the_integral_of_a_step():
    h = 1e-5
    np.testing.assert_allclose((ramp(U + h) - ramp(U - h)) / (2.0 * h), step(U), atol=1e-8)
    np.testing.assert_allclose(ramp(jnp.array([-1.0, 0.0, 1.0, 3.0])), [0.0, 0.0, 0.5, 2.5], atol=1e-15)
    np.testing.assert_allclose(jax.vmap(jax.grad(ramp))(U), step(U), atol=1e-14)


def test_a_glide_arrives_and_keeps_its_speed_in_the_middle():
    ends = glide(Jet(jnp.array([[-1.0, 0.0, 1.0, 2.0]])), 0.3, 0.4)
    np.testing.assert_allclose(ends.value, [0.0, 0.0, 1.0, 1.0], atol=1e-14)
    _, speed, bend = glide(Jet(jnp.stack([jnp.array([0.31, 0.45, 0.59]), jnp.ones(3), jnp.zeros(3)])), 0.3, 0.4).orders
    np.testing.assert_allclose(speed, 1.0 / (1.0 - 0.35), rtol=1e-12)
    np.testing.assert_allclose(bend, 0.0, atol=1e-12)


def test_smooth_functions_of_jets_have_the_derivatives_of_numbers():
    u = jnp.asarray(np.linspace(-0.2, 1.2, 29))
    table, entry = pieces(jnp.asarray(np.random.default_rng(1).normal(size=(2, 4))), jnp.ones((2, 4))), jnp.full(29, 1)

    def moving(s):
        return u + 0.3 * s + 0.5 * s * s

    at = Jet(jnp.stack([u, jnp.full(29, 0.3), jnp.ones(29)]))
    for of_jet, of_number in (
        (smooth_step, step),
        (smooth_bump, bump),
        (lambda r: smooth_curve(table, entry, r), lambda r: curve_at(table, entry, r)),
    ):

        def rate(s, of=of_number):
            return jax.jvp(lambda s: of(moving(s)), (s,), (jnp.ones(29),))[1]

        still = jnp.zeros(29)
        expected = of_number(moving(still)), *jax.jvp(rate, (still,), (jnp.ones(29),))
        for made, known in zip(of_jet(at).orders, expected, strict=True):
            np.testing.assert_allclose(made, known, rtol=1e-9, atol=1e-10)


def test_a_bump_is_one_in_the_middle_and_nothing_outside():
    np.testing.assert_allclose(bump(jnp.array([-0.1, 0.0, 0.5, 1.0, 1.1])), [0.0, 0.0, 1.0, 0.0, 0.0], atol=1e-15)


def test_pieces_pass_through_their_points_and_meet_smoothly():
    values = jnp.asarray(np.random.default_rng(0).normal(size=9)) + 1e3
    moving = jnp.array([0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0])
    table = pieces(values, moving)
    np.testing.assert_allclose([polynomial(row, jnp.asarray(0.0))[0] for row in table], values[:-1], rtol=1e-15)
    np.testing.assert_allclose([polynomial(row, jnp.asarray(1.0))[0] for row in table], values[1:], rtol=1e-12)

    @jax.jit
    def derivatives(row, r):
        function = lambda at: polynomial(row, at)[0]  # noqa: E731
        out = []
        for _ in range(5):
            out.append(function(r))
            function = jax.grad(function)
        return jnp.stack(out)

    for before, after in itertools.pairwise(table):
        np.testing.assert_allclose(derivatives(before, 1.0)[1:], derivatives(after, 0.0)[1:], atol=1e-6)
    assert derivatives(table[1], 0.0)[1:] == pytest.approx([0.0] * 4, abs=1e-9)


def test_a_line_stays_a_line():
    table = pieces(jnp.arange(6.0), jnp.ones(6))
    r = jnp.linspace(0.0, 1.0, 5)
    for entry in (1, 2, 3):
        np.testing.assert_allclose(curve_at(table, jnp.full(5, entry), r), entry + r, atol=1e-12)
        _, slope, bend = polynomial(table[entry][:, None], r)
        np.testing.assert_allclose(slope, 1.0, atol=1e-10)
        np.testing.assert_allclose(bend, 0.0, atol=1e-8)
