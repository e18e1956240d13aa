import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jgait.geometry.jets import Jet
from jgait.simulate.smooth import (
    bump,
    curve_at,
    pieces,
    polynomial,
    smooth_bump,
    smooth_curve,
    smooth_step,
    step,
)

U = np.linspace(-0.5, 1.5, 401)


def computed(function, *given):
    return jax.tree.map(np.asarray, jax.jit(function)(*given))


def test_a_step_is_flat_outside_and_its_derivatives_are_exact_inside():
    value = computed(step, U)
    np.testing.assert_allclose(value[U <= 0.0], 0.0, atol=1e-15)
    np.testing.assert_allclose(value[U >= 1.0], 1.0, atol=1e-14)
    assert np.all(np.diff(value) >= -1e-15)
    h = 1e-5
    numeric = (computed(step, U + h) - computed(step, U - h)) / (2.0 * h)
    np.testing.assert_allclose(computed(jax.vmap(jax.grad(step)), U), numeric, atol=1e-7)
    orders = computed(lambda u: smooth_step(Jet(u)).orders, np.stack([U, np.ones_like(U), np.zeros_like(U)]))
    assert not orders[1:, (U <= 0.0) | (U >= 1.0)].any()  # exactly at rest


def test_smooth_functions_of_jets_have_the_derivatives_of_numbers():
    u = np.linspace(-0.2, 1.2, 29)
    table = computed(pieces, np.random.default_rng(1).normal(size=(2, 4)), np.ones((2, 4)))
    entry, one = np.full(29, 1), np.ones(29)

    def moving(s):
        return u + 0.3 * s + 0.5 * s * s

    for of_jet, of_number in (
        (smooth_step, step),
        (smooth_bump, bump),
        (lambda r: smooth_curve(table, entry, r), lambda r: curve_at(table, entry, r)),
    ):

        def rate(s, of=of_number):
            return jax.jvp(lambda s: of(moving(s)), (s,), (one,))[1]

        def expected(still, of=of_number, rate=rate):
            return of(moving(still)), *jax.jvp(rate, (still,), (one,))

        made = computed(lambda at, of=of_jet: of(Jet(at)).orders, np.stack([u, 0.3 * one, one]))
        for ours, known in zip(made, computed(expected, 0.0 * one), strict=True):
            np.testing.assert_allclose(ours, known, rtol=1e-9, atol=1e-10)


def test_pieces_pass_through_their_points_and_meet_smoothly():
    values = np.random.default_rng(0).normal(size=9) + 1e3
    moving = np.array([0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0])
    table = computed(pieces, values, moving)

    @jax.jit
    def derivatives(row, r):
        function = lambda at: polynomial(row, at)[0]  # noqa: E731
        out = []
        for _ in range(5):
            out.append(function(r))
            function = jax.grad(function)
        return jnp.stack(out)

    starts, ends = (np.array([derivatives(row, r) for row in table]) for r in (0.0, 1.0))
    np.testing.assert_allclose(starts[:, 0], values[:-1], rtol=1e-15)
    np.testing.assert_allclose(ends[:, 0], values[1:], rtol=1e-12)
    for before, after in itertools.pairwise(range(len(table))):
        np.testing.assert_allclose(ends[before, 1:], starts[after, 1:], atol=1e-6)
    assert starts[1, 1:] == pytest.approx([0.0] * 4, abs=1e-9)
