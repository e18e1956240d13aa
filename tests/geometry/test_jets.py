"""Jets: their derivatives are those of forward-mode differentiation."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jgait.geometry.jets import Jet, outer, part, parts, reciprocal, root, sin_cos, stacked, summed

TIME = np.linspace(0.1, 2.0, 7)


def number(t):
    """Any smooth function of time."""
    return 1.3 + t + 0.4 * t * t


def other(t):
    return 2.0 - 0.7 * t


def jet(function):
    """The jet of a function of time, by forward-mode differentiation."""

    def rate(t):
        return jax.jvp(function, (t,), (jnp.ones_like(t),))[1]

    t = jnp.asarray(TIME)
    return Jet(jnp.stack([function(t), rate(t), jax.jvp(rate, (t,), (jnp.ones_like(t),))[1]]))


C = np.linspace(0.5, 1.5, 7)


@pytest.mark.parametrize(
    ("of_jets", "of_numbers"),
    [
        (lambda a, b: a + b, lambda a, b: a + b),
        (lambda a, b: a - b, lambda a, b: a - b),
        (lambda a, b: a * b, lambda a, b: a * b),
        (lambda a, b: -a * b * a, lambda a, b: -a * b * a),
        (lambda a, b: 2.0 - (3.0 + a) + 2.0 * b, lambda a, b: -1.0 - a + 2.0 * b),
        (lambda a, b: (a + C) * b - b * C, lambda a, b: (a + C) * b - b * C),
        (lambda a, b: a / 4.0 - 1.0, lambda a, b: a / 4.0 - 1.0),
        (lambda a, b: reciprocal(a * b), lambda a, b: 1.0 / (a * b)),
        (lambda a, b: sin_cos(a)[0] * sin_cos(b)[1], lambda a, b: jnp.sin(a) * jnp.cos(b)),
        (lambda a, b: root(a * a + b * b, 0.1), lambda a, b: jnp.sqrt(a * a + b * b)),
        (lambda a, b: root(b - 1.5, 0.2), lambda a, b: jnp.sqrt(jnp.maximum(b - 1.5, 0.2))),
        (lambda a, b: summed(stacked([a, a * b, b])), lambda a, b: a + a * b + b),
        (lambda a, b: part(outer(stacked([a, b]), stacked([b, a])), 0, 1), lambda a, b: a * a),
        (lambda a, b: parts(stacked([a, b], axis=1))[2], lambda a, b: jnp.stack([a, b], axis=1)[2]),
    ],
)
def test_derivatives_are_those_of_forward_mode(of_jets, of_numbers):
    made, t = of_jets(jet(number), jet(other)), jnp.asarray(TIME)
    if made.value.shape == t.shape:
        expected = jet(lambda t: of_numbers(number(t), other(t))).orders
    else:
        expected = jnp.stack([of_numbers(a, b) for a, b in zip(jet(number).orders, jet(other).orders, strict=True)])
    np.testing.assert_allclose(made.orders, expected, rtol=1e-12, atol=1e-12)
    value = of_jets(*(Jet(jnp.asarray(one(t))[None]) for one in (number, other)))
    np.testing.assert_allclose(value.orders, made.orders[:1], rtol=1e-14)


def test_a_root_at_its_least_value_does_not_move():
    held = root(jet(lambda t: -t), 0.25)
    np.testing.assert_array_equal(held.orders, np.stack([np.full(7, 0.5), np.zeros(7), np.zeros(7)]))
